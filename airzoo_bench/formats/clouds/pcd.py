"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.core.errors import readable
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, cloud_of_columns, refusal
from airzoo_bench.formats.clouds.rows import Rows, quoted, too_few

_LONGEST_HEADER = 1 << 16
_KINDS = ("ascii", "binary", "binary_compressed")
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_LITERAL = 32  # control bytes below it are of bytes to be copied
_LONG = 7  # a length that goes on in the next byte


class _Header(NamedTuple):
    """A row's type, the number of rows, how they are stored, and where they begin."""

    record: np.dtype[Any]
    points: int
    data: str
    size: int


def open_pcd(path: Path) -> FileCloud:
    """Open a PCD file."""
    record, points, data, size = _read_header(path)
    if not {*"xyz"} <= {*(record.names or ())}:
        raise refusal(path, "its FIELDS lack x, y or z", expected="FIELDS x y z, and others")
    kind = f"PCD ({data})"
    if data != "binary_compressed":
        return Rows(path, record, points, size, data == "ascii").open(kind)
    with path.open("rb") as stream:
        stream.seek(size)
        packed, plain = np.frombuffer(stream.read(8).ljust(8, b"\0"), "<u4").tolist()
    if plain != points * record.itemsize or path.stat().st_size < size + 8 + packed:
        raise too_few(path, points)
    precision = np.result_type(*(record[axis].base for axis in "xyz"))
    read = partial(_read_compressed, path, record, points, size + 8, packed, plain)
    return FileCloud(path, kind, points, read, precision)


def _read_header(path: Path) -> _Header:
    values: dict[str, list[str]] = {}
    with path.open("rb") as stream:
        while "DATA" not in values and stream.tell() < _LONGEST_HEADER:
            line = stream.readline(_LONGEST_HEADER)
            words = line.decode("latin-1").split()
            if not line:
                break
            if words and not words[0].startswith("#"):
                values.setdefault(words[0].upper(), words[1:])
        size = stream.tell()
    expected = "FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS and DATA that fit together"
    with readable(path, "the PCD header is wrong", expected=expected):
        (data,), (points,) = values["DATA"], map(int, values["POINTS"])
        width = int(values.get("WIDTH", [str(points)])[0])
        height = int(values.get("HEIGHT", ["1"])[0])
        if data not in _KINDS or not width * height == points >= 0:
            raise ValueError(f"{points:,} points, {width:,} x {height:,}, as {quoted(data)}")
        names = values["FIELDS"]
        repeats = list(map(int, values.get("COUNT", ["1"] * len(names))))
        fields: list[tuple[str, str, tuple[int]]] = []
        rows = zip(names, map(int, values["SIZE"]), values["TYPE"], repeats, strict=True)
        for number, (name, item, kind, count) in enumerate(rows):
            if item not in _SIZES.get(kind.upper(), ()) or count < 1:
                raise ValueError(f"field {name} of type {kind}, {item} bytes, {count} times")
            known = name if name != "_" else f"_ {number}"  # several fields may be padding
            fields.append((known, f"<{kind.lower()}{item}", (count,)))
        return _Header(np.dtype(fields), points, data, size)


def _read_compressed(
    path: Path, record: np.dtype[Any], count: int, start: int, packed: int, plain: int, points: int
) -> Iterator[Cloud]:
    with readable(path, "its compressed points are damaged"), path.open("rb") as stream:
        stream.seek(start)
        body = _unpack_lzf(stream.read(packed), plain)
    columns, place = {}, 0
    for name in record.names or ():  # a column after the other
        columns[name] = np.frombuffer(body, record[name], count, place)[:, 0]
        place += count * record[name].itemsize
    for done in range(0, count, points):
        part = slice(done, done + points)
        yield cloud_of_columns({name: column[part] for name, column in columns.items()})


def _unpack_lzf(data: bytes, size: int) -> bytearray:
    """Undo Marc Lehmann's LZF."""
    out, place = bytearray(), 0
    while place < len(data) and len(out) <= size:
        control = data[place]
        place += 1
        if control < _LITERAL:
            out += data[place : place + control + 1]
            place += control + 1
            continue
        length = control >> 5
        if length == _LONG:
            length += data[place]
            place += 1
        distance = ((control & 0x1F) << 8 | data[place]) + 1
        place += 1
        start = len(out) - distance
        if start < 0:
            raise ValueError("a copy from before the beginning")
        piece = out[start : start + length + 2]
        # A copy may reach into what it writes; the piece then repeats itself.
        out += (piece * math.ceil((length + 2) / distance))[: length + 2]
    if place != len(data) or len(out) != size:
        raise ValueError("more or less than its header states")
    return out

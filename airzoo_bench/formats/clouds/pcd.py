"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import readable
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, cloud_of_columns, refusal
from airzoo_bench.formats.clouds.rows import Rows, quoted, too_few_points

_LONGEST_HEADER = 1 << 16
_KINDS = ("ascii", "binary", "binary_compressed")
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_LITERAL = 32  # control bytes below it are of bytes to be copied
_LONG = 7  # a length that goes on in the next byte


def open_pcd(path: Path) -> FileCloud:
    """Open a PCD file."""
    rows, data = _read_header(path)
    if not {*"xyz"} <= {*(rows.record.names or ())}:
        raise refusal(path, "its FIELDS lack x, y or z", expected="FIELDS x y z, and others")
    kind = f"PCD ({data})"
    if data != "binary_compressed":
        return rows.open(kind)
    with path.open("rb") as stream:
        stream.seek(rows.start)
        packed, plain = np.frombuffer(stream.read(8).ljust(8, b"\0"), "<u4").tolist()
    whole = path.stat().st_size >= rows.start + 8 + packed
    if plain != rows.count * rows.record.itemsize or not whole:
        raise too_few_points(path, rows.count)
    precision = np.result_type(*(rows.record[axis].base for axis in "xyz"))
    read = partial(_read_compressed, rows, packed, plain)
    return FileCloud(path, kind, rows.count, read, precision)


def _read_header(path: Path) -> tuple[Rows, str]:
    """Return the rows, and how they are stored."""
    values: dict[str, list[str]] = {}
    with path.open("rb") as stream:
        while "DATA" not in values and stream.tell() < _LONGEST_HEADER:
            line = stream.readline(_LONGEST_HEADER)
            words = line.decode("latin-1").split()
            if not line:
                break
            if words and not words[0].startswith("#"):
                values.setdefault(words[0].upper(), words[1:])
        start = stream.tell()
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
        return Rows(path, np.dtype(fields), points, start, data == "ascii"), data


def _read_compressed(rows: Rows, packed: int, plain: int, points: int) -> Iterator[Cloud]:
    with readable(rows.path, "its compressed points are damaged"), rows.path.open("rb") as stream:
        stream.seek(rows.start + 8)
        body = unpack_lzf(stream.read(packed), plain)
    columns, place = {}, 0
    for name in rows.record.names or ():  # a column after the other
        columns[name] = np.frombuffer(body, rows.record[name], rows.count, place)[:, 0]
        place += rows.count * rows.record[name].itemsize
    for done in range(0, rows.count, points):
        part = slice(done, done + points)
        yield cloud_of_columns({name: column[part] for name, column in columns.items()})


def unpack_lzf(data: bytes, size: int) -> bytearray:
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

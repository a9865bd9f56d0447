"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    cloud_of_columns,
    read_records,
    refusal,
    too_few,
    uncounted,
)
from airzoo_bench.formats.clouds.text import count_lines, read_rows, shown

__all__ = ["open_pcd"]

_LONGEST_HEADER = 1 << 16
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_LITERAL = 32  # control bytes below it are of bytes to be copied
_LONG = 7  # a length that goes on in the next byte


class _Header(NamedTuple):
    """A row's type (fields by their places and names), and where the rows begin."""

    record: np.dtype[Any]
    points: int
    data: str
    size: int

    @property
    def fields(self) -> dict[str, str]:
        """Names of the record's fields by those of the file."""
        return {place.partition(" ")[2]: place for place in self.record.names or ()}


def open_pcd(path: Path) -> FileCloud:
    """Open a PCD file."""
    header = _read_header(path)
    if not {*"xyz"} <= header.fields.keys():
        raise refusal(path, "its FIELDS lack x, y or z", expected="FIELDS x y z, and others")
    precision = np.result_type(*(header.record[header.fields[axis]].base for axis in "xyz"))
    left, what = path.stat().st_size - header.size - header.points * header.record.itemsize, "bytes"
    readers = {"ascii": _read_text, "binary": _read_binary, "binary_compressed": _read_compressed}
    if header.data == "ascii":
        left, what = count_lines(path, header.size) - header.points, "lines"
    elif header.data == "binary_compressed":
        left = 0
        _packed_bytes(path, header)
    if left < 0:
        raise too_few(path, header.points)
    return FileCloud(
        path,
        f"PCD ({header.data})",
        header.points,
        partial(readers[header.data], path, header),
        precision,
        uncounted(left, what, header.points),
    )


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
    try:
        (data,) = values["DATA"]
        (points,) = map(int, values["POINTS"])
        width = int(values.get("WIDTH", [str(points)])[0])
        height = int(values.get("HEIGHT", ["1"])[0])
        sound = data in ("ascii", "binary", "binary_compressed") and width * height == points >= 0
        record = _record(values)
    except (KeyError, ValueError) as error:
        raise refusal(
            path,
            f"the PCD header is wrong: {shown(str(error))}",
            expected="FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS and DATA",
        ) from error
    if not sound:
        raise refusal(
            path,
            f"the PCD header states {points:,} points, {width:,} x {height:,}, as {shown(data)}",
            expected="WIDTH times HEIGHT points, DATA ascii, binary or binary_compressed",
        )
    return _Header(record, points, data, size)


def _record(values: dict[str, list[str]]) -> np.dtype[Any]:
    """Return the type of a row; field names begin with the place of their first value."""
    names = values["FIELDS"]
    repeats = list(map(int, values.get("COUNT", ["1"] * len(names))))
    kinds: list[tuple[str, str, tuple[int]]] = []
    rows = zip(names, map(int, values["SIZE"]), values["TYPE"], repeats, strict=True)
    for name, size, kind, count in rows:
        again = name != "_" and name in names[: len(kinds)]
        if size not in _SIZES.get(kind.upper(), ()) or count < 1 or again:
            raise ValueError(f"field {name} of type {kind}, {size} bytes, {count} times")
        kinds.append((f"{sum(repeats[: len(kinds)])} {name}", f"<{kind.lower()}{size}", (count,)))
    return np.dtype(kinds)


def _read_text(path: Path, header: _Header, points: int) -> Iterator[Cloud]:
    places = {name: int(field.partition(" ")[0]) for name, field in header.fields.items()}
    width = sum(header.record[field].shape[0] for field in header.record.names or ())
    for rows in read_rows(path, header.size, 0, header.points, width, points):
        yield cloud_of_columns({name: rows[:, place] for name, place in places.items()})


def _read_binary(path: Path, header: _Header, points: int) -> Iterator[Cloud]:
    for block in read_records(path, header.record, header.size, header.points, points):
        columns = {name: block[field][:, 0] for name, field in header.fields.items()}
        yield cloud_of_columns(columns)


def _read_compressed(path: Path, header: _Header, points: int) -> Iterator[Cloud]:
    with path.open("rb") as stream:
        stream.seek(header.size + 8)
        packed = stream.read(_packed_bytes(path, header))
    try:
        body = _unpack_lzf(packed, header.points * header.record.itemsize)
    except (IndexError, ValueError) as error:
        raise refusal(path, "its compressed points are damaged", fix=FIX_COPY) from error
    columns, start = {}, 0
    for field in header.record.names or ():  # a column after the other
        kind = header.record[field]
        columns[field.partition(" ")[2]] = np.frombuffer(body, kind, header.points, start)[:, 0]
        start += header.points * kind.itemsize
    for done in range(0, header.points, points):
        part = slice(done, done + points)
        yield cloud_of_columns({name: column[part] for name, column in columns.items()})


def _packed_bytes(path: Path, header: _Header) -> int:
    """Return how many bytes are compressed, once they are known to be of all points."""
    with path.open("rb") as stream:
        stream.seek(header.size)
        head = np.frombuffer(stream.read(8).ljust(8, b"\0"), "<u4")
    packed, plain = int(head[0]), int(head[1])
    left = path.stat().st_size - header.size - 8
    if packed > left or plain != header.points * header.record.itemsize:
        raise too_few(path, header.points)
    return packed


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

"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    as_confidence,
    columns_to_points,
    read_records,
    refusal,
    uncounted,
)
from airzoo_bench.formats.clouds.text_rows import lines_beyond, opened_text, parse_rows, shown

__all__ = ["open_pcd"]

_LONGEST_HEADER = 1 << 16
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_MOST_REPEATS = 1 << 16
_LONGEST_LITERAL = 32
_CONFIDENCE = ("confidence", "conf")


@dataclass(frozen=True)
class _Field:
    """A column: where its first value stands among all, and how often it repeats."""

    name: str
    type: str
    repeats: int
    place: int


@dataclass(frozen=True)
class _Header:
    fields: tuple[_Field, ...]
    points: int
    data: str
    size: int
    lines: int

    @property
    def record(self) -> np.dtype[Any]:
        kinds = [(f"{f.place} {f.name}", f.type, (f.repeats,)) for f in self.fields]
        return np.dtype(kinds)

    @property
    def width(self) -> int:
        return sum(field.repeats for field in self.fields)


def open_pcd(path: Path) -> FileCloud:
    """Open a PCD file."""
    header = _read_header(path)
    names = [field.name for field in header.fields]
    if not {"x", "y", "z"} <= set(names):
        raise refusal(path, "its FIELDS lack x, y or z", expected="FIELDS x y z, and others")
    precision = np.result_type(*(f.type for f in header.fields if f.name in ("x", "y", "z")))
    readers = {"ascii": _read_text, "binary": _read_binary}
    if header.data == "binary_compressed":
        compressed = _compressed_sizes(path, header)
        read = partial(_read_compressed, path, header, compressed)
    else:
        _refuse_short(path, header)
        read = partial(readers[header.data], path, header)
    notes = uncounted(*_beyond(path, header), header.points)
    return FileCloud(path, f"PCD ({header.data})", header.points, read, precision, notes)


def _beyond(path: Path, header: _Header) -> tuple[int, str]:
    """Return what follows the points that the header counts; a compressed body has a size."""
    if header.data == "ascii":
        return lines_beyond(path, header.size, header.points), "lines"
    end = header.size + header.points * header.record.itemsize
    return (path.stat().st_size - end if header.data == "binary" else 0), "bytes"


def _read_header(path: Path) -> _Header:
    values: dict[str, list[str]] = {}
    with path.open("rb") as stream:
        lines = 0
        while "DATA" not in values and stream.tell() < _LONGEST_HEADER:
            line = stream.readline(_LONGEST_HEADER)
            lines += 1
            words = line.decode("latin-1").split()
            if not line:
                break
            if words and not words[0].startswith("#"):
                values.setdefault(words[0].upper(), words[1:])
        size = stream.tell()
    data = " ".join(values.get("DATA", []))
    if data not in ("ascii", "binary", "binary_compressed"):
        raise refusal(
            path,
            f"the PCD header ends with DATA {shown(data)}",
            expected="ascii, binary, ..._compressed",
        )
    counts = {key: _counts(path, key, values.get(key, [])) for key in ("POINTS", "WIDTH", "HEIGHT")}
    (points, *more), width, height = counts["POINTS"] or [-1], counts["WIDTH"], counts["HEIGHT"]
    if points < 0 or more:
        raise refusal(path, "the PCD header has no POINTS", expected="POINTS and a count")
    if math.prod(width or [points]) * math.prod(height or [1]) != points:
        raise refusal(path, "WIDTH times HEIGHT is not POINTS", expected="the same number")
    return _Header(_fields(path, values), points, data, size, lines)


def _counts(path: Path, key: str, words: list[str]) -> list[int]:
    if not all(word.isascii() and word.isdigit() and len(word) < 19 for word in words):
        raise refusal(path, f"{key} is {shown(' '.join(words))}", expected="counts of 0 or more")
    return [int(word) for word in words]


def _fields(path: Path, values: dict[str, list[str]]) -> tuple[_Field, ...]:
    names, kinds = values.get("FIELDS", []), [kind.upper() for kind in values.get("TYPE", [])]
    sizes = _counts(path, "SIZE", values.get("SIZE", []))
    repeats = _counts(path, "COUNT", values.get("COUNT", ["1"] * len(names)))
    if not len(names) == len(sizes) == len(kinds) == len(repeats):
        raise refusal(path, "FIELDS, SIZE, TYPE and COUNT differ in length", expected="one a field")
    fields: list[_Field] = []
    for name, size, kind, count in zip(names, sizes, kinds, repeats, strict=True):
        wrong = size not in _SIZES.get(kind, ()) or not 1 <= count <= _MOST_REPEATS
        if wrong or (name != "_" and name in [field.name for field in fields]):
            raise refusal(
                path,
                f"field {shown(name)} has the type {shown(kind)} of {size} bytes, {count} times",
                expected="each field once, of type F (4, 8), I or U (1, 2, 4, 8)",
            )
        place = sum(field.repeats for field in fields)
        fields.append(_Field(name, f"<{kind.lower()}{size}", count, place))
    return tuple(fields)


def _refuse_short(path: Path, header: _Header) -> None:
    room = path.stat().st_size - header.size
    # In text a number takes two bytes at least, with the blank behind it.
    least = 2 * header.width if header.data == "ascii" else header.record.itemsize
    if header.points * least > room + 1:
        raise refusal(
            path,
            f"its header promises {counted(header.points, 'point')}, and {room:,} bytes are left",
            expected="all points that the header promises",
            fix=FIX_COPY,
        )


def _compressed_sizes(path: Path, header: _Header) -> int:
    with path.open("rb") as stream:
        stream.seek(header.size)
        head = np.frombuffer(stream.read(8).ljust(8, b"\0"), "<u4")
    packed, plain = int(head[0]), int(head[1])
    wanted = header.points * header.record.itemsize
    if packed > path.stat().st_size - header.size - 8 or plain != wanted:
        raise _damaged(path)
    return packed


def _damaged(path: Path) -> PredictionError:
    return refusal(path, "its compressed points are damaged or cut off", fix=FIX_COPY)


def _read_text(path: Path, header: _Header, points: int) -> Iterator[Cloud]:
    with opened_text(path, header.size, header.lines) as text:
        for done in range(0, header.points, points):
            count = min(points, header.points - done)
            rows = parse_rows(text, count, header.width, header.points, "points")
            yield _cloud({f.name: rows[:, f.place] for f in header.fields})


def _read_binary(path: Path, header: _Header, points: int) -> Iterator[Cloud]:
    for block in read_records(path, header.record, header.size, header.points, points):
        yield _cloud({f.name: block[f"{f.place} {f.name}"][:, 0] for f in header.fields})


def _read_compressed(path: Path, header: _Header, packed: int, points: int) -> Iterator[Cloud]:
    with path.open("rb") as stream:
        stream.seek(header.size + 8)
        body = _decompress(stream.read(packed), header.points * header.record.itemsize)
    if body is None:
        raise _damaged(path)
    columns, start = {}, 0
    for field in header.fields:
        kind = np.dtype((field.type, (field.repeats,)))
        columns[field.name] = np.frombuffer(body, kind, header.points, start)[:, 0]
        start += header.points * kind.itemsize
    for done in range(0, header.points, points):
        part = slice(done, done + points)
        yield _cloud({name: column[part] for name, column in columns.items()})


def _cloud(columns: dict[str, NDArray[Any]]) -> Cloud:
    trust = next((columns[name] for name in _CONFIDENCE if name in columns), None)
    points = columns_to_points(columns["x"], columns["y"], columns["z"])
    return Cloud(points, None, None if trust is None else as_confidence(trust))


def _decompress(data: bytes, size: int) -> bytearray | None:
    """Undo Marc Lehmann's LZF; None where the data are damaged."""
    out = bytearray()
    place, end = 0, len(data)
    try:
        while place < end and len(out) <= size:
            control = data[place]
            place += 1
            if control < _LONGEST_LITERAL:
                out += data[place : place + control + 1]
                place += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[place]
                place += 1
            distance = ((control & 0x1F) << 8 | data[place]) + 1
            place += 1
            if not _copy_back(out, distance, length + 2):
                return None
    except IndexError:
        return None
    return out if place == end and len(out) == size else None


def _copy_back(out: bytearray, distance: int, length: int) -> bool:
    start = len(out) - distance
    if start < 0:
        return False
    piece = out[start : start + length]
    # A copy may reach into what it writes; the piece then repeats itself.
    out += (piece * -(-length // distance))[:length] if distance < length else piece
    return True

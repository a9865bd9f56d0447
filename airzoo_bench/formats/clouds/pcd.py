"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.plurals import counted
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
from airzoo_bench.formats.clouds.lzf import decompress
from airzoo_bench.formats.clouds.text_rows import lines_beyond, opened_text, parse_rows, shown

__all__ = ["open_pcd"]

_LONGEST_HEADER = 1 << 16
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_MOST_REPEATS = 1 << 16
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
    if values.get("DATA", []) not in (["ascii"], ["binary"], ["binary_compressed"]):
        said = shown(" ".join(values.get("DATA", [])))
        raise refusal(
            path, f"the PCD header ends with DATA {said}", expected="ascii, binary, ..._compressed"
        )
    points = _one_count(path, values, "POINTS")
    if _one_count(path, values, "WIDTH", points) * _one_count(path, values, "HEIGHT", 1) != points:
        raise refusal(path, "WIDTH times HEIGHT is not POINTS", expected="the same number")
    return _Header(_fields(path, values), points, values["DATA"][0], size, lines)


def _counts(path: Path, values: dict[str, list[str]], key: str) -> list[int]:
    words = values.get(key, [])
    if not all(word.isascii() and word.isdigit() and len(word) < 19 for word in words):
        raise refusal(path, f"{key} is {shown(' '.join(words))}", expected="counts of 0 or more")
    return [int(word) for word in words]


def _one_count(
    path: Path, values: dict[str, list[str]], key: str, default: int | None = None
) -> int:
    if key not in values and default is not None:
        return default
    counts = _counts(path, values, key)
    if len(counts) != 1:
        raise refusal(path, f"the PCD header has no {key}", expected=f"{key} and a count")
    return counts[0]


def _fields(path: Path, values: dict[str, list[str]]) -> tuple[_Field, ...]:
    names, kinds = values.get("FIELDS", []), [kind.upper() for kind in values.get("TYPE", [])]
    sizes = _counts(path, values, "SIZE")
    repeats = _counts(path, values, "COUNT") if "COUNT" in values else [1] * len(names)
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
        fields.append(_Field(name, f"<{_KINDS[kind]}{size}", count, place))
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
        body = decompress(stream.read(packed), header.points * header.record.itemsize)
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

"""PLY: clouds, Gaussian splats and meshes, binary of both byte orders and text."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_write
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
from airzoo_bench.formats.clouds.meshes import Mesh, add_fan, cut_fans
from airzoo_bench.formats.clouds.text_rows import TextLines, lines_beyond, opened_text, parse_rows
from airzoo_bench.formats.clouds.text_rows import shown as quoted
from airzoo_bench.geometry.arrays import Ints

__all__ = ["open_ply", "write_ply"]

_CONFIDENCE = ("confidence", "conf")
_COLOURS = ("red", "green", "blue")
_SPLATS = {"f_dc_0", "opacity"}
_FACE_LISTS = ("vertex_indices", "vertex_index")
_SPLAT_NOTE = "Gaussian splats: their centres are taken as points, without colours"
_ROWS = 1 << 18  # that are written at a time
_FEWEST, _MOST = 32, 1 << 18  # faces that are looked at together
_LONGEST_HEADER = 1 << 20
_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
_SIZED = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_TYPES = dict(zip((*_NAMES, *_SIZED), 2 * _CODES, strict=True))
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    """A column; `counter` is the type of a list's length, None for a number."""

    name: str
    type: str
    counter: str | None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def names(self) -> list[str]:
        return [one.name for one in self.properties]

    @property
    def has_lists(self) -> bool:
        return any(one.counter is not None for one in self.properties)


@dataclass(frozen=True)
class _Header:
    """Byte order (empty for text), elements, and the byte and line that the body begins after."""

    path: Path
    order: str
    elements: list[_Element]
    size: int
    lines: int

    def record(self, element: _Element) -> np.dtype[Any]:
        return np.dtype([(one.name, self.order + one.type) for one in element.properties])


def open_ply(path: Path) -> FileCloud | Mesh:
    """Open a PLY file: a mesh where it has faces, else a cloud."""
    header = _read_header(path)
    by_name = {one.name: one for one in header.elements}
    vertex, faces = by_name.get("vertex"), by_name.get("face")
    if vertex is None or not {"x", "y", "z"} <= set(vertex.names):
        raise refusal(
            path,
            "has no vertices" if vertex is None else "its vertices lack x, y or z",
            expected="element vertex with properties x, y, z",
        )
    if vertex.has_lists:
        raise refusal(path, "its vertices hold lists", expected="numbers only in element vertex")
    cloud = _open_vertices(header, vertex)
    if faces is None or not faces.count:
        return cloud
    names = [one.name for one in faces.properties if one.name in _FACE_LISTS and one.counter]
    if not names:
        raise refusal(
            path,
            "its faces have no list of vertices",
            expected="property list uchar int vertex_indices",
        )
    piece = next(cloud.pieces(max(cloud.count, 1)), Cloud(np.empty((0, 3))))
    triangles = (_read_faces if header.order else _read_text_faces)(header, faces, names[0])
    return Mesh(path, "PLY mesh", piece.points, triangles, cloud.notes, cloud.precision)


def _read_header(path: Path) -> _Header:
    with path.open("rb") as stream:
        text = stream.read(_LONGEST_HEADER)
    end = text.find(b"end_header")
    size = text.find(b"\n", end) + 1
    if end < 0 or not size:
        raise refusal(path, "the PLY header has no line end_header", fix=FIX_COPY)
    lines = text[:size].decode("latin-1").split("\n")[:-1]
    order, elements = None, list[_Element]()
    for number, line in enumerate(lines[1:-1], start=2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", kind, "1.0"] if kind in _ORDERS:
                order = _ORDERS[kind]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,19}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", *words] if elements and (found := _property(words)):
                if found.name in elements[-1].names:
                    raise refusal(path, f"property {quoted(found.name)} stands twice")
                elements[-1].properties.append(found)
            case _:
                raise refusal(
                    path,
                    f"line {number} of the header is {quoted(line)}",
                    expected=f"format {', '.join(_ORDERS)} 1.0; element, name, count; property, "
                    "type, name; or property list, two types, name",
                )
    names = [one.name for one in elements]
    if order is None or len(set(names)) < len(names):
        what = "no format line" if order is None else "an element twice"
        raise refusal(path, f"the header has {what}", expected="a PLY header", fix=FIX_COPY)
    return _Header(path, order, elements, size, len(lines))


def _property(words: list[str]) -> _Property | None:
    length: str | None = None
    match words:
        case ["list", counter, kind, name]:
            length = _TYPES.get(counter, "f")
        case [kind, name]:
            pass
        case _:
            return None
    if kind not in _TYPES or (length or "").startswith("f"):
        return None
    return _Property(name.lower() if name in ("X", "Y", "Z") else name, _TYPES[kind], length)


def _open_vertices(header: _Header, vertex: _Element) -> FileCloud:
    path, count = header.path, vertex.count
    precision = np.result_type(*(one.type for one in vertex.properties if one.name in "xyz"))
    notes: tuple[str, ...] = (_SPLAT_NOTE,) if set(vertex.names) >= _SPLATS else ()
    is_last = vertex is header.elements[-1]
    size = path.stat().st_size
    if not header.order:
        # A number takes two bytes at least, with the blank behind it.
        least = sum(2 * max(len(one.properties), 1) * one.count for one in header.elements)
        if least > size - header.size + 1:
            raise _too_few(path, count, f"{size - header.size:,} bytes of text")
        if is_last:
            rows = sum(one.count for one in header.elements)
            notes += uncounted(lines_beyond(path, header.size, rows), "lines", count)
        read = partial(_read_text, header, vertex)
        return FileCloud(path, "PLY (text)", count, read, precision, notes)
    start, record = _start_of(header, vertex), header.record(vertex)
    room = max(size - start, 0) // record.itemsize
    if room < count:
        raise _too_few(path, count, f"room for {room:,}")
    left = size - start - count * record.itemsize if is_last else 0
    read = partial(_read_binary, path, record, start, count)
    return FileCloud(
        path, "PLY (binary)", count, read, precision, notes + uncounted(left, "bytes", count)
    )


def _too_few(path: Path, promised: int, room: str) -> PredictionError:
    return refusal(
        path,
        f"its header promises {promised:,} points, the file has {room}",
        expected="all that the header promises",
        fix=FIX_COPY,
    )


def _read_binary(
    path: Path, record: np.dtype[Any], start: int, count: int, points: int
) -> Iterator[Cloud]:
    for block in read_records(path, record, start, count, points):
        yield _cloud({name: block[name] for name in record.names or ()})


def _read_text(header: _Header, vertex: _Element, points: int) -> Iterator[Cloud]:
    with opened_text(header.path, header.size, header.lines) as text:
        _skip(text, header, vertex, "points")
        for done in range(0, vertex.count, points):
            few, width = min(points, vertex.count - done), len(vertex.properties)
            rows = parse_rows(text, few, width, vertex.count, "points")
            # Text of a float property may have more digits than float32: all are kept.
            yield _cloud(dict(zip(vertex.names, rows.T, strict=True)))


def _cloud(columns: dict[str, NDArray[Any]]) -> Cloud:
    trust = next((columns[name] for name in _CONFIDENCE if name in columns), None)
    points = columns_to_points(columns["x"], columns["y"], columns["z"])
    return Cloud(points, None, None if trust is None else as_confidence(trust))


def _skip(text: TextLines, header: _Header, element: _Element, what: str) -> None:
    for before in header.elements[: header.elements.index(element)]:
        for _ in range(before.count):
            text.take(1, before.count, f"rows before the {what}")


def _start_of(header: _Header, element: _Element) -> int:
    """Return the byte that an element of a binary file begins at."""
    start = header.size
    for before in header.elements[: header.elements.index(element)]:
        if not before.has_lists:
            start += before.count * header.record(before).itemsize
        else:
            for _, end in _runs(header, before, start):
                start = end
    return start


def _read_faces(header: _Header, faces: _Element, name: str) -> Ints:
    """Read the faces of a binary file as triangles (F, 3), polygons as fans."""
    runs = _runs(header, faces, _start_of(header, faces))
    parts = [cut_fans(np.asarray(rows[name]).astype(np.int64)) for rows, _ in runs]
    return np.concatenate([np.empty((0, 3), np.int64), *parts])


def _read_text_faces(header: _Header, faces: _Element, name: str) -> Ints:
    triangles = array("q")
    with opened_text(header.path, header.size, header.lines) as text:
        _skip(text, header, faces, "faces")
        for _ in range(faces.count):
            (line,), _numbers = text.take(1, faces.count, "faces")
            try:
                add_fan(triangles, _polygon(faces, name, line.split()))
            except (ValueError, IndexError) as error:
                expected = "a face: how many vertices, and their indices"
                raise text.wrong(line, expected) from error
    return np.array(triangles).reshape(-1, 3)


def _polygon(faces: _Element, name: str, words: list[str]) -> list[int]:
    place, found = 0, list[int]()
    for one in faces.properties:
        length = 1
        if one.counter is not None:
            length, place = int(words[place]), place + 1
        if one.name == name:
            found = [int(word) for word in words[place : place + length]]
        place += length
    if place != len(words) or not all(0 <= index < 1 << 62 for index in found):
        raise ValueError("another number of words")
    return found


def _runs(header: _Header, element: _Element, start: int) -> Iterator[tuple[NDArray[Any], int]]:
    """Yield runs of rows whose lists have the same lengths, and the byte that each ends at."""
    if element.count and start >= header.path.stat().st_size:
        raise _cut_off(header, element)
    body = np.memmap(header.path, np.uint8, "r", start) if element.count else np.empty(0, np.uint8)
    place, left, ask = 0, element.count, _FEWEST
    while left:
        record = _record_at(header, body, place, element)
        room = min(left, ask, (len(body) - place) // record.itemsize)
        rows = np.frombuffer(body, record, room, place)
        same = np.ones(room, np.bool_)
        for one in element.properties:
            if one.counter is not None:
                lengths = rows[f"{one.name} count"]
                same &= lengths == lengths[0]
        run = room if same.all() else int(np.argmin(same))
        place += run * record.itemsize
        left -= run
        yield rows[:run], start + place
        ask = min(ask * 2, _MOST) if run == room else max(_FEWEST, min(2 * run, _MOST))


def _record_at(
    header: _Header, body: NDArray[np.uint8], place: int, element: _Element
) -> np.dtype[Any]:
    """Return the type of the row that begins at a place, its lists being as long as they are."""
    fields: list[tuple[Any, ...]] = []
    for one in element.properties:
        if one.counter is None:
            fields.append((one.name, header.order + one.type))
            continue
        counter = np.dtype(header.order + one.counter)
        at = place + np.dtype(fields).itemsize
        if at + counter.itemsize > len(body):
            raise _cut_off(header, element)
        length = int(np.frombuffer(body, counter, 1, at)[0])
        if not 0 <= length <= len(body):
            raise _cut_off(header, element)
        fields += [(f"{one.name} count", counter), (one.name, header.order + one.type, (length,))]
    record = np.dtype(fields)
    if place + record.itemsize > len(body):
        raise _cut_off(header, element)
    return record


def _cut_off(header: _Header, element: _Element) -> PredictionError:
    return refusal(
        header.path,
        f"the file ends within its element {element.name[:20]!r}, or a list in it states an absurd "
        "length",
        expected=f"{element.count:,} rows, as its header says",
        fix=FIX_COPY,
    )


def write_ply(path: Path, cloud: Cloud) -> None:
    """Write a cloud, whole or not at all."""
    columns = [(name, "<f8", column) for name, column in zip("xyz", cloud.points.T, strict=True)]
    if cloud.colours is not None:
        columns += [(name, "u1", c) for name, c in zip(_COLOURS, cloud.colours.T, strict=True)]
    if cloud.confidence is not None:
        columns.append(("confidence", "<f4", cloud.confidence))
    kinds = {"<f8": "double", "<f4": "float", "u1": "uchar"}
    lines = [f"property {kinds[kind]} {name}" for name, kind, _ in columns]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}", *lines]
    with atomic_write(path) as stream:
        stream.write(("\n".join([*head, "end_header"]) + "\n").encode("ascii"))
        for start in range(0, len(cloud), _ROWS):
            rows = np.empty(min(_ROWS, len(cloud) - start), [column[:2] for column in columns])
            for name, _, column in columns:
                rows[name] = column[start : start + _ROWS]
            stream.write(rows.tobytes())

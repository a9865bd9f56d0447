"""PLY: clouds, Gaussian splats and meshes, binary of both byte orders and text."""

from __future__ import annotations

from collections.abc import Iterator
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
from airzoo_bench.formats.clouds.meshes import Mesh
from airzoo_bench.formats.clouds.ply_header import Element, PlyHeader, read_header
from airzoo_bench.formats.clouds.ply_lists import binary_polygons, end_of_element, text_polygons
from airzoo_bench.formats.clouds.text_rows import TextLines, lines_beyond, opened_text, parse_rows
from airzoo_bench.geometry.arrays import Ints

__all__ = ["open_ply", "write_ply"]

_CONFIDENCE = ("confidence", "conf")
_COLOURS = ("red", "green", "blue")
_SPLATS = ("f_dc_0", "opacity")
_ROWS = 1 << 18  # that are written at a time
_FACE_LISTS = ("vertex_indices", "vertex_index")
_SPLAT_NOTE = "Gaussian splats: their centres are taken as points, without colours"


def open_ply(path: Path) -> FileCloud | Mesh:
    """Open a PLY file: a mesh where it has faces, else a cloud."""
    header = read_header(path)
    vertex = header.element("vertex")
    if vertex is None or not {"x", "y", "z"} <= set(vertex.names):
        raise refusal(
            path,
            "has no vertices" if vertex is None else "its vertices lack x, y or z",
            expected="element vertex with properties x, y, z",
        )
    if vertex.has_lists:
        raise refusal(path, "its vertices hold lists", expected="numbers only in element vertex")
    cloud = _open_vertices(path, header, vertex)
    faces = header.element("face")
    return _open_mesh(path, header, cloud, faces) if faces and faces.count else cloud


def _open_vertices(path: Path, header: PlyHeader, vertex: Element) -> FileCloud:
    precision = np.result_type(*(one.type for one in vertex.properties if one.name in "xyz"))
    notes: tuple[str, ...] = (_SPLAT_NOTE,) if set(_SPLATS) <= set(vertex.names) else ()
    if not header.order:
        _refuse_short_text(path, header)
        read = partial(_read_text, path, header, vertex)
        if vertex is header.elements[-1]:
            rows = sum(one.count for one in header.elements)
            left = lines_beyond(path, header.size, rows)
            notes += uncounted(left, "lines", vertex.count)
        return FileCloud(path, "PLY (text)", vertex.count, read, precision, notes)
    start = _start_of(path, header, vertex)
    record = vertex.record(header.order)
    _refuse_short(path, vertex, start, record.itemsize)
    notes += _more_than_promised(path, header, vertex, start + vertex.count * record.itemsize)
    read = partial(_read_binary, path, record, start, vertex.count)
    return FileCloud(path, "PLY (binary)", vertex.count, read, precision, notes)


def _more_than_promised(
    path: Path, header: PlyHeader, vertex: Element, end: int
) -> tuple[str, ...]:
    left = path.stat().st_size - end if vertex is header.elements[-1] else 0
    return uncounted(left, "bytes", vertex.count)


def _start_of(path: Path, header: PlyHeader, element: Element) -> int:
    start = header.size
    for before in header.elements[: header.elements.index(element)]:
        start = end_of_element(path, before, header.order, start)
    return start


def _refuse_short(path: Path, vertex: Element, start: int, itemsize: int) -> None:
    room = max(path.stat().st_size - start, 0) // itemsize
    if room < vertex.count:
        raise _too_few(path, vertex.count, f"room for {room:,}")


def _refuse_short_text(path: Path, header: PlyHeader) -> None:
    # A number takes two bytes at least, with the blank behind it.
    least = sum(2 * max(len(one.properties), 1) * one.count for one in header.elements)
    if least > path.stat().st_size - header.size + 1:
        promised = ", ".join(f"{one.count:,} {one.name[:20]}" for one in header.elements[:3])
        raise _too_few(path, promised, f"{path.stat().st_size - header.size:,} bytes of text")


def _too_few(path: Path, promised: int | str, room: str) -> PredictionError:
    count = f"{promised:,} points" if isinstance(promised, int) else promised
    return refusal(
        path,
        f"its header promises {count}, the file has {room}",
        expected="all that the header promises",
        fix=FIX_COPY,
    )


def _read_binary(
    path: Path, record: np.dtype[Any], start: int, count: int, points: int
) -> Iterator[Cloud]:
    for block in read_records(path, record, start, count, points):
        yield _cloud({name: block[name] for name in record.names or ()})


def _read_text(path: Path, header: PlyHeader, vertex: Element, points: int) -> Iterator[Cloud]:
    with opened_text(path, header.size, header.lines) as text:
        _skip(text, header, vertex, "points")
        width, count = len(vertex.properties), vertex.count
        for done in range(0, count, points):
            rows = parse_rows(text, min(points, count - done), width, count, "points")
            yield _cloud(_typed_columns(vertex, rows))


def _skip(text: TextLines, header: PlyHeader, element: Element, what: str) -> None:
    for before in header.elements[: header.elements.index(element)]:
        for _ in range(before.count):
            text.take(1, before.count, f"rows before the {what}")


def _typed_columns(vertex: Element, rows: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    return {
        one.name: rows[:, place]
        for place, one in enumerate(vertex.properties)
        if one.name in ("x", "y", "z", *_CONFIDENCE)
    }


def _cloud(columns: dict[str, NDArray[Any]]) -> Cloud:
    trust = next((columns[name] for name in _CONFIDENCE if name in columns), None)
    points = columns_to_points(columns["x"], columns["y"], columns["z"])
    return Cloud(points, None, None if trust is None else as_confidence(trust))


def _open_mesh(path: Path, header: PlyHeader, cloud: FileCloud, faces: Element) -> Mesh:
    lists = [one.name for one in faces.properties if one.name in _FACE_LISTS and one.counter]
    if not lists:
        raise refusal(
            path,
            "its faces have no list of vertices",
            expected="property list uchar int vertex_indices",
        )
    piece = next(cloud.pieces(max(cloud.count, 1)), Cloud(np.empty((0, 3))))
    triangles = _triangles(path, header, faces, lists[0])
    return Mesh(path, "PLY mesh", piece.points, triangles, cloud.notes, cloud.precision)


def _triangles(path: Path, header: PlyHeader, faces: Element, name: str) -> Ints:
    if header.order:
        start = _start_of(path, header, faces)
        return binary_polygons(path, faces, name, header.order, start)
    with opened_text(path, header.size, header.lines) as text:
        _skip(text, header, faces, "faces")
        return text_polygons(text, faces, name)


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

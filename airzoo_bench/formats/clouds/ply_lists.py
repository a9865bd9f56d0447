"""Elements of a PLY file whose rows hold lists: faces, as triangles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal
from airzoo_bench.formats.clouds.meshes import fans, triangles_of
from airzoo_bench.formats.clouds.ply_header import Element
from airzoo_bench.formats.clouds.text_rows import TextLines
from airzoo_bench.geometry.arrays import Ints

__all__ = ["binary_polygons", "end_of_element", "text_polygons"]

_FEWEST, _MOST = 32, 1 << 18


def end_of_element(path: Path, element: Element, order: str, start: int) -> int:
    """Return the byte at which an element of a binary file ends."""
    if not element.has_lists:
        end = start + element.count * element.record(order).itemsize
        if end > path.stat().st_size:
            raise _cut_off(path, element)
        return end
    for _, end in _runs(path, element, order, start):
        start = end
    return start


def binary_polygons(path: Path, element: Element, name: str, order: str, start: int) -> Ints:
    """Read the faces of a binary file as triangles (F, 3), polygons as fans."""
    runs = _runs(path, element, order, start)
    parts = [fans(np.asarray(rows[name]).astype(np.int64)) for rows, _ in runs]
    return np.concatenate([np.empty((0, 3), np.int64), *parts])


def text_polygons(text: TextLines, element: Element, name: str) -> Ints:
    """Read the faces of a text file as triangles (F, 3), polygons as fans."""
    polygons = []
    for _ in range(element.count):
        (line,), _numbers = text.take(1, element.count, "faces")
        polygons.append(_text_polygon(text, element, name, line))
    return triangles_of(polygons)


def _text_polygon(text: TextLines, element: Element, name: str, line: str) -> list[int]:
    words, place, found = line.split(), 0, [""]
    for one in element.properties:
        length = 1
        if one.counter is not None:
            counted = words[place] if place < len(words) else ""
            length = int(counted) if counted.isascii() and counted.isdigit() else len(words)
            place += 1
        if one.name == name:
            found = words[place : place + length]
        place += length
    if place != len(words):
        raise _no_face(text, line)
    try:
        polygon = [int(word) for word in found]
    except ValueError as error:
        raise _no_face(text, line) from error
    if any(not 0 <= index < 1 << 62 for index in polygon):
        raise _no_face(text, line)
    return polygon


def _no_face(text: TextLines, line: str) -> PredictionError:
    return text.wrong(line, "a face: how many vertices, and their indices")


def _runs(
    path: Path, element: Element, order: str, start: int
) -> Iterator[tuple[NDArray[Any], int]]:
    """Yield runs of rows whose lists have the same lengths, and the byte that each ends at."""
    if start > path.stat().st_size or (element.count and start == path.stat().st_size):
        raise _cut_off(path, element)
    if not element.count:
        return
    body = np.memmap(path, np.uint8, "r", start)
    place, left, ask = 0, element.count, _FEWEST
    while left:
        record = _record_at(path, body, place, element, order)
        room = min(left, ask, (len(body) - place) // record.itemsize)
        rows = np.frombuffer(body, record, room, place)
        same = np.ones(room, np.bool_)
        for one in element.properties:
            if one.counter is not None:
                lengths = rows[_counter(one.name)]
                same &= lengths == lengths[0]
        run = room if same.all() else int(np.argmin(same))
        place += run * record.itemsize
        left -= run
        yield rows[:run], start + place
        ask = min(ask * 2, _MOST) if run == room else max(_FEWEST, min(2 * run, _MOST))


def _record_at(
    path: Path, body: NDArray[np.uint8], place: int, element: Element, order: str
) -> np.dtype[Any]:
    """Return the type of the row that begins at a place, its lists being as long as they are."""
    fields: list[tuple[Any, ...]] = []
    end = place
    for one in element.properties:
        kind = np.dtype(order + one.type)
        length = 1
        if one.counter is not None:
            counter = np.dtype(order + one.counter)
            if end + counter.itemsize > len(body):
                raise _cut_off(path, element)
            length = int(np.frombuffer(body, counter, 1, end)[0])
            end += counter.itemsize
            fields.append((_counter(one.name), counter))
        if length < 0:
            raise refusal(path, f"a list of {element.name[:20]!r} has the length {length}")
        end += length * kind.itemsize
        if end > len(body):
            raise _cut_off(path, element)
        fields.append((one.name, kind) if one.counter is None else (one.name, kind, (length,)))
    return np.dtype(fields)


def _counter(name: str) -> str:
    return f"{name} count"


def _cut_off(path: Path, element: Element) -> PredictionError:
    return refusal(
        path,
        f"the file ends within its element {element.name[:20]!r}, or a list in it states an absurd "
        "length",
        expected=f"{element.count:,} rows, as its header says",
        fix=FIX_COPY,
    )

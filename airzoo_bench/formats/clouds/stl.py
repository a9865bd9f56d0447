"""STL: triangles, binary or text; its normals and attributes are passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.formats.clouds.cloud import FIX_COPY, read_records, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, check_memory
from airzoo_bench.formats.clouds.text_rows import TextLines, opened_text
from airzoo_bench.geometry.arrays import Floats

__all__ = ["looks_like_stl", "open_stl"]

_HEADER = 80
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_ROWS = 1 << 16
_CORNER_BYTES = 12  # "vertex 1 2 3", the least that a corner takes as text


def looks_like_stl(head: bytes) -> bool:
    """Say whether a file may be STL, by its first bytes: text of facets, or no text."""
    return _is_text(head) or b"\0" in head


def _size(head: bytes) -> int:
    count = int.from_bytes(head[_HEADER : _HEADER + 4], "little")
    return _HEADER + 4 + count * _TRIANGLE.itemsize


def _is_text(head: bytes) -> bool:
    start = head.lstrip()
    return start.startswith(b"solid") and (b"facet" in head or b"endsolid" in head)


def open_stl(path: Path, limit_bytes: int) -> Mesh:
    """Read an STL file; corners that triangles share stand in it once for each."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER + 4)
        rest = stream.read(1 << 12)
    if path.stat().st_size != _size(head) and _is_text(head + rest):
        corners, kind, precision = _text(path, limit_bytes), "STL mesh (text)", "f8"
    else:
        corners, kind, precision = _binary(path, head, limit_bytes), "STL mesh (binary)", "f4"
    faces = np.arange(len(corners)).reshape(-1, 3)
    return Mesh(path, kind, corners, faces, precision=np.dtype(precision))


def _binary(path: Path, head: bytes, limit_bytes: int) -> Floats:
    count = (path.stat().st_size - len(head)) // _TRIANGLE.itemsize
    if path.stat().st_size != _size(head):
        raise refusal(
            path,
            f"has room for {count:,} triangles, and its header counts another number",
            expected="as many as its header counts",
            fix=FIX_COPY,
        )
    check_memory(path, 3 * count, count, limit_bytes)
    corners = np.empty((3 * count, 3))
    done = 0
    for block in read_records(path, _TRIANGLE, len(head), count, _ROWS):
        corners[done : done + 3 * len(block)] = block["corners"].reshape(-1, 3)
        done += 3 * len(block)
    return corners


def _text(path: Path, limit_bytes: int) -> Floats:
    most = path.stat().st_size // _CORNER_BYTES
    check_memory(path, most, most // 3, limit_bytes)
    corners: list[Floats] = [np.empty((0, 3))]
    rows: list[list[float]] = []
    with opened_text(path) as text:
        while (line := text.next()) is not None:
            words = line.split()
            if words[0] == "vertex":
                rows.append(_corner(text, words, line))
            elif words[0] == "endloop" and len(rows) % 3:
                raise text.error("ends a facet", "three corners a facet")
            if len(rows) == 3 * _ROWS:
                corners.append(np.array(rows))
                rows = []
    if len(rows) % 3:
        raise refusal(path, "ends within a facet", expected="three corners a facet", fix=FIX_COPY)
    return np.concatenate([*corners, np.array(rows).reshape(-1, 3)])


def _corner(text: TextLines, words: list[str], line: str) -> list[float]:
    try:
        x, y, z = map(float, words[1:])
    except ValueError as error:
        raise text.wrong(line, "vertex x y z") from error
    return [x, y, z]

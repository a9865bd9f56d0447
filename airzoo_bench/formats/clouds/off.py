"""OFF, the object file format: vertices and faces as text; colours and normals are passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.formats.clouds.cloud import refusal
from airzoo_bench.formats.clouds.meshes import Mesh, check_memory, triangles_of
from airzoo_bench.formats.clouds.text_rows import TextLines, opened_text
from airzoo_bench.geometry.arrays import Ints

__all__ = ["open_off"]

_KEYWORDS = ("OFF", "COFF", "NOFF", "CNOFF")
_FACES = 1 << 16
_MOST = 1 << 40
_EXPECTED = "OFF, then the numbers of vertices, faces and edges"


def open_off(path: Path, limit_bytes: int) -> Mesh:
    """Read an OFF file, as text."""
    with opened_text(path) as text:
        vertices, faces = _counts(text)
        if 2 * (vertices + faces) > path.stat().st_size:
            raise refusal(
                path,
                f"promises {vertices:,} vertices and {faces:,} faces, more than it has room for",
                expected="all that its first lines promise",
            )
        check_memory(path, vertices, faces, limit_bytes)
        points = np.array([_vertex(text) for _ in range(vertices)]).reshape(-1, 3)
        triangles = _faces(text, vertices, faces, limit_bytes)
    return Mesh(path, "OFF mesh", points, triangles)


def _counts(text: TextLines) -> tuple[int, int]:
    words = _words(text, _EXPECTED)
    if words[0] not in _KEYWORDS:
        raise text.wrong(" ".join(words), _EXPECTED)
    counts = words[1:] or _words(text, _EXPECTED)
    if len(counts) not in (2, 3) or not all(
        word.isascii() and word.isdigit() and int(word[:20]) < _MOST for word in counts
    ):
        raise text.wrong(" ".join(counts), _EXPECTED)
    return int(counts[0]), int(counts[1])


def _words(text: TextLines, expected: str) -> list[str]:
    """Return the words of the next line that is no comment."""
    while (line := text.next()) is not None:
        words = line.partition("#")[0].split()
        if words:
            return words
    raise text.error("is not there: the file ends", expected)


def _vertex(text: TextLines) -> list[float]:
    words = _words(text, "x y z")
    try:
        return [float(words[0]), float(words[1]), float(words[2])]
    except (ValueError, IndexError) as error:
        raise text.wrong(" ".join(words), "x y z") from error


def _faces(text: TextLines, vertices: int, count: int, limit_bytes: int) -> Ints:
    triangles: list[Ints] = [np.empty((0, 3), np.int64)]
    total = 0
    for done in range(0, count, _FACES):
        polygons = [_face(text, vertices) for _ in range(min(_FACES, count - done))]
        triangles.append(triangles_of(polygons))
        total += len(triangles[-1])
        check_memory(text.path, vertices, total, limit_bytes)
    return np.concatenate(triangles)


def _face(text: TextLines, vertices: int) -> list[int]:
    expected = "a number of corners, and as many indices of vertices from 0"
    words = _words(text, expected)
    try:
        size = int(words[0])
        corners = [int(word) for word in words[1 : size + 1]]
    except ValueError as error:
        raise text.wrong(" ".join(words), expected) from error
    if size < 1 or len(corners) != size or not all(0 <= one < vertices for one in corners):
        raise text.wrong(" ".join(words), expected)
    return corners

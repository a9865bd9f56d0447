"""OBJ: vertices, faces and colours of vertices; materials and textures are never opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.clouds.cloud import as_colours, refusal
from airzoo_bench.formats.clouds.meshes import Mesh, check_memory, triangles_of
from airzoo_bench.formats.clouds.text_rows import TextLines, opened_text
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["open_obj"]

_LINES = 1 << 16
_MOST_INDEX = 1 << 62
_IGNORED = "mtllib, usemtl and the textures they name are not read"


@dataclass
class _Pending:
    """Lines that were read and not yet turned into arrays, and what was."""

    path: Path
    limit_bytes: int
    rows: list[list[float]] = field(default_factory=list)
    polygons: list[list[int]] = field(default_factory=list)
    vertices: list[Floats] = field(default_factory=lambda: [np.empty((0, 6))])
    triangles: list[Ints] = field(default_factory=lambda: [np.empty((0, 3), np.int64)])
    n_vertices: int = 0
    n_triangles: int = 0
    coloured: bool = True
    materials: bool = False

    def flush(self) -> None:
        if self.rows:
            self.vertices.append(np.array(self.rows))
        self.triangles.append(triangles_of(self.polygons))
        self.n_triangles += len(self.triangles[-1])
        self.rows, self.polygons = [], []
        # Vertices are kept with their colours, twice the size, until the file is at its end.
        check_memory(self.path, 2 * self.n_vertices, self.n_triangles, self.limit_bytes)


def open_obj(path: Path, limit_bytes: int) -> Mesh:
    """Read an OBJ file: ``v`` with or without colours from 0 to 1, and ``f``."""
    pending = _Pending(path, limit_bytes)
    with opened_text(path) as text:
        number = 0
        while (line := text.next()) is not None:
            _take(pending, text, line)
            number += 1
            if number % _LINES == 0:
                pending.flush()
    pending.flush()
    if not pending.n_vertices:
        raise refusal(path, "has no vertices", expected="an OBJ file with lines 'v x y z'")
    values = np.concatenate(pending.vertices)
    colours: NDArray[np.uint8] | None = None
    if pending.coloured:
        colours = as_colours(*values[:, 3:].T)
    faces = np.concatenate(pending.triangles)
    notes = (_IGNORED,) if pending.materials else ()
    return Mesh(path, "OBJ mesh", values[:, :3].copy(), faces, colours, notes)


def _take(pending: _Pending, text: TextLines, line: str) -> None:
    words = line.split()
    match words[0]:
        case "v":
            row = _vertex(text, words, line)
            pending.coloured &= len(row) == 6
            pending.rows.append((row + [0.0] * 3)[:6])
            pending.n_vertices += 1
        case "f":
            pending.polygons.append(_polygon(text, words[1:], pending.n_vertices, line))
        case "mtllib":
            pending.materials = True
        case _:
            # Normals, texture places, groups and what else there may be do not move the surface.
            return


def _vertex(text: TextLines, words: list[str], line: str) -> list[float]:
    try:
        row = [float(word) for word in words[1:]]
    except ValueError as error:
        raise text.wrong(line, "v x y z, or v x y z r g b") from error
    if len(row) not in (3, 4, 6, 7):
        raise text.wrong(line, "v x y z, or v x y z r g b")
    # A fourth number is a weight, which only curves use.
    return row[:3] if len(row) < 6 else row[:6]


def _polygon(text: TextLines, words: list[str], vertices: int, line: str) -> list[int]:
    try:
        given = [int(word.partition("/")[0]) for word in words]
    except ValueError as error:
        raise text.wrong(line, "f and indices of vertices") from error
    if any(index == 0 or abs(index) > _MOST_INDEX for index in given):
        raise text.wrong(line, "indices from 1, or below 0 for those before")
    return [index - 1 if index > 0 else _from_end(text, index, vertices, line) for index in given]


def _from_end(text: TextLines, index: int, vertices: int, line: str) -> int:
    if vertices + index < 0:
        raise text.wrong(line, f"at most {vertices:,} vertices back")
    return vertices + index

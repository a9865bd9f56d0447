"""Meshes: checked, sampled on their surface by area, the same points on every machine."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.formats.clouds.cloud import ArrayPieces, Cloud, FileCloud, MeshSampling, refusal
from airzoo_bench.geometry.arrays import Floats, Ints

_ENDLESS = 1e18
_DOUBLE = np.dtype(np.float64)
_WEYL = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in memory: vertices (V, 3) and faces (F, 3), as read."""

    path: Path
    kind: str
    vertices: Floats
    faces: Ints
    notes: tuple[str, ...] = ()
    precision: np.dtype[Any] = _DOUBLE


def cut_fans(polygons: Ints) -> Ints:
    """Cut polygons (P, n) of n vertices into triangles ((n - 2) P, 3), as fans from the first."""
    sides = polygons.shape[1] if polygons.ndim == 2 else 0
    if sides < 3:
        return np.empty((0, 3), np.int64)
    first = np.broadcast_to(polygons[:, :1], (len(polygons), sides - 2))
    triangles: Ints = np.stack((first, polygons[:, 1:-1], polygons[:, 2:]), axis=-1)
    return triangles.reshape(-1, 3)


def add_fan(triangles: array[int], corners: Sequence[int]) -> None:
    """Append the triangles of a polygon, as a fan from its first corner."""
    for second, third in pairwise(corners[1:]):
        triangles.extend((corners[0], second, third))


def cloud_of_mesh(mesh: Mesh, sampling: MeshSampling | None) -> FileCloud:
    """Sample a mesh uniformly by area as its points are read; without faces, take its vertices."""
    if not len(mesh.faces):
        kind, count = mesh.kind.replace("mesh", "points"), len(mesh.vertices)
        pieces = ArrayPieces(mesh.vertices)
        return FileCloud(mesh.path, kind, count, pieces, mesh.precision, mesh.notes)
    if sampling is None:
        what = "is a mesh, and the protocol does not say how meshes are sampled"
        fix = "sample the mesh and give the points"
        raise refusal(mesh.path, what, expected="points", fix=fix)
    ends = _add_areas(mesh)
    total = float(ends[-1])
    wanted = sampling.count
    if wanted is None:
        wanted = max(round(min(total * (sampling.per_square_unit or 0.0), _ENDLESS)), 1)
    if wanted > sampling.max_points:
        raise refusal(
            mesh.path,
            f"its surface of {total:.4g} square units would take {wanted:.4g} points",
            expected=f"at most {sampling.max_points:,}",
            fix="check its unit: a mesh in millimetres has a million times the area",
        )
    read = partial(_pieces, mesh, ends, wanted, sampling.seed)
    notes = (
        *mesh.notes,
        f"a mesh of {counted(len(mesh.faces), 'face')}: {counted(wanted, 'point')} sampled on its "
        f"surface of {total:.6g} square units",
    )
    return FileCloud(mesh.path, mesh.kind, wanted, read, mesh.precision, notes)


def _face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Areas (F,) of triangles; differences come first, so that far coordinates lose nothing."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        u, v = b - a, c - a
        x = u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1]
        y = u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2]
        z = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        areas: Floats = 0.5 * np.sqrt(x * x + y * y + z * z)
    return areas


def _add_areas(mesh: Mesh) -> Floats:
    """Return the areas of faces, added up, once every face has one."""
    expected = f"finite corners, and indices below {len(mesh.vertices):,}, the number of vertices"

    def refuse(what: str, wrong: Any) -> None:
        if wrong.any():
            rows = first_of(np.flatnonzero(wrong).tolist(), len(wrong))
            raise refusal(mesh.path, f"{what}: {rows}, counted from 0", expected=expected)

    outside = ((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))).any(axis=1)
    refuse("faces with a vertex that is not there", outside)
    areas = _face_areas(mesh.vertices, mesh.faces)
    refuse("faces with a corner that is NaN, infinite or absurdly far", ~np.isfinite(areas))
    with np.errstate(over="ignore"):
        ends: Floats = np.cumsum(areas)
    if not (ends.size and 0.0 < ends[-1] < np.inf):
        raise refusal(mesh.path, "the mesh has no area", expected="faces with an area")
    return ends


def _pieces(mesh: Mesh, ends: Floats, count: int, seed: int, points: int) -> Iterator[Cloud]:
    for start in range(0, count, points):
        place, weights = _draw(ends, count, seed, start, min(start + points, count))
        a, b, c = (mesh.vertices[mesh.faces[place, corner]] for corner in range(3))
        yield Cloud(a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a))


def _draw(
    ends: Floats, count: int, seed: int, start: int, stop: int
) -> tuple[NDArray[np.intp], Floats]:
    """Faces (N,) and weights (N, 2) of their second and third corners."""
    index = np.arange(start, stop, dtype=np.uint64)
    offset, u, v = (_uniform(index, seed, stream) for stream in range(3))
    reached = (index.astype(np.float64) + offset) * (ends[-1] / count)
    # Rounding may reach the very end of the surface; the last face with an area is then meant.
    last = np.searchsorted(ends, ends[-1], side="left")
    place = np.minimum(np.searchsorted(ends, reached, side="right"), last)
    folded = u + v > 1.0
    weights = np.stack((np.where(folded, 1.0 - u, u), np.where(folded, 1.0 - v, v)), axis=-1)
    return place, weights


def _uniform(index: NDArray[np.uint64], seed: int, stream: int) -> Floats:
    """Numbers in [0, 1) by index, the SplitMix64 generator (Steele, Lea and Flood, 2014)."""
    with np.errstate(over="ignore"):
        key = _mix_bits(np.array([seed % (1 << 64)], np.uint64) + _WEYL * np.uint64(stream + 1))
        mixed = _mix_bits(key + (index + np.uint64(1)) * _WEYL)
    numbers: Floats = (mixed >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return numbers


def _mix_bits(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * _MIX_1
    state = (state ^ (state >> np.uint64(27))) * _MIX_2
    return np.asarray(state ^ (state >> np.uint64(31)))

"""Triangles of buildings: vertical walls and closed roofs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape.plan import Building, Roof
from airzoo_bench.mini.world import Material, Mesh

__all__ = ["building_mesh", "joined"]

# How far walls go below the floor, so that uneven land leaves no gap.
_FOUNDATION_M = 0.8

# Corners 0-3 are at the floor, 4-7 at the walls' top, counter-clockwise from (-u, -v); 8 and 9 are
# the ridge's ends at -u and +u.
_WALLS = (
    (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
)  # fmt: skip
_TOPS: dict[Roof, tuple[tuple[int, int, int], ...]] = {
    Roof.FLAT: ((4, 5, 6), (4, 6, 7)),
    Roof.SHED: ((4, 5, 6), (4, 6, 7)),
    Roof.GABLED: ((4, 5, 9), (4, 9, 8), (6, 7, 8), (6, 8, 9)),
    Roof.HIPPED: ((4, 5, 9), (4, 9, 8), (6, 7, 8), (6, 8, 9), (5, 6, 9), (7, 4, 8)),
}
_GABLES = ((5, 6, 9), (7, 4, 8))


def building_mesh(buildings: Sequence[Building]) -> Mesh:
    """Mesh buildings; the owner of a triangle is the building's place in the list."""
    parts = []
    for roof in Roof:
        chosen = np.array([i for i, b in enumerate(buildings) if b.roof is roof], np.int64)
        if chosen.size:
            parts.append(_of_one_form(roof, [buildings[i] for i in chosen], chosen))
    return joined(parts)


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Put meshes into one."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=True)]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate([part.material for part in parts]),
        np.concatenate([part.owner for part in parts]),
    )


def _of_one_form(roof: Roof, buildings: Sequence[Building], owners: NDArray[np.int64]) -> Mesh:
    gables = _GABLES if roof is Roof.GABLED else ()
    table = np.array(_WALLS + gables + _TOPS[roof], np.int64)
    walls = len(_WALLS) + len(gables)
    used = 8 if roof in (Roof.FLAT, Roof.SHED) else 10
    vertices = np.array([_corners(building)[:used] for building in buildings])
    starts = np.arange(len(buildings)) * used
    triangles = (table[None] + starts[:, None, None]).reshape(-1, 3)
    kinds = np.where(np.arange(len(table)) < walls, Material.WALL, Material.ROOF)
    return Mesh(
        vertices.reshape(-1, 3),
        triangles.astype(np.int32),
        np.tile(kinds, len(buildings)).astype(np.uint8),
        np.repeat(owners, len(table)).astype(np.int32),
    )


def _corners(building: Building) -> Floats:
    rect = building.rect
    low = building.base_m - (_FOUNDATION_M if building.parent < 0 else 0.0)
    far = building.ridge_m if building.roof is Roof.SHED else building.eaves_m
    plan = rect.corners()
    points = [(x, y, low) for x, y in plan]
    points += [(x, y, building.eaves_m) for x, y in plan[:2]] + [(x, y, far) for x, y in plan[2:]]
    middle, half_v = (rect.v0 + rect.v1) / 2, (rect.v1 - rect.v0) / 2
    # The slope of hips is that of the sides; a square plan keeps half a metre of ridge.
    inset = 0.0
    if building.roof is Roof.HIPPED:
        inset = min(half_v, (rect.u1 - rect.u0) / 2 - 0.25)
    for u in (rect.u0 + inset, rect.u1 - inset):
        points.append((*rect.frame.to_world(u, middle), building.ridge_m))
    return np.array(points)

"""Triangles of the land, of buildings and of trees."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.datasets.mini.noise import hash_of
from airzoo_bench.datasets.mini.plan import GRID_M, Building, Plan
from airzoo_bench.datasets.mini.world import Material, Mesh
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]

_STREAM = 31
# Distances of the apron's corners beyond the border, in steps of the grid, to 800 m.
_BEYOND = np.array([0, 2, 5, 10, 18, 30, 45, 65, 90, 120, 160, 205, 255, 325, 400])
# How far walls go below the floor, so that uneven land leaves no gap.
_FOUNDATION_M = 0.8

# Corners 0-3 are at the floor, 4-7 at the walls' top, counter-clockwise from (-u, -v); 8 and 9 are
# the ridge's ends at -u and +u.
_WALLS = (
    (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
)  # fmt: skip
_FLAT = ((4, 5, 6), (4, 6, 7))
_SLOPES = ((4, 5, 9), (4, 9, 8), (6, 7, 8), (6, 8, 9))
_ENDS = ((5, 6, 9), (7, 4, 8))
# Walls, tops and the number of corners, by roof.
_FORMS = {
    "flat": (_WALLS, _FLAT, 8),
    "gabled": (_WALLS + _ENDS, _SLOPES, 10),
    "hipped": (_WALLS, _SLOPES + _ENDS, 10),
    "shed": (_WALLS, _FLAT, 8),
}

# Half the height of canopies, as a share of the tree's.
_HALF_HEIGHTS = {"broad": 0.42, "cone": 0.46, "bush": 0.6, "bale": 0.9}
_OCTAHEDRON = (
    (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5),
)  # fmt: skip
_ICOSAHEDRON = (
    (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
    (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
    (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
)  # fmt: skip


def plan_mesh(plan: Plan) -> Mesh:
    """Mesh a plan: the land, buildings and trees, and the land mirrored beyond the border."""
    inside = np.arange(plan.heights.shape[0])
    west, east = -_BEYOND[::-1], inside[-1] + _BEYOND
    strips = [(inside, west), (inside, east), (west, inside), (east, inside)]
    corners = [(a, b) for a in (west, east) for b in (west, east)]
    land = _grid(inside, inside, plan.heights, Material.GROUND)
    apron = [_grid(x, y, plan.heights, Material.APRON) for x, y in strips + corners]
    parts = [land, *_building_meshes(plan.buildings), *_tree_meshes(plan), *apron]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=True)]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate([part.material for part in parts]),
        np.concatenate([part.owner for part in parts]),
    )


def _grid(columns: _Indices, rows: _Indices, heights: Floats, material: Material) -> Mesh:
    """Mesh land by cells cut from south-west to north-east."""
    last = heights.shape[0] - 1
    mirrored = (last - np.abs(np.abs(index) % (2 * last) - last) for index in (rows, columns))
    x, y = np.meshgrid(columns * GRID_M, rows * GRID_M)
    points = np.stack([x, y, heights[np.ix_(*mirrored)]], -1).reshape(-1, 3)
    wide = len(columns)
    first = (np.arange(len(rows) - 1)[:, None] * wide + np.arange(wide - 1)[None, :]).ravel()
    lower = np.stack([first, first + 1, first + wide + 1], 1)
    upper = np.stack([first, first + wide + 1, first + wide], 1)
    return _copies(points[None], np.concatenate([lower, upper]), material, np.array([-1]))


def _copies(vertices: Floats, table: ArrayLike, materials: ArrayLike, owners: _Indices) -> Mesh:
    """Put copies of a form (T triangles of C corners), with vertices (N, C, 3), into one mesh."""
    count, corners = vertices.shape[:2]
    form = np.asarray(table)
    triangles = form[None] + (np.arange(count) * corners)[:, None, None]
    return Mesh(
        vertices.reshape(-1, 3),
        triangles.reshape(-1, 3).astype(np.int32),
        np.tile(np.broadcast_to(materials, len(form)), count).astype(np.uint8),
        np.repeat(owners, len(form)).astype(np.int32),
    )


def _building_meshes(buildings: list[Building]) -> list[Mesh]:
    """Mesh buildings; the owner of a triangle is the building's place in the list."""
    parts = []
    for roof, (walls, tops, used) in _FORMS.items():
        owners = [i for i, building in enumerate(buildings) if building.roof == roof]
        if owners:
            vertices = np.array([_corners(buildings[i])[:used] for i in owners])
            materials = [Material.WALL] * len(walls) + [Material.ROOF] * len(tops)
            parts.append(_copies(vertices, walls + tops, materials, np.array(owners)))
    return parts


def _corners(building: Building) -> list[tuple[float, float, float]]:
    rect, eaves = building.rect, building.eaves_m
    low = building.base_m - (_FOUNDATION_M if building.parent < 0 else 0.0)
    far = building.ridge_m if building.roof == "shed" else eaves
    middle, half_v = (rect.v0 + rect.v1) / 2, rect.deep / 2
    # The slope of hips is that of the sides; a square plan keeps half a metre of ridge.
    inset = min(half_v, rect.long / 2 - 0.25) if building.roof == "hipped" else 0.0
    ridge = [rect.frame.to_world(u, middle) for u in (rect.u0 + inset, rect.u1 - inset)]
    levels = (low,) * 4 + (eaves, eaves, far, far) + (building.ridge_m,) * 2
    points = (*rect.corners(), *rect.corners(), *ridge)
    return [(*point, level) for point, level in zip(points, levels, strict=True)]


def _tree_meshes(plan: Plan) -> list[Mesh]:
    """Mesh the trees; the owner of a triangle is the tree's place in the list."""
    kinds = np.array([tree.kind for tree in plan.trees])
    sizes = np.array([(tree.radius_m, tree.height_m) for tree in plan.trees])
    feet = np.array([(tree.x, tree.y, plan.height(tree.x, tree.y)) for tree in plan.trees])
    parts = []
    for kind in _HALF_HEIGHTS:
        chosen = np.flatnonzero(kinds == kind)
        if chosen.size:
            parts.append(_canopies(feet[chosen], sizes[chosen], chosen, kind, plan.seed))
    tall = np.flatnonzero((kinds == "broad") | (kinds == "cone"))
    return [*parts, _trunks(feet[tall], sizes[tall], tall)]


def _canopies(feet: Floats, sizes: Floats, owners: _Indices, kind: str, seed: int) -> Mesh:
    """Make irregular canopies."""
    sphere, table = _sphere(kind == "broad")
    radius, height = sizes.T
    half = height * _HALF_HEIGHTS[kind]
    if kind == "broad":
        half = np.minimum(half, 1.1 * radius)
    shape = np.broadcast_to(sphere, (len(owners), *sphere.shape))
    if kind == "bale":
        shape = np.clip(shape, [-1, -1, -0.55], [1, 1, 0.55])
    else:
        bits = hash_of(seed, _STREAM, owners[:, None], np.arange(len(sphere))) >> np.uint64(44)
        shape = shape * (0.72 + 0.5 * (bits.astype(np.float64) / (1 << 20)))[..., None]
    if kind == "cone":
        shape[..., :2] *= 1.0 - 0.6 * shape[..., 2:]
    scale = np.stack([radius, radius, half], -1)[:, None, :]
    centre = np.column_stack([feet[:, :2], feet[:, 2] + height - half])
    return _copies(centre[:, None, :] + shape * scale, table, Material.CANOPY, owners)


def _trunks(feet: Floats, sizes: Floats, owners: _Indices) -> Mesh:
    half, top = 0.1 + 0.05 * sizes[:, 0], feet[:, 2] + 0.62 * sizes[:, 1]
    corners = [
        np.stack([feet[:, 0] + a * half, feet[:, 1] + b * half, z], -1)
        for z in (feet[:, 2] - 0.4, top)
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return _copies(np.stack(corners, 1), _WALLS, Material.TRUNK, owners)


def _sphere(fine: bool) -> tuple[Floats, _Indices]:
    """Return corners and triangles of an icosahedron or octahedron, each triangle cut into four."""
    if fine:
        golden = (1.0 + float(np.sqrt(5.0))) / 2.0
        flat = [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)]
        around = [(a, b, 0.0) for a, b in flat] + [(0.0, a, b) for a, b in flat]
        points = _unit(np.array(around + [(b, 0.0, a) for a, b in flat]))
    else:
        points = np.concatenate([np.eye(3)[:2], -np.eye(3)[:2], [[0.0, 0, 1], [0, 0, -1]]])
    a, b, c = np.array(_ICOSAHEDRON if fine else _OCTAHEDRON).T
    edges = np.sort(np.concatenate([np.stack(e, 1) for e in ((a, b), (b, c), (c, a))]), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    middles = _unit(points[unique[:, 0]] + points[unique[:, 1]])
    ab, bc, ca = place.reshape(3, -1) + len(points)
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([points, middles]), np.concatenate([np.stack(p, 1) for p in parts])


def _unit(points: Floats) -> Floats:
    x, y, z = points.T
    return np.asarray(points / np.sqrt(x * x + y * y + z * z)[:, None])

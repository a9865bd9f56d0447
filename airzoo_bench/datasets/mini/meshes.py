"""Triangles of the land, of buildings and of trees, in a season."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.datasets.mini.noise import direction, hash_of
from airzoo_bench.datasets.mini.plan import ALWAYS, GRID_M, LOOKS, Building, Plan, Tree
from airzoo_bench.datasets.mini.world import Material, Mesh
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]

_STREAM = 31
# Distances of the apron's corners beyond the border, in steps of the grid, to 800 m.
_BEYOND = np.array([0, 2, 5, 10, 18, 30, 45, 65, 90, 120, 160, 205, 255, 325, 400])
# How far walls go below the floor, so that uneven land leaves no gap.
_FOUNDATION_M = 0.8
_NO_WINDOWS = 4

# Corners 0-3 are at the floor, 4-7 at the walls' top, counter-clockwise from (-u, -v); 8 and 9 are
# the ridge's ends at -u and +u.
_WALLS = (
    (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
)  # fmt: skip
_FLAT = ((4, 5, 6), (4, 6, 7))
_SLOPES = ((4, 5, 9), (4, 9, 8), (6, 7, 8), (6, 8, 9))
_ENDS = ((5, 6, 9), (7, 4, 8))
# Walls and tops, by roof.
_ROOFS = {
    "flat": (_WALLS, _FLAT),
    "shed": (_WALLS, _FLAT),
    "gabled": (_WALLS + _ENDS, _SLOPES),
    "hipped": (_WALLS, _SLOPES + _ENDS),
}


def season_rows(plan: Plan, season: int) -> tuple[list[Building], list[Tree]]:
    """Return the buildings and trees of a season, whose places are the owners of triangles."""
    seasons = (ALWAYS, season)
    buildings = [building for building in plan.buildings if building.season in seasons]
    return buildings, [tree for tree in plan.trees if tree.season in seasons]


def plan_mesh(plan: Plan, season: int) -> Mesh:
    """Mesh the land, buildings and trees, and the land mirrored beyond the border.

    The land's triangles come first, as `land_triangles` says.
    """
    buildings, trees = season_rows(plan, season)
    inside = np.arange(plan.heights.shape[0])
    parts = [_mesh_grid(inside, inside, plan.heights, Material.GROUND)]
    for roof, (walls, tops) in _ROOFS.items():
        owners = [i for i, building in enumerate(buildings) if building.roof == roof]
        corners = np.array([_corners(buildings[i]) for i in owners]).reshape(-1, 10, 3)
        materials = [Material.WALL] * len(walls) + [Material.ROOF] * len(tops)
        parts.append(_copies(corners, walls + tops, materials, np.array(owners, np.int64)))
    parts += _tree_meshes(plan, trees)
    west, east = -_BEYOND[::-1], inside[-1] + _BEYOND
    strips = [(inside, west), (inside, east), (west, inside), (east, inside)]
    strips += [(a, b) for a in (west, east) for b in (west, east)]
    parts += [_mesh_grid(x, y, plan.heights, Material.APRON) for x, y in strips]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=True)]
    rest = (np.concatenate([part[k] for part in parts]) for k in (2, 3))
    vertices = np.concatenate([part.vertices for part in parts])
    return Mesh(vertices, np.concatenate(triangles).astype(np.int32), *rest)


def _mesh_grid(columns: _Indices, rows: _Indices, heights: Floats, material: Material) -> Mesh:
    """Mesh land by cells cut from south-west to north-east: lower triangles, then upper ones."""
    last = heights.shape[0] - 1
    mirrored = (last - np.abs(np.abs(index) % (2 * last) - last) for index in (rows, columns))
    x, y = np.meshgrid(columns * GRID_M, rows * GRID_M)
    points = np.stack([x, y, heights[np.ix_(*mirrored)]], -1).reshape(-1, 3)
    wide = len(columns)
    first = (np.arange(len(rows) - 1)[:, None] * wide + np.arange(wide - 1)[None, :]).ravel()
    lower = np.stack([first, first + 1, first + wide + 1], 1)
    upper = np.stack([first, first + wide + 1, first + wide], 1)
    return _copies(points[None], np.concatenate([lower, upper]), material, np.array([-1]))


def land_triangles(x: Floats, y: Floats, cells: int) -> NDArray[np.int32]:
    """Return the triangle of the land at points, which broadcast; others are clipped."""
    column, row = (np.clip(np.floor(at / GRID_M), 0, cells - 1).astype(np.int32) for at in (x, y))
    upper = (y - row * GRID_M) > (x - column * GRID_M)
    return row * np.int32(cells) + column + upper * np.int32(cells * cells)


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


def _corners(building: Building) -> list[tuple[float, float, float]]:
    box, eaves, ridge_m = building.box, building.eaves_m, building.ridge_m
    low = building.base_m - (0.0 if building.style == _NO_WINDOWS else _FOUNDATION_M)
    far = ridge_m if building.roof == "shed" else eaves
    # The slope of hips is that of the sides; a square plan keeps half a metre of ridge.
    end = box.u1 - (min(box.v1, box.u1 - 0.25) if building.roof == "hipped" else 0.0)
    plan = [box.frame.to_world(u, v) for u, v in (
        (box.u0, box.v0), (box.u1, box.v0), (box.u1, box.v1), (box.u0, box.v1), (-end, 0), (end, 0)
    )]  # fmt: skip
    levels = (low,) * 4 + (eaves, eaves, far, far) + (ridge_m,) * 2
    points = plan[:4] + plan
    return [(*point, level) for point, level in zip(points, levels, strict=True)]


def _tree_meshes(plan: Plan, trees: list[Tree]) -> list[Mesh]:
    feet = np.array([(tree.x, tree.y, plan.height(tree.x, tree.y)) for tree in trees])
    sizes = np.array([(tree.radius_m, tree.height_m) for tree in trees])
    parts = []
    for kind, look in LOOKS["trees"].items():
        owners = np.array([i for i, tree in enumerate(trees) if tree.kind == kind], np.int64)
        foot, (radius, height) = feet[owners], sizes[owners].T
        half = height * look["half"]
        half = half if look["taper"] else np.minimum(half, 1.1 * radius)
        ball, table = _ball(*look["rings"])
        # A tree keeps its form through the seasons, which is that of its place.
        place = np.rint(foot[:, :2] * 1024).astype(np.int64)
        bits = hash_of(plan.seed, _STREAM, place[:, :1], place[:, 1:], np.arange(len(ball)))
        bulge = 0.74 + 0.48 * ((bits >> np.uint64(44)).astype(np.float64) / (1 << 20))
        shape = ball * bulge[..., None]
        shape[..., :2] *= 1.0 - look["taper"] * shape[..., 2:]
        scale = np.stack([radius, radius, half], -1)[:, None, :]
        centre = np.column_stack([foot[:, :2], foot[:, 2] + height - half])[:, None, :]
        parts.append(_copies(centre + shape * scale, table, Material.CANOPY, owners))
    low = [i for i, tree in enumerate(trees) if LOOKS["trees"][tree.kind]["half"] < 0.5]
    stems = np.array(low, np.int64)
    foot, (radius, height) = feet[stems], sizes[stems].T
    half, top = 0.1 + 0.05 * radius, foot[:, 2] + 0.62 * height
    corners = [
        np.stack([foot[:, 0] + a * half, foot[:, 1] + b * half, z], -1)
        for z in (foot[:, 2] - 0.4, top)
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return [*parts, _copies(np.stack(corners, 1), _WALLS, Material.TRUNK, stems)]


def _ball(rings: int, around: int) -> tuple[Floats, _Indices]:
    """Return corners and triangles of a ball: rings between poles, every second turned."""
    corners = [(0.0, 0.0, -1.0)]
    triangles = []
    for ring in range(rings):
        height, level = direction(round(128 * (ring + 1) / (rings + 1)))
        for step in range(around):
            x, y = direction(round(256 * (step + ring % 2 / 2) / around))
            corners.append((level * x, level * y, -height))
            low, side = ring * around, (step + 1) % around
            a, b = low + step + 1, low + side + 1
            if ring == 0:
                triangles.append((0, b, a))
            else:
                # Below lie the corners before and after this one, or this one's and the next.
                c, d = ((step - 1) % around, step) if ring % 2 == 0 else (step, side)
                c, d = low - around + c + 1, low - around + d + 1
                triangles += [(c, d, a), (d, b, a)]
            if ring == rings - 1:
                triangles.append((a, b, low + around + 1))
    return np.array([*corners, (0.0, 0.0, 1.0)]), np.array(triangles)

"""A small world put together by hand, whose every measure is known; made in a fraction of a second.

Flat land at `GROUND_M`, one block with a flat roof, one with a gable, trees, a pond, and an apron.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.renderer import Raycaster
from airzoo_bench.datasets.mini.world import (
    SURVEY_SUN,
    Buildings,
    Material,
    Mesh,
    Region,
    World,
)

SIDE_M = 96.0
GROUND_M = 20.0
APRON_M = 400.0
REGION = Region("small", 401_000.0, 3_120_000.0, SIDE_M)

# west, south, east, north, top
BLOCK = (20.0, 30.0, 40.0, 50.0, 32.0)
HOUSE = (60.0, 56.0, 72.0, 76.0, 27.0)
RIDGE_M = 31.0
TREES = (
    (50.0, 20.0, 3.0),
    (58.0, 24.0, 2.5),
    (80.0, 40.0, 3.5),
    (15.0, 70.0, 3.0),
    (30.0, 80.0, 2.0),
)
POND = (70.0, 8.0, 88.0, 22.0)


class _Parts:
    """Triangles as they are put together."""

    def __init__(self) -> None:
        self.corners: list[list[tuple[float, float, float]]] = []
        self.material: list[int] = []
        self.owner: list[int] = []

    def face(self, corners: list[tuple[float, float, float]], material: int, owner: int) -> None:
        for second in range(1, len(corners) - 1):
            self.corners.append([corners[0], corners[second], corners[second + 1]])
            self.material.append(material)
            self.owner.append(owner)

    def mesh(self) -> Mesh:
        soup = np.array(self.corners).reshape(-1, 3)
        vertices, index = np.unique(soup, axis=0, return_inverse=True)
        return Mesh(
            vertices,
            index.reshape(-1, 3).astype(np.int32),
            np.array(self.material, np.uint8),
            np.array(self.owner, np.int32),
        )


@cache
def small_world() -> World:
    """Return the world, the same object each time."""
    mesh = small_mesh()
    ground, top, water = _paint()
    dsm, dom = _survey(mesh, top)
    return World(
        region=REGION,
        seed=0,
        mesh=mesh,
        buildings=_buildings(),
        tree_colours=np.array(
            [(70, 105, 45), (85, 110, 50), (60, 95, 50), (90, 120, 60), (75, 100, 40)], np.uint8
        ),
        ground_albedo=ground,
        top_albedo=top,
        water=water,
        dsm=dsm,
        dom=dom,
        satellite=np.zeros((320, 320, 3), np.uint8),
    )


@cache
def small_mesh() -> Mesh:
    """Return the mesh alone."""
    parts = _Parts()
    _land(parts)
    west, south, east, north, top = BLOCK
    _walls(parts, (west, south, east, north), top, Material.WALL, 0)
    parts.face(
        [(west, south, top), (east, south, top), (east, north, top), (west, north, top)],
        Material.ROOF,
        0,
    )
    _gable(parts)
    for number, (x, y, radius) in enumerate(TREES):
        _tree(parts, x, y, radius, number)
    return parts.mesh()


def _land(parts: _Parts) -> None:
    edges = np.linspace(0.0, SIDE_M, 13)
    for x0, x1 in pairwise(edges.tolist()):
        for y0, y1 in pairwise(edges.tolist()):
            parts.face(_flat(x0, y0, x1, y1), Material.GROUND, -1)
    rim = (-APRON_M, 0.0, SIDE_M, SIDE_M + APRON_M)
    for i in range(3):
        for j in range(3):
            if (i, j) != (1, 1):
                parts.face(_flat(rim[i], rim[j], rim[i + 1], rim[j + 1]), Material.APRON, -1)


def _flat(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float]]:
    return [(x0, y0, GROUND_M), (x1, y0, GROUND_M), (x1, y1, GROUND_M), (x0, y1, GROUND_M)]


def _walls(parts: _Parts, box: tuple[float, ...], top: float, material: int, owner: int) -> None:
    """Four upright sides on the ground."""
    west, south, east, north = box
    ring = [(west, south), (east, south), (east, north), (west, north)]
    for (x0, y0), (x1, y1) in zip(ring, ring[1:] + ring[:1], strict=True):
        foot = [(x0, y0, GROUND_M), (x1, y1, GROUND_M)]
        parts.face([*foot, (x1, y1, top), (x0, y0, top)], material, owner)


def _gable(parts: _Parts) -> None:
    west, south, east, north, eaves = HOUSE
    middle = (west + east) / 2
    _walls(parts, (west, south, east, north), eaves, Material.WALL, 1)
    ridge = [(middle, south, RIDGE_M), (middle, north, RIDGE_M)]
    parts.face([(west, south, eaves), (east, south, eaves), ridge[0]], Material.WALL, 1)
    parts.face([(east, north, eaves), (west, north, eaves), ridge[1]], Material.WALL, 1)
    parts.face([(west, north, eaves), (west, south, eaves), ridge[0], ridge[1]], Material.ROOF, 1)
    parts.face([(east, south, eaves), (east, north, eaves), ridge[1], ridge[0]], Material.ROOF, 1)


def _tree(parts: _Parts, x: float, y: float, radius: float, owner: int) -> None:
    angles = np.arange(8) * (np.pi / 4)
    rings = [(0.75, 2.5), (1.0, 2.5 + 0.8 * radius), (0.6, 2.5 + 1.6 * radius)]
    circles = [
        [
            (x + share * radius * np.cos(a), y + share * radius * np.sin(a), GROUND_M + height)
            for a in angles
        ]
        for share, height in rings
    ]
    for low, high in pairwise(circles):
        for k in range(8):
            after = (k + 1) % 8
            parts.face([low[k], low[after], high[after], high[k]], Material.CANOPY, owner)
    tip = (x, y, GROUND_M + 2.5 + 2.0 * radius)
    for k in range(8):
        parts.face([circles[-1][k], circles[-1][(k + 1) % 8], tip], Material.CANOPY, owner)
    parts.face(circles[0][::-1], Material.CANOPY, owner)
    box = (x - 0.2, y - 0.2, x + 0.2, y + 0.2)
    _walls(parts, box, GROUND_M + 2.6, Material.TRUNK, owner)


def _buildings() -> Buildings:
    return Buildings(
        wall_colour=np.array([(188, 176, 158), (170, 120, 95)], np.uint8),
        window_colour=np.array([(58, 68, 80), (50, 56, 62)], np.uint8),
        base_m=np.array([GROUND_M, GROUND_M]),
        storey_m=np.array([3.0, 3.0]),
        bay_m=np.array([3.2, 2.8]),
        style=np.array([0, 2], np.uint8),
    )


def _paint() -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.bool_]]:
    side = round(SIDE_M / 0.25)
    x = (np.arange(side) + 0.5) * 0.25
    column, row = np.meshgrid(x, SIDE_M - x)
    patches = (np.floor(column / 4) * 7 + np.floor(row / 4) * 13 + np.floor(column / 12) * 5) % 5
    ground = np.stack([95 + 9 * patches, 118 + 6 * patches, 70 + 5 * patches], axis=-1)
    ground[(np.abs(column - 48) < 3) | (np.abs(row - 53) < 2)] = (112, 112, 116)
    ground[np.abs(column - 48) < 0.2] = (215, 215, 210)
    water = _within(column, row, POND)
    ground[water] = (62, 84, 88)
    top = ground.copy()
    top[_within(column, row, BLOCK[:4])] = (150, 148, 142)
    top[_within(column, row, HOUSE[:4])] = (146, 84, 66)
    for tree_x, tree_y, radius in TREES:
        top[(column - tree_x) ** 2 + (row - tree_y) ** 2 < radius**2] = (72, 104, 46)
    return ground.astype(np.uint8), top.astype(np.uint8), water


def _within(
    x: NDArray[np.float64], y: NDArray[np.float64], box: tuple[float, ...]
) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (x >= box[0]) & (x < box[2]) & (y >= box[1]) & (y < box[3])
    return inside


def _survey(mesh: Mesh, top: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    caster = Raycaster(mesh)
    triangle, heights = _from_above(caster, 0.25)
    side = len(top)
    normals = caster.normal[:, triangle]
    x = (np.arange(side) + 0.5) * 0.25
    column, row = np.meshgrid(x, SIDE_M - x)
    points = np.stack([column.ravel(), row.ravel(), heights])
    sun = np.array(SURVEY_SUN.direction)
    visible = ~caster.occluded(points, normals, sun)
    direct = (np.maximum(sun @ normals, 0.0) * visible).reshape(side, side, 1)
    lit = top * (np.array(SURVEY_SUN.sky) + np.array(SURVEY_SUN.sun) * direct)
    _, coarse = _from_above(caster, 0.5)
    dsm = coarse.reshape(side // 2, side // 2).astype(np.float32)
    return dsm, np.clip(np.rint(lit), 0, 255).astype(np.uint8)


def _from_above(caster: Raycaster, gsd: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    x = np.arange(gsd / 2, SIDE_M, gsd)
    column, row = np.meshgrid(x, SIDE_M - x)
    return _vertical(caster, column.ravel(), row.ravel())


def _vertical(
    caster: Raycaster, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    origins = np.stack([x, y, np.full(len(x), 200.0)])
    directions = np.stack([np.zeros(len(x)), np.zeros(len(x)), np.full(len(x), -1.0)])
    triangle, depth = caster.trace(origins, directions)
    return triangle, 200.0 - depth

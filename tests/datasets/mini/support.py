"""A small world put together by hand, whose every measure is known, and views of it.

Flat land at `GROUND_M`, one block with a flat roof, one with a gable, trees, a pond, and an apron.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise, product

import numpy as np

from airzoo_bench.datasets.mini.renderer import Raycaster, Renderer, default_camera
from airzoo_bench.datasets.mini.world import SURVEY_SUN, Buildings, Material, Mesh, Region, World
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, angles_to_rotations

SIDE_M, GROUND_M, APRON_M, RIDGE_M = 96.0, 20.0, 400.0, 31.0
REGION = Region("small", 401_000.0, 3_120_000.0, SIDE_M)
CORNER = np.array([REGION.west, REGION.south, 0.0])
# west, south, east, north, top
BLOCK = (20.0, 30.0, 40.0, 50.0, 32.0)
HOUSE = (60.0, 56.0, 72.0, 76.0, 27.0)
TREES = ((50.0, 20.0, 3.0), (58.0, 24.0, 2.5), (80.0, 40.0, 3.5), (15.0, 70.0, 3.0))
POND = (70.0, 8.0, 88.0, 22.0)
LENS = ((-0.12, 0.04, 0.001, -0.002, 0.0),)

Face = tuple[list[tuple[float, float, float]], int, int]


def ring(box: Sequence[float], z: float) -> list[tuple[float, float, float]]:
    west, south, east, north = box[:4]
    return [(west, south, z), (east, south, z), (east, north, z), (west, north, z)]


def sides(low: list, high: list, material: int, owner: int) -> list[Face]:
    corners = zip(low, low[1:] + low[:1], high[1:] + high[:1], high, strict=True)
    return [(list(four), material, owner) for four in corners]


@cache
def small_mesh() -> Mesh:
    """Return the mesh alone."""
    cells = [*pairwise(np.linspace(0.0, SIDE_M, 13).tolist())]
    rim = [*pairwise((-APRON_M, 0.0, SIDE_M, SIDE_M + APRON_M))]
    faces: list[Face] = []
    for strips, material in ((cells, Material.GROUND), (rim, Material.APRON)):
        for (x0, x1), (y0, y1) in product(strips, strips):
            if (x0, y0, x1, y1, material) != (0.0, 0.0, SIDE_M, SIDE_M, Material.APRON):
                faces.append((ring((x0, y0, x1, y1), GROUND_M), material, -1))
    for owner, box in enumerate((BLOCK, HOUSE)):
        faces += sides(ring(box, GROUND_M), ring(box, box[4]), Material.WALL, owner)
    faces.append((ring(BLOCK, BLOCK[4]), Material.ROOF, 0))
    a, b, c, d = ring(HOUSE, HOUSE[4])
    start, end = ((66.0, y, RIDGE_M) for y in (HOUSE[1], HOUSE[3]))
    faces += [([a, b, start], Material.WALL, 1), ([c, d, end], Material.WALL, 1)]
    faces += [([d, a, start, end], Material.ROOF, 1), ([b, c, end, start], Material.ROOF, 1)]
    turn = np.arange(8) * (np.pi / 4)
    for owner, (x, y, radius) in enumerate(TREES):
        low, middle, high = (
            [(x + r * np.cos(t), y + r * np.sin(t), GROUND_M + 2.5 + z) for t in turn]
            for r, z in ((0.75 * radius, 0.0), (radius, 0.8 * radius), (0.0, 2.0 * radius))
        )
        for one, other in ((low, middle), (middle, high)):
            faces += sides(one, other, Material.CANOPY, owner)
        faces.append((low[::-1], Material.CANOPY, owner))
        trunk = (x - 0.2, y - 0.2, x + 0.2, y + 0.2)
        faces += sides(ring(trunk, GROUND_M), ring(trunk, GROUND_M + 2.6), Material.TRUNK, owner)
    triangles, kinds = [], []
    for corners, material, owner in faces:
        for second in range(1, len(corners) - 1):
            triangles.append([corners[0], corners[second], corners[second + 1]])
            kinds.append((material, owner))
    vertices, index = np.unique(np.reshape(triangles, (-1, 3)), axis=0, return_inverse=True)
    material, owner = np.array(kinds).T
    rows = index.reshape(-1, 3).astype(np.int32)
    return Mesh(vertices, rows, material.astype(np.uint8), owner.astype(np.int32))


@cache
def small_world() -> World:
    """Return the world, the same object each time."""
    x = (np.arange(round(SIDE_M / 0.25)) + 0.5) * 0.25
    east, north = np.meshgrid(x, SIDE_M - x)

    def within(box: Sequence[float]) -> Bools:
        return (east >= box[0]) & (east < box[2]) & (north >= box[1]) & (north < box[3])

    patches = (np.floor(east / 4) * 7 + np.floor(north / 4) * 13 + np.floor(east / 12) * 5) % 5
    ground = np.stack([95 + 9 * patches, 118 + 6 * patches, 70 + 5 * patches], axis=-1)
    ground[(np.abs(east - 48) < 3) | (np.abs(north - 53) < 2)] = (112, 112, 116)
    ground[np.abs(east - 48) < 0.2] = (215, 215, 210)
    ground[within(POND)] = (62, 84, 88)
    top = ground.copy()
    top[within(BLOCK)], top[within(HOUSE)] = (150, 148, 142), (146, 84, 66)
    for tree_x, tree_y, radius in TREES:
        top[(east - tree_x) ** 2 + (north - tree_y) ** 2 < radius**2] = (72, 104, 46)
    caster, sun = Raycaster(small_mesh()), np.array(SURVEY_SUN.direction)
    origins = np.stack([east.ravel(), north.ravel(), np.full(east.size, 200.0)])
    triangle, depth = caster.trace(origins, np.array([[0.0], [0.0], [-1.0]]) + 0.0 * origins)
    origins[2], normals = 200.0 - depth, caster.normal[:, triangle]
    lit = np.maximum(sun @ normals, 0.0) * ~caster.occluded(origins, normals, sun)
    light = np.array(SURVEY_SUN.sky) + np.array(SURVEY_SUN.sun) * lit.reshape(*east.shape, 1)
    heights = origins[2].reshape(east.shape)
    return World(
        region=REGION,
        seed=0,
        mesh=small_mesh(),
        buildings=Buildings(
            wall_colour=np.array([(188, 176, 158), (170, 120, 95)], np.uint8),
            window_colour=np.array([(58, 68, 80), (50, 56, 62)], np.uint8),
            base_m=np.array([GROUND_M, GROUND_M]),
            storey_m=np.array([3.0, 3.0]),
            bay_m=np.array([3.2, 2.8]),
            style=np.array([0, 2], np.uint8),
        ),
        tree_colours=np.array(
            [(70, 105, 45), (85, 110, 50), (60, 95, 50), (90, 120, 60)], np.uint8
        ),
        ground_albedo=ground.astype(np.uint8),
        top_albedo=top.astype(np.uint8),
        water=within(POND),
        dsm=heights.reshape(192, 2, 192, 2).max(axis=(1, 3)).astype(np.float32),
        dom=np.clip(np.rint(top * light), 0, 255).astype(np.uint8),
        satellite=np.zeros((320, 320, 3), np.uint8),
    )


@cache
def small_renderer() -> Renderer:
    return Renderer(small_world())


def camera(width: int = 160, height: int = 120, *, bent: bool = False) -> Cameras:
    """Return a small camera, a pinhole or with a bent lens."""
    straight = default_camera(width, height)
    return Cameras.from_matrices(straight.matrices, width, height, LENS) if bent else straight


def pose(centre: Sequence[float], yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    """Return one pose; the centre is in the world's local frame."""
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], np.array([centre]) + CORNER)


NADIR = pose((48.0, 48.0, 100.0), 20.0, -90.0)
OBLIQUE = pose((48.0, -20.0, 90.0), 5.0, -45.0)
HORIZON = pose((110.0, -10.0, 45.0), -35.0, -10.0)


def rays(camera: Cameras, pose: Poses) -> Floats:
    """Return directions (H * W, 3) in the world, z of the camera being 1."""
    width, height = int(camera.width[0]), int(camera.height[0])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    unit = back_project(camera, np.stack([x.ravel(), y.ravel()], axis=-1)[None])[0]
    directions: Floats = (unit / unit[:, 2:]) @ pose.rotation[0]
    return directions

"""Rays, depth and colours of rendered frames against geometry that is known otherwise."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from airzoo_bench.datasets.mini.renderer import Raycaster, default_camera
from airzoo_bench.datasets.mini.shading import TIMES, WEATHERS
from airzoo_bench.datasets.mini.world import Mesh
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from tests.datasets.mini import conftest as small
from tests.datasets.mini.conftest import BLOCK, CAMERA, CORNER, GROUND_M, HORIZON, NADIR, OBLIQUE

FINE = default_camera(320, 240)


def shot(view: Poses, weather: str = "sunny", time: str = "day", lens: Cameras = CAMERA) -> Floats:
    return small.renderer().render(lens, view, weather, time, 1)[0].astype(float)


def depth_of(view: Poses, lens: Cameras = CAMERA) -> np.ndarray:
    return small.renderer().render(lens, view, "sunny", "day", 1)[1]


def test_a_mesh_far_from_the_origin_of_its_ray_is_met_to_the_last_digits() -> None:
    """A slope seen over a kilometre: single precision alone would be 0.1 mm off."""
    vertices = np.array([[900.0, -50.0, -30.0], [1000.0, -50.0, 70.0], [950.0, 90.0, 20.0]])
    one = np.zeros(1, np.uint8), np.zeros(1, np.int32)
    mesh = Mesh(vertices, np.array([[0, 1, 2]], np.int32), *one)
    origin = np.array([0.1, 0.2, 0.3])
    target = np.array([0.3, 0.3, 0.4]) @ vertices
    _, distance, _ = Raycaster(mesh).trace(origin, (target - origin)[:, None])
    np.testing.assert_allclose(distance, 1.0, atol=1e-14)


def block_and_ground(origin: Floats, directions: Floats) -> Floats:
    """Distance to the ground and the block, by slabs; inf elsewhere."""
    low, high = np.array([*BLOCK[:2], GROUND_M]), np.array([*BLOCK[2:4], BLOCK[4]])
    with np.errstate(divide="ignore"):
        to_low, to_high = (low - origin) / directions, (high - origin) / directions
        ground = (GROUND_M - origin[2]) / directions[:, 2]
    enter = np.minimum(to_low, to_high).max(axis=1)
    leave = np.maximum(to_low, to_high).min(axis=1)
    place = origin[:2] + ground[:, None] * directions[:, :2]
    on_land = ((place > -800.0) & (place < 1400.0)).all(axis=1)  # where the mesh ends
    far = np.where((ground > 0) & on_land, ground, np.inf)
    return np.where((enter <= leave) & (enter > 0), enter, far)


@pytest.mark.parametrize("view", [NADIR, OBLIQUE, HORIZON, small.pose((5, 20, 26), 60, 0, 8)])
def test_depth_against_slabs(view: Poses) -> None:
    truth = block_and_ground((view.centres - CORNER)[0], small.rays(CAMERA, view))
    depth = depth_of(view).ravel()
    # House and trees only come before; rays along a silhouette may fall on either side.
    nearer = (depth > 0) & (depth < truth * (1 - 1e-6) - 1e-4)
    truth = np.where(np.isinf(truth), 0.0, truth)
    same = np.abs(depth - truth) <= 1e-6 * truth
    assert (same | nearer).mean() > 0.999
    assert same.mean() > 0.75


def test_depth_is_exact_to_the_bit() -> None:
    """Of level land and roofs from straight above, and of a wall that is looked at squarely."""
    depth = depth_of(NADIR)
    assert (depth.shape, depth.dtype) == ((120, 160), np.float32)
    assert {np.float32(100 - GROUND_M), np.float32(100 - BLOCK[4])} <= set(depth.ravel().tolist())
    assert depth.max() == np.float32(100 - GROUND_M)
    depth = depth_of(small.pose((30, 0, 26), 0, 0))
    focal = CAMERA.focal[0, 0]
    wide, high = int(10.0 / 30.0 * focal) - 1, int(6 / 30 * focal) - 1
    wall = depth[60 - high : 60 + high, 80 - wide : 80 + wide]
    np.testing.assert_array_equal(wall, np.float32(30.0))
    assert depth[0, 80] == 0.0  # sky above the roof


def test_conditions_never_change_depth() -> None:
    lens, render = default_camera(80, 60), small.renderer().render
    frames = [render(lens, HORIZON, *given, 5) for given in product(WEATHERS, TIMES)]
    picture, depth = frames[0]
    assert (len(frames), len({other.tobytes() for _, other in frames})) == (15, 1)
    up = small.rays(lens, HORIZON).reshape(60, 80, 3)[..., 2] >= 0
    assert not depth[up].any()
    assert (depth[-10:] > 0.0).all()
    # Land goes on to the horizon, where the mesh has ended.
    beyond = (depth == 0.0) & ~up
    assert beyond.any()
    assert np.abs(picture[beyond].mean(axis=0) - picture[up].mean(axis=0)).max() > 3.0


def test_shadows_are_of_the_sun() -> None:
    """The block stands 12 m high and the sun, in (-6, -10, 15), rises 1.5 m a metre of northing.

    North of the wall its shadow so reaches 8 m.
    """

    def at(picture: np.ndarray, north: float) -> float:
        point = np.array([[[34.0, BLOCK[3] + north, 20.0]]]) + CORNER
        x, y = project(FINE, world_to_camera(NADIR, point))[0, 0].astype(int)
        return float(picture[y - 1 : y + 2, x - 1 : x + 2].mean())

    for weather, shady in (("sunny", True), ("cloudy", False)):
        picture = shot(NADIR, weather, lens=FINE)
        assert (at(picture, 6.5) < 0.6 * at(picture, 9.5)) == shady

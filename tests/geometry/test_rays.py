from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project, project
from airzoo_bench.geometry.poses import Poses, rays_to_world, world_to_camera
from airzoo_bench.geometry.rays import RayStatus, intersect_plane

from .support import LENSES, looking_down, quick, seeds

NAN = np.nan
UTM = np.array((576661.0, 5188212.0))


def names(status: np.ndarray) -> list[str]:
    return [RayStatus(value).name for value in status.ravel()]


def test_tilted_camera_worked_by_hand() -> None:
    # 100 m above ground, looking north 45 degrees down; f = 100 px, image 200 x 200 px.
    K = [[[100, 0, 100], [0, 100, 100], [0, 0, 1]]]
    camera = Cameras.from_matrices(K, 200, 200)
    pose = Poses.from_centres(looking_down(45.0), [[0, 0, 100]])
    # The axis meets the ground 100 m north. The pixel 50 px below it looks atan(1/2) lower:
    # tan of its angle from the vertical is (1 - 1/2) / (1 + 1/2) = 1/3, 33.333 m north.
    # The pixel 50 px right of the axis has (x, y, z) = (0.5, 0, 1), z along (0, 1, -1) / sqrt 2:
    # 100 m down take 100 sqrt 2 of z, which is 70.711 m to the east, 100 m north.
    # The pixel 100 px above the axis looks 45 degrees up from it: to the horizon.
    pixels = np.array([[[100, 100], [100, 150], [150, 100], [100, 0]]], float)
    directions = rays_to_world(pose, back_project(camera, pixels))
    points, valid, status = intersect_plane(pose.centres, directions, 0.0, 1e4)
    expected = [(0, 100, 0), (0, 100 / 3, 0), (50 * np.sqrt(2), 100, 0)]
    np.testing.assert_allclose(points[0, :3], expected, rtol=0, atol=1e-10)
    assert valid.tolist() == [[True, True, True, False]]
    # The horizon by rounding is a hair up or down: no ground point either way.
    assert names(status)[:3] == ["HIT"] * 3
    assert names(status)[3] in ("NOT_DOWNWARD", "BEYOND_RANGE")
    assert np.isnan(points[0, 3]).all()


def test_anchors_fail_without_the_half_pixel() -> None:
    # Nadir over the origin, 10 m up, f = 10 px: a pixel is a metre. 16 px wide, axis in the
    # middle (8, 8), the corner of four pixels: anchors at 1 and 15 lie 7 m to each side.
    camera = Cameras.from_matrices([[[10, 0, 8], [0, 10, 8], [0, 0, 1]]], 16, 16)
    pose = Poses.from_centres(looking_down(0.0), [[0, 0, 10]])
    directions = rays_to_world(pose, back_project(camera, anchor_pixels(camera)))
    points = intersect_plane(pose.centres, directions, 0.0, 1e4).points
    expected = [(-7, 7, 0), (7, 7, 0), (7, -7, 0), (-7, -7, 0)]
    np.testing.assert_allclose(points[0], expected, rtol=0, atol=1e-13)


def test_reasons_on_the_plane() -> None:
    down, level, up, away = (0, 0, -2), (1, 0, 0), (0, 1, 1), (3, 0, -4)
    directions = np.tile(
        np.array([(down, level, up, away, (NAN, 0, -1), (0, 0, 0))], float), (3, 1, 1)
    )
    origins = np.array([(0, 0, 40), (0, 0, 10), (0, 0, 7)], float)
    # Plane at 10: 30 m below the first; the slanted ray 5/4 * 30 = 37.5 m, right at the range.
    hits = intersect_plane(origins, directions, 10.0, 37.5)
    common = ["NOT_DOWNWARD", "NOT_DOWNWARD"]
    assert names(hits.status[0]) == ["HIT", *common, "HIT", "NO_RAY", "NO_RAY"]
    for below in (1, 2):
        expected = ["BEHIND", *common, "BEHIND", "NO_RAY", "NO_RAY"]
        assert names(hits.status[below]) == expected
    assert hits.points[0, 3].tolist() == [22.5, 0, 10]
    assert np.isnan(hits.points[~hits.valid]).all()
    shorter = intersect_plane(origins, directions, (10.0, 9.0, 0.0), 37.49)
    assert names(shorter.status[:, 3]) == ["BEYOND_RANGE", "HIT", "HIT"]
    assert shorter.points[:, 0, 2].tolist() == [10, 9, 0]
    with pytest.raises(RasterError, match="not finite"):
        intersect_plane(origins, directions, NAN, 100.0)


@quick
@given(seeds)
def test_pixel_to_ground_and_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = len(LENSES)
    K = np.tile(((2000.0, 0, 2000), (0, 2000, 1100), (0, 0, 1)), (count, 1, 1))
    cameras = Cameras.from_matrices(K, 4000, 2200, LENSES)
    R = np.repeat(looking_down(rng.uniform(0, 50), rng.uniform(0, 360)), count, axis=0)
    centres = np.array((*UTM, 120.0)) + rng.uniform(-50, 50, (count, 3))
    poses = Poses.from_centres(R, centres)
    pixels = rng.uniform((200, 200), (3800, 2000), (count, 30, 2))
    directions = rays_to_world(poses, back_project(cameras, pixels))
    hits = intersect_plane(poses.centres, directions, 3.0, 1e4)
    assert hits.valid.mean() > 0.5
    assert (hits.points[hits.valid][:, 2] == 3.0).all()
    back = project(cameras, world_to_camera(poses, hits.points))
    np.testing.assert_allclose(back[hits.valid], pixels[hits.valid], rtol=0, atol=1e-6)
    again = rays_to_world(poses, back_project(cameras, back))
    ground = intersect_plane(poses.centres, again, 3.0, 1e4).points
    far = np.linalg.norm(hits.points - centres[:, None], axis=-1) > 2000
    near = hits.valid & ~far
    np.testing.assert_allclose(ground[near], hits.points[near], rtol=0, atol=1e-6)

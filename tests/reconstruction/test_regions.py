"""Columns that a cloud covers, and what photos see of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.preparation import (
    bounding_box,
    covered_columns,
    observed_cells,
    occupied_cells,
    seen_by,
)
from tests.geometry.support import looking_down, quick, seeds
from tests.reconstruction.cloud_support import Pieces, settings

UTM = np.array((500_000.0, 5_200_000.0, 100.0))


@quick
@given(seeds)
def test_cells_hold_the_points_that_made_them_and_their_neighbours(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(-9, 9, (40, 3)) + UTM
    found = occupied_cells([points[:13], points[13:]], (2.0, 1.0, 0.5), bounding_box(points))
    assert found.holds(points).all()
    others = random.uniform(-12, 12, (400, 3)) + UTM
    cells = {tuple(cell) for cell in np.floor(points / (2.0, 1.0, 0.5)).tolist()}
    expected = [tuple(cell) in cells for cell in np.floor(others / (2.0, 1.0, 0.5)).tolist()]
    np.testing.assert_array_equal(found.holds(others), expected)
    assert found.holds(found.centres()).all()


@quick
@given(seeds)
def test_columns_reach_as_far_as_the_margin(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(0, 60, (5, 3)) + UTM
    margin, size = float(random.uniform(0.5, 12)), 4.0
    columns = covered_columns([points], size, bounding_box(points), margin)
    others = random.uniform(-30, 90, (2000, 3)) + UTM
    held = columns.holds(others)
    away = np.linalg.norm(others[:, None, :2] - points[None, :, :2], axis=-1).min(axis=1)
    upright = (others[:, 2] >= points[:, 2].min() - margin) & (
        others[:, 2] <= points[:, 2].max() + margin
    )
    # All within the margin are held, and none that is two columns' diagonals farther.
    assert held[upright & (away < margin)].all()
    assert not held[away > margin + 2 * size * np.sqrt(2)].any()
    assert not held[~upright].any()


def test_points_far_from_the_grid_are_not_held() -> None:
    columns = covered_columns([UTM[None]], 4.0, bounding_box(UTM[None]), 5.0)
    far = UTM + np.array([[1e9, 0, 0], [0, 1e140, 0], [0, 0, -1e9]])
    assert not columns.holds(far).any()
    assert columns.holds(UTM[None]).all()


def test_a_cloud_that_spans_the_world_is_refused() -> None:
    points = np.array([[0.0, 0, 0], [1e9, 1e9, 1e9]])
    with pytest.raises(BenchmarkError, match="spans 1e\\+09 x 1e\\+09"):
        occupied_cells([points], (0.5, 0.5, 0.5), bounding_box(points))


def plain_camera(distortion: float = 0.0) -> Cameras:
    lens = np.array([[distortion, 0, 0, 0, 0]])
    size = np.array([400]), np.array([300])
    return Cameras(*size, np.array([[400.0, 400.0]]), np.array([[200.0, 150.0]]), lens)


def above(height: float, east: float = 0.0) -> Poses:
    return Poses(rotation=looking_down(0.0).reshape(1, 3, 3), centres=UTM[None] + (east, 0, height))


def level(height: float, half: float = 80.0) -> np.ndarray:
    along = np.arange(-half + 0.5, half)
    x, y = np.meshgrid(along, along, indexing="ij")
    return np.stack((x.ravel(), y.ravel(), np.full(x.size, height)), axis=1) + UTM


@pytest.mark.parametrize("distortion", [0.0, -0.2])
def test_what_is_inside_of_the_photo_is_seen(distortion: float) -> None:
    points = level(0.0)
    seen = seen_by(points, plain_camera(distortion), above(100.0), 1.0, 3.0)
    x, y = np.abs(points - UTM)[:, :2].T
    if distortion == 0.0:
        np.testing.assert_array_equal(seen[y != 37.5], ((x < 50) & (y < 37.5))[y != 37.5])
    else:
        assert seen[(x < 50) & (y < 37.5)].all()
        assert not seen[(x > 60) | (y > 50)].any()


def test_what_is_under_a_roof_is_hidden() -> None:
    ground, roof = level(0.0), level(12.0, half=8.0)
    points = np.concatenate((ground, roof))
    seen = seen_by(points, plain_camera(), above(100.0), 1.0, 3.0)
    x, y = np.abs(ground - UTM)[:, :2].T
    # The roof, 8 m to each side, hides 9.1 m of the ground; a cell of the buffer is about 2 m wide.
    under = (x < 7) & (y < 7)
    around = (x < 50) & (y < 37) & ((x > 12) | (y > 12))
    assert seen[len(ground) :].all()
    assert not seen[: len(ground)][under].any()
    assert seen[: len(ground)][around].all()


def test_what_one_photo_sees_is_not_observed() -> None:
    points = level(0.0)
    box = bounding_box(points)
    poses = Poses(
        rotation=np.concatenate([above(100.0).rotation] * 2),
        centres=np.concatenate([above(100.0, -40.0).centres, above(100.0, 40.0).centres]),
    )
    cameras = plain_camera()
    two = Cameras(*(np.repeat(getattr(cameras, name), 2, axis=0) for name in FIELDS))
    found = observed_cells(Pieces(points), box, two, poses, settings(), 1000)
    x, y = np.abs(points - UTM)[:, :2].T
    off = y != 37.5  # the border of a photo
    np.testing.assert_array_equal(found.holds(points[off]), ((x < 10) & (y < 37.5))[off])
    with pytest.raises(BenchmarkError, match="seen by 3 photos"):
        observed_cells(Pieces(points), box, two, poses, settings(observed_photos=3), 1000)


FIELDS = ("width", "height", "focal", "principal_point", "distortion")


def test_oblique_views_of_level_ground_hide_none_of_it() -> None:
    points = level(0.0)
    tilted = Poses(
        rotation=looking_down(50.0).reshape(1, 3, 3), centres=UTM[None] + (0, -70.0, 60.0)
    )
    with_all = seen_by(points, plain_camera(), tilted, 1.0, 1e9)
    seen = seen_by(points, plain_camera(), tilted, 1.0, 5.0)
    assert with_all.sum() > 2000
    assert seen.sum() > 0.99 * with_all.sum()

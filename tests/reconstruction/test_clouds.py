"""Which points are compared: regions, voxels, points that the photos saw, and counts."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.formats.clouds.cloud import ArrayPieces
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.clouds import (
    PieceCloud,
    PreparedCloud,
    VoxelGrid,
    box_of,
    cloud_of,
    covered_columns,
    cropped_region,
    observed_cells,
    occupied_cells,
    prepare_cloud,
    seen_by,
    transform_cloud,
)
from airzoo_bench.reconstruction.settings import Preparation
from tests.geometry.support import looking_down, quick, seeds
from tests.reconstruction.support import UTM, clouds


def settings(**changes: Any) -> Preparation:
    crop = {"crop": "none", "crop_margin_m": 1.0, "crop_cell_m": 1.0}
    region = {"region": "all", "observed_photos": 2, "observed_cell_m": 1.0, "hidden_beyond_m": 3.0}
    return Preparation(**(crop | region | {"voxel_m": "none"} | changes))


def thinned(points: Floats, size: float, step: int = 1 << 30, most: int | None = None) -> Floats:
    """Thin a cloud that is added in pieces."""
    grid = VoxelGrid(size, np.zeros(3), most)
    for start in range(0, len(points), step):
        grid.add(points[start : start + step])
    return grid.points()


def test_voxels_by_hand() -> None:
    points = np.array([(0.5, 0.5, 0.5), (-0.5, 0.0, 0.0), (0.75, 1.75, 0.0), (0.25, 1.25, 0.5)])
    assert thinned(points, 1.0).tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, 1.5, 0.25]]


@given(clouds(), st.integers(0, 2**32 - 1), st.sampled_from((0.05, 0.1, 0.3, 1.0, 1e-9)))
@quick
def test_no_bit_depends_on_order_or_pieces(points: Floats, seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    shuffled, step = random.permutation(points), int(random.integers(1, len(points) + 1))
    assert thinned(shuffled, size, step).tobytes() == thinned(points, size).tobytes()


def test_voxels_beyond_the_limit_are_refused() -> None:
    points = np.random.default_rng(0).uniform(0, 10, (1000, 3))
    occupied = len(thinned(points, 1.0))
    assert len(thinned(points, 1.0, 300, occupied)) == occupied
    with pytest.raises(UsageError):
        thinned(points, 1.0, 300, occupied - 1)


def prepare(points: Floats, block: int, **changes: Any) -> PreparedCloud:
    """Prepare a cloud whose truth is two corners of the unit cube."""
    used, truth = settings(**changes), cloud_of(np.array(((0.0, 0, 0), (1, 1, 1))))
    region = cropped_region(truth, box_of(truth), used, block)
    return prepare_cloud(cloud_of(points), used, region, block)


def points_of(cloud: PreparedCloud, points: int = 3) -> Floats:
    parts = [piece.points for piece in cloud.source.pieces(points)]
    assert all(len(part) <= points for part in parts)
    found = np.concatenate([np.zeros((0, 3)), *parts])
    assert len(found) == cloud.source.count
    return found


def test_points_left_out_are_counted() -> None:
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 2, np.inf], [5, 5, 5], [0, -1e200, 0]])
    cloud = prepare(points, 2)
    assert (cloud.not_finite, cloud.outside, cloud.thinned) == (3, 0, 0)
    np.testing.assert_array_equal(points_of(cloud), points[[0, 3]])
    # Voxels thin what the crop has left; they begin at 0.191 of 0.5.
    points = np.array([[0.2, 0.1, 0.1], [0.4, 0.1, 0.1], [0.7, 0.1, 0.1], [9, 9, 9.0]])
    cloud = prepare(points, 1, crop="covered", crop_margin_m=0.0, voxel_m=0.5)
    assert (cloud.outside, cloud.thinned) == (1, 1)
    np.testing.assert_allclose(points_of(cloud), [[0.3, 0.1, 0.1], [0.7, 0.1, 0.1]], atol=1e-9)


def test_moving_keeps_the_more_confident_points() -> None:
    points = np.array([[1.0, 0, 0], [0, 1, 0], [np.inf, 0, 0]])
    transform = Similarity(2.0, np.eye(3), np.array((10.0, 0, 0)))
    trusted = PieceCloud(3, ArrayPieces(points, np.array([0.2, 0.5, 0.9], np.float32)))
    everything = next(transform_cloud(trusted, transform).pieces(10))
    np.testing.assert_array_equal(everything.points[:2], [[12, 0, 0], [10, 2, 0]])
    assert not np.isfinite(everything.points[2]).all()
    assert len(next(transform_cloud(trusted, transform, 0.2).pieces(10))) == 2
    # Clouds without confidences keep all points.
    assert len(next(transform_cloud(cloud_of(points), transform, 0.9).pieces(10))) == 3


@quick
@given(seeds)
def test_cells_and_columns_hold_what_is_near(seed: int) -> None:
    random = np.random.default_rng(seed)
    points, others = random.uniform(-9, 9, (40, 3)) + UTM, random.uniform(-12, 12, (400, 3)) + UTM
    found = occupied_cells([points[:13], points[13:]], (2.0, 1.0, 0.5), box_of(cloud_of(points)))
    assert found.holds(points).all()
    cells = {tuple(cell) for cell in np.floor(points / (2.0, 1.0, 0.5)).tolist()}
    expected = [tuple(cell) in cells for cell in np.floor(others / (2.0, 1.0, 0.5)).tolist()]
    np.testing.assert_array_equal(found.holds(others), expected)
    points, others = points[:5], random.uniform(-40, 40, (2000, 3)) + UTM
    margin, size = float(random.uniform(0.5, 12)), 4.0
    held = covered_columns([points], size, box_of(cloud_of(points)), margin)(others)
    away = np.linalg.norm(others[:, None, :2] - points[None, :, :2], axis=-1).min(axis=1)
    low, high = points[:, 2].min() - margin, points[:, 2].max() + margin
    upright = (others[:, 2] >= low) & (others[:, 2] <= high)
    # All within the margin are held, and none that is two columns' diagonals farther.
    assert held[upright & (away < margin)].all()
    assert not held[(away > margin + 2 * size * np.sqrt(2)) | ~upright].any()


# --- the points that the photos saw ---

SIZE = np.array([400]), np.array([300])
PLAIN = Cameras(*SIZE, np.array([[400.0, 400.0]]), np.array([[200.0, 150.0]]), np.zeros((1, 5)))


def above(height: float, east: float = 0.0) -> Poses:
    return Poses(rotation=looking_down(0.0).reshape(1, 3, 3), centres=UTM[None] + (east, 0, height))


def level(height: float, half: float = 80.0) -> Floats:
    along = np.arange(-half + 0.5, half)
    x, y = np.meshgrid(along, along, indexing="ij")
    return np.stack((x.ravel(), y.ravel(), np.full(x.size, height)), axis=1) + UTM


def test_points_under_a_roof_and_outside_of_the_photo_are_hidden() -> None:
    ground, roof = level(0.0), level(12.0, half=8.0)
    x, y = np.abs(ground - UTM)[:, :2].T
    inside, border = (x < 50) & (y < 37.5), np.abs(y - 37.5) < 0.25
    seen = seen_by(ground, PLAIN, above(100.0), 1.0, 3.0)
    np.testing.assert_array_equal(seen[~border], inside[~border])
    seen = seen_by(np.concatenate((ground, roof)), PLAIN, above(100.0), 1.0, 3.0)
    # The roof, 8 m to each side, hides 9.1 m of the ground; a cell of the buffer is about 2 m wide.
    assert seen[len(ground) :].all()
    assert not seen[: len(ground)][(x < 7) & (y < 7)].any()
    assert seen[: len(ground)][inside & (y < 37) & ((x > 12) | (y > 12))].all()


def test_points_that_one_photo_sees_are_not_observed() -> None:
    points = level(0.0)
    both = [np.repeat(getattr(PLAIN, one.name), 2, axis=0) for one in fields(PLAIN)]
    pair = [above(100.0, east) for east in (-40.0, 40.0)]
    poses = Poses(
        rotation=np.concatenate([one.rotation for one in pair]),
        centres=np.concatenate([one.centres for one in pair]),
    )
    given_all = (cloud_of(points), box_of(cloud_of(points)), Cameras(*both), poses)
    found = observed_cells(*given_all, settings(), 1000)
    x, y = np.abs(points - UTM)[:, :2].T
    off = np.abs(y - 37.5) > 0.75  # the border of a photo
    off &= np.abs(x - 10) > 0.75
    np.testing.assert_array_equal(found.holds(points[off]), ((x < 10) & (y < 37.5))[off])
    with pytest.raises(BenchmarkError):
        observed_cells(*given_all, settings(observed_photos=3), 1000)

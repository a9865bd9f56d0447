"""Which points are compared: regions, voxels, what the photos saw, and what is counted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.clouds import (
    InMemoryCloud,
    VoxelGrid,
    transform_cloud,
)
from airzoo_bench.reconstruction.preparation import (
    Box,
    PreparedCloud,
    box_of,
    covered_columns,
    cropped_region,
    observed_cells,
    occupied_cells,
    prepare_cloud,
    seen_by,
)
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.similarity import Similarity
from tests.geometry.support import looking_down, quick, seeds
from tests.reconstruction.cloud_support import Pieces, clouds, settings

ORIGIN = np.zeros(3)


def voxel_downsample(points: Floats, *, size: float, origin: Floats) -> Floats:
    """Thin a cloud that is added in one piece."""
    grid = VoxelGrid(size, origin)
    grid.add(points)
    return grid.points()


def test_by_hand() -> None:
    points = np.array([(0.5, 0.5, 0.5), (-0.5, 0.0, 0.0), (0.75, 1.75, 0.0), (0.25, 1.25, 1.0)])
    points[3, 2] = 0.5
    small = voxel_downsample(points, size=1.0, origin=ORIGIN)
    assert small.tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, 1.5, 0.25]]


@given(clouds(), st.integers(0, 2**32 - 1), st.sampled_from((0.05, 0.1, 0.3, 1.0, 1e-9)))
@quick
def test_no_bit_depends_on_order_or_pieces(points: Floats, seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    shuffled = random.permutation(points)
    expected = voxel_downsample(points, size=size, origin=ORIGIN).tobytes()
    assert voxel_downsample(shuffled, size=size, origin=ORIGIN).tobytes() == expected
    grid, step = VoxelGrid(size, ORIGIN), int(random.integers(1, len(points) + 1))
    for start in range(0, len(points), step):
        grid.add(shuffled[start : start + step])
    assert grid.points().tobytes() == expected


@given(clouds(), st.sampled_from((0.05, 0.1, 0.3, 1.0)))
@quick
def test_against_a_dictionary(points: Floats, size: float) -> None:
    voxels: dict[tuple[float, ...], list[Floats]] = {}
    for point in points:
        voxels.setdefault(tuple(np.floor(point / size)), []).append(point)
    means = np.array([np.mean(voxels[key], axis=0) for key in sorted(voxels)])
    small = voxel_downsample(points, size=size, origin=ORIGIN)
    tolerance = size * 2.0**-31 + np.abs(points).max() * 1e-15
    assert small.shape == means.shape
    assert np.abs(small - means).max() <= tolerance


def test_voxels_beyond_the_limit_are_refused() -> None:
    points = np.random.default_rng(0).uniform(0, 10, (5000, 3))
    occupied = len(voxel_downsample(points, size=1.0, origin=np.zeros(3)))
    grid = VoxelGrid(1.0, np.zeros(3), occupied)
    for start in range(0, 5000, 300):
        grid.add(points[start : start + 300])
    assert len(grid.points()) == occupied
    with pytest.raises(UsageError, match=f"more than {occupied:,} voxels of 1 m"):  # noqa: PT012
        grid.add(np.full((1, 3), 50.0))
        grid.points()


BOX = Box(np.zeros(3), np.ones(3))


def prepare(source: CloudSource, used: Preparation, block: int) -> PreparedCloud:
    """Prepare a cloud whose truth is the unit cube's corners."""
    truth = Pieces(np.stack((BOX.low, BOX.high)))
    return prepare_cloud(source, used, cropped_region(truth, BOX, used, block), block)


def points_of(cloud: PreparedCloud, points: int = 3) -> np.ndarray[Any, Any]:
    parts = [piece.points for piece in cloud.source.pieces(points)]
    assert all(len(part) <= points for part in parts)
    found = np.concatenate([np.zeros((0, 3)), *parts])
    assert len(found) == cloud.source.count
    return found


def test_points_that_are_not_finite_are_counted_and_left_out() -> None:
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 2, np.inf], [5, 5, 5], [0, -1e200, 0]])
    cloud = prepare(Pieces(points), settings(), 2)
    assert (cloud.not_finite, cloud.outside, cloud.thinned) == (3, 0, 0)
    np.testing.assert_array_equal(points_of(cloud), points[[0, 3]])


def test_voxels_thin_what_the_crop_has_left() -> None:
    # Voxels begin at 0.191 of 0.5.
    points = np.array([[0.2, 0.1, 0.1], [0.4, 0.1, 0.1], [0.7, 0.1, 0.1], [9, 9, 9.0]])
    cloud = prepare(Pieces(points), settings(crop="box", crop_margin_m=0.0, voxel_m=0.5), 1)
    assert (cloud.outside, cloud.thinned) == (1, 1)
    np.testing.assert_allclose(points_of(cloud), [[0.3, 0.1, 0.1], [0.7, 0.1, 0.1]], atol=1e-9)


@quick
@given(seeds, st.integers(1, 400))
def test_nothing_depends_on_the_pieces(seed: int, block: int) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(size=(300, 3))
    points[random.random(300) < 0.1] = np.nan
    for used in (settings(), settings(crop="box", crop_margin_m=0.3), settings(voxel_m=0.2)):
        one, other = (prepare(Pieces(points), used, size) for size in (300, block))
        np.testing.assert_array_equal(points_of(one), points_of(other, 7))
        np.testing.assert_array_equal(one.bounds, other.bounds)
        assert (one.not_finite, one.outside, one.thinned) == (
            other.not_finite,
            other.outside,
            other.thinned,
        )


class Confident(Pieces):
    def pieces(self, points: int) -> Iterator[Cloud]:
        for piece in super().pieces(points):
            yield Cloud(piece.points, confidence=np.array([0.2, 0.5, 0.9], np.float32))


def test_moving_keeps_the_more_confident_points() -> None:
    points = np.array([[1.0, 0, 0], [0, 1, 0], [np.inf, 0, 0]])
    transform = Similarity(2.0, np.eye(3), np.array((10.0, 0, 0)))
    everything = next(transform_cloud(Confident(points), transform).pieces(10))
    np.testing.assert_array_equal(everything.points[:2], [[12, 0, 0], [10, 2, 0]])
    assert not np.isfinite(everything.points[2]).all()
    kept = next(transform_cloud(Confident(points), transform, 0.2).pieces(10))
    np.testing.assert_array_equal(kept.points[0], [10, 2, 0])
    assert len(kept) == 2
    # Without confidences nothing is asked of them.
    assert len(next(transform_cloud(InMemoryCloud(points), transform, 0.9).pieces(10))) == 3


UTM = np.array((500_000.0, 5_200_000.0, 100.0))


@quick
@given(seeds)
def test_cells_hold_the_points_that_made_them_and_their_neighbours(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(-9, 9, (40, 3)) + UTM
    found = occupied_cells([points[:13], points[13:]], (2.0, 1.0, 0.5), box_of(Pieces(points)))
    assert found.holds(points).all()
    others = random.uniform(-12, 12, (400, 3)) + UTM
    cells = {tuple(cell) for cell in np.floor(points / (2.0, 1.0, 0.5)).tolist()}
    expected = [tuple(cell) in cells for cell in np.floor(others / (2.0, 1.0, 0.5)).tolist()]
    np.testing.assert_array_equal(found.holds(others), expected)


@quick
@given(seeds)
def test_columns_reach_as_far_as_the_margin(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(0, 60, (5, 3)) + UTM
    margin, size = float(random.uniform(0.5, 12)), 4.0
    columns = covered_columns([points], size, box_of(Pieces(points)), margin)
    others = random.uniform(-30, 90, (2000, 3)) + UTM
    held = columns(others)
    away = np.linalg.norm(others[:, None, :2] - points[None, :, :2], axis=-1).min(axis=1)
    upright = (others[:, 2] >= points[:, 2].min() - margin) & (
        others[:, 2] <= points[:, 2].max() + margin
    )
    # All within the margin are held, and none that is two columns' diagonals farther.
    assert held[upright & (away < margin)].all()
    assert not held[away > margin + 2 * size * np.sqrt(2)].any()
    assert not held[~upright].any()


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
    box = box_of(Pieces(points))
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

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.clouds import VoxelGrid, finite_rows
from airzoo_bench.reconstruction.preparation import bounding_box
from tests.geometry.support import quick
from tests.reconstruction.cloud_support import clouds, surface

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


def test_borders_belong_to_the_voxel_above() -> None:
    points = np.array([(1.0, 0.0, 0.0), (0.999, 0.0, 0.0), (-1e-300, 0.0, 0.0)])
    small = voxel_downsample(points, size=1.0, origin=ORIGIN)
    assert len(small) == 3
    moved = voxel_downsample(points, size=1.0, origin=np.array((0.5, 0.0, 0.0)))
    assert moved[:, 0].tolist() == pytest.approx([0.0, 0.9995])


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


@pytest.mark.parametrize("far", [1e3, 1e12, 1e40, 1e149])
def test_one_point_however_far_changes_no_other(far: float) -> None:
    points = surface(2000, 0)
    alone = voxel_downsample(points, size=2.0, origin=ORIGIN)
    with_far = voxel_downsample(np.vstack((points, (far, -far, far))), size=2.0, origin=ORIGIN)
    assert np.array_equal(with_far[:-1], alone)
    assert with_far[-1] == pytest.approx((far, -far, far), rel=1e-3 if far < 1e4 else 1e-12)


def test_a_million_metres_from_the_origin() -> None:
    points, shift = surface(3000, 0), np.array((1_000_000.0, 4_000_000.0, 0.0))
    near = voxel_downsample(points, size=0.5, origin=ORIGIN)
    far = voxel_downsample(points + shift, size=0.5, origin=ORIGIN)
    assert np.abs(far - shift - near).max() < 5e-9


def test_nothing_stays_nothing() -> None:
    assert len(voxel_downsample(np.zeros((0, 3)), size=1.0, origin=ORIGIN)) == 0


def test_points_whose_squares_are_no_numbers_are_not_finite() -> None:
    points = np.arange(21.0).reshape(7, 3)
    for row, value in enumerate((np.nan, np.inf, -np.inf, 1e200)):
        points[row, row % 3] = value
    assert finite_rows(points).tolist() == [False] * 4 + [True] * 3


def test_regions_have_their_borders() -> None:
    box = bounding_box(np.array([(0.0, 1.0, 2.0), (3.0, 0.0, 5.0)]))
    assert (box.low.tolist(), box.high.tolist()) == ([0.0, 0.0, 2.0], [3.0, 1.0, 5.0])
    grown = box.grown(0.5)
    points = np.array([(-0.5, -0.5, 1.5), (3.5, 1.5, 5.5), (3.6, 0.0, 3.0), (0.0, 0.0, 1.4)])
    assert grown.holds(points).tolist() == [True, True, False, False]
    assert box.holds(points).tolist() == [False] * 4


def test_voxels_beyond_the_limit_are_refused() -> None:
    points = np.random.default_rng(0).uniform(0, 10, (5000, 3))
    occupied = len(voxel_downsample(points, size=1.0, origin=np.zeros(3)))
    grid = VoxelGrid(1.0, np.zeros(3), occupied)
    for start in range(0, 5000, 300):
        grid.add(points[start : start + 300])
    assert len(grid.points()) == occupied
    with pytest.raises(UsageError, match=f"more than {occupied:,} voxels of 1 m"):
        grid.add(np.full((1, 3), 50.0))

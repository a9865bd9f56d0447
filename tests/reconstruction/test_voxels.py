from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import UsageError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.regions import bounding_box
from airzoo_bench.reconstruction.sources import finite_rows, take
from airzoo_bench.reconstruction.voxels import VoxelGrid
from tests.geometry.support import quick
from tests.reconstruction.cloud_support import clouds, surface

ORIGIN = np.zeros(3)


def voxel_downsample(cloud: Cloud, *, size: float, origin: Floats) -> Cloud:
    """Thin a cloud that is added in one piece."""
    grid = VoxelGrid(size, origin)
    grid.add(cloud)
    return grid.cloud()


def dressed(points: Floats, seed: int = 0) -> Cloud:
    """Give points colours and confidences."""
    random = np.random.default_rng(seed)
    return Cloud(
        points,
        random.integers(0, 256, (len(points), 3), dtype=np.uint8),
        random.random(len(points), dtype=np.float32),
    )


def bytes_of(cloud: Cloud) -> tuple[bytes, ...]:
    assert cloud.colours is not None
    assert cloud.confidence is not None
    return cloud.points.tobytes(), cloud.colours.tobytes(), cloud.confidence.tobytes()


def test_by_hand() -> None:
    points = np.array([(0.5, 0.5, 0.5), (-0.5, 0.0, 0.0), (0.75, 1.75, 0.0), (0.25, 1.25, 1.0)])
    points[3, 2] = 0.5
    colours = np.array([(1, 2, 3), (7, 7, 7), (0, 10, 255), (1, 13, 255)], dtype=np.uint8)
    confidence = np.array([1.0, 2.0, 3.0, 4.0], dtype=np.float32)
    small = voxel_downsample(Cloud(points, colours, confidence), size=1.0, origin=ORIGIN)
    assert small.points.tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, 1.5, 0.25]]
    assert small.colours is not None
    assert small.confidence is not None
    assert small.colours.tolist() == [[7, 7, 7], [1, 2, 3], [1, 12, 255]]  # halves go up
    assert small.confidence.tolist() == [2.0, 1.0, 4.0]
    assert (small.colours.dtype, small.confidence.dtype) == (np.uint8, np.float32)


def test_borders_belong_to_the_voxel_above() -> None:
    points = np.array([(1.0, 0.0, 0.0), (0.999, 0.0, 0.0), (-1e-300, 0.0, 0.0)])
    small = voxel_downsample(Cloud(points), size=1.0, origin=ORIGIN)
    assert len(small) == 3
    moved = voxel_downsample(Cloud(points), size=1.0, origin=np.array((0.5, 0.0, 0.0)))
    assert moved.points[:, 0].tolist() == pytest.approx([0.0, 0.9995])


@given(clouds(), st.integers(0, 2**32 - 1), st.sampled_from((0.05, 0.1, 0.3, 1.0, 1e-9)))
@quick
def test_no_bit_depends_on_order_or_pieces(points: Floats, seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    cloud = dressed(points, seed)
    order = random.permutation(len(points))
    expected = bytes_of(voxel_downsample(cloud, size=size, origin=ORIGIN))
    shuffled = Cloud(points[order], cloud.colours[order], cloud.confidence[order])  # type: ignore[index]
    assert bytes_of(voxel_downsample(shuffled, size=size, origin=ORIGIN)) == expected
    grid, step = VoxelGrid(size, ORIGIN), int(random.integers(1, len(points) + 1))
    for start in range(0, len(points), step):
        grid.add(take(shuffled, slice(start, start + step)))
    assert bytes_of(grid.cloud()) == expected


@given(clouds(), st.sampled_from((0.05, 0.1, 0.3, 1.0)))
@quick
def test_against_a_dictionary(points: Floats, size: float) -> None:
    voxels: dict[tuple[float, ...], list[Floats]] = {}
    for point in points:
        voxels.setdefault(tuple(np.floor(point / size)), []).append(point)
    means = np.array([np.mean(voxels[key], axis=0) for key in sorted(voxels)])
    small = voxel_downsample(Cloud(points), size=size, origin=ORIGIN)
    tolerance = size * 2.0**-31 + np.abs(points).max() * 1e-15
    assert small.points.shape == means.shape
    assert np.abs(small.points - means).max() <= tolerance


@pytest.mark.parametrize("far", [1e3, 1e12, 1e40, 1e149])
def test_one_point_however_far_changes_no_other(far: float) -> None:
    points = surface(2000, 0)
    alone = voxel_downsample(Cloud(points), size=2.0, origin=ORIGIN).points
    with_far = voxel_downsample(
        Cloud(np.vstack((points, (far, -far, far)))), size=2.0, origin=ORIGIN
    ).points
    assert np.array_equal(with_far[:-1], alone)
    assert with_far[-1] == pytest.approx((far, -far, far), rel=1e-3 if far < 1e4 else 1e-12)


def test_a_million_metres_from_the_origin() -> None:
    points, shift = surface(3000, 0), np.array((1_000_000.0, 4_000_000.0, 0.0))
    near = voxel_downsample(Cloud(points), size=0.5, origin=ORIGIN).points
    far = voxel_downsample(Cloud(points + shift), size=0.5, origin=ORIGIN).points
    assert np.abs(far - shift - near).max() < 5e-9


def test_colours_and_confidences_only_where_all_pieces_have_them() -> None:
    grid = VoxelGrid(1.0, ORIGIN)
    grid.add(dressed(np.zeros((2, 3))))
    grid.add(Cloud(np.ones((2, 3))))
    small = grid.cloud()
    assert (small.colours, small.confidence) == (None, None)
    assert len(small) == 2


def test_nothing_stays_nothing() -> None:
    assert len(voxel_downsample(Cloud(np.zeros((0, 3))), size=1.0, origin=ORIGIN)) == 0


@pytest.mark.parametrize("size", [0.0, -1.0, np.inf, np.nan])
def test_voxels_that_cannot_be(size: float) -> None:
    with pytest.raises(ValueError, match="voxels of size"):
        VoxelGrid(size, ORIGIN)


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
    occupied = len(voxel_downsample(Cloud(points), size=1.0, origin=np.zeros(3)))
    grid = VoxelGrid(1.0, np.zeros(3), occupied)
    for start in range(0, 5000, 300):
        grid.add(Cloud(points[start : start + 300]))
    assert len(grid.cloud()) == occupied
    with pytest.raises(UsageError, match=f"more than {occupied:,} voxels of 1 m"):
        grid.add(Cloud(np.full((1, 3), 50.0)))

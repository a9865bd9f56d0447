from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.distances.boxes import gather, morton_order
from tests.geometry.support import quick
from tests.reconstruction.cloud_support import clouds, surface


@given(clouds())
@quick
def test_order_is_a_permutation(points: Floats) -> None:
    assert sorted(morton_order(points).tolist()) == list(range(len(points)))


def test_none_and_one() -> None:
    assert morton_order(np.zeros((0, 3))).tolist() == []
    assert morton_order(np.full((1, 3), 7.0)).tolist() == [0]


def test_corners_of_a_cube_come_x_first_then_y_then_z() -> None:
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    ordered = corners[morton_order(corners)]
    expected = [(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]
    assert ordered.tolist() == [list(corner) for corner in expected]


@pytest.mark.parametrize("scale", [0.0, 10.0, 1e6, 1e30, 1e300])
def test_neighbours_in_the_order_are_near_however_far_some_points_are(scale: float) -> None:
    points = surface(20_000, 0)
    points[::20] *= 1.0 + scale
    core = points[np.arange(len(points)) % 20 != 0]
    order = morton_order(points)
    ordered = points[order[order % 20 != 0]]
    steps = np.linalg.norm(np.diff(ordered, axis=0), axis=1)
    unordered = np.linalg.norm(np.diff(core, axis=0), axis=1)
    # A point in a hundred metres square has its neighbour within a metre.
    assert np.median(steps) < 2.0
    assert np.median(unordered) > 30.0


def test_gather_takes_any_layout() -> None:
    points = np.asfortranarray(surface(70_000, 0))
    order = np.random.default_rng(1).permutation(70_000)
    picked = gather(points, order)
    assert np.array_equal(picked, points[order])
    assert picked.flags.c_contiguous

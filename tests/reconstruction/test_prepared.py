"""What is left of a cloud before it is compared, and what is counted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.reconstruction.clouds import InMemoryCloud, TransformedCloud
from airzoo_bench.reconstruction.preparation import (
    Box,
    PreparedCloud,
    box_of,
    cropped_region,
    prepared,
)
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.similarity import Similarity
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import Pieces, settings

BOX = Box(np.zeros(3), np.ones(3))


def prepare(source: CloudSource, used: Preparation, block: int) -> PreparedCloud:
    """Prepare a cloud whose truth is the unit cube's corners."""
    truth = Pieces(np.stack((BOX.low, BOX.high)))
    return prepared(source, used, cropped_region(truth, BOX, used, block), block)


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


def test_the_crop_includes_its_border() -> None:
    points = np.array([[1.5, 0, 0], [1.5000001, 0, 0], [-0.5, -0.5, -0.5], [0, 0, np.nan]])
    cloud = prepare(Pieces(points), settings(crop="box", crop_margin_m=0.5), 10)
    assert (cloud.not_finite, cloud.outside) == (1, 1)
    np.testing.assert_array_equal(points_of(cloud), points[[0, 2]])


def test_voxels_thin_what_the_crop_has_left() -> None:
    # Voxels begin at 0.191 of 0.5.
    points = np.array([[0.2, 0.1, 0.1], [0.4, 0.1, 0.1], [0.7, 0.1, 0.1], [9, 9, 9.0]])
    cloud = prepare(Pieces(points), settings(crop="box", crop_margin_m=0.0, voxel_m=0.5), 1)
    assert (cloud.outside, cloud.thinned) == (1, 1)
    np.testing.assert_allclose(points_of(cloud), [[0.3, 0.1, 0.1], [0.7, 0.1, 0.1]], atol=1e-9)


def test_bounds_see_through_outliers_and_crops() -> None:
    along = np.linspace(0, 1000, 1001)
    points = np.stack([along, 2 * along, 0 * along], axis=1)
    points[0] = np.nan
    cloud = prepare(Pieces(points), settings(crop="box", crop_margin_m=0.0), 100)
    np.testing.assert_allclose(cloud.bounds[:, 0], [10.99, 990.01])
    nothing = prepare(Pieces(np.zeros((0, 3))), settings(), 100)
    assert np.isnan(nothing.bounds).all()


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


def test_bounds_of_many_points_do_not_depend_on_the_pieces() -> None:
    points = np.random.default_rng(0).normal(size=(250_001, 3))
    sizes = (250_001, 99_999, 7_001)
    found = [prepare(Pieces(points), settings(), size).bounds for size in sizes]
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    # Every second point was looked at.
    np.testing.assert_array_equal(found[0], np.percentile(points[::2], (1, 99), axis=0))


class Confident(Pieces):
    def pieces(self, points: int) -> Iterator[Cloud]:
        for piece in super().pieces(points):
            yield Cloud(piece.points, confidence=np.array([0.2, 0.5, 0.9], np.float32))


def test_moving_keeps_the_more_confident_points() -> None:
    points = np.array([[1.0, 0, 0], [0, 1, 0], [np.inf, 0, 0]])
    transform = Similarity(2.0, np.eye(3), np.array((10.0, 0, 0)))
    everything = next(TransformedCloud(Confident(points), transform, None).pieces(10))
    np.testing.assert_array_equal(everything.points[:2], [[12, 0, 0], [10, 2, 0]])
    assert not np.isfinite(everything.points[2]).all()
    kept = next(TransformedCloud(Confident(points), transform, 0.2).pieces(10))
    np.testing.assert_array_equal(kept.points[0], [10, 2, 0])
    assert len(kept) == 2
    # Without confidences nothing is asked of them.
    assert len(next(TransformedCloud(InMemoryCloud(points), transform, 0.9).pieces(10))) == 3


def test_the_box_of_a_cloud() -> None:
    points = np.array([[0, 5, 0], [np.nan, 9, 9], [-1, 2, 7.0]])
    box = box_of(Pieces(points))
    np.testing.assert_array_equal([box.low, box.high], [[-1, 2, 0], [0, 5, 7]])
    with pytest.raises(BenchmarkError, match="holds no finite point"):
        box_of(Pieces(np.full((3, 3), np.nan)))

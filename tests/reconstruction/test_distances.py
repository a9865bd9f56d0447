"""Distances: the same bits as all pairs, in memory and on disk, and however the clouds lie."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction import distances as neighbours
from airzoo_bench.reconstruction.clouds import cloud_of
from airzoo_bench.reconstruction.distances import cloud_distances, mutual_distances
from tests.geometry.support import seeds
from tests.reconstruction.support import all_pairs, clouds, sphere, surface


def assert_exact(first: Floats, second: Floats, *, on_disk: bool = False) -> None:
    found = mutual_distances(first, second, jobs=2, on_disk=on_disk)
    with np.errstate(over="ignore", under="ignore"):
        assert np.array_equal(found[0], all_pairs(first, second))
        assert np.array_equal(found[1], all_pairs(second, first))


def test_by_hand() -> None:
    points = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 0.0), (1.0, 2.0, 2.0)])
    others = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 12.0)])
    there, back = mutual_distances(points, others, jobs=1)
    assert there.tolist() == [0.0, 5.0, 3.0]
    assert back.tolist() == [0.0, np.sqrt(4 + 4 + 100)]


@given(clouds(60), clouds(60), st.booleans(), seeds)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_same_bits_as_all_pairs_in_any_order(
    points: Floats, others: Floats, on_disk: bool, seed: int
) -> None:
    assert_exact(points, others, on_disk=on_disk)
    random = np.random.default_rng(seed)
    order = random.permutation(len(points))
    found, _ = mutual_distances(points, others, jobs=1)
    again, _ = mutual_distances(points[order], random.permutation(others), jobs=3)
    assert np.array_equal(again, found[order])


@pytest.mark.parametrize("east", [0.01, 500.0, 1e7])
@pytest.mark.parametrize("scale", [1e-160, 1.0, 1e14, 1e140])
def test_points_however_far_or_near(east: float, scale: float) -> None:
    points, others = surface(400, 0, far=0.05), surface(400, 1, far=0.05)
    points[:20] *= scale
    others[: 400 if scale < 1 else 5] *= scale
    assert_exact(points + np.array((east, 0, 30)), others)


def grid(shift: float = 0.0) -> Floats:
    axis = np.arange(9) * 0.1 + shift
    return np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)


def middle() -> tuple[Floats, Floats]:
    """Return points on a sphere, and some in its middle, to which all are equally near."""
    random = np.random.default_rng(0)
    return sphere(random, 1000) * 1.2, random.normal(size=(50, 3)) * 1e-14


def test_ties_that_differ_in_their_last_bits_are_decided_exactly() -> None:
    # The middles of a grid's cells have eight neighbours, equally far up to the roundings.
    assert len(np.unique(all_pairs(grid() + 0.05, grid()))) > 2
    for both in ((grid() + 0.05, grid()), middle()):
        assert_exact(*both)


class _Careless:
    """A tree as careless as errors of its bounds allow: it misses the nearest where all tie."""

    def __init__(self, tree: Any) -> None:
        self._tree = tree

    def query(self, points: Floats, *, k: int, sqr_dists: bool) -> tuple[Floats, Any]:
        near, index = self._tree.query(points, k=k + 1, sqr_dists=sqr_dists)
        near, index = near.copy(), index.copy()
        tied = near[:, k] <= near[:, 0] * (1.0 + 1e-13)
        near[tied, :-1], index[tied, :-1] = near[tied, 1:], index[tied, 1:]
        return near[:, :-1], index[:, :-1]


def careless(points: Floats, leafsize: int, build: Any = neighbours.kdtree.KDTree) -> _Careless:
    return _Careless(build(points, leafsize=leafsize))


def test_a_neighbour_missed_by_the_tree_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(neighbours.kdtree, "KDTree", careless)
    for points, others in ((grid(7.3) + 0.05, grid(7.3)), middle()):
        assert np.array_equal(
            mutual_distances(points, others, jobs=2)[0], all_pairs(points, others)
        )


def test_many_copies_cost_no_more_than_one() -> None:
    same = np.zeros((50_000, 3))  # all pairs would be 2.5 10^9
    found, _ = mutual_distances(same + np.array((3.0, 4.0, 0.0)), same, jobs=2)
    assert found.tolist() == [5.0] * 50_000


@pytest.mark.parametrize("block_points", [100, 2000])
def test_sources_in_memory_or_on_disk_with_points_that_are_not_finite(block_points: int) -> None:
    prediction, truth = surface(1500, 0), surface(900, 1)
    prediction[7, 1], truth[800, 1] = np.nan, np.inf
    finite = np.delete(prediction, 7, axis=0), np.delete(truth, 800, axis=0)
    found = cloud_distances(
        cloud_of(prediction), cloud_of(truth), block_points=block_points, jobs=1
    )
    assert np.array_equal(found.to_truth, all_pairs(*finite))
    assert np.array_equal(found.to_prediction, all_pairs(*finite[::-1]))


@pytest.mark.parametrize("nothing", [np.zeros((0, 3)), np.full((9, 3), np.nan)])
def test_nothing_predicted_is_infinitely_far_and_no_truth_an_error(nothing: Floats) -> None:
    some = cloud_of(surface(5, 0))
    for block_points in (2, 2000):
        found = cloud_distances(cloud_of(nothing), some, block_points=block_points, jobs=1)
        assert (found.to_truth.tolist(), found.to_prediction.tolist()) == ([], [np.inf] * 5)
        with pytest.raises(BenchmarkError):
            cloud_distances(some, cloud_of(nothing), block_points=block_points, jobs=1)

"""Distances: the same bits as all pairs, in memory and on disk, and however the clouds lie."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction import distances as neighbours
from airzoo_bench.reconstruction.distances import (
    NeighbourSearch,
    block_distances,
    bound_squared,
    cloud_distances,
    mutual_distances,
)
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import Pieces, all_pairs, clouds, surface


def nearest_distances(points: Floats, others: Floats, *, jobs: int) -> Floats:
    return mutual_distances(points, others, jobs=jobs)[0]


def test_by_hand() -> None:
    points = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 0.0), (1.0, 2.0, 2.0)])
    others = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 12.0)])
    assert nearest_distances(points, others, jobs=1).tolist() == [0.0, 5.0, 3.0]
    assert nearest_distances(others, points, jobs=1).tolist() == [0.0, np.sqrt(4 + 4 + 100)]


@given(clouds(), clouds())
@settings(max_examples=200, deadline=None, derandomize=True)
def test_same_bits_as_all_pairs(points: Floats, others: Floats) -> None:
    assert np.array_equal(nearest_distances(points, others, jobs=1), all_pairs(points, others))


@given(clouds(), clouds(), st.integers(0, 2**32 - 1))
@quick
def test_no_bit_depends_on_order_or_threads(points: Floats, others: Floats, seed: int) -> None:
    random = np.random.default_rng(seed)
    order, others_order = random.permutation(len(points)), random.permutation(len(others))
    found = nearest_distances(points, others, jobs=1)
    again = nearest_distances(points[order], others[others_order], jobs=3)
    assert np.array_equal(again, found[order])


@given(clouds(), clouds())
@quick
def test_mutual_is_both_ways(first: Floats, second: Floats) -> None:
    one, other = mutual_distances(first, second, jobs=2)
    assert np.array_equal(one, all_pairs(first, second))
    assert np.array_equal(other, all_pairs(second, first))


def test_a_million_metres_from_the_origin_nothing_is_lost() -> None:
    origin = np.array((1_000_000.0, 4_000_000.0, 0.0))
    points, others = np.round(surface(3000, 0), 6), np.round(surface(3000, 1), 6)
    near = nearest_distances(points, others, jobs=2)
    far = nearest_distances(points + origin, others + origin, jobs=2)
    assert np.abs(far - near).max() < 2e-9
    rounded = ((cloud + origin).astype(np.float32).astype(np.float64) for cloud in (points, others))
    assert np.abs(nearest_distances(*rounded, jobs=2) - near).max() > 0.1  # float32 does lose


def test_ties_that_differ_in_their_last_bits_are_decided_exactly() -> None:
    # The middles of a grid's cells have eight neighbours, equally far but for the roundings.
    axis = np.arange(15) * 0.1
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    middles = grid + 0.05
    assert len(np.unique(all_pairs(middles, grid))) > 2
    found = nearest_distances(middles, grid, jobs=2)
    assert np.array_equal(found, all_pairs(middles, grid))


def test_more_ties_than_neighbours_asked_for_are_decided_exactly() -> None:
    random = np.random.default_rng(0)
    sphere = random.normal(size=(5000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    middle = random.normal(size=(20, 3)) * 1e-17
    found = nearest_distances(middle, sphere, jobs=2)
    assert np.array_equal(found, all_pairs(middle, sphere))
    assert (found < 1.0).all()


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


@pytest.mark.parametrize("shift", [0.0, 7.3])
def test_a_neighbour_missed_by_the_tree_is_found_again(
    monkeypatch: pytest.MonkeyPatch, shift: float
) -> None:
    axis = np.arange(13) * 0.1 + shift
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    middles, expected = grid + 0.05, all_pairs(grid + 0.05, grid)
    monkeypatch.setattr(neighbours.kdtree, "KDTree", careless)
    assert np.array_equal(nearest_distances(middles, grid, jobs=2), expected)
    monkeypatch.setattr(
        NeighbourSearch, "_resolve_ties", lambda self, points: self._ask(points, 2)[0]
    )
    assert not np.array_equal(nearest_distances(middles, grid, jobs=2), expected)


def test_a_neighbour_missed_among_very_many_is_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = np.random.default_rng(0)
    sphere = random.normal(size=(3000, 3))
    sphere *= 1.2 / np.linalg.norm(sphere, axis=1, keepdims=True)
    middles = random.normal(size=(50, 3)) * 1e-14
    expected = all_pairs(middles, sphere)
    monkeypatch.setattr(neighbours.kdtree, "KDTree", careless)
    assert np.array_equal(nearest_distances(middles, sphere, jobs=2), expected)
    monkeypatch.setattr(neighbours.KDTree, "query_ball_point", lambda *_: [0])
    assert not np.array_equal(nearest_distances(middles, sphere, jobs=2), expected)


@pytest.mark.parametrize("scale", [1e3, 1e9, 1e14, 1e30, 1e140])
def test_points_however_far(scale: float) -> None:
    points, others = surface(400, 0, far=0.05), surface(400, 1, far=0.05)
    points[:20] *= scale
    others[:5] *= scale
    with np.errstate(over="ignore"):
        expected = all_pairs(points, others)
    assert np.array_equal(nearest_distances(points, others, jobs=2), expected)


def test_distances_too_small_for_relative_bounds() -> None:
    points, others = surface(300, 0) * 1e-160, surface(300, 1) * 1e-160
    with np.errstate(under="ignore"):
        expected = all_pairs(points, others)
    assert np.array_equal(nearest_distances(points, others, jobs=2), expected)


def test_a_hundred_thousand_copies_cost_no_more_than_one() -> None:
    # All pairs would be 10^10.
    same = np.zeros((100_000, 3))
    assert (
        nearest_distances(same + np.array((3.0, 4.0, 0.0)), same, jobs=2).tolist()
        == [5.0] * 100_000
    )


def test_nothing_is_infinitely_far_from_everything() -> None:
    nothing, points = np.zeros((0, 3)), np.zeros((2, 3))
    assert nearest_distances(points, nothing, jobs=1).tolist() == [np.inf, np.inf]
    assert nearest_distances(nothing, points, jobs=1).tolist() == []
    one, other = mutual_distances(points, nothing, jobs=1)
    assert (one.tolist(), other.tolist()) == ([np.inf, np.inf], [])
    assert mutual_distances(nothing, points, jobs=1)[1].tolist() == [np.inf, np.inf]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    points = np.zeros((5, 3))
    points[3, 1] = bad
    with pytest.raises(ValueError, match="not finite"):
        nearest_distances(points, np.zeros((1, 3)), jobs=1)
    with pytest.raises(ValueError, match="not finite"):
        mutual_distances(np.zeros((1, 3)), points, jobs=1)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        nearest_distances(np.zeros((5, 2)), points, jobs=1)


@given(clouds(), clouds())
@quick
def test_bounds_of_boxes_hold_to_the_last_bit(points: Floats, others: Floats) -> None:
    bounds = bound_squared(points, others.min(axis=0), others.max(axis=0))
    assert (np.sqrt(bounds) <= all_pairs(points, others)).all()


def in_blocks(first: Floats, second: Floats, block_points: int) -> tuple[Floats, Floats]:
    found = block_distances(Pieces(first), Pieces(second), block_points=block_points, jobs=1)
    return found.to_truth, found.to_prediction


def assert_same_bits(first: Floats, second: Floats, block_points: int) -> None:
    expected = mutual_distances(first, second, jobs=1)
    found = in_blocks(first, second, block_points)
    assert np.array_equal(found[0], expected[0])
    assert np.array_equal(found[1], expected[1])


@given(clouds(), clouds(), st.integers(1, 60))
@quick
def test_no_bit_depends_on_the_size_of_blocks(
    first: Floats, second: Floats, block_points: int
) -> None:
    assert_same_bits(first, second, block_points)


@given(seeds, st.sampled_from((37, 150, 400, 5000)))
@quick
def test_surfaces_with_far_points(seed: int, block_points: int) -> None:
    assert_same_bits(surface(900, seed, far=0.05), surface(700, seed + 1), block_points)


@pytest.mark.parametrize("shift", [(0, 0, 30), (500, 0, 0), (1e7, 1e7, 0), (0.01, 0, 0)])
def test_clouds_that_lie_apart(shift: tuple[float, float, float]) -> None:
    # Here a halo of any fixed width is too small, and most points reach into many blocks.
    assert_same_bits(surface(3000, 0) + np.array(shift), surface(3000, 1), 200)


def test_far_points_reach_few_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []
    ask = NeighbourSearch.squared

    def counted(self: NeighbourSearch, points: Floats, *, jobs: int) -> Floats:
        searched.append(len(points))
        return ask(self, points, jobs=jobs)

    monkeypatch.setattr(NeighbourSearch, "squared", counted)
    in_blocks(surface(20_000, 0, far=0.05), surface(20_000, 1, far=0.05), 500)
    # Once each in its own block, and again for each block that those near borders reach.
    assert sum(searched) < 5 * 20_000 * 2


def test_nothing_is_left_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = surface(1000, 0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    written: list[str] = []

    class Watched(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            written.extend(path.name for path in tmp_path.rglob("*") if path.is_file())

    block_distances(Watched(points), Watched(points), block_points=100, jobs=1)
    assert any(name.startswith("prediction") for name in written)
    assert list(tmp_path.iterdir()) == []

    class Broken(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block_distances(Pieces(points), Broken(points), block_points=100, jobs=1)
    assert list(tmp_path.iterdir()) == []


def scored(prediction: Floats, truth: Floats, block_points: int) -> tuple[Floats, Floats]:
    found = cloud_distances(Pieces(prediction), Pieces(truth), block_points=block_points, jobs=1)
    return found.to_truth, found.to_prediction


@pytest.mark.parametrize("block_points", [100, 2000])
def test_sources_in_memory_or_in_blocks_with_points_that_are_not_finite(block_points: int) -> None:
    prediction, truth = surface(1500, 0), surface(900, 1)
    for points, row, value in ((prediction, 7, np.nan), (truth, 800, np.inf)):
        points[row, 1] = value
    kept = np.delete(prediction, 7, axis=0), np.delete(truth, 800, axis=0)
    found = scored(prediction, truth, block_points)
    expected = mutual_distances(*kept, jobs=1)
    assert np.array_equal(found[0], expected[0])
    assert np.array_equal(found[1], expected[1])


@pytest.mark.parametrize("block_points", [2, 2000])
@pytest.mark.parametrize("nothing", [np.zeros((0, 3)), np.full((9, 3), np.nan)])
def test_nothing_predicted_is_infinitely_far_and_no_truth_an_error(
    nothing: Floats, block_points: int
) -> None:
    there, back = scored(nothing, surface(5, 0), block_points)
    assert (there.tolist(), back.tolist()) == ([], [np.inf] * 5)
    with pytest.raises(BenchmarkError, match="no finite point"):
        scored(surface(5, 0), nothing, block_points)

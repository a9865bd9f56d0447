from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.retrieval import positives
from airzoo_bench.retrieval.positives import overlaps, positives_from_points
from tests.retrieval.positive_support import (
    UNIT_BOX,
    assert_same,
    naive,
    points_near,
    tilted,
    two_scales,
)

sizes = st.sampled_from([1.0, 2, 2.5, 4, 5, 7, 9.5, 20])


@settings(max_examples=60, deadline=None)
@given(sizes, sizes, st.sampled_from([None, tilted]), st.integers(0, 2**32 - 1))
def test_grids_agree_with_every_tile_tested(width, height, place, seed):
    boxes = two_scales(width, height, place or (lambda x, y: (x, y)))
    points = points_near(boxes, np.random.default_rng(seed), 40)
    assert_same(positives_from_points(points, boxes), naive(points, boxes))


coordinate = st.integers(-4, 4)
any_box = st.tuples(coordinate, coordinate, st.integers(0, 5), st.integers(0, 5))
any_point = st.tuples(*[st.one_of(coordinate, st.just(np.nan), st.just(np.inf))] * 2)


@settings(max_examples=150, deadline=None)
@given(st.lists(any_box, max_size=30), st.lists(st.tuples(any_point, any_point), min_size=1))
def test_any_boxes_agree_with_every_tile_tested(corners_and_sizes, points):
    boxes = np.array(
        [(x, y, x + w, y + h) for x, y, w, h in corners_and_sizes], dtype=float
    ).reshape(-1, 4)
    points = np.array(points, dtype=float)
    assert_same(positives_from_points(points, boxes), naive(points, boxes))


@pytest.mark.parametrize(
    "change", ["none", "shuffled", "upwards", "westwards", "column first", "with holes", "random"]
)
@pytest.mark.parametrize("place", [lambda x, y: (x, y), tilted], ids=["product", "tilted"])
def test_large_galleries_agree_with_a_search_tree(place, change):
    rng = np.random.default_rng(3)
    boxes = two_scales(61.0, 45.0, place)
    order = {
        "shuffled": rng.permutation(len(boxes)),
        "upwards": np.arange(len(boxes))[::-1],
        "westwards": np.lexsort((-boxes[:, 0], -boxes[:, 3])),
        "column first": np.lexsort((boxes[:, 1], boxes[:, 0])),
        "with holes": np.flatnonzero(rng.random(len(boxes)) > 0.1),
    }
    boxes = boxes[order.get(change, np.arange(len(boxes)))]
    if change == "random":
        low = rng.uniform(0, 60, (2_000, 2))
        boxes = np.concatenate([low, low + rng.exponential(3, (2_000, 2))], axis=1)
    points = points_near(boxes, rng, 5_000)
    tree = shapely.STRtree(shapely.box(*boxes.T))
    point, tile = tree.query(shapely.points(points.reshape(-1, 2)))
    pairs = np.unique(np.stack([point // 4, tile], axis=1), axis=0)
    found = positives_from_points(points, boxes)
    assert np.array_equal(found.queries, pairs[:, 0])
    assert np.array_equal(found.tiles, pairs[:, 1])


@pytest.mark.parametrize("place", [lambda x, y: (x, y), tilted], ids=["product", "tilted"])
def test_of_a_grid_few_tiles_are_tested(place):
    boxes = two_scales(100.0, 80.0, place)
    grids = positives._grids(boxes)
    assert [grid.columns for grid in grids] == [49, 99]
    assert max(grid.candidates for grid in grids) <= 16
    assert positives._grids(np.random.default_rng(0).permutation(boxes)) == []


def test_no_tiles_no_points_no_ground():
    assert_same(positives_from_points(np.zeros((2, 4, 2)), np.empty((0, 4))), [[], []])
    assert_same(positives_from_points(np.zeros((0, 4, 2)), UNIT_BOX), [])
    assert_same(positives_from_points(np.zeros((2, 0, 2)), UNIT_BOX), [[], []])
    assert_same(positives_from_points(np.full((2, 4, 2), np.nan), UNIT_BOX), [[], []])


def test_large_galleries_are_searched_by_several_trees(monkeypatch):
    corners = np.random.default_rng(0).uniform(0, 9, (500, 2))
    boxes = np.concatenate([corners, corners + 1], axis=1)
    points = np.random.default_rng(1).uniform(0, 9, (20, 4, 2))
    expected = [positives_from_points(points, boxes), overlaps(points, boxes)]
    monkeypatch.setattr(positives, "_TILES", 64)
    found = [positives_from_points(points, boxes), overlaps(points, boxes)]
    assert [one.tiles.tolist() for one in found] == [one.tiles.tolist() for one in expected]

"""Tiles that overlap a footprint, and pairs as a file holds them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.retrieval.positives import (
    overlap_of,
    overlaps,
    positives_from_iou,
)
from airzoo_bench.retrieval.truth import Positives
from tests.retrieval.positive_support import UNIT_BOX, grid


def test_overlap_by_hand():
    square = np.array([[[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]])
    boxes = np.array([[0, 0, 1, 1], [1, 1, 2, 2], [0.5, 0.5, 1.5, 1.5], [5, 5, 6, 6]], float)
    found = overlaps(square, boxes)
    assert found.tiles.tolist() == [0, 1, 2]
    assert found.overlap == pytest.approx([0.25 / 1.75, 0.25 / 1.75, 1])


def test_rounding_does_not_make_touching_an_overlap():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-3, 4, (2, 500, 4))
    above = np.stack([np.sort(x, axis=1), 1 + np.abs(y)], axis=2)
    boxes = UNIT_BOX / 7 + [113, 28, 113, 28]
    above = above / 7 + [113, 28]
    above[:, :2, 1] = boxes[0, 3]
    every = Positives(np.arange(501), np.zeros(500, np.int32))
    assert not overlap_of(above, boxes, every).any()


def test_footprint_with_nan_or_without_area_overlaps_nothing():
    polygons = np.zeros((3, 4, 2)) + 0.5
    polygons[0] = [[0, 0], [1, 0], [1, 1], [0, np.nan]]
    polygons[1] = [[0, 0], [1, 0], [1, 1], [0, 1]]
    found = overlaps(polygons, UNIT_BOX)
    assert found.counts.tolist() == [0, 1, 0]
    every = Positives(np.arange(4), np.zeros(3, np.int32))
    assert overlap_of(polygons, UNIT_BOX, every).tolist() == [0, 1, 0]


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 113.0]), st.booleans())
def test_overlaps_agree_with_shapely(seed, offset, on_lattice):
    rng = np.random.default_rng(seed)
    polygons = rng.uniform(-2, 3, (3, 4, 2))
    if on_lattice:
        polygons = rng.integers(-1, 3, (3, 4, 2)).astype(float)
    boxes = np.concatenate([UNIT_BOX, grid(4, 4, 2.0), [[-1.0, -1, 0.3, 2]]])
    shapes = shapely.polygons(polygons)
    shapes = np.where(shapely.is_valid(shapes), shapes, shapely.convex_hull(shapes))
    tiles = shapely.box(*boxes.T)
    common = shapely.area(shapely.intersection(shapes[:, None], tiles))
    expected = common / (shapely.area(shapes)[:, None] + shapely.area(tiles) - common)
    found = overlaps(polygons + offset, boxes + offset)
    ratios = np.zeros((3, len(boxes)))
    ratios[found.queries, found.tiles] = found.overlap
    # Of lattice points some sides touch each other; what such a figure covers is not defined.
    simple = shapely.is_valid(shapely.polygons(polygons)) | (not on_lattice)
    assert ratios[simple] == pytest.approx(expected[simple], abs=1e-10)
    every = Positives(np.arange(4) * len(boxes), np.tile(np.arange(len(boxes)), 3))
    assert np.array_equal(overlap_of(polygons + offset, boxes + offset, every), ratios.ravel())


def test_iou_threshold_is_strict():
    half = np.array([[[0.0, 0], [0.5, 0], [0.5, 1], [0, 1]]])
    assert positives_from_iou(half, UNIT_BOX, 0.5).counts.tolist() == [0]
    found = positives_from_iou(half, UNIT_BOX, 0.49)
    assert found.tiles.tolist() == [0]
    assert found.overlap.tolist() == [0.5]

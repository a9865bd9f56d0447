"""Which tiles hold a query's points, and which overlap its footprint."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.retrieval import positives
from airzoo_bench.retrieval.positives import (
    find_holding_tiles,
    find_overlaps,
    find_positives,
    with_overlap,
)
from airzoo_bench.retrieval.truth import Positives

UNIT_BOX = np.array([[0.0, 0, 1, 1]])


def naive(points, boxes):
    """Test every point against every tile."""
    lon, lat = points[:, :, None, 0], points[:, :, None, 1]
    inside = (boxes[:, 0] <= lon) & (lon <= boxes[:, 2])
    inside &= (boxes[:, 1] <= lat) & (lat <= boxes[:, 3])
    return [np.flatnonzero(row) for row in inside.any(axis=1)]


def assert_same(found, expected):
    assert (found.tiles.dtype, found.offsets.dtype) == (np.int32, np.int64)
    assert found.counts.tolist() == [len(tiles) for tiles in expected]
    assert found.tiles.tolist() == [tile for tiles in expected for tile in tiles]


def starts_of(length, tile):
    """Tiles at half a tile's stride; the last anchored to the edge."""
    starts = np.arange(0, max(length - tile, 0) + 1, tile / 2)
    return starts if starts[-1] >= length - tile else np.append(starts, length - tile)


def grid(width, height, tile, place=lambda x, y: (x, y)):
    """Boxes of the corners of a map's tiles, row by row from the north."""
    x, y = np.meshgrid(starts_of(width, tile), -starts_of(height, tile))
    lon, lat = np.moveaxis([place(x + dx, y - dy) for dx in (0, tile) for dy in (0, tile)], 1, 0)
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def product(x, y):
    return x, y


def tilted(x, y):
    """Tilt and bend a map as the convergence of the meridians does, only more."""
    return 112 + x + 0.05 * y + 2e-4 * x * y, 28 + y - 0.05 * x - 1e-4 * x**2


def two_scales(width, height, place):
    return np.concatenate([grid(width, height, tile, place) for tile in (4.0, 2.0)])


def points_near(boxes, rng, n):
    """Points in, on the borders and corners of, and beside tiles, and some NaN."""
    picks = boxes[rng.integers(0, len(boxes), (n, 4))]
    share = rng.choice([0, 0, 0.25, 0.5, 1, 1, 1.5, np.nan], (n, 4, 2))
    low, high = picks[..., :2], picks[..., 2:]
    return np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))


sizes = st.sampled_from([1.0, 2, 2.5, 4, 5, 7, 9.5, 20])


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.integers(1, 9))
def test_any_boxes_agree_with_every_tile_tested(seed, n_tiles, n_queries):
    rng = np.random.default_rng(seed)
    low = rng.integers(-4, 5, (n_tiles, 2)).astype(float)
    boxes = np.concatenate([low, low + rng.integers(0, 6, (n_tiles, 2))], axis=1)
    points = rng.choice([*range(-4, 5), np.nan, np.inf], (n_queries, 2, 2))
    assert_same(find_holding_tiles(points, boxes), naive(points, boxes))


ORDERS = {
    "none": lambda boxes, rng: np.arange(len(boxes)),
    "shuffled": lambda boxes, rng: rng.permutation(len(boxes)),
    "upwards": lambda boxes, rng: np.arange(len(boxes))[::-1],
    "westwards": lambda boxes, rng: np.lexsort((-boxes[:, 0], -boxes[:, 3])),
    "column first": lambda boxes, rng: np.lexsort((boxes[:, 1], boxes[:, 0])),
    "with holes": lambda boxes, rng: np.flatnonzero(rng.random(len(boxes)) > 0.1),
}


@settings(max_examples=120, deadline=None)
@given(sizes, sizes, st.sampled_from([product, tilted]), st.sampled_from([*ORDERS]), st.integers(0))
def test_grids_agree_with_every_tile_tested(width, height, place, order, seed):
    rng = np.random.default_rng(seed)
    boxes = two_scales(width, height, place)
    boxes = boxes[ORDERS[order](boxes, rng)]
    points = points_near(boxes, rng, 40) if len(boxes) else np.zeros((40, 4, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(positives, "_TILES", 64)  # of a tree, which then are several
        assert_same(find_holding_tiles(points, boxes), naive(points, boxes))


def test_no_tiles_no_points_no_ground():
    assert_same(find_holding_tiles(np.zeros((2, 4, 2)), np.empty((0, 4))), [[], []])
    assert_same(find_holding_tiles(np.zeros((0, 4, 2)), UNIT_BOX), [])
    assert_same(find_holding_tiles(np.full((2, 4, 2), np.nan), UNIT_BOX), [[], []])


# --- overlap ---


def test_overlap_by_hand():
    square = np.array([[[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]])
    boxes = np.array([[0, 0, 1, 1], [1, 1, 2, 2], [0.5, 0.5, 1.5, 1.5], [5, 5, 6, 6]], float)
    found = find_overlaps(square, boxes)
    assert found.tiles.tolist() == [0, 1, 2]
    assert found.overlap == pytest.approx([0.25 / 1.75, 0.25 / 1.75, 1])
    half = np.array([[[0.0, 0], [0.5, 0], [0.5, 1], [0, 1]]])
    assert find_positives(half, UNIT_BOX, 0.5).counts.tolist() == [0]  # strictly above
    assert find_positives(half, UNIT_BOX, 0.49).overlap.tolist() == [0.5]


def test_rounding_does_not_make_touching_an_overlap():
    x, y = np.random.default_rng(0).uniform(-3, 4, (2, 500, 4))
    boxes = UNIT_BOX / 7 + [113, 28, 113, 28]
    above = np.stack([np.sort(x, axis=1), 1 + np.abs(y)], axis=2) / 7 + [113, 28]
    above[:, :2, 1] = boxes[0, 3]
    every = Positives(np.arange(501), np.zeros(500, np.int32))
    assert not with_overlap(above, boxes, every).overlap.any()


def test_footprint_with_nan_or_without_area_overlaps_nothing():
    polygons = np.full((3, 4, 2), 0.5)
    polygons[:2] = [[0, 0], [1, 0], [1, 1], [0, 1]]
    polygons[0, 3, 1] = np.nan
    assert find_overlaps(polygons, UNIT_BOX).counts.tolist() == [0, 1, 0]
    every = Positives(np.arange(4), np.zeros(3, np.int32))
    assert with_overlap(polygons, UNIT_BOX, every).overlap.tolist() == [0, 1, 0]


@settings(max_examples=80, deadline=None)
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
    found = find_overlaps(polygons + offset, boxes + offset)
    ratios = np.zeros((3, len(boxes)))
    ratios[found.queries, found.tiles] = found.overlap
    # Of lattice points some sides touch each other; what such a figure covers is not defined.
    simple = shapely.is_valid(shapely.polygons(polygons)) | (not on_lattice)
    assert ratios[simple] == pytest.approx(expected[simple], abs=1e-10)

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.positives import (
    overlap_of,
    overlaps,
    positives_from_iou,
    positives_from_points,
)
from airzoo_bench.retrieval.tile_grid import find_runs

UNIT_BOX = np.array([[0.0, 0, 1, 1]])


def naive(points, boxes):
    """Test every point against every tile."""
    lon, lat = points[:, :, None, 0], points[:, :, None, 1]
    inside = (boxes[:, 0] <= lon) & (lon <= boxes[:, 2])
    inside &= (boxes[:, 1] <= lat) & (lat <= boxes[:, 3])
    return [np.flatnonzero(row) for row in inside.any(axis=1)]


def assert_same(found, expected):
    assert found.tiles.dtype == np.int32
    assert found.offsets.dtype == np.int64
    assert found.n_queries == len(expected)
    assert found.counts.tolist() == [len(tiles) for tiles in expected]
    assert found.tiles.tolist() == [tile for tiles in expected for tile in tiles]


def starts_of(length, tile):
    """Tiles at half a tile's stride; the last anchored to the edge."""
    starts = np.arange(0, max(length - tile, 0) + 1, tile / 2)
    return starts if starts[-1] >= length - tile else np.append(starts, length - tile)


def grid(width, height, tile, place=lambda x, y: (x, y)):
    """Boxes of the corners of a map's tiles, row by row from the north."""
    x, y = np.meshgrid(starts_of(width, tile), -starts_of(height, tile))
    corners = [place(x + dx, y - dy) for dx in (0, tile) for dy in (0, tile)]
    lon, lat = np.stack([c[0] for c in corners]), np.stack([c[1] for c in corners])
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def tilted(x, y):
    """Tilt and bend a map as the convergence of the meridians does, only more."""
    return 112 + x + 0.05 * y + 2e-4 * x * y, 28 + y - 0.05 * x - 1e-4 * x**2


def two_scales(width, height, place=lambda x, y: (x, y)):
    return np.concatenate([grid(width, height, tile, place) for tile in (4.0, 2.0)])


def points_near(boxes, rng, n, per_query=4):
    """Points in, on the borders and corners of, and beside tiles, and some NaN."""
    picks = boxes[rng.integers(0, len(boxes), (n, per_query))]
    share = rng.choice([0, 0, 0.25, 0.5, 1, 1, 1.5, np.nan], (n, per_query, 2))
    low, high = picks[..., :2], picks[..., 2:]
    return np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))


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


def test_grids_are_found_and_few_tiles_tested():
    runs = find_runs(two_scales(100.0, 80.0))
    assert [run.boxes is None for run in runs] == [True, True]
    assert [run.columns for run in runs] == [49, 99]
    assert [run.slots for run in runs] == [9, 9]  # a border is shared by three tiles a way
    runs = find_runs(two_scales(100.0, 80.0, tilted))
    assert [run.columns for run in runs] == [49, 99]
    assert max(run.slots for run in runs) <= 16


def test_columns_of_very_different_width():
    edges = np.geomspace(1e-6, 1e3, 60)
    low, high = edges[:-2], edges[2:]
    boxes = np.array([[w, -s - 1, e, -s] for s in range(3) for w, e in zip(low, high, strict=True)])
    assert len(find_runs(boxes)) == 1
    points = points_near(boxes, np.random.default_rng(1), 500)
    assert_same(positives_from_points(points, boxes), naive(points, boxes))


def test_shuffled_gallery_is_no_grid():
    boxes = two_scales(60.0, 60.0)
    assert find_runs(np.random.default_rng(0).permutation(boxes)) is None


def test_borders_and_corners_belong_to_the_tile():
    points = np.array([[[1.0, 1.0]], [[0.5, 0.0]], [[np.nextafter(1, 2), 0.5]]])
    assert positives_from_points(points, UNIT_BOX).counts.tolist() == [1, 1, 0]


def test_two_points_in_a_tile_count_once():
    points = np.array([[[0.2, 0.2], [0.8, 0.8]]])
    assert positives_from_points(points, UNIT_BOX).tiles.tolist() == [0]


def test_no_tiles_no_points_no_ground():
    assert_same(positives_from_points(np.zeros((2, 4, 2)), np.empty((0, 4))), [[], []])
    assert_same(positives_from_points(np.zeros((0, 4, 2)), UNIT_BOX), [])
    assert_same(positives_from_points(np.zeros((2, 0, 2)), UNIT_BOX), [[], []])
    assert_same(positives_from_points(np.full((2, 4, 2), np.nan), UNIT_BOX), [[], []])


def test_many_blocks_of_queries_keep_their_order():
    boxes = two_scales(30.0, 30.0)
    points = points_near(boxes, np.random.default_rng(5), 9_000, per_query=1)
    assert_same(positives_from_points(points, boxes), naive(points, boxes))


@pytest.mark.parametrize("bad", [[0, 0, np.nan, 1], [0, 0, np.inf, 1], [1, 0, 0, 1]])
def test_tiles_without_extent_are_refused_by_row(bad):
    boxes = np.concatenate([UNIT_BOX, [bad]])
    with pytest.raises(BenchmarkError, match="1 of 2 \\(1\\)"):
        positives_from_points(np.zeros((1, 1, 2)), boxes)


def test_overlap_by_hand():
    square = np.array([[[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]])
    boxes = np.array([[0, 0, 1, 1], [1, 1, 2, 2], [0.5, 0.5, 1.5, 1.5], [5, 5, 6, 6]], float)
    found = overlaps(square, boxes)
    assert found.tiles.tolist() == [0, 1, 2]
    assert found.overlap == pytest.approx([0.25 / 1.75, 0.25 / 1.75, 1])


def test_diamond_by_hand():
    diamond = np.array([[[0.5, -0.5], [1.5, 0.5], [0.5, 1.5], [-0.5, 0.5]]])
    assert overlaps(diamond, UNIT_BOX).overlap == pytest.approx([1 / 2])


def test_touching_is_not_overlapping():
    beside = np.array([[[1.0, 0], [2, 0], [2, 1], [1, 1]], [[1.0, 1], [2, 0.7], [2, 2], [1, 2]]])
    assert overlaps(beside, UNIT_BOX).counts.tolist() == [0, 0]


def test_rounding_does_not_make_touching_an_overlap():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-3, 4, (2, 500, 4))
    above = np.stack([np.sort(x, axis=1), 1 + np.abs(y)], axis=2)
    boxes = UNIT_BOX / 7 + [113, 28, 113, 28]
    above = above / 7 + [113, 28]
    above[:, :2, 1] = boxes[0, 3]
    every = Positives(np.arange(501), np.zeros(500, np.int32))
    assert not overlap_of(above, boxes, every).any()


def test_bow_tie_is_its_hull():
    square = [[0.25, 0], [0.75, 0], [0.75, 1], [0.25, 1]]
    ties = np.array([[square[i] for i in order] for order in ([0, 2, 1, 3], [0, 1, 3, 2])])
    assert overlaps(ties, UNIT_BOX).overlap == pytest.approx([0.5, 0.5])


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


def test_checked_takes_what_a_file_holds():
    found = Positives.checked(
        np.array([0, 2, 2]), np.array([1, 4]), np.array([0.5, 1]), n_queries=2, n_tiles=5
    )
    assert found.of(0).tolist() == [1, 4]
    assert found.of(1).tolist() == []
    assert found.queries.tolist() == [0, 0]
    assert found.holds(np.array([0, 0, 1]), np.array([4, 2, 1]), 5).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("offsets", "tiles", "overlap", "fault"),
    [
        ([0, 2], [1, 4], None, "shape"),
        ([1, 2, 2], [1, 4], None, "rise"),
        ([0, 2, 1], [1, 4], None, "rise"),
        ([0, 1, 3], [1, 4], None, "rise"),
        ([0, 1, 2], [1, 5], None, "gallery"),
        ([0, 1, 2], [-1, 4], None, "gallery"),
        ([0, 2, 2], [4, 1], None, "ascend"),
        ([0, 2, 2], [4, 4], None, "ascend"),
        ([0, 1, 2], [1.0, 4.0], None, "integers"),
        ([0, 1, 2], [1, 4], [0.5, np.nan], "overlaps"),
        ([0, 1, 2], [1, 4], [0.5], "overlaps"),
    ],
)
def test_checked_refuses_damage(offsets, tiles, overlap, fault):
    ratio = None if overlap is None else np.array(overlap)
    with pytest.raises(BenchmarkError, match=fault) as caught:
        Positives.checked(
            np.array(offsets), np.array(tiles), ratio, n_queries=2, n_tiles=5, where="p.npz"
        )
    assert caught.value.where == "p.npz"


def test_descending_tiles_of_different_queries_are_fine():
    Positives.checked(np.array([0, 1, 2]), np.array([4, 1]), n_queries=2, n_tiles=5)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="points"):
        positives_from_points(np.zeros((1, 2)), UNIT_BOX)
    with pytest.raises(ValueError, match="boxes"):
        positives_from_points(np.zeros((1, 1, 2)), np.zeros((1, 3)))
    with pytest.raises(ValueError, match="polygons"):
        overlaps(np.zeros((1, 5, 2)), UNIT_BOX)
    with pytest.raises(ValueError, match="1 polygons for 0"):
        overlap_of(np.zeros((1, 4, 2)), UNIT_BOX, Positives(np.zeros(1, int), np.zeros(0, int)))


@pytest.mark.parametrize(
    "box",
    [
        [1.0, 0, 0, 1],
        [0, 1.0, 1, 0],
        [np.nan, 0, 1, 1],
        [0, 0, 1, np.nan],
        [-np.inf, 0, 1, 1],
        [0, 0, 1, np.inf],
    ],
    ids=["west of east", "south of north", "NaN", "NaN at last", "-infinity", "infinity"],
)
def test_boxes_that_are_none_are_refused_by_row(box):
    boxes = np.array([[0.0, 0, 1, 1], box, [0, 0, 1, 1]])
    corners = np.array([[[0, 0], [1, 0], [1, 1], [0, 1.0]]])
    for call in (
        lambda: positives_from_points(corners, boxes),
        lambda: overlaps(corners, boxes),
        lambda: positives_from_iou(corners, boxes, 0.1),
    ):
        with pytest.raises(BenchmarkError, match=r"without a valid box: 1 of 3 \(1\)"):
            call()
    flat = np.array([[0.0, 0, 0, 1], [0, 0, 1, 0]])  # without area, but boxes
    assert positives_from_points(corners, flat).tiles.tolist() == [0, 1]

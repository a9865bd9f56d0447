"""Footprints by hand; which tiles hold a query's points, and which overlap its footprint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from rasterio.transform import Affine

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.retrieval import positives
from airzoo_bench.retrieval.positives import (
    Footprints,
    cast_footprints,
    find_holding_tiles,
    find_overlaps,
    find_positives,
    with_overlap,
)
from airzoo_bench.retrieval.truth import Positives

UNIT_BOX = np.array([[0.0, 0, 1, 1]])


def naive(points: Any, boxes: Any) -> Any:
    """Test every point against every tile."""
    lon, lat = points[:, :, None, 0], points[:, :, None, 1]
    inside = (boxes[:, 0] <= lon) & (lon <= boxes[:, 2])
    inside &= (boxes[:, 1] <= lat) & (lat <= boxes[:, 3])
    return [np.flatnonzero(row) for row in inside.any(axis=1)]


def assert_same(found, expected) -> None:
    assert (found.tiles.dtype, found.offsets.dtype) == (np.int32, np.int64)
    assert found.counts.tolist() == [len(tiles) for tiles in expected]
    assert found.tiles.tolist() == [tile for tiles in expected for tile in tiles]


def starts_of(length: float, tile: float) -> Any:
    """Tiles at half a tile's stride; the last anchored to the edge."""
    starts = np.arange(0, max(length - tile, 0) + 1, tile / 2)
    return starts if starts[-1] >= length - tile else np.append(starts, length - tile)


def grid(width: float, height: float, tile: float, bend: float = 0.0) -> Any:
    """Boxes of the corners of a map's tiles, row by row from the north.

    A bend tilts and curves the map as the convergence of the meridians does, only more.
    """
    x, y = np.meshgrid(starts_of(width, tile), -starts_of(height, tile))
    corners = []
    for px, py in ((x + dx, y - dy) for dx in (0, tile) for dy in (0, tile)):
        lon = px + bend * (112 + 0.05 * py + 2e-4 * px * py)
        corners.append((lon, py + bend * (28 - 0.05 * px - 1e-4 * px**2)))
    lon, lat = np.moveaxis(corners, 1, 0)
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def points_near(boxes: Any, rng: np.random.Generator, n: int) -> Any:
    """Points in, on the borders and corners of, and beside tiles, and some NaN."""
    picks = boxes[rng.integers(0, len(boxes), (n, 4))]
    share = rng.choice([0, 0, 0.25, 0.5, 1, 1, 1.5, np.nan], (n, 4, 2))
    low, high = picks[..., :2], picks[..., 2:]
    return np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))


sizes = st.sampled_from([1.0, 2, 2.5, 4, 5, 7, 9.5, 20])


@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.integers(0, 9))
def test_any_boxes_agree_with_every_tile_tested(seed, n_tiles, n_queries) -> None:
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


@given(sizes, sizes, st.sampled_from([0.0, 1.0]), st.sampled_from([*ORDERS]), st.integers(0))
def test_grids_agree_with_every_tile_tested(width, height, bend, order, seed) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.concatenate([grid(width, height, tile, bend) for tile in (4.0, 2.0)])
    boxes = boxes[ORDERS[order](boxes, rng)]
    points = points_near(boxes, rng, 40) if len(boxes) else np.zeros((40, 4, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(positives, "_TILES", 64)  # of a tree, which then are several
        assert_same(find_holding_tiles(points, boxes), naive(points, boxes))


# --- overlap ---


def test_overlap_by_hand() -> None:
    square = np.array([[[0.5, 0.5], [1.5, 0.5], [1.5, 1.5], [0.5, 1.5]]])
    boxes = np.array([[0, 0, 1, 1], [1, 1, 2, 2], [0.5, 0.5, 1.5, 1.5], [5, 5, 6, 6]], float)
    found = find_overlaps(square, boxes)
    assert found.tiles.tolist() == [0, 1, 2]
    assert found.overlap == pytest.approx([0.25 / 1.75, 0.25 / 1.75, 1])
    half = np.array([[[0.0, 0], [0.5, 0], [0.5, 1], [0, 1]]])
    assert find_positives(half, UNIT_BOX, 0.5).counts.tolist() == [0]  # strictly above
    assert find_positives(half, UNIT_BOX, 0.49).overlap.tolist() == [0.5]


def test_rounding_does_not_make_touching_an_overlap() -> None:
    x, y = np.random.default_rng(0).uniform(-3, 4, (2, 500, 4))
    boxes = UNIT_BOX / 7 + [113, 28, 113, 28]
    above = np.stack([np.sort(x, axis=1), 1 + np.abs(y)], axis=2) / 7 + [113, 28]
    above[:, :2, 1] = boxes[0, 3]
    every = Positives(np.arange(501), np.zeros(500, np.int32))
    assert not with_overlap(above, boxes, every).overlap.any()


def test_footprint_with_nan_or_without_area_overlaps_nothing() -> None:
    polygons = np.full((3, 4, 2), 0.5)
    polygons[:2] = [[0, 0], [1, 0], [1, 1], [0, 1]]
    polygons[0, 3, 1] = np.nan
    assert find_overlaps(polygons, UNIT_BOX).counts.tolist() == [0, 1, 0]
    every = Positives(np.arange(4), np.zeros(3, np.int32))
    assert with_overlap(polygons, UNIT_BOX, every).overlap.tolist() == [0, 1, 0]


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 113.0]), st.booleans())
def test_overlaps_agree_with_shapely(seed, offset, on_lattice) -> None:
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


# --- footprints ---

CRS = "EPSG:32650"
EAST, NORTH = 500_000.0, 3_000_000.0
NADIR = np.diag([1.0, -1.0, -1.0])  # x east, y south, z down
# 800 x 600 px, f = 400: the half angles' tangents are 1 and 0.75.
CAMERA = Cameras.from_matrices(np.array([[[400, 0, 400], [0, 400, 300], [0, 0, 1.0]]]), 800, 600)


def cast(
    rotation: np.ndarray, height: float = 150.0, ground: float | HeightField = 50.0, **how: float
) -> Footprints:
    poses = Poses.from_centres(rotation[None], np.array([[EAST, NORTH, height]]))
    chosen = {"inset": 1 / 16, "max_range_m": 1000.0, "about_lon": 117.0} | how
    return cast_footprints(CAMERA, poses, CRS, ground, **chosen)


def metres(lonlat: np.ndarray) -> np.ndarray:
    back = Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    return np.stack(back.transform(lonlat[..., 0], lonlat[..., 1]), axis=-1) - [EAST, NORTH]


def test_nadir() -> None:
    # Anchors at u = 50, 750 and v = 37.5, 562.5: tangents -+350/400 = 0.875, -+262.5/400 = 0.65625.
    # From 100 m above the plane they lie 87.5 m to the sides and 65.625 m up and down.
    found = cast(NADIR)
    corners = [[-87.5, 65.625], [87.5, 65.625], [87.5, -65.625], [-87.5, -65.625]]
    np.testing.assert_allclose(metres(found.lonlat[0]), corners, atol=2e-4)
    np.testing.assert_allclose(metres(found.centres), [[0, 0]], atol=2e-4)
    # The ground is at 50 m west of the camera and at 100 m east of it: half the distance, half the
    # offset (43.75 and 32.8125 m).
    heights = np.full((400, 400), 50.0)
    heights[:, 200:] = 100.0
    surface = HeightField(heights, Affine(1, 0, EAST - 200, 0, -1, NORTH + 200), CRS)
    corners[1:3] = [43.75, 32.8125], [43.75, -32.8125]
    np.testing.assert_allclose(metres(cast(NADIR, ground=surface).lonlat[0]), corners, atol=2e-4)


def test_a_camera_at_the_horizon_sees_ground_below_only() -> None:
    # Looking north: x east, y down, z north. The upper anchors look up; the lower ones have a
    # tangent of 0.65625 down, so from 100 m they meet the plane 100 / 0.65625 = 152.38 m north.
    found = cast(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float))
    north = 100 / 0.65625
    lower = [[north * 0.875, north], [-north * 0.875, north]]
    np.testing.assert_allclose(metres(found.lonlat[0, 2:]), lower, atol=3e-4)
    np.testing.assert_allclose(metres(found.centres[0]), [0, north], atol=3e-4)
    assert np.isnan(found.lonlat[0, :2]).all()


# Looks at the sky; is below the plane; is beyond the range.
@pytest.mark.parametrize(("rotation", "height"), [(np.eye(3), 150), (NADIR, 20), (NADIR, 5000)])
def test_no_ground_point_at_all(rotation: np.ndarray, height: float) -> None:
    found = cast(rotation, height)
    assert np.isnan(found.lonlat).all()
    assert np.isnan(found.centres).all()


def test_points_are_rounded_as_boxes_are_whatever_the_turn() -> None:
    # Kept to 1e-9 degrees: a point on a tile's border is on it on every machine.
    tilted = NADIR @ np.array([[1, 0, 0], [0, 0.96, -0.28], [0, 0.28, 0.96]])
    for part, moved in zip(cast(tilted), cast(tilted, about_lon=477.0), strict=True):
        assert np.array_equal(part, np.round(part, 9))
        assert np.array_equal(moved, np.round(moved, 9))
        np.testing.assert_allclose((moved - part)[..., 0], 360, atol=4e-9)

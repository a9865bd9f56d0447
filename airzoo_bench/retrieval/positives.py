"""Ground truth of retrieval: which tiles of the gallery show what a query shows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import shapely
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.footprints import (
    box_areas,
    intersection_areas,
    polygon_areas,
    untangled,
)
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.tile_grid import TileRun, find_runs

__all__ = ["overlap_of", "overlaps", "positives_from_iou", "positives_from_points"]

_BLOCK = 4096  # queries at a time
_TILES = 1 << 18  # of a search tree, which bounds its memory
_PAIRS = 1 << 17  # query-tile pairs at a time; they stay in the cache
_NONE = np.iinfo(np.int32).max
_TOUCH = 1e-12  # of the tile's area; rounding leaves less than this of two that only touch


def positives_from_points(points: NDArray[np.floating], boxes: NDArray[np.floating]) -> Positives:
    """Find the tiles that hold at least one of a query's ground points, borders included."""
    boxes = _check_boxes(boxes)
    anchors: Floats = np.asarray(points, dtype=np.float64)
    if anchors.ndim != 3 or anchors.shape[2] != 2:
        raise ValueError(f"points must be (Q, A, 2), not {anchors.shape}")
    if anchors.size == 0 or len(boxes) == 0:
        return _from_keys([], len(anchors), len(boxes))
    runs = find_runs(boxes)
    if runs is not None:
        blocks = (anchors[start : start + _BLOCK] for start in range(0, len(anchors), _BLOCK))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            found = list(pool.map(lambda block: _in_runs(block, runs), blocks))
        counts, tiles = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Positives(offsets_of(counts), tiles)
    query = np.repeat(np.arange(len(anchors)), anchors.shape[1])
    places = anchors.reshape(-1, 2)
    keys = [query[row] * len(boxes) + tile for row, tile in _meeting(places, places, boxes)]
    return _from_keys(keys, len(anchors), len(boxes))


def overlaps(polygons: NDArray[np.floating], boxes: NDArray[np.floating]) -> Positives:
    """Overlap ratio (intersection over union) of every footprint and tile that overlap."""
    boxes, polygons = _check_boxes(boxes), _check_polygons(polygons)
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    keys = [query * len(boxes) + tile for query, tile in _meeting(low, high, boxes)]
    near = _from_keys(keys, len(polygons), len(boxes))
    return _above(near, _ratios(polygons, boxes, near), 0.0)


def positives_from_iou(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], threshold: float
) -> Positives:
    """Keep the tiles whose overlap with the footprint exceeds a threshold (strictly)."""
    found = overlaps(polygons, boxes)
    return _above(found, np.asarray(found.overlap), threshold)


def overlap_of(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], positives: Positives
) -> Floats:
    """Overlap ratio of given pairs of footprint and tile."""
    boxes, polygons = _check_boxes(boxes), _check_polygons(polygons)
    if len(polygons) != positives.n_queries:
        raise ValueError(f"{len(polygons)} polygons for {positives.n_queries} queries")
    return _ratios(polygons, boxes, positives)


def _in_runs(points: Floats, runs: list[TileRun]) -> tuple[Ints, NDArray[np.int32]]:
    """Return how many tiles hold points of each query of a block, and these tiles."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    hits = np.empty((len(lon), sum(run.slots for run in runs)), dtype=np.int32)
    used = 0
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points hit nothing
        for run in runs:
            run.fill(lon, lat, hits[:, used : used + run.slots], _NONE)
            used += run.slots
    hits = hits.reshape(len(points), -1)
    hits.sort(axis=1)
    first = hits != _NONE
    first[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return first.sum(axis=1), hits[first]


def _meeting(low: Floats, high: Floats, boxes: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Give pairs of a box (`low` to `high`, finite ones only) and a tile that it meets."""
    finite = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1))
    for first in range(0, len(boxes), _TILES):
        tree = shapely.STRtree(shapely.box(*boxes[first : first + _TILES].T))
        for start in range(0, len(finite), _BLOCK):
            rows = finite[start : start + _BLOCK]
            query, tile = tree.query(shapely.box(*low[rows].T, *high[rows].T))
            yield rows[query], first + tile


def _from_keys(keys: list[Ints], n_queries: int, n_tiles: int) -> Positives:
    """Make pairs of keys, which are query x number of tiles + tile."""
    query, tile = np.divmod(
        np.unique(np.concatenate([np.zeros(0, np.int64), *keys])), max(n_tiles, 1)
    )
    return Positives(offsets_of(np.bincount(query, minlength=n_queries)), tile.astype(np.int32))


def _above(pairs: Positives, ratio: Floats, threshold: float) -> Positives:
    above = ratio > threshold
    counts = np.bincount(pairs.queries[above], minlength=pairs.n_queries)
    return Positives(offsets_of(counts), pairs.tiles[above], ratio[above])


def _ratios(polygons: Floats, boxes: Floats, pairs: Positives) -> Floats:
    """Intersection over union of pairs, in blocks."""
    shapes, query = untangled(polygons), pairs.queries
    found = np.zeros(len(query))
    for start in range(0, len(query), _PAIRS):
        part = slice(start, start + _PAIRS)
        shape, box = shapes[query[part]], boxes[pairs.tiles[part]]
        common = intersection_areas(shape, box)
        size = box_areas(box)
        union = polygon_areas(shape) + size - common
        # A NaN corner makes `common` NaN, which is not above the rounding either.
        np.divide(common, union, out=found[part], where=common > _TOUCH * size)
    return np.minimum(found, 1)


def _check_boxes(boxes: NDArray[np.floating]) -> Floats:
    checked: Floats = np.ascontiguousarray(boxes, dtype=np.float64)
    if checked.ndim != 2 or checked.shape[1] != 4:
        raise ValueError(f"boxes must be (G, 4), not {checked.shape}")
    west, south, east, north = checked.T
    good = (west <= east) & (south <= north)  # also tells NaN
    if not (good.all() and np.isfinite(checked).all()):
        good &= np.isfinite(checked).all(axis=1)
        rows = np.flatnonzero(~good)
        raise BenchmarkError(
            f"tiles without a valid box: {first_of(rows, len(boxes))}",
            where="tiles",
            expected="finite lon_min <= lon_max and lat_min <= lat_max, in degrees",
            fix="correct those rows of the gallery table, or run `airzoo-bench prepare` again",
        )
    return checked


def _check_polygons(polygons: NDArray[np.floating]) -> Floats:
    shapes: Floats = np.asarray(polygons, dtype=np.float64)
    if shapes.ndim != 3 or shapes.shape[1:] != (4, 2):
        raise ValueError(f"polygons must be (Q, 4, 2), not {shapes.shape}")
    return shapes

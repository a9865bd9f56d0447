"""Ground truth of retrieval: which tiles of the gallery show what a query shows."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
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

if TYPE_CHECKING:
    import shapely

__all__ = [
    "Positives",
    "overlap_of",
    "overlaps",
    "positives_from_iou",
    "positives_from_points",
]


_BLOCK = 4096  # queries at a time; bounds memory and stays in the cache
_PAIRS = 1 << 17  # query-tile pairs at a time
_NONE = np.iinfo(np.int32).max
_TOUCH = 1e-12  # of the tile's area; what rounding leaves of two that only touch is below


def positives_from_points(points: NDArray[np.floating], boxes: NDArray[np.floating]) -> Positives:
    """Find the tiles that hold at least one of a query's ground points, borders included.

    Parameters
    ----------
    points : (Q, A, 2) array
        lon, lat of the anchor pixels' ground points, degrees, or x, y in the map's own frame. A
        point with NaN (a ray without ground) lies in no tile.
    boxes : (G, 4) array
        lon_min, lat_min, lon_max, lat_max of each tile, in the same frame. Longitudes of both are
        unwrapped about one meridian; see `frames.unwrapped`.

    Returns
    -------
    Positives
        Without overlap.

    Raises
    ------
    BenchmarkError
        Where a box is not finite or its minimum exceeds its maximum.
    ValueError
        Where the arrays have other shapes.
    """
    checked = _check_boxes(boxes)
    anchors = np.asarray(points, dtype=np.float64)
    if anchors.ndim != 3 or anchors.shape[2] != 2:
        raise ValueError(f"points must be (Q, A, 2), not {anchors.shape}")
    if anchors.size == 0 or len(checked) == 0:
        return _joined([], len(anchors))
    runs = find_runs(checked)
    tree = _tree(checked) if runs is None else None

    def block(start: int) -> tuple[Ints, NDArray[np.int32]]:
        some = anchors[start : start + _BLOCK]
        return _in_boxes(some, checked, tree) if runs is None else _in_runs(some, runs)

    starts = range(0, len(anchors), _BLOCK)
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(starts))) as pool:
        return _joined(list(pool.map(block, starts)), len(anchors))


def overlaps(polygons: NDArray[np.floating], boxes: NDArray[np.floating]) -> Positives:
    """Overlap ratio (intersection over union) of every footprint and tile that overlap.

    The ratio is taken in lon/lat. It is the ratio on the ground, since a ratio of areas does not
    change when an axis is scaled, and within a tile degrees differ from metres by such a scale.

    Parameters
    ----------
    polygons : (Q, 4, 2) array
        lon, lat of the footprint's corners in order, either way round, degrees. A polygon with a
        NaN corner is no footprint and overlaps nothing. A quadrilateral that crosses itself is
        replaced with its convex hull: a convex frame seen on a plane is convex, so that only the
        order of the corners can have been wrong.
    boxes : (G, 4) array
        lon_min, lat_min, lon_max, lat_max of each tile, as in :func:`positives_from_points`.

    Returns
    -------
    Positives
        The pairs whose common area exceeds 0, with overlap in (0, 1]. Touching is not
        overlapping: less than 1e-12 of the tile, the rounding of its area, counts as 0.

    Raises
    ------
    BenchmarkError
        Where a box is not finite or its minimum exceeds its maximum.
    ValueError
        Where the arrays have other shapes.
    """
    boxes = _check_boxes(boxes)
    polygons = _check_polygons(polygons)
    whole = np.flatnonzero(np.isfinite(polygons).all(axis=(1, 2)))
    tree = _tree(boxes)
    found = []
    for start in range(0, len(whole), _BLOCK):
        some = whole[start : start + _BLOCK]
        query, tile = _near(polygons[some], tree, len(boxes))
        ratio = _ratios(polygons[some], boxes, query, tile)
        kept = ratio > 0
        found.append((some[query[kept]], tile[kept].astype(np.int32), ratio[kept]))
    queries, tiles, ratios = (
        np.concatenate([np.empty(0, dtype), *(part[i] for part in found)])
        for i, dtype in enumerate((np.int64, np.int32, np.float64))
    )
    return Positives(offsets_of(np.bincount(queries, minlength=len(polygons))), tiles, ratios)


def positives_from_iou(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], threshold: float
) -> Positives:
    """Keep the tiles whose overlap with the footprint exceeds a threshold (strictly).

    Parameters
    ----------
    polygons, boxes : arrays
        As of :func:`overlaps`.
    threshold : float
        Overlap ratio, 0 to 1; Game4Loc takes 0.39 for positives and 0.14 for semi-positives.

    Returns
    -------
    Positives
        With overlap.
    """
    found = overlaps(polygons, boxes)
    ratio = overlap_of(polygons, boxes, found) if found.overlap is None else found.overlap
    kept = ratio > threshold
    counts = np.bincount(found.queries[kept], minlength=found.n_queries)
    return Positives(offsets_of(counts), found.tiles[kept], ratio[kept])


def overlap_of(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], positives: Positives
) -> Floats:
    """Overlap ratio of given pairs of footprint and tile.

    Parameters
    ----------
    polygons, boxes : arrays
        As of :func:`overlaps`.
    positives : Positives
        The pairs.

    Returns
    -------
    (P,) array
        In the order of `positives.tiles`; 0 where there is no footprint or no overlap.
    """
    boxes, polygons = _check_boxes(boxes), _check_polygons(polygons)
    if len(polygons) != positives.n_queries:
        raise ValueError(f"{len(polygons)} polygons for {positives.n_queries} queries")
    return _ratios(polygons, boxes, positives.queries, positives.tiles)


def _in_runs(points: Floats, runs: list[TileRun]) -> tuple[Ints, NDArray[np.int32]]:
    """Tiles of a block of queries: a row of candidates each, sorted, repeats dropped."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    hits = np.empty((len(lon), sum(run.slots for run in runs)), dtype=np.int32)
    used = 0
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points hit nothing
        for run in runs:
            run.fill(lon, lat, hits[:, used : used + run.slots], _NONE)
            used += run.slots
    hits = hits.reshape(len(points), -1)
    hits.sort(axis=1)
    kept = hits != _NONE
    kept[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return kept.sum(axis=1), hits[kept]


def _in_boxes(
    points: Floats, boxes: Floats, tree: shapely.STRtree
) -> tuple[Ints, NDArray[np.int32]]:
    """Tiles of a block of queries by the search tree, whatever the tiles are."""
    import shapely

    lon, lat = points.reshape(-1, 2).T
    point, tile = tree.query(shapely.points(lon, lat))
    lon, lat, box = lon[point], lat[point], boxes[tile]
    inside = (box[:, 0] <= lon) & (lon <= box[:, 2]) & (box[:, 1] <= lat) & (lat <= box[:, 3])
    key = np.sort(point[inside] // points.shape[1] * len(boxes) + tile[inside])
    query, tile = np.divmod(key[np.diff(key, prepend=-1) > 0], len(boxes))
    return np.bincount(query, minlength=len(points)), tile.astype(np.int32)


def _near(polygons: Floats, tree: shapely.STRtree, n_tiles: int) -> tuple[Ints, Ints]:
    """Pairs of polygon and tile whose bounding boxes meet, in order."""
    import shapely

    bounds = np.concatenate([polygons.min(axis=1), polygons.max(axis=1)], axis=1)
    query, tile = tree.query(shapely.box(*bounds.T))
    key = np.sort(query * n_tiles + tile)
    return key // max(n_tiles, 1), key % max(n_tiles, 1)


def _ratios(polygons: Floats, boxes: Floats, query: Ints, tile: NDArray[np.integer[Any]]) -> Floats:
    """Intersection over union of pairs, in blocks."""
    shapes = untangled(polygons)
    ratios = np.zeros(len(query))
    for start in range(0, len(query), _PAIRS):
        part = slice(start, start + _PAIRS)
        shape, box = shapes[query[part]], boxes[tile[part]]
        common = intersection_areas(shape, box)
        size = box_areas(box)
        union = polygon_areas(shape) + size - common
        # A NaN corner makes `common` NaN, which is not above the rounding either.
        overlapping = common > _TOUCH * size
        np.divide(common, union, out=ratios[part], where=overlapping)
    return np.minimum(ratios, 1)


def _tree(boxes: Floats) -> shapely.STRtree:
    import shapely

    return shapely.STRtree(shapely.box(*boxes.T))


def _joined(blocks: list[tuple[Ints, NDArray[np.int32]]], n_queries: int) -> Positives:
    counts = np.concatenate([np.zeros(0, np.int64), *(block[0] for block in blocks)])
    tiles = np.concatenate([np.zeros(0, np.int32), *(block[1] for block in blocks)])
    return Positives(offsets_of(np.resize(counts, n_queries)), tiles)


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

"""Ground truth of retrieval: which tiles of the gallery show what a query shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.positive_shards import (
    by_shards,
    merged,
    overlapping,
    ratios,
    tiles_of_points,
)

__all__ = [
    "Positives",
    "overlap_of",
    "overlaps",
    "positives_from_iou",
    "positives_from_points",
]


def positives_from_points(
    points: NDArray[np.floating], boxes: NDArray[np.floating], engine: Engine = HERE
) -> Positives:
    """Find the tiles that hold at least one of a query's ground points, borders included.

    Parameters
    ----------
    points : (Q, A, 2) array
        lon, lat of the anchor pixels' ground points, degrees, or x, y in the map's own frame. A
        point with NaN (a ray without ground) lies in no tile.
    boxes : (G, 4) array
        lon_min, lat_min, lon_max, lat_max of each tile, in the same frame. Longitudes of both are
        unwrapped about one meridian; see `frames.unwrapped`.
    engine : Engine
        Where shards of the gallery are searched.

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
        return merged([], len(anchors))
    return by_shards(tiles_of_points, anchors, checked, engine)


def overlaps(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], engine: Engine = HERE
) -> Positives:
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
    engine : Engine
        Where shards of the gallery are searched.

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
    return by_shards(overlapping, polygons, boxes, engine)


def positives_from_iou(
    polygons: NDArray[np.floating],
    boxes: NDArray[np.floating],
    threshold: float,
    engine: Engine = HERE,
) -> Positives:
    """Keep the tiles whose overlap with the footprint exceeds a threshold (strictly).

    Parameters
    ----------
    polygons, boxes : arrays
        As of :func:`overlaps`.
    threshold : float
        Overlap ratio, 0 to 1; Game4Loc takes 0.39 for positives and 0.14 for semi-positives.
    engine : Engine

    Returns
    -------
    Positives
        With overlap.
    """
    found = overlaps(polygons, boxes, engine)
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
    return ratios(polygons, boxes, positives.queries, positives.tiles)


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

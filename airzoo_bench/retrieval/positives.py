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
    """Find the tiles that hold at least one of a query's ground points, borders included."""
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
    """Overlap ratio (intersection over union) of every footprint and tile that overlap."""
    boxes = _check_boxes(boxes)
    polygons = _check_polygons(polygons)
    return by_shards(overlapping, polygons, boxes, engine)


def positives_from_iou(
    polygons: NDArray[np.floating],
    boxes: NDArray[np.floating],
    threshold: float,
    engine: Engine = HERE,
) -> Positives:
    """Keep the tiles whose overlap with the footprint exceeds a threshold (strictly)."""
    found = overlaps(polygons, boxes, engine)
    ratio = overlap_of(polygons, boxes, found) if found.overlap is None else found.overlap
    kept = ratio > threshold
    counts = np.bincount(found.queries[kept], minlength=found.n_queries)
    return Positives(offsets_of(counts), found.tiles[kept], ratio[kept])


def overlap_of(
    polygons: NDArray[np.floating], boxes: NDArray[np.floating], positives: Positives
) -> Floats:
    """Overlap ratio of given pairs of footprint and tile."""
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

"""Ground truth of retrieval: which tiles of the gallery show what a query shows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.footprints import ious, untangled
from airzoo_bench.retrieval.truth import Positives, offsets_of

_BLOCK = 4096  # queries at a time
_TILES = 1 << 18  # of a search tree, which bounds its memory
_PAIRS = 1 << 17  # query-tile pairs at a time; they stay in the cache
_NONE = np.iinfo(np.int32).max
_MOST_GRIDS = 16
_MOST_CANDIDATES = 128  # a point; beyond this a search tree is faster
_FIT_TILES = 12  # a side; functions are fitted on at most 12 x 12 tiles
_SLACK = 1e-12  # of the terms' size; far above their rounding, far below a tile


def positives_from_points(points: Floats, boxes: Floats) -> Positives:
    """Find the tiles (G, 4) that hold at least one of a query's points (Q, A, 2), borders included.

    Points of NaN lie in no tile.
    """
    n_queries, n_tiles = len(points), len(boxes)
    if points.size == 0 or n_tiles == 0:
        return _from_keys([], n_queries, n_tiles)
    grids = _grids(boxes)
    if grids:
        blocks = (points[start : start + _BLOCK] for start in range(0, n_queries, _BLOCK))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            found = list(pool.map(lambda block: _in_grids(grids, block), blocks))
        counts, tiles = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Positives(offsets_of(counts), tiles)
    query = np.repeat(np.arange(n_queries), points.shape[1])
    places = points.reshape(-1, 2)
    keys = [query[row] * n_tiles + tile for row, tile in _meeting(places, places, boxes)]
    return _from_keys(keys, n_queries, n_tiles)


def overlaps(polygons: Floats, boxes: Floats) -> Positives:
    """Find every footprint (Q, 4, 2) and tile (G, 4) that overlap, with intersection over union."""
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    keys = [query * len(boxes) + tile for query, tile in _meeting(low, high, boxes)]
    near = _from_keys(keys, len(polygons), len(boxes))
    found = Positives(near.offsets, near.tiles, overlap_of(polygons, boxes, near))
    return found.where(np.asarray(found.overlap) > 0)


def positives_from_iou(polygons: Floats, boxes: Floats, threshold: float) -> Positives:
    """Find the tiles that overlap the footprint by more than a threshold (strictly)."""
    found = overlaps(polygons, boxes)
    return found.where(np.asarray(found.overlap) > threshold)


def overlap_of(polygons: Floats, boxes: Floats, pairs: Positives) -> Floats:
    """Return the intersection over union of given pairs of footprint and tile."""
    shapes, query = untangled(polygons), pairs.queries
    found = np.zeros(len(query))
    for start in range(0, len(query), _PAIRS):
        part = slice(start, start + _PAIRS)
        found[part] = ious(shapes[query[part]], boxes[pairs.tiles[part]])
    return found


def _meeting(low: Floats, high: Floats, boxes: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield pairs of a box (`low` to `high`, finite ones only) and a tile that it meets."""
    finite = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1))
    for first in range(0, len(boxes), _TILES):
        tree = shapely.STRtree(shapely.box(*boxes[first : first + _TILES].T))
        for start in range(0, len(finite), _BLOCK):
            rows = finite[start : start + _BLOCK]
            query, tile = tree.query(shapely.box(*low[rows].T, *high[rows].T))
            yield rows[query], first + tile


def _from_keys(keys: list[Ints], n_queries: int, n_tiles: int) -> Positives:
    """Make pairs of keys, which are query x number of tiles + tile."""
    every = np.unique(np.concatenate([np.zeros(0, np.int64), *keys]))
    query, tile = np.divmod(every, max(n_tiles, 1))
    return Positives(offsets_of(np.bincount(query, minlength=n_queries)), tile.astype(np.int32))


# A gallery cut from one map is a few grids of tiles, one a scale, row by row. There arithmetic
# finds the tiles that may hold a point, more than 10 times as fast as a search tree.


@dataclass(frozen=True)
class _Grid:
    """Tiles that follow each other row by row, and which of them may hold a point.

    Rows and columns are nearly straight and parallel. Two linear functions of lon/lat give a tile's
    centre nearly its column and its row. Each column covers an interval of the first one's values,
    each row of the second one's, which are computed from every tile: a poor fit costs time, never
    a tile.
    """

    start: int  # index of the first tile
    columns: int  # tiles a row
    boxes: Floats  # (n, 4)
    fits: list[Floats]  # of columns and rows: offset, and factors of lon and lat
    ends: list[Floats]  # where the intervals of the columns and the rows end, ascending
    widths: list[int]  # the most columns and rows that one value can lie in

    @property
    def candidates(self) -> int:
        """How many tiles are tested for a point."""
        return self.widths[0] * self.widths[1]

    def fill(self, lon: Floats, lat: Floats, hits: NDArray[np.int32]) -> None:
        """Write the tiles that hold each of N points into `hits` (N, candidates)."""
        column, row = (
            np.minimum(np.searchsorted(ends, _linear(fit, lon, lat)), len(ends) - width)
            for fit, ends, width in zip(self.fits, self.ends, self.widths, strict=True)
        )
        corner = row * self.columns + column
        for slot in range(self.candidates):
            down, right = divmod(slot, self.widths[0])
            tile = corner + (down * self.columns + right)
            box = self.boxes.take(tile, axis=0)
            inside = (box[:, 0] <= lon) & (lon <= box[:, 2])
            inside &= (box[:, 1] <= lat) & (lat <= box[:, 3])
            hits[:, slot] = np.where(inside, tile + self.start, _NONE)


def _fit_grid(boxes: Floats, start: int, columns: int) -> _Grid:
    """Fit the linear functions of a run of tiles."""
    west, south, east, north = boxes.T  # by column: reducing (n, 4) over n is 20 times slower
    lon, lat = ((one / 2).reshape(-1, columns) for one in (west + east, south + north))
    reach = (east - west).max() / 2, (north - south).max() / 2
    # Not by the last row and column: anchored to the map's edge, they are out of step.
    rows = [np.unique(np.linspace(0, max(n - 2, 0), _FIT_TILES).astype(int)) for n in lon.shape]
    some = np.ix_(*rows)
    terms = np.stack([one.ravel() for one in (np.ones_like(lon[some]), lon[some], lat[some])], 1)
    fits, ends, widths = [], [], []
    for axis, index in enumerate(np.broadcast_arrays(some[1], some[0])):
        fit: Floats = np.linalg.lstsq(terms, index.ravel().astype(np.float64))[0]
        margin = np.abs(fit[1:]) @ reach + _SLACK * float(1 + np.abs(fit * (1, 180, 90)).sum())
        values = _linear(fit, lon, lat)
        begin = np.minimum.accumulate((values.min(axis=axis) - margin)[::-1])[::-1]
        end = np.maximum.accumulate(values.max(axis=axis) + margin)
        met = np.searchsorted(begin, end, side="right") - np.arange(len(begin))
        fits.append(fit)
        ends.append(end)
        widths.append(int(met.max()))
    return _Grid(start, columns, boxes, fits, ends, widths)


def _linear(fit: Floats, lon: Floats, lat: Floats) -> Floats:
    return np.asarray(fit[0] + fit[1] * lon + fit[2] * lat)


def _grids(boxes: Floats) -> list[_Grid]:
    """Split a gallery into grids of tiles; none where a search tree is faster."""
    starts = np.concatenate([[0], np.flatnonzero(boxes[1:, 0] <= boxes[:-1, 0]) + 1])
    step = np.sign(np.diff(boxes[starts, 3]))
    usual = -1 if step.sum() <= 0 else 1  # latitude falls from row to row, or rises
    lengths = np.diff(np.append(starts, len(boxes)))
    firsts = np.append(0, np.flatnonzero((np.diff(lengths) != 0) | (step != usual)) + 1)
    if len(firsts) > _MOST_GRIDS:
        return []
    ends = np.append(starts[firsts[1:]], len(boxes))
    runs = np.stack([starts[firsts], ends, lengths[firsts]], axis=1).tolist()
    grids = [_fit_grid(boxes[start:end], start, columns) for start, end, columns in runs]
    return grids if sum(grid.candidates for grid in grids) <= _MOST_CANDIDATES else []


def _in_grids(grids: list[_Grid], points: Floats) -> tuple[Ints, NDArray[np.int32]]:
    """Return how many tiles hold points of each query of a block, and these tiles."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    widths = [grid.candidates for grid in grids]
    hits = np.empty((len(lon), sum(widths)), np.int32)
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points lie in no tile
        for grid, part in zip(grids, np.split(hits, np.cumsum(widths)[:-1], axis=1), strict=True):
            grid.fill(lon, lat, part)
    hits = hits.reshape(len(points), -1)
    hits.sort(axis=1)
    first = hits != _NONE
    first[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return first.sum(axis=1), hits[first]

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
_FIT_TILES = 12  # a side; quadratics are fitted on at most 12 x 12 tiles
_SLACK = 1e-9  # in tile indices; far above the rounding of quadratics, far below a tile


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
# finds the tiles that may hold a point, some 40 times as fast as a search tree.


@dataclass(frozen=True)
class _Grid:
    """Tiles that follow each other row by row, and which of them may hold a point.

    Rows and columns are straight and parallel (a geographic map) or slightly tilted and bent (a
    projected one). Two quadratics in lon/lat give a tile's centre nearly its column and its row.
    Each column covers an interval of the first one's values, each row of the second one's, which
    are computed from every tile: a poor fit costs time, never a tile.
    """

    start: int  # index of the first tile
    columns: int  # tiles a row
    boxes: Floats  # (n, 4)
    middle: Floats  # (2,), centre of the grid in lon/lat
    half: Floats  # (2,), its half size, the unit of the quadratics
    fits: list[Floats]  # of columns and rows, coefficients of 1, x, y, xy, x^2, y^2
    ends: list[Floats]  # where the intervals of the columns and the rows end, ascending
    widths: list[int]  # the most columns and rows that one value can lie in

    @property
    def candidates(self) -> int:
        """How many tiles are tested for a point."""
        return self.widths[0] * self.widths[1]

    def fill(self, lon: Floats, lat: Floats, hits: NDArray[np.int32]) -> None:
        """Write the tiles that hold each of N points into `hits` (N, candidates)."""
        x, y = (lon - self.middle[0]) / self.half[0], (lat - self.middle[1]) / self.half[1]
        column, row = (
            np.minimum(np.searchsorted(ends, _quadratic(fit, x, y)), len(ends) - width)
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
    """Fit the quadratics of a run of tiles."""
    west, south, east, north = boxes.T  # by column: reducing (n, 4) over n is 20 times slower
    low, high = np.array([west.min(), south.min()]), np.array([east.max(), north.max()])
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, np.finfo(np.float64).tiny)
    x = (((west + east) / 2 - middle[0]) / half[0]).reshape(-1, columns)
    y = (((south + north) / 2 - middle[1]) / half[1]).reshape(-1, columns)
    reach = np.array([(east - west).max(), (north - south).max()]) / half / 2
    # Not by the last row and column: anchored to the map's edge, they are out of step.
    some = [np.unique(np.linspace(0, max(n - 2, 0), _FIT_TILES).astype(int)) for n in x.shape]
    fx, fy = (values[np.ix_(*some)].ravel() for values in (x, y))
    terms = np.stack([np.ones_like(fx), fx, fy, fx * fy, fx**2, fy**2], axis=1)
    row, column = (index.ravel() for index in np.meshgrid(*some, indexing="ij"))
    fits, ends, widths = [], [], []
    for axis, index in enumerate((column, row)):
        fit: Floats = np.linalg.lstsq(terms, index.astype(np.float64))[0].astype(np.float64)
        slopes = np.abs(fit[1:3]) + abs(fit[3]) + 2 * np.abs(fit[4:])
        margin = float(slopes @ reach) + _SLACK * (1 + float(np.abs(fit).sum()))
        values = _quadratic(fit, x, y)
        begin = np.minimum.accumulate((values.min(axis=axis) - margin)[::-1])[::-1]
        end = np.maximum.accumulate(values.max(axis=axis) + margin)
        met = np.searchsorted(begin, end, side="right") - np.arange(len(begin))
        fits.append(fit)
        ends.append(end)
        widths.append(int(met.max()))
    return _Grid(start, columns, boxes, middle, half, fits, ends, widths)


def _quadratic(c: Floats, x: Floats, y: Floats) -> Floats:
    value: Floats = c[0] + x * (c[1] + c[3] * y + c[4] * x) + y * (c[2] + c[5] * y)
    return value


def _grids(boxes: Floats) -> list[_Grid]:
    """Split a gallery into grids of tiles; none where a search tree is faster."""
    starts = np.concatenate([[0], np.flatnonzero(boxes[1:, 0] <= boxes[:-1, 0]) + 1])
    step = np.sign(np.diff(boxes[starts, 3]))
    usual = -1 if step.sum() <= 0 else 1  # latitude falls from row to row, or rises
    lengths = np.diff(np.append(starts, len(boxes)))
    breaks = (np.diff(lengths) != 0) | (step != usual)
    firsts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    if len(firsts) > _MOST_GRIDS:
        return []
    ends = np.append(starts[firsts[1:]], len(boxes))
    runs = np.stack([starts[firsts], ends, lengths[firsts]], axis=1).tolist()
    grids = [_fit_grid(boxes[start:end], start, columns) for start, end, columns in runs]
    return grids if sum(grid.candidates for grid in grids) <= _MOST_CANDIDATES else []


def _in_grids(grids: list[_Grid], points: Floats) -> tuple[Ints, NDArray[np.int32]]:
    """Return how many tiles hold points of each query of a block, and these tiles."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    hits = np.empty((len(lon), sum(grid.candidates for grid in grids)), np.int32)
    used = 0
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points lie in no tile
        for grid in grids:
            grid.fill(lon, lat, hits[:, used : used + grid.candidates])
            used += grid.candidates
    hits = hits.reshape(len(points), -1)
    hits.sort(axis=1)
    first = hits != _NONE
    first[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return first.sum(axis=1), hits[first]

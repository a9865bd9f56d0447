"""Which tiles of a grid a point may lie in, by arithmetic instead of a search tree.

A gallery cut from one map is a few *runs* of tiles, one a scale, each row by row. In lon/lat the
rows and columns of such a run are straight and parallel (geographic map) or slightly tilted and
bent (projected map, by the convergence of the meridians). A *ruler*, a function of lon/lat whose
level lines follow the columns (or the rows), gives every column an interval of values that covers
all its tiles; a point can only lie in the columns whose interval holds its value. The intervals
are computed from every tile, so that no candidate is missed whatever the boxes are: a poor fit
costs time, never a tile.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints

__all__ = ["Ruler", "TileRun", "find_runs"]


_MAX_RUNS = 16
_MAX_CANDIDATES = 128  # a point; beyond this a search tree is faster
_FIT_TILES = 12  # a side; the rulers are fitted on at most 12 x 12 tiles
_SLACK = 1e-9  # in tile indices; far above the rounding of the rulers, far below a tile
_LOOKUP = 8192
_BOUND_TILES = 1 << 15  # tiles at a time; stays in the cache


@dataclass(frozen=True)
class Ruler:
    """A scale across columns (or rows): which of them may hold a point.

    Parameters
    ----------
    coefficients : (6,) array or None
        Of 1, x, y, xy, x^2, y^2; None where the value of a point is the coordinate itself.
    low, high : (n,) array
        Interval of values that each column covers; both ascending.
    width : int
        The most columns that one value can lie in.
    table : (m,) array
        First column whose `high` reaches the start of each of m equal parts of the scale.
    """

    coefficients: Floats | None
    low: Floats
    high: Floats
    width: int
    table: Ints

    @classmethod
    def over(cls, low: Floats, high: Floats, coefficients: Floats | None = None) -> Ruler:
        """Make a ruler of intervals; they are widened where they do not ascend."""
        low = np.minimum.accumulate(low[::-1])[::-1]
        high = np.maximum.accumulate(high)
        reach = np.searchsorted(low, high, side="right") - np.arange(len(low))
        starts = np.linspace(low[0], high[-1], _LOOKUP)
        return cls(coefficients, low, high, int(reach.max()), np.searchsorted(high, starts))

    def first(self, values: Floats) -> Ints:
        """Give the first of the `width` columns that may hold each value."""
        scale = (_LOOKUP - 1) / max(self.high[-1] - self.low[0], np.finfo(np.float64).tiny)
        part = np.fmin(np.fmax((values - self.low[0]) * scale, 0), _LOOKUP - 1).astype(np.int64)
        # One part earlier, so that rounding of `part` cannot skip a column.
        column = np.minimum(self.table[np.maximum(part - 1, 0)], len(self.high) - 1)
        column += self.high[column] < values
        column = np.minimum(column, len(self.high) - 1)
        late = np.flatnonzero(self.high[column] < values)
        column[late] = np.searchsorted(self.high, values[late])
        first: Ints = np.minimum(column, len(self.high) - self.width)
        return first


@dataclass(frozen=True)
class TileRun:
    """Tiles that follow each other row by row, `columns` a row.

    Parameters
    ----------
    start : int
        Index of the first tile.
    columns : int
        Tiles a row.
    across, along : Ruler
        Over the columns, and over the rows.
    boxes : (n, 4) array or None
        Boxes of the tiles, for the exact test; None where the rulers are exact, as the boxes
        are the product of lon intervals and lat intervals.
    origin : (4,) array
        Centre and half size of the run in lon/lat, the unit of the rulers' fit.
    southwards : bool
        Whether latitude falls from row to row.
    """

    start: int
    columns: int
    across: Ruler
    along: Ruler
    boxes: Floats | None
    origin: Floats
    southwards: bool

    @property
    def slots(self) -> int:
        """How many tiles are tested for a point."""
        return self.across.width * self.along.width

    def fill(self, lon: Floats, lat: Floats, hits: NDArray[np.int32], none: int) -> None:
        """Write the tiles that hold each of N points into `hits` (N, slots), `none` elsewhere."""
        if self.boxes is None:
            self._fill_product(lon, lat, hits, none)
        else:
            self._fill_tilted(self.boxes, lon, lat, hits, none)

    def _fill_product(self, lon: Floats, lat: Floats, hits: NDArray[np.int32], none: int) -> None:
        value = -lat if self.southwards else lat
        columns = list(_inside(self.across, lon))
        slot = 0
        for row, in_row in _inside(self.along, value):
            base = row * self.columns + self.start
            for column, in_column in columns:
                hits[:, slot] = np.where(in_row & in_column, base + column, none)
                slot += 1

    def _fill_tilted(
        self, boxes: Floats, lon: Floats, lat: Floats, hits: NDArray[np.int32], none: int
    ) -> None:
        x, y = (lon - self.origin[0]) / self.origin[2], (lat - self.origin[1]) / self.origin[3]
        column = self.across.first(_polynomial(self.across.coefficients, x, y))
        row = self.along.first(_polynomial(self.along.coefficients, x, y))
        corner = row * self.columns + column
        for slot in range(self.slots):
            step_row, step_column = divmod(slot, self.across.width)
            tile = corner + (step_row * self.columns + step_column)
            box = boxes.take(tile, axis=0)
            inside = (box[:, 0] <= lon) & (lon <= box[:, 2])
            inside &= (box[:, 1] <= lat) & (lat <= box[:, 3])
            hits[:, slot] = np.where(inside, tile + self.start, none)


def find_runs(boxes: Floats) -> list[TileRun] | None:
    """Split a gallery into runs of tiles that lie row by row."""
    starts = np.concatenate([[0], np.flatnonzero(boxes[1:, 0] <= boxes[:-1, 0]) + 1])
    step = np.sign(np.diff(boxes[starts, 3]))
    southwards = bool(step.sum() <= 0)
    lengths = np.diff(np.append(starts, len(boxes)))
    breaks = (np.diff(lengths) != 0) | (step != (-1 if southwards else 1))
    firsts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    if len(firsts) > _MAX_RUNS:
        return None
    ends = np.append(starts[firsts[1:]], len(boxes))
    runs: list[TileRun] = []
    for first, end in zip(firsts.tolist(), ends.tolist(), strict=True):
        start = int(starts[first])
        runs.append(_make_run(boxes[start:end], start, int(lengths[first]), southwards))
        if sum(run.slots for run in runs) > _MAX_CANDIDATES:
            return None
    return runs


def _make_run(boxes: Floats, start: int, columns: int, southwards: bool) -> TileRun:
    grid = boxes.reshape(-1, columns, 4)
    if np.array_equal(grid[:, :, ::2], np.broadcast_to(grid[:1, :, ::2], (*grid.shape[:2], 2))):
        top = grid[:, :1, 1::2]
        if np.array_equal(grid[:, :, 1::2], np.broadcast_to(top, (*grid.shape[:2], 2))):
            return _product_run(grid, start, southwards)
    return _tilted_run(grid, boxes, start, southwards)


def _product_run(grid: Floats, start: int, southwards: bool) -> TileRun:
    low, high = grid[:, 0, 1], grid[:, 0, 3]
    along = Ruler.over(-high, -low) if southwards else Ruler.over(low, high)
    across = Ruler.over(grid[0, :, 0], grid[0, :, 2])
    # Widened intervals no longer decide exactly, so such rows or columns need their boxes.
    exact = np.array_equal(across.low, grid[0, :, 0]) and np.array_equal(across.high, grid[0, :, 2])
    exact &= np.array_equal(along.high, -low if southwards else high)
    exact &= np.array_equal(along.low, -high if southwards else low)
    if not exact:
        return _tilted_run(grid, grid.reshape(-1, 4), start, southwards)
    return TileRun(start, grid.shape[1], across, along, None, np.empty(0), southwards)


def _tilted_run(grid: Floats, boxes: Floats, start: int, southwards: bool) -> TileRun:
    west, south, east, north = boxes.T  # by column: reducing (n, 4) over n is 20 times slower
    lower, upper = np.array([west.min(), south.min()]), np.array([east.max(), north.max()])
    half = np.maximum((upper - lower) / 2, np.finfo(np.float64).tiny)
    origin = np.concatenate([(lower + upper) / 2, half])
    half_size = np.array([(east - west).max(), (north - south).max()]) / half / 2
    across, along = _fitted_rulers(grid, origin, half_size)
    return TileRun(start, grid.shape[1], across, along, boxes, origin, southwards)


def _fitted_rulers(grid: Floats, origin: Floats, half_size: Floats) -> tuple[Ruler, Ruler]:
    """Fit quadratics that give a tile its column and its row, and bound them by every tile."""
    fit = _fit(grid, origin)
    slope_x = np.abs(fit[1]) + np.abs(fit[3]) + 2 * np.abs(fit[4])
    slope_y = np.abs(fit[2]) + np.abs(fit[3]) + 2 * np.abs(fit[5])
    reach = slope_x * half_size[0] + slope_y * half_size[1] + _SLACK * (1 + np.abs(fit).sum(axis=0))

    def bounds(first: int) -> tuple[Floats, Floats, Floats, Floats]:
        x, y = _centres(grid[first : first + step], origin)
        column, row = _polynomial(fit[:, 0], x, y), _polynomial(fit[:, 1], x, y)
        return column.min(axis=0), column.max(axis=0), row.min(axis=1), row.max(axis=1)

    step = max(1, _BOUND_TILES // grid.shape[1])
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(zip(*pool.map(bounds, range(0, len(grid), step)), strict=True))
    low, high = np.min(parts[0], axis=0), np.max(parts[1], axis=0)
    across = Ruler.over(low - reach[0], high + reach[0], fit[:, 0])
    low, high = np.concatenate(parts[2]), np.concatenate(parts[3])
    return across, Ruler.over(low - reach[1], high + reach[1], fit[:, 1])


def _fit(grid: Floats, origin: Floats) -> Floats:
    """Coefficients (6, 2) of the column and the row by least squares over some of the tiles."""
    # Not of the last row and column: anchored to the map's edge, they are out of step.
    rows, columns = (
        np.unique(np.linspace(0, max(n - 2, 0), _FIT_TILES).astype(int)) for n in grid.shape[:2]
    )
    x, y = (values.ravel() for values in _centres(grid[np.ix_(rows, columns)], origin))
    terms = np.stack([np.ones_like(x), x, y, x * y, x**2, y**2], axis=1)
    row, column = (index.ravel() for index in np.meshgrid(rows, columns, indexing="ij"))
    fit: Floats = np.linalg.lstsq(terms, np.stack([column, row], axis=1).astype(np.float64))[0]
    return fit


def _centres(grid: Floats, origin: Floats) -> tuple[Floats, Floats]:
    x = ((grid[:, :, 0] + grid[:, :, 2]) / 2 - origin[0]) / origin[2]
    y = ((grid[:, :, 1] + grid[:, :, 3]) / 2 - origin[1]) / origin[3]
    return x, y


def _polynomial(c: Floats | None, x: Floats, y: Floats) -> Floats:
    if c is None:
        return x
    value: Floats = c[0] + x * (c[1] + c[3] * y + c[4] * x) + y * (c[2] + c[5] * y)
    return value


def _inside(ruler: Ruler, values: Floats) -> list[tuple[Ints, Bools]]:
    """Give the columns that may hold each value, one a step, and whether they do."""
    first = ruler.first(values)
    columns = [first + step for step in range(ruler.width)]
    return [(c, (ruler.low[c] <= values) & (values <= ruler.high[c])) for c in columns]

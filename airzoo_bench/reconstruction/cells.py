"""Sets of cells of a grid: the columns that a cloud covers, grown, and cells that photos see."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.regions import Box

__all__ = ["CellSet", "Columns", "covered_columns", "occupied_cells"]

_MOST_CELLS = 1 << 62


@dataclass(frozen=True, eq=False)
class CellSet:
    """Some cells of a grid that has a corner at (0, 0, 0).

    Attributes
    ----------
    size : (3,) float64
        Sides of a cell; an infinite one makes columns.
    low, extent : (3,) float64
        Least cell of the part of the grid that is looked at, and its cells along each axis.
    keys : (C,) int64
        Cells of the set, each as one number, ascending.
    """

    size: Floats
    low: Floats
    extent: Floats
    keys: Ints

    def holds(self, points: Floats) -> Bools:
        """Whether each of points (N, 3), finite, lies in a cell of the set."""
        inside, keys = self.keys_of(points)
        if not len(self.keys):
            return np.zeros(len(points), np.bool_)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.asarray(inside & (self.keys[place] == keys))

    def keys_of(self, points: Floats) -> tuple[Bools, Ints]:
        """Whether points (N, 3) lie in the part that is looked at, and the numbers of cells."""
        cells = np.floor(points / self.size) - self.low
        inside = np.asarray(((cells >= 0) & (cells < self.extent)).all(axis=1))
        x, y, z = np.where(inside[:, None], cells, 0.0).astype(np.int64).T
        return inside, self.packed(x, y, z)

    def packed(self, x: Ints, y: Ints, z: Ints) -> Ints:
        """Return the numbers of cells by their places along the axes, counted from the least."""
        _, along_y, along_z = self.extent.astype(np.int64).tolist()
        keys: Ints = (x * along_y + y) * along_z + z
        return keys

    def places(self) -> Ints:
        """Places (C, 3) of the set's cells along the axes, counted from the least."""
        _, along_y, along_z = self.extent.astype(np.int64).tolist()
        rest, z = np.divmod(self.keys, along_z)
        return np.stack((*np.divmod(rest, along_y), z), axis=1)

    def centres(self) -> Floats:
        """Middles (C, 3) of the set's cells."""
        middles: Floats = (self.places() + self.low + 0.5) * self.size
        return middles


@dataclass(frozen=True, eq=False)
class Columns:
    """Upright columns between two heights, borders included.

    Attributes
    ----------
    cells : CellSet
    low, high : float
        Heights.
    """

    cells: CellSet
    low: float
    high: float

    def holds(self, points: Floats) -> Bools:
        """Whether each of points (N, 3), finite, lies in a column."""
        upright = (points[:, 2] >= self.low) & (points[:, 2] <= self.high)
        return np.asarray(upright & self.cells.holds(points))


def occupied_cells(
    pieces: Iterable[Floats], size: tuple[float, float, float], box: Box, margin: float = 0.0
) -> CellSet:
    """Cells that hold a point.

    Parameters
    ----------
    pieces : iterable of (N, 3) arrays
        Finite points.
    size : tuple of float
        Sides of a cell.
    box : Box
        That holds all points.
    margin : float
        Beyond the box, cells are numbered that far, too.

    Raises
    ------
    BenchmarkError
        The box has too many cells to number.
    """
    sides = np.array(size)
    low, high = (np.floor(corner / sides) for corner in (box.low - margin, box.high + margin))
    extent = high - low + 1.0
    if not extent.prod() < _MOST_CELLS:
        raise BenchmarkError(
            f"the true cloud spans {' x '.join(f'{s:.4g}' for s in box.high - box.low)} m",
            expected="a scene, without points far away from it",
            fix="leave stray points out of the cloud, and prepare the benchmark again",
        )
    found = CellSet(sides, low, extent, np.zeros(0, np.int64))
    keys = found.keys
    for points in pieces:
        keys = np.union1d(keys, found.keys_of(points)[1])
    return CellSet(sides, low, extent, keys)


def covered_columns(pieces: Iterable[Floats], size: float, box: Box, margin: float) -> Columns:
    """Columns that hold a point, and those that come within a margin of one.

    Parameters
    ----------
    pieces : iterable of (N, 3) arrays
        Finite points.
    size : float
        Side of a column.
    box : Box
        That holds all points.
    margin : float
        Upwards and downwards it is added to the box.

    Raises
    ------
    BenchmarkError
        See `occupied_cells`.
    """
    held = occupied_cells(pieces, (size, size, np.inf), box, margin + size)
    grown = held.keys
    reach = int(np.floor(margin / size)) + 1
    x, y, z = held.places().T
    for east in range(-reach, reach + 1):
        for north in range(-reach, reach + 1):
            # Between the nearest sides of two columns.
            apart = np.hypot(max(abs(east) - 1, 0), max(abs(north) - 1, 0)) * size
            if apart < margin:
                grown = np.union1d(grown, _shifted(held, x + east, y + north, z))
    cells = CellSet(held.size, held.low, held.extent, grown)
    return Columns(cells, float(box.low[2] - margin), float(box.high[2] + margin))


def _shifted(cells: CellSet, x: Ints, y: Ints, z: Ints) -> Ints:
    inside = (x >= 0) & (y >= 0) & (x < cells.extent[0]) & (y < cells.extent[1])
    return cells.packed(x[inside], y[inside], z[inside])

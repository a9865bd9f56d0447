"""Parts of space: boxes, and sets of cells of a grid, such as the columns that a cloud covers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.cloud_sources import finite_pieces

__all__ = [
    "Box",
    "CellSet",
    "Columns",
    "bounding_box",
    "box_of",
    "covered_columns",
    "occupied_cells",
]

_MOST_CELLS = 1 << 62
_PIECE = 1 << 20


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the axes, borders included; its corners `low` and `high` (3,)."""

    low: Floats
    high: Floats

    def grown(self, margin: float) -> Box:
        """Return the box with its sides moved outwards by `margin`."""
        return Box(self.low - margin, self.high + margin)

    def holds(self, points: Floats) -> Bools:
        """Whether each of points (N, 3) lies in the box or on its border."""
        inside: Bools = np.all((points >= self.low) & (points <= self.high), axis=1)
        return inside


def bounding_box(points: Floats) -> Box:
    """Smallest box that holds points (N, 3), finite and at least one."""
    return Box(points.min(axis=0), points.max(axis=0))


def box_of(source: CloudSource) -> Box:
    """Smallest box that holds the finite points of the true cloud."""
    pieces = [bounding_box(piece) for piece in finite_pieces(source, _PIECE) if len(piece)]
    if not pieces:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point",
            fix="check the benchmark's cloud",
        )
    return bounding_box(np.array([corner for box in pieces for corner in (box.low, box.high)]))


@dataclass(frozen=True, eq=False)
class CellSet:
    """Some cells of a grid that has a corner at (0, 0, 0).

    Attributes
    ----------
    size : (3,) float64
        Sides of a cell; an infinite one makes columns.
    low, shape : (3,) float64
        Least cell of the part of the grid that is looked at, and its cells along each axis.
    keys : (C,) int64
        Cells of the set, each as one number, ascending.
    """

    size: Floats
    low: Floats
    shape: Floats
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
        inside = np.asarray(((cells >= 0) & (cells < self.shape)).all(axis=1))
        x, y, z = np.where(inside[:, None], cells, 0.0).astype(np.int64).T
        return inside, self.packed(x, y, z)

    def packed(self, x: Ints, y: Ints, z: Ints) -> Ints:
        """Return the numbers of cells by their places along the axes, counted from the least."""
        _, along_y, along_z = self.shape.astype(np.int64).tolist()
        keys: Ints = (x * along_y + y) * along_z + z
        return keys

    def places(self) -> Ints:
        """Places (C, 3) of the set's cells along the axes, counted from the least."""
        _, along_y, along_z = self.shape.astype(np.int64).tolist()
        rest, z = np.divmod(self.keys, along_z)
        return np.stack((*np.divmod(rest, along_y), z), axis=1)

    def centres(self) -> Floats:
        """Centres (C, 3) of the set's cells."""
        centres: Floats = (self.places() + self.low + 0.5) * self.size
        return centres


@dataclass(frozen=True, eq=False)
class Columns:
    """Upright columns (cells of infinite height) between two heights, borders included."""

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
    """Cells, of these sides, that hold one of the finite points (N, 3) of some pieces."""
    found = _numbered(np.array(size), box, margin)
    keys = found.keys
    for points in pieces:
        keys = np.union1d(keys, found.keys_of(points)[1])
    return replace(found, keys=keys)


def _numbered(sides: Floats, box: Box, margin: float) -> CellSet:
    """Return a set without cells, over the part of the grid that the box and its margin meet."""
    low, high = (np.floor(corner / sides) for corner in (box.low - margin, box.high + margin))
    shape = high - low + 1.0
    if not shape.prod() < _MOST_CELLS:
        raise BenchmarkError(
            f"the true cloud spans {' x '.join(f'{s:.4g}' for s in box.high - box.low)} m",
            expected="a scene, without points far away from it",
            fix="leave stray points out of the cloud, and prepare the benchmark again",
        )
    return CellSet(sides, low, shape, np.zeros(0, np.int64))


def covered_columns(pieces: Iterable[Floats], size: float, box: Box, margin: float) -> Columns:
    """Columns that hold one of the finite points of some pieces, or come within a margin of one."""
    occupied = occupied_cells(pieces, (size, size, np.inf), box, margin + size)
    grown = occupied.keys
    reach = int(np.floor(margin / size)) + 1
    x, y, z = occupied.places().T
    for east in range(-reach, reach + 1):
        for north in range(-reach, reach + 1):
            # Between the nearest sides of two columns.
            apart = np.hypot(max(abs(east) - 1, 0), max(abs(north) - 1, 0)) * size
            if apart < margin:
                grown = np.union1d(grown, _shifted(occupied, x + east, y + north, z))
    low, high = float(box.low[2] - margin), float(box.high[2] + margin)
    return Columns(replace(occupied, keys=grown), low, high)


def _shifted(cells: CellSet, x: Ints, y: Ints, z: Ints) -> Ints:
    inside = (x >= 0) & (y >= 0) & (x < cells.shape[0]) & (y < cells.shape[1])
    return cells.packed(x[inside], y[inside], z[inside])

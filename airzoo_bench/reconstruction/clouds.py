"""Clouds that are read in pieces, and thinning them by voxels.

Thinning is the same to the last bit for any order of points and any pieces. The voxel of a point is
``floor((point - origin) / size)``, so that borders belong to the voxel above. Each occupied voxel
gives the mean of its points: their offsets from the voxel's lower corner are rounded to 2^-32 of a
voxel and summed as integers, which no order changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.similarity import Similarity

_ENDLESS = 1e150
_OFF_GRID = 0.3819660112501052
_UNIT = 2.0**32  # 2^31 points of one voxel fit into a signed 64-bit sum
_MOST_CELLS = 1 << 62
_CHUNK = 1 << 20


@dataclass(frozen=True, eq=False)
class InMemoryCloud:
    """Points (N, 3) in memory, as a `CloudSource`."""

    points: Floats

    @property
    def count(self) -> int:
        """How many points it holds."""
        return len(self.points)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, in pieces of at most `points`."""
        for start in range(0, len(self.points), points):
            yield Cloud(self.points[start : start + points])


@dataclass(frozen=True, eq=False)
class TransformedCloud:
    """A cloud brought into another frame, without points of too little confidence."""

    source: CloudSource
    transform: Similarity
    confidence_above: float | None

    @property
    def count(self) -> int:
        """How many points it holds at most."""
        return self.source.count

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, in pieces of at most `points`."""
        for piece in self.source.pieces(points):
            kept = piece.points
            if self.confidence_above is not None and piece.confidence is not None:
                kept = kept[piece.confidence > self.confidence_above]
            # What is infinite becomes NaN at worst, and is counted where the cloud is prepared.
            with np.errstate(invalid="ignore", over="ignore"):
                yield Cloud(self.transform.apply(kept))


def finite_rows(points: Floats) -> Bools:
    """Mark the points (N, 3) that are finite, also when squared."""
    finite: Bools = np.all(np.abs(points) < _ENDLESS, axis=1)
    return finite


def finite_pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    """Yield the finite points (N, 3) of a cloud, in pieces of at most `points`."""
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def concatenated(pieces: Iterable[Floats]) -> Floats:
    """Concatenate any number of pieces (N, 3)."""
    return np.concatenate([np.zeros((0, 3)), *pieces])


def grid_origin(size: float) -> Floats:
    """Return a corner (3,) of the voxels of this side, the same for all clouds."""
    return np.full(3, size * _OFF_GRID)


@dataclass(frozen=True, eq=False)
class _Voxels:
    """Sums over the points of V occupied voxels, sorted by x, then y, then z."""

    cells: Floats
    counts: Ints
    offsets: Ints

    @classmethod
    def merged(cls, cells: Floats, counts: Ints, offsets: Ints) -> _Voxels:
        """Sum what is in the same voxel."""
        order = _order(cells)
        ordered = cells[order]
        changes = (ordered[1:] != ordered[:-1]).any(axis=1)
        starts = np.flatnonzero(np.concatenate(([True], changes)))
        summed = [np.add.reduceat(values[order], starts, axis=0) for values in (counts, offsets)]
        return cls(ordered[starts], *summed)

    def __len__(self) -> int:
        return len(self.cells)


class VoxelGrid:
    """Collects points piece by piece, and gives one for each occupied voxel.

    Memory holds the occupied voxels and some pieces.

    Parameters
    ----------
    size : float
        Side of a voxel, positive.
    origin : (3,) array
        A corner of the grid; the same for clouds that are to be compared.
    most : int, optional
        Voxels that may be occupied; any number where left out.
    """

    def __init__(self, size: float, origin: Floats, most: int | None = None) -> None:
        self._size, self._origin, self._most = size, origin, most
        self._parts: list[_Voxels] = []

    def add(self, points: Floats) -> None:
        """Add finite points (N, 3)."""
        for start in range(0, len(points), _CHUNK):
            position = (points[start : start + _CHUNK] - self._origin) / self._size
            # Floating-point numbers hold these integers exactly, however far the point.
            cells = np.floor(position)
            offsets = np.rint((position - cells) * _UNIT).astype(np.int64)
            self._parts.append(_Voxels.merged(cells, np.ones(len(cells), np.int64), offsets))
            # Like a binary counter: a part is merged about log2(pieces) times, not with each piece.
            while len(self._parts) > 1 and 2 * len(self._parts[-1]) >= len(self._parts[-2]):
                self._join_last_two()
            self._require_room()

    def points(self) -> Floats:
        """Return one point (V, 3) for each occupied voxel, by x, then y, then z of the voxels."""
        while len(self._parts) > 1:
            self._join_last_two()
        if not self._parts:
            return np.zeros((0, 3))
        (voxels,) = self._parts
        mean = voxels.offsets / voxels.counts[:, None] / _UNIT
        points: Floats = (voxels.cells + mean) * self._size + self._origin
        return points

    def _require_room(self) -> None:
        # Parts may share voxels: they are counted once all are merged.
        while self._most is not None and sum(map(len, self._parts)) > self._most:
            if len(self._parts) == 1:
                raise UsageError(
                    f"a cloud occupies more than {self._most:,} voxels of {self._size:g} m, "
                    "which is all that memory may hold",
                    fix="raise --max-memory, or choose larger voxels in the protocol",
                )
            self._join_last_two()

    def _join_last_two(self) -> None:
        one, other = self._parts[-2:]
        fields = ("cells", "counts", "offsets")
        joined = (np.concatenate((getattr(one, key), getattr(other, key))) for key in fields)
        self._parts[-2:] = [_Voxels.merged(*joined)]


def _order(cells: Floats) -> Ints:
    """Sort cells by x, then y, then z: as one integer each, where they are not too far apart."""
    low, high = cells.min(axis=0), cells.max(axis=0)
    along_x, along_y, along_z = (int(length) + 1 for length in high - low)
    if along_x * along_y * along_z > _MOST_CELLS:
        return np.lexsort(cells.T[::-1])
    x, y, z = (cells - low).astype(np.int64).T
    return np.argsort((x * along_y + y) * along_z + z)

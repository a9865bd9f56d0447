"""Down-sampling by voxels, the same to the last bit for any order of points and any pieces.

The voxel of a point is ``floor((point - origin) / size)``, so that borders belong to the voxel
above. Each occupied voxel gives the mean of its points: their offsets from the voxel's lower
corner are rounded to 2^-32 of a voxel and summed as integers, which no order changes; the mean is
off by less than that rounding and those of the coordinates themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["VoxelGrid"]

_UNIT = 2.0**32  # 2^31 points of one voxel fit into a signed 64-bit sum
_MOST_CELLS = 1 << 62
_CHUNK = 1 << 20


@dataclass(frozen=True, eq=False)
class _Voxels:
    """Sums over the points of V occupied voxels, sorted by x, then y, then z."""

    cells: Floats
    counts: Ints
    offsets: Ints

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
            self._add(points[start : start + _CHUNK])
            self._require_room()

    def points(self) -> Floats:
        """One point (V, 3) for each occupied voxel, by x, then y, then z of the voxels."""
        voxels = self._joined()
        mean = voxels.offsets / voxels.counts[:, None] / _UNIT
        points: Floats = (voxels.cells + mean) * self._size + self._origin
        return points

    def _add(self, points: Floats) -> None:
        position = (points - self._origin) / self._size
        # Floating-point numbers hold these integers exactly, however far the point.
        cells = np.floor(position)
        offsets = np.rint((position - cells) * _UNIT).astype(np.int64)
        self._append(_merged(cells, np.ones(len(points), dtype=np.int64), offsets))

    def _append(self, voxels: _Voxels) -> None:
        self._parts.append(voxels)
        # Like a binary counter: a part is merged about log2(pieces) times, not with each piece.
        while len(self._parts) > 1 and 2 * len(self._parts[-1]) >= len(self._parts[-2]):
            self._join_last_two()

    def _joined(self) -> _Voxels:
        while len(self._parts) > 1:
            self._join_last_two()
        nothing = np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        return self._parts[0] if self._parts else _Voxels(*nothing)

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
        cells, offsets = (
            np.concatenate((getattr(one, name), getattr(other, name)))
            for name in ("cells", "offsets")
        )
        counts = np.concatenate((one.counts, other.counts))
        self._parts[-2:] = [_merged(cells, counts, offsets)]


def _merged(cells: Floats, counts: Ints, offsets: Ints) -> _Voxels:
    """Sum what is in the same voxel."""
    keys = _packed(cells)
    order = np.lexsort(cells.T[::-1]) if keys is None else np.argsort(keys)
    ordered = cells[order]
    changes = (ordered[1:] != ordered[:-1]).any(axis=1)
    starts = np.flatnonzero(np.concatenate(([True], changes)))
    return _Voxels(
        ordered[starts],
        np.add.reduceat(counts[order], starts),
        np.add.reduceat(offsets[order], starts, axis=0),
    )


def _packed(cells: Floats) -> Ints | None:
    """One integer a cell, of the same order, or None where they are too far apart for that."""
    low, high = cells.min(axis=0), cells.max(axis=0)
    along_x, along_y, along_z = (int(length) + 1 for length in high - low)
    if along_x * along_y * along_z > _MOST_CELLS:
        return None
    x, y, z = (cells - low).astype(np.int64).T
    keys: Ints = (x * along_y + y) * along_z + z
    return keys

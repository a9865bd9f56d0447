"""Down-sampling by voxels, the same to the last bit for any order of points and any pieces.

The voxel of a point is ``floor((point - origin) / size)``, so that borders belong to the voxel
above. Each occupied voxel gives the mean of its points: their offsets from the voxel's lower
corner are rounded to 2^-32 of a voxel and summed as integers, which no order changes; the mean is
off by less than that rounding and those of the coordinates themselves. Colours are averaged and
rounded, a half upwards; the confidence is the largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.reconstruction.sources import take

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
    colours: Ints | None
    confidence: NDArray[np.float32] | None

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

    Raises
    ------
    ValueError
        A size that is not positive and finite.
    """

    def __init__(self, size: float, origin: Floats, most: int | None = None) -> None:
        if not (size > 0.0 and np.isfinite(size)):
            raise ValueError(f"voxels of size {size}")
        self._size, self._origin = size, np.asarray(origin, dtype=np.float64)
        self._parts: list[_Voxels] = []
        self._most = most

    def add(self, cloud: Cloud) -> None:
        """Add finite points; colours and confidences are kept where all pieces have them.

        Raises
        ------
        UsageError
            More voxels are occupied than may be.
        """
        for start in range(0, len(cloud), _CHUNK):
            self._add(take(cloud, slice(start, start + _CHUNK)))
            self._require_room()

    def cloud(self) -> Cloud:
        """One point for each occupied voxel, by x, then y, then z of the voxels."""
        while len(self._parts) > 1:
            self._join_last_two()
        if not self._parts:
            return Cloud(np.zeros((0, 3)))
        voxels = self._parts[0]
        counts = voxels.counts[:, None]
        mean = voxels.offsets / counts / _UNIT
        points = (voxels.cells + mean) * self._size + self._origin
        colours = voxels.colours
        if colours is not None:
            colours = (2 * colours + counts) // (2 * counts)
        return Cloud(
            points, None if colours is None else colours.astype(np.uint8), voxels.confidence
        )

    def _add(self, cloud: Cloud) -> None:
        position = (cloud.points - self._origin) / self._size
        # Floating-point numbers hold these integers exactly, however far the point.
        cells = np.floor(position)
        offsets = np.rint((position - cells) * _UNIT).astype(np.int64)
        colours = None if cloud.colours is None else cloud.colours.astype(np.int64)
        ones = np.ones(len(cloud), dtype=np.int64)
        self._parts.append(_merged(_Voxels(cells, ones, offsets, colours, cloud.confidence)))
        # Like a binary counter: a part is merged about log2(pieces) times, not with each piece.
        while len(self._parts) > 1 and 2 * len(self._parts[-1]) >= len(self._parts[-2]):
            self._join_last_two()

    def _require_room(self) -> None:
        # Parts may share voxels: they are counted once all are merged.
        while self._most is not None and sum(map(len, self._parts)) > self._most:
            if len(self._parts) == 1:
                raise UsageError(
                    f"a cloud occupies more than {self._most:,} voxels of {self._size:g} m, "
                    "which is all that memory may hold",
                    fix="give --max-memory more, or choose larger voxels in the protocol",
                )
            self._join_last_two()

    def _join_last_two(self) -> None:
        one, other = self._parts[-2:]
        self._parts[-2:] = [_merged(_stacked(one, other))]


def _stacked(one: _Voxels, other: _Voxels) -> _Voxels:
    return _Voxels(
        np.concatenate((one.cells, other.cells)),
        np.concatenate((one.counts, other.counts)),
        np.concatenate((one.offsets, other.offsets)),
        _both(one.colours, other.colours),
        _both(one.confidence, other.confidence),
    )


def _both(one: NDArray[Any] | None, other: NDArray[Any] | None) -> NDArray[Any] | None:
    return None if one is None or other is None else np.concatenate((one, other))


def _merged(voxels: _Voxels) -> _Voxels:
    """Sum what is in the same voxel."""
    order, starts = _runs(voxels.cells)

    def total(values: Ints) -> Ints:
        summed: Ints = np.add.reduceat(values[order], starts, axis=0)
        return summed

    confidence = voxels.confidence
    if confidence is not None:
        confidence = np.maximum.reduceat(confidence[order], starts)
    return _Voxels(
        voxels.cells[order[starts]],
        total(voxels.counts),
        total(voxels.offsets),
        None if voxels.colours is None else total(voxels.colours),
        confidence,
    )


def _runs(cells: Floats) -> tuple[Ints, Ints]:
    """Order that sorts cells by x, then y, then z, and where runs of the same cell start."""
    keys = _packed(cells)
    order = np.lexsort(cells.T[::-1]) if keys is None else np.argsort(keys)
    ordered = cells[order]
    changes = (ordered[1:] != ordered[:-1]).any(axis=1)
    return order, np.flatnonzero(np.concatenate(([True], changes)))


def _packed(cells: Floats) -> Ints | None:
    """One integer a cell, of the same order, or None where they are too far apart for that."""
    low, high = cells.min(axis=0), cells.max(axis=0)
    along_x, along_y, along_z = (int(extent) + 1 for extent in high - low)
    if along_x * along_y * along_z > _MOST_CELLS:
        return None
    x, y, z = (cells - low).astype(np.int64).T
    keys: Ints = (x * along_y + y) * along_z + z
    return keys

"""Clouds that are read in pieces, and thinning them by voxels.

Thinning is the same to the last bit for any order of points and any pieces. The voxel of a point is
``floor((point - origin) / size)``, so that borders belong to the voxel above. Each occupied voxel
gives the mean of its points: their offsets from the voxel's lower corner are rounded to 2^-32 of a
voxel and summed as integers, which no order changes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.formats.clouds.cloud import ArrayPieces, Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.similarity import Similarity

_ENDLESS = 1e150
_OFF_GRID = 0.3819660112501052
_UNIT = 2.0**32  # 2^31 points of one voxel fit into a signed 64-bit sum
_MOST_CELLS = 1 << 62
_CHUNK = 1 << 20


@dataclass(frozen=True, eq=False)
class PieceCloud:
    """A cloud that a function reads in pieces, as a `CloudSource`.

    It has `count` points, those of too little confidence included, which are not read.
    """

    count: int
    read: Callable[[int], Iterator[Cloud]]

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield the points, in pieces of at most `points`."""
        return self.read(points)


def cloud_of(points: Floats) -> PieceCloud:
    """Return a cloud of points (N, 3) in memory."""
    return PieceCloud(len(points), ArrayPieces(points))


def transform_cloud(
    source: CloudSource, transform: Similarity, confidence_above: float | None = None
) -> PieceCloud:
    """Bring a cloud into another frame, without points of too little confidence."""

    def read(points: int) -> Iterator[Cloud]:
        for piece in source.pieces(points):
            kept = piece.points
            if confidence_above is not None and piece.confidence is not None:
                kept = kept[piece.confidence > confidence_above]
            # Infinite points become NaN at worst, and are counted where the cloud is prepared.
            with np.errstate(invalid="ignore", over="ignore"):
                yield Cloud(transform.apply(kept))

    return PieceCloud(source.count, read)


def finite_rows(points: Floats) -> Bools:
    """Mark the points (N, 3) that are finite, also when squared."""
    finite: Bools = np.all(np.abs(points) < _ENDLESS, axis=1)
    return finite


def finite_pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    """Yield the finite points (N, 3) of a cloud, in pieces of at most `points`."""
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def concatenate_pieces(pieces: Iterable[Floats]) -> Floats:
    """Concatenate any number of pieces (N, 3)."""
    return np.concatenate([np.zeros((0, 3)), *pieces])


def map_points(pieces: Iterable[Floats]) -> Floats:
    """Write pieces (N, 3) to a temporary file and map it; it goes with the last map of it."""
    with tempfile.TemporaryFile() as stream:
        try:
            for piece in pieces:
                stream.write(np.ascontiguousarray(piece).data)
            stream.flush()
        except OSError as error:
            raise UserError(
                f"clouds cannot be kept on disk: {error.strerror or error}",
                where=tempfile.gettempdir(),
                expected="48 bytes of room for each point of both clouds",
                fix="make room, or set TMPDIR (TEMP on Windows) to another folder",
            ) from error
        shape = (stream.tell() // 24, 3)
        return np.memmap(stream, np.float64, "r", shape=shape) if shape[0] else np.zeros(shape)


def grid_origin(size: float) -> Floats:
    """Return a corner (3,) of the voxels of this side, the same for all clouds."""
    return np.full(3, size * _OFF_GRID)


class VoxelGrid:
    """Collects points piece by piece, and gives one for each of at most `most` occupied voxels.

    `size` is the side of a voxel, and `origin` (3,) a corner of one, the same for clouds that are
    to be compared.
    """

    def __init__(self, size: float, origin: Floats, most: int | None = None) -> None:
        self._size, self._origin, self._most = size, origin, most
        # Cells (V, 3) sorted by x, y, z with sums (V, 4): of their points' offsets, and the count.
        self._parts: list[tuple[Floats, Ints]] = []

    def add(self, points: Floats) -> None:
        """Add finite points (N, 3)."""
        for start in range(0, len(points), _CHUNK):
            position = (points[start : start + _CHUNK] - self._origin) / self._size
            # Floating-point numbers hold these integers exactly, however far the point.
            cells = np.floor(position)
            sums = np.ones((len(cells), 4), np.int64)
            sums[:, :3] = np.rint((position - cells) * _UNIT)
            self._parts.append(_merged(cells, sums))
            # Merged once as much again has come.
            if sum(len(cells) for cells, _ in self._parts[1:]) > len(self._parts[0][0]):
                self._merge()

    def points(self) -> Floats:
        """Return one point (V, 3) for each occupied voxel, by x, then y, then z of the voxels."""
        if not self._parts:
            return np.zeros((0, 3))
        self._merge()
        ((cells, sums),) = self._parts
        mean = sums[:, :3] / sums[:, 3:] / _UNIT
        points: Floats = (cells + mean) * self._size + self._origin
        return points

    def _merge(self) -> None:
        cells, sums = map(np.concatenate, zip(*self._parts, strict=True))
        self._parts = [_merged(cells, sums)]
        if self._most is not None and len(self._parts[0][0]) > self._most:
            raise UsageError(
                f"a cloud occupies more than {self._most:,} voxels of {self._size:g} m, which is "
                "all that memory may hold",
                fix="raise --max-memory, or choose larger voxels in the protocol",
            )


def _merged(cells: Floats, sums: Ints) -> tuple[Floats, Ints]:
    """Sum what is in the same cell; cells are sorted by x, then y, then z."""
    low, high = cells.min(axis=0), cells.max(axis=0)
    along_x, along_y, along_z = (int(length) + 1 for length in high - low)
    if along_x * along_y * along_z > _MOST_CELLS:
        order = np.lexsort(cells.T[::-1])
    else:
        x, y, z = (cells - low).astype(np.int64).T
        order = np.argsort((x * along_y + y) * along_z + z)
    ordered = cells[order]
    changes = (ordered[1:] != ordered[:-1]).any(axis=1)
    starts = np.flatnonzero(np.concatenate(([True], changes)))
    return ordered[starts], np.add.reduceat(sums[order], starts, axis=0)

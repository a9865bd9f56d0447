"""Clouds in pieces, and which of their points are compared: in a crop, thinned, seen by photos.

Points that are not finite are left out and counted, then those outside the crop, and the rest is
thinned by voxels; each step only where a protocol asks for it. Recall is over the part of the true
cloud that the photos saw: inside enough of them, and not hidden.

Thinning is the same to the last bit for any order of points and any pieces. The voxel of a point is
``floor((point - origin) / size)``, so that borders belong to the voxel above. Each occupied voxel
gives the mean of its points: their offsets from the voxel's lower corner are rounded to 2^-32 of a
voxel and summed as integers, which no order changes.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError
from airzoo_bench.formats.clouds.cloud import ArrayPieces, Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.settings import Preparation

Crop = Callable[[Floats], Bools]
"""Says which of finite points (N, 3) lie in a part of space."""

_ENDLESS = 1e150
_OFF_GRID = 0.3819660112501052
_UNIT = 2.0**32  # 2^31 points of one voxel fit into a signed 64-bit sum
_MOST_CELLS = 1 << 62
_AXIS_BITS = 21
_PIECE = 1 << 20
_LEAST_VOXELS = 1 << 18
_SAMPLE = 100_000
_NEAREST = 1e-3
# A cell of the depth buffer is this many projected cells wide, so that surfaces have no holes.
_SPLAT = 1.5
_STEP = np.sqrt(2.0)


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
            yield Cloud(transform.apply(kept))

    return PieceCloud(source.count, read)


def finite_rows(points: Floats) -> Bools:
    """Mark the points (N, 3) that are finite, also when squared."""
    return np.asarray(np.all(np.abs(points) < _ENDLESS, axis=1))


def finite_pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    """Yield the finite points (N, 3) of a cloud, in pieces of at most `points`."""
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def gather_points(pieces: Iterable[Floats], *, on_disk: bool) -> Floats:
    """Join pieces (N, 3), in memory or in a temporary file that goes with the last map of it."""
    if not on_disk:
        return np.concatenate([np.zeros((0, 3)), *pieces])
    with tempfile.TemporaryFile() as stream:
        try:
            for piece in pieces:
                stream.write(np.ascontiguousarray(piece).data)
            stream.flush()
        except OSError as error:
            what = f"clouds cannot be kept on disk: {error.strerror or error}"
            fix = "make room of 48 bytes a point, or set TMPDIR to another folder"
            raise UserError(what, where=tempfile.gettempdir(), fix=fix) from error
        shape = (stream.tell() // 24, 3)
        return np.memmap(stream, np.float64, "r", shape=shape) if shape[0] else np.zeros(shape)


# --- voxels ---


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
        for start in range(0, len(points), _PIECE):
            position = (points[start : start + _PIECE] - self._origin) / self._size
            # Floating-point numbers hold these integers exactly, however far the point.
            cells = np.floor(position)
            sums = np.ones((len(cells), 4), np.int64)
            sums[:, :3] = np.rint((position - cells) * _UNIT)
            self._parts.append(_merge_cells(cells, sums))
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
        return np.asarray((cells + mean) * self._size + self._origin)

    def _merge(self) -> None:
        cells, sums = map(np.concatenate, zip(*self._parts, strict=True))
        self._parts = [_merge_cells(cells, sums)]
        if self._most is not None and len(self._parts[0][0]) > self._most:
            what = f"a cloud occupies more than the {self._most:,} voxels that memory may hold"
            raise UsageError(what, fix="raise --max-memory, or use larger voxels")


def _merge_cells(cells: Floats, sums: Ints) -> tuple[Floats, Ints]:
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


# --- cells of a grid, and the crop of both clouds ---


def bounding_box(source: CloudSource) -> Floats:
    """Return the low and the high corner (2, 3) of the finite points of the true cloud."""
    pieces = (piece for piece in finite_pieces(source, _PIECE) if len(piece))
    corners = [(piece.min(axis=0), piece.max(axis=0)) for piece in pieces]
    if not corners:
        raise BenchmarkError("the true cloud holds no finite point", expected="at least one point")
    low, high = np.swapaxes(corners, 0, 1)
    box = np.stack((low.min(axis=0), high.max(axis=0)))
    if (most := np.abs(box).max()) > 1e9:
        raise BenchmarkError(f"the true cloud reaches {most:.3g} m", expected="less than 1e9 m")
    return box


@dataclass(frozen=True, eq=False)
class Cells:
    """Some cells of a grid that has a corner at (0, 0, 0); an infinite `size` makes columns.

    `keys` (C,), ascending, have 21 bits an axis: of indices, which count from a cell `low`.
    """

    size: Floats
    low: Floats
    keys: Ints

    def holds(self, points: Floats) -> Bools:
        """Say which of finite points (N, 3) lie in one of the cells."""
        keys = cell_keys(np.floor(points / self.size) - self.low)
        rows = np.searchsorted(self.keys, keys)
        return np.asarray(np.append(self.keys, -2)[rows] == keys)

    def indices(self) -> Ints:
        """Return the indices (C, 3) of the cells along the axes."""
        shifts, mask = np.array((2 * _AXIS_BITS, _AXIS_BITS, 0)), (1 << _AXIS_BITS) - 1
        return np.asarray(self.keys[:, None] >> shifts & mask)


def cell_keys(indices: Floats) -> Ints:
    """Return keys of cells by indices (N, 3), which ascend by x, y and z; -1 where none is."""
    inside = np.all((indices >= 0) & (indices < 1 << _AXIS_BITS), axis=1)
    x, y, z = np.where(inside[:, None], indices, 0.0).astype(np.int64).T
    return np.where(inside, ((x << _AXIS_BITS | y) << _AXIS_BITS) | z, -1)


def occupied_cells(
    pieces: Iterable[Floats], size: tuple[float, float, float], box: Floats, margin: float = 0.0
) -> Cells:
    """Return the cells, of these sides, that hold one of the points of some pieces in a box."""
    sides = np.array(size)
    low, keys = np.floor((box[0] - margin) / sides), np.zeros(0, np.int64)
    for points in pieces:
        keys = np.union1d(keys, cell_keys(np.floor(points / sides) - low))
    return Cells(sides, low, keys[keys >= 0])


def covered_columns(pieces: Iterable[Floats], size: float, box: Floats, margin: float) -> Crop:
    """Return the upright columns that hold one of some points, or come within a margin of one.

    They reach from the box's lowest to its highest point and, both ways, by the margin beyond.
    """
    occupied = occupied_cells(pieces, (size, size, np.inf), box, margin + size)
    keys, indices = occupied.keys, occupied.indices()
    reach = int(np.floor(margin / size)) + 1
    for east, north in itertools.product(range(-reach, reach + 1), repeat=2):
        # Between the nearest sides of two columns.
        apart = np.hypot(max(abs(east) - 1, 0), max(abs(north) - 1, 0)) * size
        if apart < margin:
            keys = np.union1d(keys, cell_keys(indices + np.array((east, north, 0.0))))
    columns = replace(occupied, keys=keys[keys >= 0])
    low, high = float(box[0, 2] - margin), float(box[1, 2] + margin)

    def holds(points: Floats) -> Bools:
        upright = (points[:, 2] >= low) & (points[:, 2] <= high)
        return np.asarray(upright & columns.holds(points))

    return holds


def find_crop(
    truth: CloudSource, box: Floats, settings: Preparation, block_points: int
) -> Crop | None:
    """Return the part of the scene that both clouds are cropped to, or None."""
    if settings.crop == "none":
        return None
    pieces = finite_pieces(truth, block_points)
    return covered_columns(pieces, settings.crop_cell_m, box, settings.crop_margin_m)


# --- clouds as they are compared ---


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """A cloud as it is compared, and how many points were left out of it, or merged by voxels.

    `distrusted` are those of too little confidence. `sample` (S, 3) are finite points from all of
    the cloud, those outside the crop among them.
    """

    source: CloudSource
    distrusted: int
    not_finite: int
    outside: int
    thinned: int
    sample: Floats

    def in_memory(self) -> PreparedCloud:
        """Return the cloud with all its points read."""
        points = (piece.points for piece in self.source.pieces(_PIECE))
        return replace(self, source=cloud_of(gather_points(points, on_disk=False)))


def prepare_cloud(
    source: CloudSource, settings: Preparation, crop: Crop | None, block_points: int
) -> PreparedCloud:
    """Prepare a cloud, cropped where there is a crop."""
    size, grid = settings.voxel_m, None
    if not isinstance(size, str):
        grid = VoxelGrid(size, grid_origin(size), max(block_points, _LEAST_VOXELS))
    seen = finite = inside = 0
    # Every n-th point, the same for any pieces.
    sample, every = [np.zeros((0, 3))], max(1, source.count // _SAMPLE)
    for piece in source.pieces(block_points):
        sample.append(piece.points[-seen % every :: every].copy())
        near = piece.points[finite_rows(piece.points)]
        within = near if crop is None else near[crop(near)]
        seen, finite, inside = seen + len(piece), finite + len(near), inside + len(within)
        if grid is not None:
            grid.add(within)
    some = np.concatenate(sample)

    def read(points: int) -> Iterator[Cloud]:
        for near in finite_pieces(source, points):
            yield Cloud(near if crop is None else near[crop(near)])

    prepared = PieceCloud(inside, read) if grid is None else cloud_of(grid.points())
    return PreparedCloud(
        prepared,
        distrusted=source.count - seen,
        not_finite=seen - finite,
        outside=finite - inside,
        thinned=inside - prepared.count,
        sample=some[finite_rows(some)],
    )


# --- the points that the photos saw ---


def observed_cells(
    truth: CloudSource,
    box: Floats,
    cameras: Cameras,
    poses: Poses,
    settings: Preparation,
    block_points: int,
) -> Cells:
    """Return the cells of the true cloud, which `box` holds, that enough of the photos saw."""
    cell = settings.observed_cell_m
    # Thinning rounds: points may lie outside the box of the unthinned cloud by a hair.
    occupied = occupied_cells(finite_pieces(truth, block_points), (cell, cell, cell), box, cell)
    centres = (occupied.indices() + occupied.low + 0.5) * occupied.size
    times = np.zeros(len(centres), np.int64)
    for row in range(len(poses)):
        camera, pose = cameras.take(row), poses.take(row)
        times += find_visible(centres, camera, pose, cell, settings.hidden_beyond_m)
    keys = occupied.keys[times >= settings.observed_photos]
    if not len(keys):
        what = f"no point of the true cloud is seen by {settings.observed_photos} of the photos"
        raise BenchmarkError(what, expected="a cloud in the coordinates of the photos")
    return replace(occupied, keys=keys)


def find_visible(
    points: Floats, camera: Cameras, pose: Poses, cell: float, hidden_beyond: float
) -> Bools:
    """Say which of points (N, 3), centres of cells that a surface occupies, a photo sees."""
    seen = np.zeros(len(points), np.bool_)
    local = apply_matrix(pose.rotation[0], points - pose.centres[0])
    rows = np.flatnonzero(local[:, 2] > _NEAREST)
    pixels = project(camera, local[None, rows])[0]
    size = np.array((camera.width[0], camera.height[0]))
    inside = ((pixels >= 0.0) & (pixels < size)).all(axis=1)
    rows, pixels = rows[inside], pixels[inside]
    depth = local[rows, 2]
    wide = _SPLAT * cell * float(camera.focal[0].max()) / depth
    levels = np.ceil(np.log(np.maximum(wide, 1.0)) / np.log(_STEP)).astype(np.int64)
    # Points are tested against all nearer ones; those need buffers of wider cells.
    hidden = np.zeros(len(depth), np.bool_)
    for level in np.unique(levels).tolist():
        side = _STEP**level
        columns = int(size[0] // side) + 1
        x, y = np.floor(pixels / side).astype(np.int64).T
        pixel = y * columns + x
        nearest = np.full(columns * (int(size[1] // side) + 1), np.inf)
        own = levels == level
        np.minimum.at(nearest, pixel[own], depth[own])
        tested = levels <= level
        hidden[tested] |= nearest[pixel[tested]] < depth[tested] - hidden_beyond
    seen[rows] = ~hidden
    return seen

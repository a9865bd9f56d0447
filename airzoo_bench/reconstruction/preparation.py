"""Which points of both clouds are compared: finite ones, in a region, thinned, seen by the photos.

Points that are not finite are left out and counted, then those outside the region, and the rest is
thinned by voxels; each step only where a protocol asks for it. Recall is over the part of the true
cloud that the photos saw: inside enough of them, and not hidden.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.clouds import (
    InMemoryCloud,
    PieceCloud,
    VoxelGrid,
    concatenate_pieces,
    finite_pieces,
    finite_rows,
    grid_origin,
)
from airzoo_bench.reconstruction.settings import Preparation

Region = Callable[[Floats], Bools]
"""Says which of finite points (N, 3) lie in a part of space."""

_MOST_CELLS = 1 << 62
_LEAST_VOXELS = 1 << 18
_SAMPLE = 100_000
_PIECE = 1 << 20
_ROBUST = (1.0, 99.0)
_NEAREST = 1e-3
# A cell of the depth buffer is this many projected cells wide, so that surfaces have no holes.
_SPLAT = 1.5
_STEP = np.sqrt(2.0)


# --- regions ---


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the axes, borders included; its corners `low` and `high` (3,)."""

    low: Floats
    high: Floats

    def grown(self, margin: float) -> Box:
        """Return the box with its sides moved outwards by `margin`."""
        return Box(self.low - margin, self.high + margin)

    def holds(self, points: Floats) -> Bools:
        """Say which of points (N, 3) lie in the box or on its border."""
        inside: Bools = np.all((points >= self.low) & (points <= self.high), axis=1)
        return inside


def box_of(source: CloudSource) -> Box:
    """Return the smallest box that holds the finite points of the true cloud."""
    pieces = finite_pieces(source, _PIECE)
    corners = [(piece.min(axis=0), piece.max(axis=0)) for piece in pieces if len(piece)]
    if not corners:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point",
            fix="check the benchmark's cloud",
        )
    low, high = zip(*corners, strict=True)
    return Box(np.min(low, axis=0), np.max(high, axis=0))


@dataclass(frozen=True, eq=False)
class CellSet:
    """Some cells of a grid that has a corner at (0, 0, 0); an infinite `size` makes columns.

    `keys` (C,), ascending, number the cells in the part of the grid that is looked at, whose least
    cell is `low` and which has so many cells along each axis.
    """

    size: Floats
    low: Floats
    shape: Floats
    keys: Ints

    def holds(self, points: Floats) -> Bools:
        """Say which of points (N, 3), finite, lie in a cell of the set."""
        inside, keys = self.keys_of(points)
        if not len(self.keys):
            return np.zeros(len(points), np.bool_)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.asarray(inside & (self.keys[place] == keys))

    def keys_of(self, points: Floats) -> tuple[Bools, Ints]:
        """Say which of points (N, 3) lie in the part that is looked at, and in which cells."""
        return self.keys_at(np.floor(points / self.size) - self.low)

    def keys_at(self, places: Floats) -> tuple[Bools, Ints]:
        """Say which places (N, 3), counted from the least, are looked at, and their keys."""
        inside = np.asarray(((places >= 0) & (places < self.shape)).all(axis=1))
        x, y, z = np.where(inside[:, None], places, 0.0).astype(np.int64).T
        _, along_y, along_z = self.shape.astype(np.int64).tolist()
        return inside, (x * along_y + y) * along_z + z

    def places(self) -> Ints:
        """Return places (C, 3) of the set's cells along the axes, counted from the least."""
        _, along_y, along_z = self.shape.astype(np.int64).tolist()
        rest, z = np.divmod(self.keys, along_z)
        return np.stack((*np.divmod(rest, along_y), z), axis=1)


def occupied_cells(
    pieces: Iterable[Floats], size: tuple[float, float, float], box: Box, margin: float = 0.0
) -> CellSet:
    """Return the cells, of these sides, that hold one of the finite points of some pieces."""
    sides = np.array(size)
    low, high = (np.floor(corner / sides) for corner in (box.low - margin, box.high + margin))
    shape = high - low + 1.0
    if not shape.prod() < _MOST_CELLS:
        raise BenchmarkError(
            f"the true cloud spans {' x '.join(f'{s:.4g}' for s in box.high - box.low)} m",
            expected="a scene, without points far away from it",
            fix="leave stray points out of the cloud, and prepare the benchmark again",
        )
    found = CellSet(sides, low, shape, np.zeros(0, np.int64))
    keys = found.keys
    for points in pieces:
        keys = np.union1d(keys, found.keys_of(points)[1])
    return replace(found, keys=keys)


def covered_columns(pieces: Iterable[Floats], size: float, box: Box, margin: float) -> Region:
    """Return the upright columns that hold one of some points, or come within a margin of one.

    They reach from the box's lowest to its highest point and, both ways, by the margin beyond.
    """
    occupied = occupied_cells(pieces, (size, size, np.inf), box, margin + size)
    keys, places = occupied.keys, occupied.places()
    reach = int(np.floor(margin / size)) + 1
    for east, north in itertools.product(range(-reach, reach + 1), repeat=2):
        # Between the nearest sides of two columns.
        apart = np.hypot(max(abs(east) - 1, 0), max(abs(north) - 1, 0)) * size
        if apart < margin:
            inside, grown = occupied.keys_at(places + np.array((east, north, 0.0)))
            keys = np.union1d(keys, grown[inside])
    columns = replace(occupied, keys=keys)
    low, high = float(box.low[2] - margin), float(box.high[2] + margin)

    def holds(points: Floats) -> Bools:
        upright = (points[:, 2] >= low) & (points[:, 2] <= high)
        return np.asarray(upright & columns.holds(points))

    return holds


def cropped_region(
    truth: CloudSource, box: Box, settings: Preparation, block_points: int
) -> Region | None:
    """Return what a protocol crops both clouds to, or None."""
    if settings.crop == "none":
        return None
    if settings.crop == "box":
        return box.grown(settings.crop_margin_m).holds
    pieces = finite_pieces(truth, block_points)
    return covered_columns(pieces, settings.crop_cell_m, box, settings.crop_margin_m)


# --- clouds as they are compared ---


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """A cloud as it is compared, and how many points were left out of it, or merged by voxels.

    `distrusted` are those of too little confidence.

    `sample` (S, 3) are finite points from all of the cloud, those outside the region among them.
    """

    source: CloudSource
    distrusted: int
    not_finite: int
    outside: int
    thinned: int
    sample: Floats

    @property
    def bounds(self) -> Floats:
        """Percentiles 1 and 99 (2, 3) of the sample; NaN where there is none."""
        if not len(self.sample):
            return np.full((2, 3), np.nan)
        return np.asarray(np.percentile(self.sample, _ROBUST, axis=0), dtype=np.float64)

    def in_memory(self) -> PreparedCloud:
        """Return the cloud with all its points read."""
        points = concatenate_pieces(piece.points for piece in self.source.pieces(_PIECE))
        return replace(self, source=InMemoryCloud(points))


def prepare_cloud(
    source: CloudSource, settings: Preparation, region: Region | None, block_points: int
) -> PreparedCloud:
    """Prepare a cloud, cropped to a region where one is given."""
    size, grid = settings.voxel_m, None
    if not isinstance(size, str):
        grid = VoxelGrid(size, grid_origin(size), max(block_points, _LEAST_VOXELS))
    seen = not_finite = inside = 0
    # Every n-th point, the same for any pieces.
    sample, every = [np.zeros((0, 3))], max(1, source.count // _SAMPLE)
    for piece in source.pieces(block_points):
        finite, within = _masks(piece.points, region)
        sample.append(piece.points[-seen % every :: every].copy())
        seen += len(piece)
        not_finite += int(np.count_nonzero(~finite))
        inside += int(np.count_nonzero(within))
        if grid is not None:
            grid.add(piece.points[within])
    some = np.concatenate(sample)
    some, outside = some[finite_rows(some)], seen - not_finite - inside
    left_out = source.count - seen, not_finite, outside
    if grid is not None:
        thin = grid.points()
        return PreparedCloud(InMemoryCloud(thin), *left_out, inside - len(thin), some)

    def read(points: int) -> Iterator[Cloud]:
        for piece in source.pieces(points):
            yield Cloud(piece.points[_masks(piece.points, region)[1]])

    return PreparedCloud(PieceCloud(inside, read), *left_out, 0, some)


def _masks(points: Floats, region: Region | None) -> tuple[Bools, Bools]:
    """Say which points are finite, and which lie in the region too."""
    finite = finite_rows(points)
    within = finite.copy()
    if region is not None:
        within[finite] = region(points[finite])
    return finite, within


# --- what the photos saw ---


def observed_cells(
    truth: CloudSource,
    box: Box,
    cameras: Cameras,
    poses: Poses,
    settings: Preparation,
    block_points: int,
) -> CellSet:
    """Return the cells of the true cloud, which `box` holds, that enough of the photos saw."""
    cell = settings.observed_cell_m
    # Thinning rounds: points may lie outside the box of the unthinned cloud by a hair.
    occupied = occupied_cells(finite_pieces(truth, block_points), (cell, cell, cell), box, cell)
    centres = (occupied.places() + occupied.low + 0.5) * occupied.size
    times = np.zeros(len(centres), np.int64)
    for row in range(len(poses)):
        camera, pose = cameras.take(row), poses.take(row)
        times += seen_by(centres, camera, pose, cell, settings.hidden_beyond_m)
    keys = occupied.keys[times >= settings.observed_photos]
    if not len(keys):
        raise BenchmarkError(
            f"no point of the true cloud is seen by {counted(settings.observed_photos, 'photo')}",
            expected="a cloud of what the photos show, in the same coordinates",
            fix='check poses and cloud, or choose region = "all" in the protocol',
        )
    return replace(occupied, keys=keys)


def seen_by(
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
    seen[rows] = ~_hidden(pixels, depth, levels, size, hidden_beyond)
    return seen


def _hidden(pixels: Floats, depth: Floats, levels: Ints, size: Ints, beyond: float) -> Bools:
    """Test points against all nearer ones; those need buffers of wider cells."""
    hidden = np.zeros(len(depth), np.bool_)
    for level in np.unique(levels).tolist():
        side = _STEP**level
        columns = int(size[0] // side) + 1
        x, y = np.floor(pixels / side).astype(np.int64).T
        place = y * columns + x
        nearest = np.full(columns * (int(size[1] // side) + 1), np.inf)
        own = levels == level
        np.minimum.at(nearest, place[own], depth[own])
        tested = levels <= level
        hidden[tested] |= nearest[place[tested]] < depth[tested] - beyond
    return hidden

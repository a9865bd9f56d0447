"""What is done to both clouds before distances are taken, piece by piece.

Points that are not finite are left out and counted, then those outside the region, and the rest is
thinned by voxels; each step only where a protocol asks for it. Recall is over the part of the
truth that the photos saw: inside enough of them, and not hidden.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.cloud_sources import (
    EvenSample,
    InMemoryCloud,
    concatenated,
    finite_pieces,
    finite_rows,
)
from airzoo_bench.reconstruction.regions import (
    Box,
    CellSet,
    Columns,
    covered_columns,
    occupied_cells,
)
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.voxels import VoxelGrid

__all__ = [
    "PreparedCloud",
    "cropped_region",
    "grid_origin",
    "observed_cells",
    "prepared",
    "seen_by",
]

Region = Box | Columns

_OFF_GRID = 0.3819660112501052
_LEAST_VOXELS = 1 << 18
_SAMPLE = 100_000
_PIECE = 1 << 20
_ROBUST = (1.0, 99.0)
_NEAREST = 1e-3
# A cell of the depth buffer is this many projected cells wide, so that surfaces have no holes.
_SPLAT = 1.5
_STEP = np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """A cloud as it is compared, and what was left out of it.

    Attributes
    ----------
    source : CloudSource
        Finite points only.
    not_finite, outside, thinned : int
        Points with NaN or infinite coordinates, outside the region, and merged by voxels.
    sample : (S, 3) float64
        Finite points from all of the cloud, those outside the region among them.
    """

    source: CloudSource
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
        points = concatenated(piece.points for piece in self.source.pieces(_PIECE))
        return replace(self, source=InMemoryCloud(points))


def cropped_region(
    truth: CloudSource, box: Box, settings: Preparation, block_points: int
) -> Region | None:
    """Return what a protocol crops both clouds to, or None.

    Parameters
    ----------
    truth : CloudSource
        The true cloud, which `box` holds.
    box : Box
    settings : Preparation
    block_points : int
        Points that are read at a time.

    Raises
    ------
    BenchmarkError
        The true cloud spans too much for columns.
    """
    if settings.crop == "none":
        return None
    if settings.crop == "box":
        return box.grown(settings.crop_margin_m)
    pieces = finite_pieces(truth, block_points)
    return covered_columns(pieces, settings.crop_cell_m, box, settings.crop_margin_m)


def prepared(
    source: CloudSource, settings: Preparation, region: Region | None, block_points: int
) -> PreparedCloud:
    """Prepare a cloud, cropped to a region where one is given.

    So many `block_points` are read at a time, and about as many voxels may be occupied.

    Raises
    ------
    UsageError
        More voxels are occupied.
    """
    grid = None
    if not isinstance(size := settings.voxel_m, str):
        grid = VoxelGrid(size, grid_origin(size), max(block_points, _LEAST_VOXELS))
    not_finite = outside = inside = 0
    sample = EvenSample(source.count, _SAMPLE)
    for piece in source.pieces(block_points):
        finite, within = _kept(piece, region)
        sample.add(piece.points)
        not_finite += len(piece) - int(np.count_nonzero(finite))
        outside += int(np.count_nonzero(finite & ~within))
        inside += int(np.count_nonzero(within))
        if grid is not None:
            grid.add(piece.points[within])
    some = sample.points()
    some = some[finite_rows(some)]
    if grid is None:
        cropped = _CroppedCloud(source, region, inside)
        return PreparedCloud(cropped, not_finite, outside, 0, some)
    thin = grid.points()
    return PreparedCloud(InMemoryCloud(thin), not_finite, outside, inside - len(thin), some)


def grid_origin(size: float) -> Floats:
    """Return a corner (3,) of the voxels of this side, the same for all clouds.

    It is no round number: coordinates that were rounded to centimetres would else lie on the
    borders of voxels, where rounding decides.
    """
    return np.full(3, size * _OFF_GRID)


@dataclass(frozen=True, eq=False)
class _CroppedCloud:
    """The finite points of a cloud that lie in a region, as a `CloudSource`."""

    source: CloudSource
    region: Region | None
    count: int

    def pieces(self, points: int) -> Iterator[Cloud]:
        for piece in self.source.pieces(points):
            _, within = _kept(piece, self.region)
            yield Cloud(piece.points[within])


def _kept(piece: Cloud, region: Region | None) -> tuple[Bools, Bools]:
    """Whether points are finite, and whether they lie in the region too."""
    finite = finite_rows(piece.points)
    if region is None:
        return finite, finite
    within = finite.copy()
    within[finite] = region.holds(piece.points[finite])
    return finite, within


def observed_cells(
    truth: CloudSource,
    box: Box,
    cameras: Cameras,
    poses: Poses,
    settings: Preparation,
    block_points: int,
) -> CellSet:
    """Cells of the true cloud, which `box` holds, that enough of the photos saw.

    So many `block_points` are read at a time.

    Raises
    ------
    BenchmarkError
        They see none.
    """
    cell = settings.observed_cell_m
    # Thinning rounds: points may lie outside the box of the unthinned cloud by a hair.
    occupied = occupied_cells(finite_pieces(truth, block_points), (cell, cell, cell), box, cell)
    points, times = occupied.centres(), np.zeros(len(occupied.keys), np.int64)
    for row in range(len(poses)):
        camera, pose = cameras.take(row), poses.take(row)
        times += seen_by(points, camera, pose, cell, settings.hidden_beyond_m)
    keys = occupied.keys[times >= settings.observed_photos]
    if not len(keys):
        raise BenchmarkError(
            f"no point of the true cloud is seen by {counted(settings.observed_photos, 'photo')}",
            expected="a cloud of what the photos show, in the same coordinates",
            fix='check poses and cloud, or choose region = "all" in the protocol',
        )
    return CellSet(occupied.size, occupied.low, occupied.shape, keys)


def seen_by(
    points: Floats, camera: Cameras, pose: Poses, cell: float, hidden_beyond: float
) -> Bools:
    """Whether a photo sees each of points (N, 3): centres of the cells that a surface occupies.

    A point is hidden where another one in the same direction is nearer along the optical axis by
    more than `hidden_beyond`. Directions are cells of a depth buffer, 1.5 to 2.1 times as wide as
    a cell of the surface, of side `cell`, appears there. Camera and pose are one each.
    """
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

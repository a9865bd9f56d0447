"""What is done to a cloud before distances are taken, piece by piece.

Points that are not finite are left out and counted, then those outside the region, and the rest is
thinned by voxels; each step only where a protocol asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.cells import Columns, covered_columns
from airzoo_bench.reconstruction.regions import Box, bounding_box, finite_rows, take
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.voxels import VoxelGrid

__all__ = [
    "InMemoryCloud",
    "PreparedCloud",
    "TransformedCloud",
    "box_of",
    "cropped_region",
    "finite_pieces",
    "grid_origin",
    "prepared",
]

Region = Box | Columns

_OFF_GRID = 0.3819660112501052
_LEAST_VOXELS = 1 << 18
_SAMPLE = 100_000
_ROBUST = (1.0, 99.0)


@dataclass(frozen=True, eq=False)
class InMemoryCloud:
    """A cloud in memory, as a `CloudSource`."""

    cloud: Cloud

    @property
    def count(self) -> int:
        """How many points it holds."""
        return len(self.cloud)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most so many at a time."""
        for start in range(0, len(self.cloud), points):
            yield take(self.cloud, slice(start, start + points))


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
        """Yield all points, at most so many at a time."""
        for piece in self.source.pieces(points):
            kept = piece
            if self.confidence_above is not None and piece.confidence is not None:
                kept = take(piece, piece.confidence > self.confidence_above)
            # What is infinite becomes NaN at worst, and is counted where the cloud is prepared.
            with np.errstate(invalid="ignore", over="ignore"):
                moved = self.transform.apply(kept.points)
            yield Cloud(moved, kept.colours, kept.confidence)


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


def box_of(source: CloudSource, points: int = 1 << 20) -> Box:
    """Return the smallest box that holds the finite points of a cloud.

    Raises
    ------
    BenchmarkError
        There are none.
    """
    box: Box | None = None
    for piece in source.pieces(points):
        finite = piece.points[finite_rows(piece.points)]
        if len(finite):
            found = bounding_box(finite)
            box = found if box is None else box.joined(found)
    if box is None:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point",
            fix="check the benchmark's cloud",
        )
    return box


def grid_origin(size: float) -> Floats:
    """Return a corner of the voxels of this side, the same for all clouds.

    It is no round number: coordinates that were rounded to centimetres would else lie on the
    borders of voxels, where rounding decides.
    """
    return np.full(3, size * _OFF_GRID)


def cropped_region(
    truth: CloudSource, box: Box, settings: Preparation, block_points: int
) -> Region | None:
    """Return what a protocol crops both clouds to, or None.

    Parameters
    ----------
    truth : CloudSource
        The true cloud.
    box : Box
        That holds it.
    settings : Preparation
    block_points : int
        Points that are read at a time.

    Raises
    ------
    BenchmarkError
        The true cloud spans too much for columns.
    """
    margin = settings.crop_margin_m
    if settings.crop == "none":
        return None
    if settings.crop == "box":
        return box.grown(margin)
    pieces = finite_pieces(truth, block_points)
    return covered_columns(pieces, settings.crop_cell_m, box, margin)


def finite_pieces(source: CloudSource, block_points: int) -> Iterator[Floats]:
    """Yield the finite points of a cloud, at most so many at a time."""
    for piece in source.pieces(block_points):
        yield piece.points[finite_rows(piece.points)]


def prepared(
    source: CloudSource, settings: Preparation, region: Region | None, block_points: int
) -> PreparedCloud:
    """Prepare a cloud.

    Parameters
    ----------
    source : CloudSource
    settings : Preparation
    region : Region or None
        What it is cropped to.
    block_points : int
        Points that are read at a time, and about as many voxels may be occupied.

    Raises
    ------
    UsageError
        More voxels are occupied.
    """
    kept = _Kept(source, region)
    grid = None
    if not isinstance(size := settings.voxel_m, str):
        grid = VoxelGrid(size, grid_origin(size), max(block_points, _LEAST_VOXELS))
    not_finite = outside = inside = 0
    sample = _Sample(source.count)
    for piece in source.pieces(block_points):
        finite, within = kept.rows(piece)
        sample.add(piece.points)
        not_finite += len(piece) - int(np.count_nonzero(finite))
        outside += int(np.count_nonzero(finite & ~within))
        inside += int(np.count_nonzero(within))
        if grid is not None:
            grid.add(take(piece, within))
    some = sample.points()
    if grid is None:
        return PreparedCloud(_Counted(kept, inside), not_finite, outside, 0, some)
    thin = grid.cloud()
    return PreparedCloud(InMemoryCloud(thin), not_finite, outside, inside - len(thin), some)


class _Sample:
    """Every so many-th point of a cloud, the same whatever the pieces."""

    def __init__(self, count: int) -> None:
        self._step, self._seen = max(1, count // _SAMPLE), 0
        self._parts = [np.zeros((0, 3))]

    def add(self, points: Floats) -> None:
        self._parts.append(points[-self._seen % self._step :: self._step])
        self._seen += len(points)

    def points(self) -> Floats:
        points = np.concatenate(self._parts)
        return points[finite_rows(points)]


@dataclass(frozen=True, eq=False)
class _Kept:
    """The finite points of a cloud that lie in a region."""

    source: CloudSource
    region: Region | None

    def rows(self, piece: Cloud) -> tuple[Bools, Bools]:
        finite = finite_rows(piece.points)
        if self.region is None:
            return finite, finite
        within = finite.copy()
        within[finite] = self.region.holds(piece.points[finite])
        return finite, within


@dataclass(frozen=True, eq=False)
class _Counted:
    kept: _Kept
    count: int

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most so many at a time."""
        for piece in self.kept.source.pieces(points):
            _, within = self.kept.rows(piece)
            yield piece if within.all() else take(piece, within)

"""What is done to both clouds before distances are taken, piece by piece.

Points that are not finite are left out and counted, then those outside the region, and the rest is
thinned by voxels; each step only where a protocol asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.cloud_sources import (
    EvenSample,
    InMemoryCloud,
    concatenated,
    finite_pieces,
    finite_rows,
)
from airzoo_bench.reconstruction.regions import (
    Box,
    Columns,
    covered_columns,
)
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.voxels import VoxelGrid

__all__ = [
    "PreparedCloud",
    "cropped_region",
    "grid_origin",
    "prepared",
]

Region = Box | Columns

_OFF_GRID = 0.3819660112501052
_LEAST_VOXELS = 1 << 18
_SAMPLE = 100_000
_PIECE = 1 << 20
_ROBUST = (1.0, 99.0)


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
    truth: CloudSource,
    box: Box,
    settings: Preparation,
    block_points: int,
) -> Region | None:
    """Return what a protocol crops both clouds to, or None."""
    if settings.crop == "none":
        return None
    if settings.crop == "box":
        return box.grown(settings.crop_margin_m)
    size = settings.crop_cell_m
    return covered_columns(finite_pieces(truth, block_points), size, box, settings.crop_margin_m)


def prepared(
    source: CloudSource,
    settings: Preparation,
    region: Region | None,
    block_points: int,
) -> PreparedCloud:
    """Prepare a cloud, cropped to a region where one is given."""
    grid = _grid(settings, block_points)
    counts = np.zeros(3, np.int64)
    sampled = EvenSample(source.count, _SAMPLE)
    for piece in source.pieces(block_points):
        finite, within = _kept(piece, region)
        sampled.add(piece.points)
        counts += [np.count_nonzero(which) for which in (~finite, finite & ~within, within)]
        if grid is not None:
            grid.add(piece.points[within])
    not_finite, outside, inside = counts.tolist()
    some = sampled.points()
    sample = some[finite_rows(some)]
    if grid is None:
        cropped = _CroppedCloud(source, region, inside, _within(sample, region))
        return PreparedCloud(cropped, not_finite, outside, 0, sample)
    thin = grid.points()
    return PreparedCloud(InMemoryCloud(thin), not_finite, outside, inside - len(thin), sample)


def _grid(settings: Preparation, block_points: int) -> VoxelGrid | None:
    size = settings.voxel_m
    if isinstance(size, str):
        return None
    return VoxelGrid(size, grid_origin(size), max(block_points, _LEAST_VOXELS))


def grid_origin(size: float) -> Floats:
    """Return a corner (3,) of the voxels of this side, the same for all clouds."""
    return np.full(3, size * _OFF_GRID)


@dataclass(frozen=True, eq=False)
class _CroppedCloud:
    """The finite points of a cloud that lie in a region, as a `CloudSource`, and some of them."""

    source: CloudSource
    region: Region | None
    count: int
    sample: Floats

    def pieces(self, points: int) -> Iterator[Cloud]:
        for piece in self.source.pieces(points):
            _, within = _kept(piece, self.region)
            yield Cloud(piece.points[within])


def _within(points: Floats, region: Region | None) -> Floats:
    return points if region is None else points[region.holds(points)]


def _kept(piece: Cloud, region: Region | None) -> tuple[Bools, Bools]:
    """Whether points are finite, and whether they lie in the region too."""
    finite = finite_rows(piece.points)
    if region is None:
        return finite, finite
    within = finite.copy()
    within[finite] = region.holds(piece.points[finite])
    return finite, within

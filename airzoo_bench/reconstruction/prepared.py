"""What is done to both clouds before distances are taken, piece by piece.

Points that are not finite are left out and counted, then those outside the region, and the rest is
thinned by voxels; each step only where a protocol asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource, Shard, shards_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.cloud_sources import (
    EvenSample,
    InMemoryCloud,
    concatenated,
    finite_rows,
)
from airzoo_bench.reconstruction.regions import (
    Box,
    Columns,
    covered_columns,
    occupying,
)
from airzoo_bench.reconstruction.settings import Preparation
from airzoo_bench.reconstruction.sharded import over_shards
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
    engine: Engine = HERE,
) -> Region | None:
    """Return what a protocol crops both clouds to, or None; shards of the true cloud are tasks."""
    if settings.crop == "none":
        return None
    if settings.crop == "box":
        return box.grown(settings.crop_margin_m)
    size = settings.crop_cell_m
    pieces = occupying(truth, (size, size, np.inf), block_points, engine)
    return covered_columns(pieces, size, box, settings.crop_margin_m)


def prepared(
    source: CloudSource,
    settings: Preparation,
    region: Region | None,
    block_points: int,
    engine: Engine = HERE,
) -> PreparedCloud:
    """Prepare a cloud, cropped to a region where one is given; its shards are tasks."""
    grid = _grid(settings, block_points)
    counts = np.zeros(3, np.int64)
    some = [np.zeros((0, 3))]
    shared = _Preparing(settings, region, block_points, source.count)
    for found in over_shards(_prepared_shard, source, shared, engine):
        counts += found["kept"]
        some.append(found["sample"])
        if grid is not None:
            grid.add_sums(found)
    not_finite, outside, inside = counts.tolist()
    sample = np.concatenate(some)
    if grid is None:
        cropped = _CroppedCloud(source, region, inside, _within(sample, region))
        return PreparedCloud(cropped, not_finite, outside, 0, sample)
    thin = grid.points()
    return PreparedCloud(InMemoryCloud(thin), not_finite, outside, inside - len(thin), sample)


@dataclass(frozen=True, eq=False)
class _Preparing:
    settings: Preparation
    region: Region | None
    block_points: int
    count: int


def _prepared_shard(shared: _Preparing, shard: Shard) -> dict[str, NDArray[Any]]:
    """Count points that are not finite, outside and inside; sample them, and sum up voxels."""
    grid = _grid(shared.settings, shared.block_points)
    counts = np.zeros(3, np.int64)
    sample = EvenSample(shared.count, _SAMPLE, shard.first)
    for piece in shard.source.pieces(shared.block_points):
        finite, within = _kept(piece, shared.region)
        sample.add(piece.points)
        counts += [np.count_nonzero(which) for which in (~finite, finite & ~within, within)]
        if grid is not None:
            grid.add(piece.points[within])
    some = sample.points()
    found = {"kept": counts, "sample": some[finite_rows(some)]}
    return found if grid is None else found | grid.sums()


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

    @property
    def shards(self) -> tuple[Shard, ...]:
        """See `Sharded`."""
        nothing = np.zeros((0, 3))
        return tuple(
            shard.through(lambda source: replace(self, source=source, sample=nothing))
            for shard in shards_of(self.source)
        )

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

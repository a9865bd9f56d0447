"""Exact distances between two clouds, in memory where they fit, in blocks on disk where not.

In blocks, both clouds are written to disk in cells (`spill`). The points of a cell are compared
with the other cloud's points of the same cell; what this finds bounds their distances. A point
whose bound reaches into the box of another block is first compared with a sample of the whole other
cloud, which tightens bounds of points that are alone in their cell, and where its bound still
reaches, against that block. No halo is guessed, nothing is searched twice, and far points cost no
more than the blocks that their bounds reach. The least over blocks of the least in each block is
the least of all, so the distances are those of `neighbours`, to the last bit.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.reconstruction.cloud_sources import EvenSample, concatenated, finite_pieces
from airzoo_bench.reconstruction.distances.boxes import (
    bound_squared,
    gap_squared,
    gather,
    morton_order,
)
from airzoo_bench.reconstruction.distances.neighbours import NeighbourSearch, mutual_distances
from airzoo_bench.reconstruction.distances.spill import Block, Spill, cells_of, spilled

__all__ = ["CloudDistances", "block_distances", "cloud_distances"]

_SAMPLE = 1 << 17
_RUN = 1 << 10
_PAIRS = 1 << 21


@dataclass(frozen=True, eq=False)
class CloudDistances:
    """Nearest distances both ways, infinite where nothing is predicted.

    Attributes
    ----------
    to_truth : (P,) float64
        From each finite predicted point to the true cloud, in the order of the source.
    to_prediction : (T,) float64
        From each finite true point to the predicted cloud.
    """

    to_truth: Floats
    to_prediction: Floats


def cloud_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    progress: Progress = silent,
) -> CloudDistances:
    """Exact nearest distances between two clouds, both ways.

    Parameters
    ----------
    prediction, truth : CloudSource
        Points that are not finite are left out.
    block_points : int
        Two clouds of at most this many points are held in memory; larger ones are cut into blocks
        of about this size. The distances do not depend on it.
    jobs : int
        Threads, at least 1; the distances do not depend on it.
    progress : Progress

    Raises
    ------
    BenchmarkError
        The true cloud has no finite point.
    UserError
        Temporary files cannot be written; what the sources raise.
    """
    if max(prediction.count, truth.count) <= block_points:
        predicted, true = (
            concatenated(finite_pieces(cloud, block_points)) for cloud in (prediction, truth)
        )
        _require_truth(len(true) > 0)
        return CloudDistances(*mutual_distances(predicted, true, jobs=jobs))
    _require_truth(_any(truth, block_points))
    if not _any(prediction, block_points):
        points = sum(map(len, finite_pieces(truth, block_points)))
        return CloudDistances(np.zeros(0), np.full(points, np.inf))
    return block_distances(
        prediction, truth, block_points=block_points, jobs=jobs, progress=progress
    )


def _any(cloud: CloudSource, points: int) -> bool:
    return any(len(piece) for piece in finite_pieces(cloud, points))


def _require_truth(there: bool) -> None:
    if not there:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point, after cropping too",
            fix="check the benchmark's cloud and the protocol's crop",
        )


def block_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    progress: Progress = silent,
) -> CloudDistances:
    """Nearest distances both ways, in memory that holds the distances and a few blocks.

    Parameters and errors are those of `cloud_distances`; both clouds have a finite point. Temporary
    files take 32 bytes a point where the system keeps such files.
    """
    clouds = prediction, truth
    samples = [_sample(cloud, block_points) for cloud in clouds]
    most = max(prediction.count, truth.count)
    cells = cells_of(np.concatenate(samples), -(-most // block_points))
    with ExitStack() as stack:
        one, other = (
            stack.enter_context(
                spilled(finite_pieces(cloud, block_points), cells, most=2 * block_points)
            )
            for cloud in clouds
        )
        ways = ((one, other, samples[1]), (other, one, samples[0]))
        return CloudDistances(
            *(
                _Search(others, sample, jobs, 2 * block_points).distances(points, progress)
                for points, others, sample in ways
            )
        )


def _sample(cloud: CloudSource, points: int) -> Floats:
    sample = EvenSample(cloud.count, _SAMPLE)
    for piece in finite_pieces(cloud, points):
        sample.add(piece)
    return sample.points()


class _Search:
    """The search of one spilled cloud, `others`."""

    def __init__(self, others: Spill, sample: Floats, jobs: int, patience: int) -> None:
        self._others, self._jobs, self._patience = others, jobs, patience
        self._homes = [others.blocks(cell) for cell in range(others.cell_count)]
        self._blocks = [block for blocks in self._homes for block in blocks]
        self._sample = _search(sample)
        self._low, self._high = (
            np.reshape([getattr(block, side) for block in self._blocks], (-1, 3))
            for side in ("low", "high")
        )
        self._slice = max(_RUN, _PAIRS // len(self._blocks))
        self._waiting: list[tuple[Ints, Ints, Floats]] = []

    def distances(self, points: Spill, progress: Progress) -> Floats:
        """Distance of each of the points, by their numbers."""
        squared = np.empty(points.count)
        for cell in progress(range(points.cell_count), "cells", points.cell_count):
            self._within_cell(points, cell, squared)
        self._across_cells(squared)
        return np.sqrt(squared, out=squared)

    def _within_cell(self, points: Spill, cell: int, squared: Floats) -> None:
        home = self._homes[cell][0] if self._homes[cell] else None
        search = self._sample if home is None else _search(self._others.read(home)[0])
        for block in points.blocks(cell):
            here, numbers = points.read(block)
            order = morton_order(here)
            for start in range(0, len(order), self._slice):
                rows = order[start : start + self._slice]
                part, their = here[rows], numbers[rows]
                squared[their] = search.squared(part, jobs=self._jobs)
                self._wait(part, their, squared, home)

    def _wait(self, points: Floats, numbers: Ints, squared: Floats, home: Block | None) -> None:
        """Note which points have to be compared with which other blocks."""
        rows, blocks = self._reached(points, squared[numbers], home)
        if len(rows) == 0:
            return
        lone = np.unique(rows)
        found = self._sample.squared(points[lone], jobs=self._jobs)
        squared[numbers[lone]] = np.minimum(squared[numbers[lone]], found)
        still = self._bounds(points[rows], blocks) < squared[numbers[rows]]
        rows, blocks = rows[still], blocks[still]
        self._waiting.append((blocks, numbers[rows], points[rows]))
        if sum(len(waiting) for waiting, _, _ in self._waiting) > self._patience:
            self._across_cells(squared)

    def _reached(self, points: Floats, found: Floats, home: Block | None) -> tuple[Ints, Ints]:
        """Pairs of a point and a block, not its own, that may hold a nearer one."""
        others = np.array([block is not home for block in self._blocks])
        pairs = []
        for start in range(0, len(points), _RUN):
            part, reach = points[start : start + _RUN], found[start : start + _RUN]
            # Points in a run are near each other: for most runs, no other block is near.
            apart = gap_squared(part.min(axis=0), part.max(axis=0), self._low, self._high)
            near = np.flatnonzero(others & (apart < reach.max()))
            bounds = bound_squared(part[:, None], self._low[near], self._high[near])
            row, column = np.nonzero(bounds < reach[:, None])
            pairs.append(np.stack((row + start, near[column])))
        rows, blocks = np.concatenate(pairs, axis=1)
        return rows, blocks

    def _across_cells(self, squared: Floats) -> None:
        """Hold the waiting points against their blocks, one block at a time."""
        if not self._waiting:
            return
        blocks, numbers, points = (
            np.concatenate(parts) for parts in zip(*self._waiting, strict=True)
        )
        self._waiting.clear()
        order = np.argsort(blocks, kind="stable")
        ends = np.searchsorted(blocks[order], np.arange(len(self._blocks) + 1))
        for which in np.flatnonzero(np.diff(ends)).tolist():
            rows = order[ends[which] : ends[which + 1]]
            still = self._bounds(points[rows], blocks[rows]) < squared[numbers[rows]]
            rows = rows[still]
            if len(rows):
                search = _search(self._others.read(self._blocks[which])[0])
                found = search.squared(points[rows], jobs=self._jobs)
                squared[numbers[rows]] = np.minimum(squared[numbers[rows]], found)

    def _bounds(self, points: Floats, blocks: Ints) -> Floats:
        return bound_squared(points, self._low[blocks], self._high[blocks])


def _search(points: Floats) -> NeighbourSearch:
    return NeighbourSearch(gather(points, morton_order(points)))

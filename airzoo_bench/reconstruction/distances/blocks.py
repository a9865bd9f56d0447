"""Exact distances to nearest neighbours between clouds that need not fit into memory.

Both clouds are written to disk in cells (`spill`). The points of a cell are held against the other
cloud's points of the same cell; what this finds bounds their distances. A point whose bound
reaches into the box of another block is first held against a sample of the whole other cloud, which
tightens bounds of points that are alone in their cell, and where its bound still reaches, against
that block. No halo is guessed, nothing is searched twice, and far points cost no more than the
blocks that their bounds reach. The least over blocks of the least in each block is the least of
all, so the distances are those of `neighbours`, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.reconstruction.distances.boxes import bound_squared, gap_squared
from airzoo_bench.reconstruction.distances.morton import gather, morton_order
from airzoo_bench.reconstruction.distances.neighbours import NeighbourSearch
from airzoo_bench.reconstruction.distances.spill import Block, Spill, cells_of, spilled

__all__ = ["block_distances"]

_SAMPLE = 1 << 17
_RUN = 1 << 10
_PAIRS = 1 << 21

Pieces = Callable[[], Iterable[Floats]]


def block_distances(
    first: Pieces,
    second: Pieces,
    *,
    counts: tuple[int, int],
    block_points: int,
    threads: int,
    folder: Path | None,
    progress: Progress = silent,
) -> tuple[Floats, Floats]:
    """Nearest distances both ways, as `neighbours.mutual_distances`, in bounded memory.

    Memory holds the distances and a few blocks.

    Parameters
    ----------
    first, second : callable
        Gives the points (N, 3) of a cloud, finite, in pieces of at most `block_points`; called
        twice, and gives the same both times.
    counts : (int, int)
        About how many points each gives.
    block_points : int
        About how many points of a cloud are in memory at a time. The distances do not depend on it.
    threads : int
    folder : Path or None
        Where clouds are kept meanwhile, 32 bytes a point; by default where the system keeps
        temporary files.
    progress : Progress

    Returns
    -------
    (N,) float64
        From each point of `first` to `second`, in the order in which they come.
    (M,) float64
        From each point of `second` to `first`.

    Raises
    ------
    UserError
        See `spill.spilled`.
    ValueError
        A cloud without points.
    """
    samples = _sample(first(), counts[0]), _sample(second(), counts[1])
    if min(map(len, samples)) == 0:
        raise ValueError("a cloud without points")
    cells = cells_of(np.concatenate(samples), -(-max(counts) // block_points))
    with ExitStack() as stack:
        one, other = (
            stack.enter_context(spilled(pieces(), cells, most=2 * block_points, folder=folder))
            for pieces in (first, second)
        )
        ways = ((one, other, samples[1]), (other, one, samples[0]))
        first_way, second_way = (
            _Search(others, sample, threads, 2 * block_points).distances(points, progress)
            for points, others, sample in ways
        )
    return first_way, second_way


def _sample(pieces: Iterable[Floats], count: int) -> Floats:
    """About so many points as are told, evenly from all pieces; all, if there are not more."""
    step = max(1, count // _SAMPLE)
    parts, first = [np.zeros((0, 3))], 0
    for piece in pieces:
        parts.append(piece[first::step].copy())
        first = (first - len(piece)) % step
    return np.concatenate(parts)


class _Search:
    """The search of one spilled cloud, `others`."""

    def __init__(self, others: Spill, sample: Floats, threads: int, patience: int) -> None:
        self._others, self._threads, self._patience = others, threads, patience
        self._homes = [others.blocks(cell) for cell in range(others.cell_count)]
        self._blocks = [block for blocks in self._homes for block in blocks]
        self._sample = _search(sample)
        self._boxes = _stacked_boxes(self._blocks)
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
                squared[their] = search.squared(part, threads=self._threads)
                self._wait(part, their, squared, home)

    def _wait(self, points: Floats, numbers: Ints, squared: Floats, home: Block | None) -> None:
        """Note which points have to be held against which other blocks."""
        rows, blocks = self._reached(points, squared[numbers], home)
        if len(rows) == 0:
            return
        lone = np.unique(rows)
        found = self._sample.squared(points[lone], threads=self._threads)
        squared[numbers[lone]] = np.minimum(squared[numbers[lone]], found)
        still = self._bounds(points[rows], blocks) < squared[numbers[rows]]
        rows, blocks = rows[still], blocks[still]
        self._waiting.append((blocks, numbers[rows], points[rows]))
        if sum(len(waiting) for waiting, _, _ in self._waiting) > self._patience:
            self._across_cells(squared)

    def _reached(self, points: Floats, found: Floats, home: Block | None) -> tuple[Ints, Ints]:
        """Pairs of a point and a block, not its own, that may hold a nearer one."""
        low, high = self._boxes
        others = np.array([block is not home for block in self._blocks])
        pairs = []
        for start in range(0, len(points), _RUN):
            part, reach = points[start : start + _RUN], found[start : start + _RUN]
            # Points in a run are near each other: for most runs, no other block is near.
            apart = gap_squared(part.min(axis=0), part.max(axis=0), low, high)
            near = np.flatnonzero(others & (apart < reach.max()))
            bounds = bound_squared(part[:, None], low[near], high[near])
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
                found = search.squared(points[rows], threads=self._threads)
                squared[numbers[rows]] = np.minimum(squared[numbers[rows]], found)

    def _bounds(self, points: Floats, blocks: Ints) -> Floats:
        low, high = self._boxes
        return bound_squared(points, low[blocks], high[blocks])


def _search(points: Floats) -> NeighbourSearch:
    return NeighbourSearch(gather(points, morton_order(points)))


def _stacked_boxes(blocks: list[Block]) -> tuple[Floats, Floats]:
    low = [block.low for block in blocks]
    high = [block.high for block in blocks]
    return np.reshape(low, (-1, 3)), np.reshape(high, (-1, 3))

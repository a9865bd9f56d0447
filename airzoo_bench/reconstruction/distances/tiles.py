"""Distances of the points of one tile: a task that reads blocks of two spilled clouds.

Points of a tile are compared with the other cloud's points of the same tile, its home; what this
finds bounds their distances. Points whose bounds reach into the boxes of other blocks are first
compared with a sample of the whole other cloud, which tightens bounds of points that are alone in
their tile, and where they still reach, against those points of these blocks that can be nearer. No
halo is guessed, and far points cost no more than the blocks that their bounds reach. The least over
parts of a cloud of the least in each part is the least of all, so the distances are those of
`neighbours`, to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from hashlib import sha256
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.reconstruction.distances.boxes import (
    bound_squared,
    gap_squared,
    gather,
    morton_order,
)
from airzoo_bench.reconstruction.distances.neighbours import NeighbourSearch
from airzoo_bench.reconstruction.distances.spill import SpilledCloud

__all__ = ["Side", "Sides", "Tile", "tile_distances", "tiles_of"]

_RUN = 1 << 10
_PART = 1 << 5  # of a run
_PAIRS = 1 << 21
_HALO = 1 << 18

_Bounds = tuple[Floats, Floats, Floats]


@dataclass(frozen=True)
class Tile:
    """What one task is about: blocks of two clouds, either of which may be an empty range.

    Attributes
    ----------
    blocks : (range, range)
        Of each cloud, those whose distances are asked for.
    homes : (range, range)
        Of the other cloud, those that each of these are first compared with.
    cut : str
        Digest of how both clouds are cut: results of tiles belong together where it is the same.
    """

    blocks: tuple[range, range]
    homes: tuple[range, range]
    cut: str


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two clouds, as all tasks share it.

    Attributes
    ----------
    cloud : SpilledCloud
    sample : (S, 3) float64
        Some of its points, at least one, along a Morton curve.
    """

    cloud: SpilledCloud
    sample: Floats


@dataclass(frozen=True, eq=False)
class Sides:
    """Both clouds, and the threads that a task may take."""

    sides: tuple[Side, Side]
    jobs: int


def tiles_of(clouds: tuple[SpilledCloud, SpilledCloud], cells: int, most: int) -> list[Tile]:
    """Group blocks by tiles of so many cells, and split tiles of far more than `most` points."""
    last = max(int(cloud.cells[-1]) for cloud in clouds)
    digest = sha256(b"".join(cloud.runs.tobytes() for cloud in clouds))
    digest.update(b"".join(cloud.low.tobytes() + cloud.high.tobytes() for cloud in clouds))
    tiles = []
    for first in range(0, last + 1, cells):
        parts = [_parts(cloud, first, first + cells, most) for cloud in clouds]
        for place in range(max(map(len, parts))):
            own = [part[place] if place < len(part) else range(0) for part in parts]
            near = [part[min(place, len(part) - 1)] if part else range(0) for part in parts]
            tiles.append(Tile((own[0], own[1]), (near[1], near[0]), digest.hexdigest()))
    return tiles


def _parts(cloud: SpilledCloud, first: int, stop: int, most: int) -> list[range]:
    """Blocks of the cells from `first` to before `stop`, in ranges of about `most` points."""
    begin, end = np.searchsorted(cloud.cells, (first, stop)).tolist()
    before = np.cumsum(cloud.counts[begin:end]) - cloud.counts[begin:end]
    cuts = np.flatnonzero(np.diff(before // (2 * most), prepend=-1)).tolist()
    return [range(begin + a, begin + b) for a, b in pairwise([*cuts, end - begin])]


def tile_distances(shared: Sides, tile: Tile) -> dict[str, NDArray[Any]]:
    """Squared distances of a tile's points to the other cloud."""

    @cache
    def read(which: int, blocks: range) -> tuple[Floats, Ints]:
        points, numbers = shared.sides[which].cloud.read(blocks)
        order = morton_order(points)
        return gather(points, order), numbers[order]

    found: dict[str, NDArray[Any]] = {}
    for which, (blocks, home) in enumerate(zip(tile.blocks, tile.homes, strict=True)):
        points, numbers = read(which, blocks)
        others = _Others(shared.sides[1 - which], shared.jobs)
        at_home = NeighbourSearch(read(1 - which, home)[0]) if home else None
        found[f"numbers_{which}"] = numbers
        found[f"squared_{which}"] = others.squared(points, home, at_home)
    return found


class _Others:
    """The cloud whose points are the neighbours."""

    def __init__(self, side: Side, jobs: int) -> None:
        self._cloud, self._sample, self._jobs = side.cloud, side.sample, jobs

    def squared(self, points: Floats, home: range, at_home: NeighbourSearch | None) -> Floats:
        """Squared distances (N,) of points (N, 3) in Morton order; `home` are blocks of this."""
        if not len(points):
            return np.zeros(0)
        found = (at_home or NeighbourSearch(self._sample)).squared(points, jobs=self._jobs)
        if at_home is not None:
            lone = _Reach(points, found, self._cloud, home).lone()
            self._improve(points, found, lone, self._sample)
        self._search_halo(points, found, _Reach(points, found, self._cloud, home))
        return found

    def _search_halo(self, points: Floats, found: Floats, reach: _Reach) -> None:
        halo: list[Floats] = []
        rows: list[Ints] = []
        held = 0
        for block in reach.blocks:
            rows.append(reach.waiting(block))
            halo.append(self._cropped(block, points[rows[-1]], found[rows[-1]]))
            held += len(rows[-1]) + len(halo[-1])
            if held and (held > _HALO or block == reach.blocks[-1]):
                near, waiting = np.concatenate(halo), np.unique(np.concatenate(rows))
                self._improve(points, found, waiting, near[morton_order(near)])
                halo, rows, held = [], [], 0

    def _cropped(self, block: int, points: Floats, found: Floats) -> Floats:
        """Return the points of a block that may be nearer to some of these than what is found."""
        if not len(points):
            return np.zeros((0, 3))
        there, _ = self._cloud.read(range(block, block + 1))
        bounds = bound_squared(there, points.min(axis=0), points.max(axis=0))
        near: Floats = there[bounds < found.max()]
        return near

    def _improve(self, points: Floats, found: Floats, rows: Ints, others: Floats) -> None:
        """Lower what is found for some rows to their distances to others, in Morton order."""
        if len(rows) and len(others):
            squared = NeighbourSearch(others).squared(points[rows], jobs=self._jobs)
            found[rows] = np.minimum(found[rows], squared)


class _Reach:
    """Which blocks, but those at home, points may have a nearer neighbour in.

    `found` (N,) is looked at anew whenever it is asked: it falls while blocks are searched.
    """

    def __init__(self, points: Floats, found: Floats, cloud: SpilledCloud, home: range) -> None:
        self._points, self._found, self._low, self._high = points, found, cloud.low, cloud.high
        # Points in a run are near each other: for most runs, no other block is near.
        self._parts = _bounds((points, points, found), _PART)
        low, high, most = _bounds(self._parts, _RUN // _PART)
        blocks = self._candidates(low.min(axis=0), high.max(axis=0), most.max(), home)
        parts = []
        for start in range(0, len(most), step := max(1, _PAIRS // max(len(blocks), 1))):
            part = slice(start, start + step)
            apart = gap_squared(low[part, None], high[part, None], *self._boxes(blocks))
            run, column = np.nonzero(apart < most[part, None])
            parts.append((run + start, blocks[column], apart[run, column]))
        runs, near, apart = map(np.concatenate, zip(*parts, strict=True))
        order = np.argsort(near, kind="stable")
        self._runs, self._near, self._apart = runs[order], near[order], apart[order]

    def _candidates(self, low: Floats, high: Floats, most: float, home: range) -> Ints:
        near = gap_squared(low, high, self._low, self._high) < most
        near[home.start : home.stop] = False
        return np.flatnonzero(near)

    def _boxes(self, blocks: Ints | int) -> tuple[Floats, Floats]:
        return self._low[blocks], self._high[blocks]

    @cached_property
    def blocks(self) -> list[int]:
        """Blocks that may be reached, the nearest first."""
        least = np.full(len(self._low), np.inf)
        np.minimum.at(least, self._near, self._apart)
        blocks = np.unique(self._near)
        nearest_first: list[int] = blocks[np.argsort(least[blocks], kind="stable")].tolist()
        return nearest_first

    def waiting(self, block: int) -> Ints:
        """Rows of the points that reach into a block."""
        begin, end = np.searchsorted(self._near, (block, block + 1))
        low, high, most = self._parts
        parts = _spread(self._runs[begin:end], _RUN // _PART, len(most))
        apart = gap_squared(low[parts], high[parts], *self._boxes(block))
        rows = _spread(parts[apart < most[parts]], _PART, len(self._points))
        return rows[bound_squared(self._points[rows], *self._boxes(block)) < self._found[rows]]

    def lone(self) -> Ints:
        """Rows of the points that reach into the block that is nearest to their run."""
        order = np.lexsort((self._apart, self._runs))
        runs, first = np.unique(self._runs[order], return_index=True)
        rows = _spread(runs, _RUN, len(self._points))
        nearest = np.zeros(len(self._points) // _RUN + 1, np.int64)
        nearest[runs] = self._near[order][first]
        low, high = self._boxes(nearest[rows // _RUN])
        return rows[bound_squared(self._points[rows], low, high) < self._found[rows]]


def _bounds(values: _Bounds, size: int) -> _Bounds:
    """Low and high corner and the greatest of what is found, of every so many rows."""
    low, high, most = values
    starts = np.arange(0, len(most), size)
    return (
        np.minimum.reduceat(low, starts),
        np.maximum.reduceat(high, starts),
        np.maximum.reduceat(most, starts),
    )


def _spread(runs: Ints, size: int, count: int) -> Ints:
    """Rows of runs of so many rows each, of `count` rows."""
    rows = (runs[:, None] * size + np.arange(size)).ravel()
    return rows[rows < count]

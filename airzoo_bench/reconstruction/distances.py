"""Exact distances between two clouds, in memory where they fit, in blocks on disk where not.

In blocks, both clouds are written to disk by the cells of one k-d tree of a sample of them: as many
cells where there are many points, and few for what lies far away. The points of a cell are compared
with the other cloud's points of the same cell, which bounds their distances; those whose bounds
reach into the boxes of other cells are compared with the points there that may be nearer. No halo
is guessed, and far points cost no more than the cells that their bounds reach. The distances are
those of `neighbours`, to the last bit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.files import temporary_folder
from airzoo_bench.core.progress import Progress, shown, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.cloud_sources import (
    EvenSample,
    Sampled,
    concatenated,
    finite_pieces,
)
from airzoo_bench.reconstruction.neighbours import (
    NeighbourSearch,
    gather,
    morton_order,
    mutual_distances,
)

__all__ = ["CloudDistances", "block_distances", "bound_squared", "cloud_distances"]

_SAMPLE = 1 << 15
_PIECE = 1 << 18
_RUN = 1 << 8
_HALO = 1 << 18
_CELLS, _DEEPEST = 8, 14  # cells of a block, and the deepest tree that 16 bits number
_SPREAD = 0.05, 0.5, 0.95
_BYTES_ON_DISK = 48  # of a point: as it came, and by cells


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
    """Exact nearest distances between two clouds, both ways."""
    if max(prediction.count, truth.count) <= block_points:
        predicted, true = (
            concatenated(finite_pieces(cloud, block_points)) for cloud in (prediction, truth)
        )
        _require_truth(len(true) > 0)
        measure = partial(mutual_distances, predicted, true, jobs=jobs)
        return CloudDistances(*shown(measure, "distances", progress))
    return block_distances(
        prediction, truth, block_points=block_points, jobs=jobs, progress=progress
    )


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
    """Nearest distances both ways, in memory that holds them and some cells."""
    clouds = prediction, truth
    samples = [_sample(cloud) for cloud in clouds]
    _require_truth(len(samples[1]) > 0)
    if not len(samples[0]):
        points = sum(map(len, finite_pieces(truth, _PIECE)))
        return CloudDistances(np.zeros(0), np.full(points, np.inf))
    most = max(cloud.count for cloud in clouds)
    planes = _Planes.through(np.concatenate(samples), _CELLS * -(-most // block_points))
    with _scratch_folder() as folder:
        sides = [
            _Side.write(cloud, folder / name, planes, sample)
            for cloud, name, sample in zip(clouds, ("prediction", "truth"), samples, strict=True)
        ]
        found = [np.empty(len(side.order)) for side in sides]
        blocks = [range(first, first + _CELLS) for first in range(0, planes.cells, _CELLS)]
        for block in progress(blocks, "blocks", len(blocks)):
            for which, side in enumerate(sides):
                squared = _block_squared(side, sides[1 - which], block, jobs)
                found[which][side.order[side.rows_of(block)]] = squared
    to_truth, to_prediction = (np.sqrt(squared, out=squared) for squared in found)
    return CloudDistances(to_truth, to_prediction)


def _sample(cloud: CloudSource) -> Floats:
    """Return some finite points of all of a cloud, at least one where it has any."""
    if isinstance(cloud, Sampled) and len(cloud.sample):
        some = cloud.sample
    else:
        sample = EvenSample(cloud.count, _SAMPLE)
        for piece in finite_pieces(cloud, _PIECE):
            sample.add(piece)
        some = sample.points()
    return some[:: max(1, len(some) // _SAMPLE)]


@dataclass(frozen=True, eq=False)
class _Planes:
    """A complete binary tree of planes; node n has the children 2n + 1 and 2n + 2.

    Attributes
    ----------
    axes : (2^depth - 1,) int64
    cuts : (2^depth - 1,) float64
        Points at the cut or above belong to the second child.
    """

    axes: Ints
    cuts: Floats

    @classmethod
    def through(cls, sample: Floats, count: int) -> _Planes:
        """Cut space into cells with about as many points of a sample (S, 3) each."""
        depth = min(max((count - 1).bit_length(), _CELLS.bit_length() - 1), _DEEPEST)
        axes, cuts = np.zeros(2**depth - 1, np.int64), np.zeros(2**depth - 1)
        parts = [sample]
        for node in range(len(axes)):
            part = parts[node]
            low, middle, high = np.quantile(part if len(part) else sample, _SPREAD, axis=0)
            axis = int(np.argmax(high - low))
            axes[node], cuts[node] = axis, middle[axis]
            above = part[:, axis] >= middle[axis]
            parts += [part[~above], part[above]]
        return cls(axes, cuts)

    @property
    def cells(self) -> int:
        """How many cells there are, 2^depth."""
        return len(self.axes) + 1

    def cells_of(self, points: Floats) -> NDArray[np.uint16]:
        """Cell (N,) of each of points (N, 3)."""
        node, rows = np.zeros(len(points), np.int64), np.arange(len(points))
        for _ in range(self.cells.bit_length() - 1):
            node = 2 * node + 1 + (points[rows, self.axes[node]] >= self.cuts[node])
        return (node - len(self.axes)).astype(np.uint16)


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two clouds on disk, N points in C cells.

    Attributes
    ----------
    order : (N,) int64
        The row in the source of each point on disk.
    starts : (C + 1,) int64
        Where the points of a cell begin.
    low, high : (C, 3) float64
        The smallest box that holds a cell's points; where there are none, no box at all.
    sample : NeighbourSearch
        Of some points of the whole cloud.
    """

    path: Path
    order: Ints
    starts: Ints
    low: Floats
    high: Floats
    sample: NeighbourSearch

    @classmethod
    def write(cls, cloud: CloudSource, path: Path, planes: _Planes, sample: Floats) -> _Side:
        """Write the finite points of a cloud by their cells."""
        raw, cells = path.with_suffix(".raw"), [np.zeros(0, np.uint16)]
        with _disk_faults():
            stream = raw.open("wb")
        with stream:
            for piece in finite_pieces(cloud, _PIECE):
                cells.append(planes.cells_of(piece))
                with _disk_faults():
                    stream.write(np.ascontiguousarray(piece).data)
            with _disk_faults():
                stream.flush()
        order = np.argsort(np.concatenate(cells), kind="stable")  # by radix, which 16 bits allow
        counts = sum(np.bincount(some, minlength=planes.cells) for some in cells)
        starts = np.append(0, np.cumsum(counts))
        low, high = np.full((planes.cells, 3), np.inf), np.full((planes.cells, 3), -np.inf)
        points = np.memmap(raw, np.float64, "r", shape=(len(order), 3))
        with _disk_faults(), path.open("wb") as stream:
            for cell, (first, stop) in enumerate(pairwise(starts)):
                own = points[order[first:stop]]
                low[cell] = own.min(axis=0, initial=np.inf)
                high[cell] = own.max(axis=0, initial=-np.inf)
                stream.write(np.ascontiguousarray(own).data)
        del points
        raw.unlink()
        search = NeighbourSearch(gather(sample, morton_order(sample)))
        return cls(path, order, starts, low, high, search)

    def rows_of(self, cells: range) -> slice:
        """Return where the points of consecutive cells lie on disk."""
        return slice(int(self.starts[cells.start]), int(self.starts[cells.stop]))

    def read(self, cells: range) -> Floats:
        """Read the points (n, 3) of consecutive cells."""
        rows = self.rows_of(cells)
        count = 3 * (rows.stop - rows.start)
        return np.fromfile(self.path, np.float64, count, offset=24 * rows.start).reshape(-1, 3)


def _block_squared(side: _Side, others: _Side, block: range, jobs: int) -> Floats:
    """Squared distance (n,) of each point of a block to the nearest of the other cloud."""
    points = side.read(block)
    if not len(points):
        return np.zeros(0)
    order = morton_order(points)
    home = _search(others.read(block)) or others.sample
    reach = _Reach(gather(points, order), home, jobs)
    _improve_beyond(reach, others, block)
    squared = np.empty(len(points))
    squared[order] = reach.squared
    return squared


def _improve_beyond(reach: _Reach, others: _Side, home: range) -> None:
    """Compare points with those of all cells but their own that they may have a neighbour in."""
    low, high = reach.points.min(axis=0), reach.points.max(axis=0)
    apart = _gap_squared(low, high, others.low, others.high)
    apart[home.start : home.stop] = np.inf
    near = np.flatnonzero(apart < reach.squared.max())
    near = near[np.argsort(apart[near], kind="stable")]
    lone = np.zeros(len(reach.points), np.bool_)
    for cell in near.tolist():
        lone[reach.into(others.low[cell], others.high[cell])] = True
    reach.improve(np.flatnonzero(lone), others.sample)
    rows, halo = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for cell in near.tolist():
        reached = reach.into(others.low[cell], others.high[cell])
        if len(reached):
            there = others.read(range(cell, cell + 1))
            rows.append(reached)
            halo.append(there[reach.may_be_nearer(reached, there)])
        if sum(map(len, (*rows, *halo))) > _HALO or cell == near[-1]:
            search = _search(np.concatenate(halo))
            if search is not None:
                reach.improve(np.unique(np.concatenate(rows)), search)
            del rows[1:], halo[1:]


def _search(points: Floats) -> NeighbourSearch | None:
    return NeighbourSearch(gather(points, morton_order(points))) if len(points) else None


class _Reach:
    """Points (n, 3) along a Morton curve and their least squared distances (n,) so far."""

    def __init__(self, points: Floats, first: NeighbourSearch, jobs: int) -> None:
        self.points, self._jobs = points, jobs
        self.squared = first.squared(points, jobs=jobs)
        # Points in a run are near each other: for most runs, no other cell is near.
        self._starts = np.arange(0, len(points), _RUN)
        self._low = np.minimum.reduceat(points, self._starts)
        self._high = np.maximum.reduceat(points, self._starts)

    def into(self, low: Floats, high: Floats) -> Ints:
        """Rows of the points that may have a nearer neighbour in a box."""
        most = np.maximum.reduceat(self.squared, self._starts)
        runs = self._starts[_gap_squared(self._low, self._high, low, high) < most]
        rows = (runs[:, None] + np.arange(_RUN)).ravel()
        rows = rows[rows < len(self.points)]
        reached: Ints = rows[bound_squared(self.points[rows], low, high) < self.squared[rows]]
        return reached

    def may_be_nearer(self, rows: Ints, others: Floats) -> Bools:
        """Whether each of other points may be nearer to some of the rows than what is found."""
        low, high = self.points[rows].min(axis=0), self.points[rows].max(axis=0)
        nearer: Bools = bound_squared(others, low, high) < self.squared[rows].max()
        return nearer

    def improve(self, rows: Ints, search: NeighbourSearch) -> None:
        """Lower what is found for some rows to their distances to other points."""
        if len(rows):
            squared = search.squared(self.points[rows], jobs=self._jobs)
            self.squared[rows] = np.minimum(self.squared[rows], squared)


def bound_squared(points: Floats, low: Floats, high: Floats) -> Floats:
    """Lower bound (...) of the squared distance from points (..., 3) to all that a box can hold.

    It is never above such a distance, not even by a rounding: subtraction, multiplication and
    addition of floating-point numbers are monotone, and a bound takes the steps of a distance.
    """
    return _gap_squared(points, points, low, high)


def _gap_squared(low: Floats, high: Floats, others_low: Floats, others_high: Floats) -> Floats:
    """Lower bound (...) of the squared distance from all in one box to all in another."""
    gap = np.maximum(np.maximum(others_low - high, low - others_high), 0.0)
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = np.moveaxis(gap, -1, 0)
        total: Floats = (x * x + y * y) + z * z
    return total


@contextmanager
def _scratch_folder() -> Iterator[Path]:
    """Make a folder for clouds where the system keeps temporary files, and remove it at the end."""
    with ExitStack() as stack:
        with _disk_faults():
            parent = Path(tempfile.gettempdir())
            folder = stack.enter_context(temporary_folder(parent, "airzoo-clouds"))
        yield folder


@contextmanager
def _disk_faults() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UserError(
            f"clouds cannot be kept on disk: {error.strerror or error}",
            where=tempfile.gettempdir(),
            expected=f"{_BYTES_ON_DISK} bytes of room for each point of both clouds",
            fix="make room, or set TMPDIR (TEMP on Windows) to another folder",
        ) from error

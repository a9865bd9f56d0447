"""Clouds on disk, cut into cells of about as many points each, for tasks to read by path.

Cells are those of a k-d tree of a sample of the points: as many cells where there are many points,
and few for what lies far away. A cloud is written in parts, a file each, of rows of 32 bytes: a
point, and its number within the part. What a cell holds are runs of rows, and blocks are runs that
are taken into memory together.
"""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.temporaries import temporary_file, temporary_folder
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["Cells", "Runs", "SpilledCloud", "cells_of", "spill_folder", "spilled", "write_part"]

_ROW_BYTES = 32
_SETTING = "TMPDIR" if os.name == "posix" else "TEMP"
_DEEPEST = 14
_CHUNK = 1 << 15

Runs = dict[str, NDArray[Any]]
"""R runs of one part: their cell, start and count (R,), low and high (R, 3)."""


@dataclass(frozen=True, eq=False)
class Cells:
    """A complete binary tree of planes; node n has the children 2n + 1 and 2n + 2.

    Attributes
    ----------
    axes : (2^depth - 1,) int64
    cuts : (2^depth - 1,) float64
        Points at the cut or above belong to the second child.
    """

    axes: Ints
    cuts: Floats

    @property
    def count(self) -> int:
        """How many cells there are, 2^depth."""
        return len(self.axes) + 1

    def of(self, points: Floats) -> Ints:
        """Cell (N,) of each of points (N, 3)."""
        cells = np.empty(len(points), dtype=np.int64)
        for start in range(0, len(points), _CHUNK):
            part = np.ascontiguousarray(points[start : start + _CHUNK])
            node, rows = np.zeros(len(part), dtype=np.int64), np.arange(0, part.size, 3)
            for _ in range(self.count.bit_length() - 1):
                above = part.ravel().take(rows + self.axes.take(node)) >= self.cuts.take(node)
                node = 2 * node + 1 + above
            cells[start : start + len(part)] = node - len(self.axes)
        return cells


def cells_of(sample: Floats, count: int) -> Cells:
    """Cut space into cells with about as many points of a sample (S, 3) each."""
    depth = min(max(count - 1, 0).bit_length(), _DEEPEST)
    axes, cuts = np.zeros(2**depth - 1, dtype=np.int64), np.zeros(2**depth - 1)
    parts = [sample]
    for node in range(len(axes)):
        part = parts[node]
        low, middle, high = np.quantile(part if len(part) else sample, (0.05, 0.5, 0.95), axis=0)
        axis = int(np.argmax(high - low))
        axes[node], cuts[node] = axis, middle[axis]
        above = part[:, axis] >= middle[axis]
        parts += [part[~above], part[above]]
    return Cells(axes, cuts)


@contextmanager
def spill_folder() -> Iterator[Path]:
    """Make a folder for clouds where the system keeps temporary files, and remove it at the end."""
    with ExitStack() as stack:
        with _disk_faults():
            parent = Path(tempfile.gettempdir())
            folder = stack.enter_context(temporary_folder(parent, "airzoo-clouds"))
        yield folder


def write_part(path: Path, pieces: Iterable[Floats], cells: Cells, *, most: int) -> Runs:
    """Write one part of a cloud by cells; its file is there whole, or not at all."""
    parts = [_runs(np.zeros((0, 4)), np.zeros(0, np.int64), most, 0)]
    done = 0
    with ExitStack() as stack:
        with _disk_faults():
            handle, temporary = stack.enter_context(temporary_file(path))
            stream = stack.enter_context(os.fdopen(handle, "wb"))
        for piece in pieces:
            rows, cell = _by_cell(piece, cells, done)
            with _disk_faults():
                stream.write(rows.data)
            parts.append(_runs(rows, cell, most, done))
            done += len(piece)
        with _disk_faults():
            stream.flush()
            temporary.replace(path)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _by_cell(points: Floats, cells: Cells, done: int) -> tuple[Floats, Ints]:
    """Return rows (N, 4) of points (N, 3) in the order of their cells, and these cells (N,)."""
    cell = cells.of(points)
    order = np.argsort(cell.astype(np.uint16), kind="stable")  # by radix, which 16 bits allow
    rows = np.empty((len(points), 4))
    rows[:, :3] = points.take(order, axis=0)
    rows.view(np.int64)[:, 3] = order + done
    return rows, cell[order]


def _runs(rows: Floats, cell: Ints, most: int, done: int) -> Runs:
    held = np.bincount(cell)
    starts = np.flatnonzero((np.arange(len(cell)) - (np.cumsum(held) - held)[cell]) % most == 0)
    low, high = (
        corner.reduceat(rows[:, :3], starts) if len(starts) else np.zeros((0, 3))
        for corner in (np.minimum, np.maximum)
    )
    counts = np.diff(starts, append=len(cell))
    return {"cell": cell[starts], "start": starts + done, "count": counts, "low": low, "high": high}


@dataclass(frozen=True, eq=False)
class SpilledCloud:
    """One cloud on disk, B blocks of R runs; `spilled` puts it together.

    Attributes
    ----------
    paths : tuple of Path
        Its parts.
    firsts : (P,) int64
        Number of the first point of each part.
    runs : (R, 3) int64
        Part, first row and rows of each run, block by block.
    begins : (B + 1,) int64
        Where the runs of a block begin.
    cells, counts : (B,) int64
        Which cell a block is of, ascending, and how many points it has.
    low, high : (B, 3) float64
        The smallest box that holds them.
    """

    paths: tuple[Path, ...]
    firsts: Ints
    runs: Ints
    begins: Ints
    cells: Ints
    counts: Ints
    low: Floats
    high: Floats

    @property
    def count(self) -> int:
        """How many points it has."""
        return int(self.counts.sum())

    def read(self, blocks: range) -> tuple[Floats, Ints]:
        """Return points (N, 3) of consecutive blocks, and their numbers (N,)."""
        runs = self.runs[self.begins[blocks.start] : self.begins[blocks.stop]]
        rows = np.empty((int(runs[:, 2].sum()), 4))
        numbers = rows.view(np.int64)[:, 3]
        stop = 0
        for part, group in groupby(runs.tolist(), lambda run: run[0]):
            with _seen(self.paths[part]), self.paths[part].open("rb", buffering=0) as stream:
                for _, first, count in group:
                    start, stop = stop, stop + count
                    stream.seek(first * _ROW_BYTES)
                    _fill(stream, rows[start:stop])
                    numbers[start:stop] += self.firsts[part]
        return np.ascontiguousarray(rows[:, :3]), numbers.copy()


def spilled(paths: Sequence[Path], parts: Sequence[Runs], *, most: int) -> SpilledCloud:
    """Put the parts of a cloud together, in their order; blocks hold less than twice `most` points.

    Their runs hold at most `most`.
    """
    part = np.repeat(np.arange(len(parts)), [len(runs["cell"]) for runs in parts])
    joined = {name: np.concatenate([runs[name] for runs in parts]) for name in parts[0]}
    totals = np.array([runs["count"].sum() for runs in parts], np.int64)
    order = np.argsort(joined["cell"], kind="stable")
    cell, count = joined["cell"][order], joined["count"][order]
    before = np.cumsum(count) - count
    block = (before - before[np.searchsorted(cell, cell)]) // most
    changes = (np.diff(cell, prepend=-1) != 0) | (np.diff(block, prepend=-1) != 0)
    begins = np.flatnonzero(changes)
    return SpilledCloud(
        tuple(paths),
        np.asarray(np.cumsum(totals) - totals),
        np.stack((part[order], joined["start"][order], count), axis=1),
        np.append(begins, len(cell)),
        cell[begins],
        np.add.reduceat(count, begins),
        np.minimum.reduceat(joined["low"][order], begins),
        np.maximum.reduceat(joined["high"][order], begins),
    )


def _fill(stream: IO[bytes], rows: Floats) -> None:
    view = memoryview(rows.data).cast("B")
    while view:
        got = stream.readinto(view)  # type: ignore[attr-defined]
        if not got:
            raise OSError(f"{stream.name} ends before its points do")
        view = view[got:]


@contextmanager
def _seen(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise UserError(
            f"a worker on {socket.gethostname()} does not see the clouds of this run",
            where=path,
            expected="temporary files in a folder that all workers share",
            fix=f"set {_SETTING} to such a folder where the run is started",
        ) from error


@contextmanager
def _disk_faults() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UserError(
            f"clouds cannot be kept on disk: {error.strerror or error}",
            where=tempfile.gettempdir(),
            expected=f"{_ROW_BYTES} bytes of room for each point of both clouds",
            fix=f"make room, or set {_SETTING} to another folder",
        ) from error

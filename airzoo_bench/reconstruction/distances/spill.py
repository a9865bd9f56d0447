"""Clouds on disk, cut into cells of about as many points each.

Cells are those of a k-d tree of a sample of the points: as many cells where there are many points,
and few for what lies far away.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

import numpy as np

from airzoo_bench.core.errors import UserError
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["Block", "Cells", "Spill", "cells_of", "spilled"]

_ROW_BYTES = 32
_DEEPEST = 12


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
        node = np.zeros(len(points), dtype=np.int64)
        rows = np.arange(len(points))
        for _ in range(self.count.bit_length() - 1):
            above = points[rows, self.axes[node]] >= self.cuts[node]
            node = 2 * node + 1 + above
        return node - len(self.axes)


def cells_of(sample: Floats, count: int) -> Cells:
    """Cut space into cells with about as many points of a sample (S, 3) each.

    There are at least `count` cells: a power of two, at most 4,096.
    """
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


@dataclass(frozen=True, eq=False)
class _Run:
    """Some points of one cell that lie together in the file."""

    offset: int
    count: int
    low: Floats
    high: Floats


@dataclass(frozen=True, eq=False)
class Block:
    """Points of one cell, as many as are taken into memory at a time.

    Attributes
    ----------
    runs : tuple
        Where they are in the file.
    count : int
    low, high : (3,) float64
        The smallest box that holds them.
    """

    runs: tuple[_Run, ...]
    count: int
    low: Floats
    high: Floats


class Spill:
    """One cloud on disk; `spilled` makes and removes it.

    Attributes
    ----------
    count : int
        Points in all.
    """

    def __init__(self, stream: IO[bytes], cells: Cells, *, most: int) -> None:
        self._stream, self._cells, self._most = stream, cells, most
        self._runs: list[list[_Run]] = [[] for _ in range(cells.count)]
        self.count = 0

    @property
    def cell_count(self) -> int:
        """How many cells there are."""
        return self._cells.count

    def add(self, points: Floats) -> None:
        """Write points (N, 3), which are numbered on from those before."""
        cell = self._cells.of(points)
        order = np.argsort(cell, kind="stable")
        rows = np.empty((len(points), 4))
        rows[:, :3] = points[order]
        rows.view(np.int64)[:, 3] = order + self.count
        self.count += len(points)
        ends = np.searchsorted(cell[order], np.arange(self._cells.count + 1))
        for which in np.flatnonzero(np.diff(ends)).tolist():
            self._append(which, rows[ends[which] : ends[which + 1]])

    def _append(self, cell: int, rows: Floats) -> None:
        with _disk_faults():
            offset = self._stream.tell()
            self._stream.write(rows.data)
        low, high = rows[:, :3].min(axis=0), rows[:, :3].max(axis=0)
        self._runs[cell].append(_Run(offset, len(rows), low, high))

    def blocks(self, cell: int) -> list[Block]:
        """Return the points of a cell in blocks: one, unless the cell has far more than others."""
        groups: list[list[_Run]] = []
        room = 0
        for run in self._runs[cell]:
            if not groups or run.count > room:
                groups.append([])
                room = self._most
            groups[-1].append(run)
            room -= run.count
        return [_block(group) for group in groups]

    def read(self, block: Block) -> tuple[Floats, Ints]:
        """Return points (N, 3) of a block, and their numbers (N,)."""
        rows = np.empty((block.count, 4))
        start = 0
        for run in block.runs:
            stop = start + run.count
            with _disk_faults():
                self._stream.seek(run.offset)
                content = self._stream.read(run.count * _ROW_BYTES)
            rows[start:stop] = np.frombuffer(content).reshape(-1, 4)
            start = stop
        return np.ascontiguousarray(rows[:, :3]), rows.view(np.int64)[:, 3].copy()


@contextmanager
def spilled(pieces: Iterable[Floats], cells: Cells, *, most: int) -> Iterator[Spill]:
    """Write a cloud to a temporary file where the system keeps such files, cell by cell.

    The file has no name, or loses it at once where the system allows that: it is gone with the
    process, however that ends. Blocks hold at most `most` points, and so must the pieces.

    Raises
    ------
    UserError
        The disk is full or cannot be written to.
    """
    with _disk_faults():
        stream = tempfile.TemporaryFile()  # noqa: SIM115
    with stream:
        spill = Spill(stream, cells, most=most)
        for piece in pieces:
            spill.add(piece)
        yield spill


@contextmanager
def _disk_faults() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        setting = "TMPDIR" if os.name == "posix" else "TEMP"
        raise UserError(
            f"clouds cannot be kept on disk: {error.strerror or error}",
            where=tempfile.gettempdir(),
            expected=f"{_ROW_BYTES} bytes of room for each point of both clouds",
            fix=f"make room, or set {setting} to another folder",
        ) from error


def _block(runs: list[_Run]) -> Block:
    return Block(
        tuple(runs),
        sum(run.count for run in runs),
        np.min([run.low for run in runs], axis=0),
        np.max([run.high for run in runs], axis=0),
    )

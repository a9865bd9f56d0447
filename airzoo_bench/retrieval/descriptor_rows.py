"""Descriptors by runs of rows: out of memory, or straight from the files that hold them."""

from __future__ import annotations

import mmap
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.arrays import as_floating
from airzoo_bench.geometry.arrays import Ints

__all__ = ["RowParts", "RowSource", "Rows", "Run", "as_float32", "rows_of"]

Run = tuple[int, int]
"""The first of some rows, and the one after the last."""

_NEAR = 1024  # rows that are read as one where some of them are asked for


class Rows(ABC):
    """Rows (n, D) of floating point that lie somewhere; where they lie in files, small to send.

    Attributes
    ----------
    shape : tuple of int
        Rows and dimensions.
    dtype : dtype
    by_reference : bool
        Whether it says where the rows lie, and holds none of them.
    """

    shape: tuple[int, int]
    dtype: np.dtype[Any]

    @property
    def ndim(self) -> int:
        """2, as of an array."""
        return 2

    @property
    def itemsize(self) -> int:
        """Bytes of a number."""
        return self.dtype.itemsize

    @property
    def by_reference(self) -> bool:
        """See the class."""
        return True

    def __len__(self) -> int:
        return self.shape[0]

    @abstractmethod
    def part(self, start: int, stop: int) -> Rows:
        """Return some of the rows, which are not read yet."""

    @abstractmethod
    def runs(self, bounds: Iterable[Run]) -> Iterator[NDArray[Any]]:
        """Read runs of at least one row that follow each other, without overlap."""

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Read one run."""
        return next(self.runs([(start, stop)])) if start < stop else np.empty((0, *self.shape[1:]))

    def blocks(self, step: int) -> Iterator[tuple[int, NDArray[Any]]]:
        """Give (first row, rows) in order; the next block is read meanwhile."""
        starts = range(0, len(self), step)
        runs = self.runs((start, min(start + step, len(self))) for start in starts)
        with ThreadPoolExecutor(1) as reader:
            ahead = [reader.submit(next, runs, None)]
            for start in starts:
                rows = ahead.pop().result()
                ahead.append(reader.submit(next, runs, None))
                assert rows is not None
                yield start, rows

    def take(self, rows: Ints) -> NDArray[Any]:
        """Read rows into memory, in the order that is asked for."""
        order = np.argsort(rows, kind="stable")
        window = rows[order] // _NEAR
        groups = np.split(order, np.flatnonzero(np.diff(window)) + 1) if len(rows) else []
        bounds = [(int(rows[group[0]]), int(rows[group[-1]]) + 1) for group in groups]
        found = np.empty((len(rows), self.shape[1]), self.dtype)
        for group, (start, _), read in zip(groups, bounds, self.runs(bounds), strict=True):
            found[group] = read[rows[group] - start]
        return found


@dataclass(frozen=True, eq=False)
class RowSource(Rows):
    """Rows of an array; those of a memory map are read with plain file reads.

    Pages read through a map count as the process's memory until the kernel takes them back;
    plain reads into a buffer do not.

    Parameters
    ----------
    shape : tuple of int
    dtype : dtype
    array : (n, D) array or None
        The descriptors, where they lie in no file.
    path : Path or None
        The file that holds them row by row, if one does.
    offset : int
        Where in the file, bytes.
    """

    shape: tuple[int, int]
    dtype: np.dtype[Any]
    array: NDArray[Any] | None = None
    path: Path | None = None
    offset: int = 0

    @classmethod
    def of(cls, array: NDArray[Any]) -> RowSource:
        """Wrap an array, and find the place in its file if it is a memory map."""
        plain = np.asarray(array)
        rows, width = plain.shape
        root: Any = array
        while isinstance(root, np.memmap) and isinstance(root.base, np.memmap):
            root = root.base
        mapped = isinstance(root, np.memmap) and isinstance(root.base, mmap.mmap)
        # A copy-on-write map may differ from its file; one of an open file may have no name.
        if not mapped or root.mode == "c" or not root.filename or not plain.flags.c_contiguous:
            return cls((rows, width), plain.dtype, plain)
        # A view inherits the offset of its map, not its own.
        within = plain.ctypes.data - root.ctypes.data
        offset = int(root.offset) + within
        return cls((rows, width), plain.dtype, None, Path(str(root.filename)), offset)

    @property
    def by_reference(self) -> bool:
        """See `Rows`."""
        return self.path is not None

    def part(self, start: int, stop: int) -> RowSource:
        """See `Rows.part`."""
        shape = stop - start, self.shape[1]
        if self.array is not None:
            return RowSource(shape, self.dtype, self.array[start:stop])
        offset = self.offset + start * self.shape[1] * self.itemsize
        return RowSource(shape, self.dtype, None, self.path, offset)

    def runs(self, bounds: Iterable[Run]) -> Iterator[NDArray[Any]]:
        """See `Rows.runs`."""
        buffers: list[NDArray[Any]] = [np.empty((0, self.shape[1]), self.dtype)] * 2
        for turn, (start, stop) in enumerate(bounds):
            if self.array is not None:
                yield self.array[start:stop]
                continue
            if len(buffers[turn % 2]) < stop - start:
                buffers[turn % 2] = np.empty((stop - start, self.shape[1]), self.dtype)
            yield self._read_into(buffers[turn % 2][: stop - start], start)

    def _read_into(self, rows: NDArray[Any], start: int) -> NDArray[Any]:
        assert self.path is not None
        view = memoryview(rows.view(np.uint8).reshape(-1).data)
        with self.path.open("rb", buffering=0) as file:
            file.seek(self.offset + start * self.shape[1] * self.itemsize)
            while len(view):
                got = file.readinto(view)
                if not got:
                    raise PredictionError("the file ends before its descriptors", where=self.path)
                view = view[got:]
        return rows


@dataclass(frozen=True, eq=False)
class RowParts(Rows):
    """Rows of several sources, one after the other, each of which may lie in its own file.

    Parameters
    ----------
    parts : tuple of Rows
        At least one, all of one D.
    """

    parts: tuple[Rows, ...]

    @classmethod
    def of(cls, arrays: Iterable[NDArray[Any]]) -> RowParts:
        """Put arrays together, which may be mapped."""
        return cls(tuple(map(rows_of, arrays)))

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        """See `Rows`."""
        return sum(map(len, self.parts)), self.parts[0].shape[1]

    @property
    def dtype(self) -> np.dtype[Any]:  # type: ignore[override]
        """The least type that holds the numbers of all parts."""
        return np.result_type(*(part.dtype for part in self.parts))

    @property
    def by_reference(self) -> bool:
        """See `Rows`."""
        return all(part.by_reference for part in self.parts)

    def part(self, start: int, stop: int) -> Rows:
        """See `Rows.part`; rows of one source are that source's own."""
        parts = [
            part.part(max(start - first, 0), min(stop - first, len(part)))
            for first, part in self._starts()
            if first < stop and start < first + len(part)
        ]
        parts = parts or [self.parts[0].part(0, 0)]
        return parts[0] if len(parts) == 1 else RowParts(tuple(parts))

    def runs(self, bounds: Iterable[Run]) -> Iterator[NDArray[Any]]:
        """See `Rows.runs`."""
        asked = list(bounds)
        pieces = chain.from_iterable(
            part.runs(_clipped(asked, first, len(part))) for first, part in self._starts()
        )
        for start, stop in asked:
            rows = next(pieces)
            if len(rows) < stop - start:
                found = np.empty((stop - start, self.shape[1]), self.dtype)
                done = 0
                while done < len(found):
                    rows = rows if not done else next(pieces)
                    found[done : done + len(rows)] = rows
                    done += len(rows)
                rows = found
            yield rows.astype(self.dtype, copy=False)

    def _starts(self) -> Iterator[tuple[int, Rows]]:
        start = 0
        for part in self.parts:
            yield start, part
            start += len(part)


def _clipped(bounds: list[Run], first: int, count: int) -> list[Run]:
    """Return what of some runs lies in one part, counted from the part's first row."""
    cut = ((max(start - first, 0), min(stop - first, count)) for start, stop in bounds)
    return [(start, stop) for start, stop in cut if start < stop]


@dataclass(frozen=True, eq=False)
class WholeRows(Rows):
    """Rows of whole numbers or truth values, read as floating point."""

    source: RowSource
    shape: tuple[int, int]
    dtype: np.dtype[Any]

    @classmethod
    def of(cls, source: RowSource) -> WholeRows:
        """Wrap rows."""
        return cls(source, source.shape, as_floating(np.empty(0, source.dtype)).dtype)

    @property
    def by_reference(self) -> bool:
        """See `Rows`."""
        return self.source.by_reference

    def part(self, start: int, stop: int) -> WholeRows:
        """See `Rows.part`."""
        return WholeRows.of(self.source.part(start, stop))

    def runs(self, bounds: Iterable[Run]) -> Iterator[NDArray[Any]]:
        """See `Rows.runs`."""
        return map(as_floating, self.source.runs(bounds))


def rows_of(descriptors: NDArray[Any] | Rows) -> Rows:
    """Return rows of an array, or those that are given."""
    if isinstance(descriptors, Rows):
        return descriptors
    source = RowSource.of(descriptors)
    return source if source.dtype.kind == "f" else WholeRows.of(source)


def as_float32(rows: NDArray[Any]) -> NDArray[np.float32]:
    """Round rows to float32; too large a number becomes infinite."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.ascontiguousarray(rows, dtype=np.float32)

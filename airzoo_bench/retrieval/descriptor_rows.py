"""Descriptors by blocks of rows, out of memory or straight from the file behind a memory map."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError

__all__ = ["RowParts", "RowSource", "as_float32"]


@dataclass(frozen=True)
class RowSource:
    """Rows of an array; those of a memory map are read with plain file reads.

    Pages read through a map count as the process's memory until the kernel takes them back;
    plain reads into a buffer do not.

    Parameters
    ----------
    array : (n, D) array
        The descriptors.
    path : Path or None
        The file that holds them row by row, if one does.
    offset : int
        Where in the file, bytes.
    """

    array: NDArray[Any]
    path: Path | None = None
    offset: int = 0

    @classmethod
    def of(cls, array: NDArray[Any]) -> RowSource:
        """Wrap an array, and find the place in its file if it is a memory map."""
        plain = np.asarray(array)
        root: Any = array
        while isinstance(root, np.memmap) and isinstance(root.base, np.memmap):
            root = root.base
        mapped = isinstance(root, np.memmap) and isinstance(root.base, mmap.mmap)
        # A copy-on-write map may differ from its file; one of an open file may have no name.
        if not mapped or root.mode == "c" or not root.filename or not plain.flags.c_contiguous:
            return cls(plain)
        # A view inherits the offset of its map, not its own.
        within = plain.ctypes.data - root.ctypes.data
        return cls(plain, Path(str(root.filename)), int(root.offset) + within)

    def __len__(self) -> int:
        return len(self.array)

    def read(self, start: int, stop: int, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Give rows `start` to `stop` as stored, in `out` if they come from a file."""
        if self.path is None:
            return self.array[start:stop]
        width = self.array.shape[1]
        rows = np.empty((stop - start, width), self.array.dtype) if out is None else out
        rows = rows[: stop - start]
        view = memoryview(rows.view(np.uint8).reshape(-1).data)
        with self.path.open("rb", buffering=0) as file:
            file.seek(self.offset + start * width * rows.itemsize)
            while len(view):
                got = file.readinto(view)
                if not got:
                    raise PredictionError("the file ends before its descriptors", where=self.path)
                view = view[got:]
        return rows

    def blocks(self, step: int) -> Iterator[tuple[int, NDArray[Any]]]:
        """Give (first row, rows) in order; the next block is read meanwhile.

        A block is valid until the next one is asked for.
        """
        starts = list(range(0, len(self), step))
        buffers: list[NDArray[Any] | None] = [None, None]
        if self.path is not None:
            shape = min(step, len(self)), self.array.shape[1]
            buffers = [np.empty(shape, self.array.dtype) for _ in range(2)]

        def fetch(turn: int) -> NDArray[Any]:
            stop = min(starts[turn] + step, len(self))
            return self.read(starts[turn], stop, buffers[turn % 2])

        with ThreadPoolExecutor(1) as reader:
            ahead = [reader.submit(fetch, turn) for turn in range(min(1, len(starts)))]
            for turn, start in enumerate(starts):
                rows = ahead.pop().result()
                if turn + 1 < len(starts):
                    ahead.append(reader.submit(fetch, turn + 1))
                yield start, rows


@dataclass(frozen=True, eq=False)
class RowParts:
    """Rows of several arrays, one after the other, each of which may be mapped from its own file.

    Parameters
    ----------
    arrays : tuple of (n, D) array
        At least one, all of one D.
    """

    arrays: tuple[NDArray[Any], ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and dimensions."""
        return sum(map(len, self.arrays)), self.arrays[0].shape[1]

    @property
    def itemsize(self) -> int:
        """Bytes of the largest number."""
        return max(array.itemsize for array in self.arrays)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice | NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Read rows into memory, in the order that is asked for."""
        asked = np.arange(len(self))[rows]
        found = np.empty((len(asked), self.shape[1]), np.result_type(*self.arrays))
        for start, array in self._starts():
            mine = (asked >= start) & (asked < start + len(array))
            found[mine] = array[asked[mine] - start]
        return found

    def whole(self, start: int, count: int) -> tuple[NDArray[Any], int] | None:
        """Return the array that holds all of some rows, and which of its rows is the first."""
        for begin, array in self._starts():
            if begin <= start and start + count <= begin + len(array):
                return array, start - begin
        return None

    def _starts(self) -> Iterator[tuple[int, NDArray[Any]]]:
        start = 0
        for array in self.arrays:
            yield start, array
            start += len(array)


def as_float32(rows: NDArray[Any]) -> NDArray[np.float32]:
    """Round rows to float32; too large a number becomes infinite."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.ascontiguousarray(rows, dtype=np.float32)

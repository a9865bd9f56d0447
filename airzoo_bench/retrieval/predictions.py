"""Prediction files of the retrieval track: ranked tile ids, or descriptors."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.queries import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import (
    Arrays,
    as_floating,
    check_length,
    numbers,
    open_arrays,
    texts,
)
from airzoo_bench.geometry.arrays import Floats, Ints

Texts = NDArray[np.str_]

_COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")  # of a table
_EXPECTED = "query_ids with ranked_ids, or with gallery_descriptors, gallery_ids, query_descriptors"
_BLOCK_BYTES, _BLOCK_ROWS = 1 << 26, 1 << 15
_WINDOW = 1024  # rows that are read as one where some of them are needed


@dataclass(frozen=True)
class _FileRows:
    """Rows that lie one after the other in a file."""

    path: Path
    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, int]

    def read(self, start: int, stop: int) -> NDArray[Any]:
        numbers_a_row = self.shape[1]
        offset = self.offset + start * numbers_a_row * self.dtype.itemsize
        count = (stop - start) * numbers_a_row
        found = np.fromfile(self.path, self.dtype, count, offset=offset)
        if len(found) < count:
            raise PredictionError("the file ends before its descriptors", where=self.path)
        return found.reshape(-1, numbers_a_row)


@dataclass(frozen=True, eq=False)
class Rows:
    """Descriptors (n, D) of floating-point numbers, in memory or in files, read some at a time.

    A part that is a memory map is read by plain reads: pages of a map count as memory of the
    process, and a map is sent to other processes as a whole.
    """

    parts: tuple[NDArray[Any] | _FileRows, ...]  # whose rows from `start` to `stop` are meant
    dtype: np.dtype[Any]
    start: int
    stop: int

    @classmethod
    def join(cls, *arrays: NDArray[Any]) -> Rows:
        """Join arrays, which may be mapped; whole numbers are read as floating point."""
        types = [as_floating(np.empty(0, array.dtype)).dtype for array in arrays]
        parts = tuple(_file_rows(array) or array for array in arrays)
        return cls(parts, np.result_type(*types), 0, sum(map(len, arrays)))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and dimensions."""
        return len(self), self.parts[0].shape[1]

    @property
    def in_files(self) -> bool:
        """Whether no row is held in memory."""
        return all(isinstance(part, _FileRows) for part in self.parts)

    def __len__(self) -> int:
        return self.stop - self.start

    def part(self, start: int, stop: int) -> Rows:
        """Return some of the rows, which are not read yet."""
        return replace(self, start=self.start + start, stop=self.start + stop)

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Read rows that follow each other."""
        low, high = self.start + start, min(self.start + stop, self.stop)
        found = [np.empty((0, self.shape[1]), self.dtype)]
        for part in self.parts:
            first, last = max(low, 0), min(high, part.shape[0])
            if first < last:
                found.append(as_floating(_rows_of(part, first, last)))
            low, high = low - part.shape[0], high - part.shape[0]
        rows = found[-1] if len(found) <= 2 else np.concatenate(found)
        return rows.astype(self.dtype, copy=False)

    def block(self, memory_bytes: int) -> int:
        """Return how many rows `blocks` reads at a time."""
        row_bytes = max(1, self.shape[1] * max(self.dtype.itemsize, 4))
        return int(np.clip(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, 1, _BLOCK_ROWS))

    def blocks(self, memory_bytes: int = 8 * _BLOCK_BYTES) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield (first row, rows) in order; the next are read meanwhile."""
        step = self.block(memory_bytes)
        with ThreadPoolExecutor(1) as reader:
            ahead = reader.submit(self.read, 0, step)
            for start in range(0, len(self), step):
                rows = ahead.result()
                ahead = reader.submit(self.read, start + step, start + 2 * step)
                yield start, rows

    def take(self, rows: Ints) -> NDArray[Any]:
        """Read rows into memory, in the order of their numbers."""
        found = np.empty((len(rows), self.shape[1]), self.dtype)
        for group in in_windows(rows, _WINDOW):
            first = int(rows[group[0]])
            found[group] = self.read(first, int(rows[group[-1]]) + 1)[rows[group] - first]
        return found


def _rows_of(part: NDArray[Any] | _FileRows, start: int, stop: int) -> NDArray[Any]:
    return part.read(start, stop) if isinstance(part, _FileRows) else part[start:stop]


def in_windows(rows: Ints, width: int) -> list[Ints]:
    """Group the places of rows, in ascending order of row, by windows of `width` rows."""
    order = np.argsort(rows, kind="stable")
    firsts = np.flatnonzero(np.diff(rows[order] // width)) + 1
    return np.split(order, firsts) if len(rows) else []


def _file_rows(array: NDArray[Any]) -> _FileRows | None:
    """Return where in which file the rows of a memory map lie; None of any other array."""
    if not isinstance(array, np.memmap) or not array.flags.c_contiguous:
        return None
    if array.mode == "c" or not array.filename:  # it may differ from its file
        return None
    root: Any = array
    while isinstance(root.base, np.memmap):
        root = root.base
    # A view inherits the offset of its map, not its own.
    offset = int(root.offset) + array.ctypes.data - root.ctypes.data
    return _FileRows(Path(str(root.filename)), offset, array.dtype, (len(array), array.shape[1]))


@dataclass(frozen=True)
class RankedIds:
    """Ranked tile ids of each query, best first."""

    kind: ClassVar[str] = "ranked_ids"

    ids: Texts  # (Q, K), empty where a list is shorter than K
    scores: Floats | None  # (Q, K), similarities or distances; equal ones are ties


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of queries (Q, D) and of tiles (G, D), which may lie in files."""

    kind: ClassVar[str] = "descriptors"

    queries: NDArray[np.floating[Any]]
    gallery_ids: Texts
    gallery: Rows


RetrievalPredictions = QueryPredictions[RankedIds | Descriptors]
"""A prediction file of the retrieval track, as read."""


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track."""
    return read_fields(open_arrays(path, limit_bytes, _COLUMNS), _FORMS, _EXPECTED)


def _read_ranked(arrays: Arrays, query_ids: Texts) -> RankedIds | Descriptors:
    ids = texts(arrays, "ranked_ids", 2)
    check_length(arrays, "ranked_ids", ids, len(query_ids))
    if not ids.shape[1]:
        where = f"{arrays.path}, field 'ranked_ids'"
        expected = "tiles of each query, best first"
        raise PredictionError("ranks no tile", where=where, expected=expected)
    if "scores" not in arrays.names():
        return RankedIds(ids, None)
    scores = numbers(arrays, "scores", (None, None))
    if scores.shape != ids.shape:
        raise PredictionError(
            f"field 'scores' has shape {scores.shape}",
            where=arrays.path,
            expected=f"the shape of ranked_ids, {ids.shape}",
            fix="give a score for each ranked tile",
        )
    return RankedIds(ids, scores.astype(np.float64))


def _read_descriptors(arrays: Arrays, query_ids: Texts) -> RankedIds | Descriptors:
    gallery_ids = texts(arrays, "gallery_ids", 1)
    queries = numbers(arrays, "query_descriptors", (None, None))
    gallery = numbers(arrays, "gallery_descriptors", (None, None), mapped=True)
    check_length(arrays, "query_descriptors", queries, len(query_ids))
    check_length(arrays, "gallery_descriptors", gallery, len(gallery_ids))
    return Descriptors(queries, gallery_ids, Rows.join(gallery))


_FORMS = (
    Fields("ranked_ids", ("ranked_ids",), ("scores",), _read_ranked),
    Fields(
        "query_descriptors",
        ("query_descriptors", "gallery_ids", "gallery_descriptors"),
        (),
        _read_descriptors,
    ),
)

"""Descriptors in files that are unpacked grain by grain: Parquet's row groups, Zarr's chunks."""

from __future__ import annotations

from abc import abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.engines.tasks import count_read
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.parquet_pages import Chunk, row_groups
from airzoo_bench.formats.zarr import ZarrMatrix
from airzoo_bench.retrieval.descriptor_rows import Rows, Run

__all__ = ["COLUMN", "ParquetRows", "ZarrRows"]

COLUMN = "descriptor"
"""The column of a Parquet shard that holds them."""
_BATCH_BYTES = 1 << 20
_FLOATS = {"halffloat": "f2", "float": "f4", "double": "f8"}


@dataclass(frozen=True, eq=False)
class _Grained(Rows):
    """Rows that are unpacked a grain at a time, from its start.

    Parameters
    ----------
    shape : tuple of int
    dtype : dtype
    first : int
        Which row of the file is the first.
    """

    shape: tuple[int, int]
    dtype: np.dtype[Any]
    first: int

    def part(self, start: int, stop: int) -> Self:
        """See `Rows.part`."""
        return replace(self, shape=(stop - start, self.shape[1]), first=self.first + start)

    def runs(self, bounds: Iterable[Run]) -> Iterator[NDArray[Any]]:
        """See `Rows.runs`; each grain is unpacked once at most, and only where it is needed."""
        grain, at = -1, 0
        pieces: Iterator[NDArray[Any]] = iter(())
        piece = np.empty((0, self.shape[1]), self.dtype)
        for start, stop in bounds:
            rows, done = np.empty((stop - start, self.shape[1]), self.dtype), 0
            while done < len(rows):
                row = self.first + start + done
                wanted, begins = self._grain(row)
                if wanted != grain:
                    grain, at, pieces, piece = wanted, begins, self._pieces(wanted), piece[:0]
                while row >= at + len(piece):
                    at += len(piece)
                    piece = next(pieces)
                some = piece[row - at : row - at + len(rows) - done]
                rows[done : done + len(some)] = some
                done += len(some)
            yield rows

    @abstractmethod
    def _grain(self, row: int) -> tuple[int, int]:
        """Return which grain holds a row of the file, and the grain's first row."""

    @abstractmethod
    def _pieces(self, grain: int) -> Iterator[NDArray[Any]]:
        """Unpack a grain, a few rows at a time."""


@dataclass(frozen=True, eq=False)
class ZarrRows(_Grained):
    """Rows of a Zarr array, a band of chunks at a time."""

    matrix: ZarrMatrix

    @classmethod
    def open(cls, path: Path, budget: Budget) -> ZarrRows:
        """Look at an array; see `ZarrMatrix.open`."""
        matrix = ZarrMatrix.open(path, budget)
        return cls(matrix.shape, np.dtype(matrix.dtype).newbyteorder("="), 0, matrix)

    def _grain(self, row: int) -> tuple[int, int]:
        number = row // self.matrix.chunk[0]
        return number, number * self.matrix.chunk[0]

    def _pieces(self, grain: int) -> Iterator[NDArray[Any]]:
        rows = self.matrix.band(grain)
        count_read(rows.nbytes)
        yield rows


@dataclass(frozen=True, eq=False)
class ParquetRows(_Grained):
    """Rows of a Parquet file, in its column `COLUMN` of lists; a row group is a grain.

    Parameters
    ----------
    starts : tuple of int
        The first row of each row group.
    """

    path: Path
    starts: tuple[int, ...]

    @classmethod
    def open(cls, path: Path, budget: Budget) -> ParquetRows:
        """Look at a file.

        Parameters
        ----------
        path : Path
        budget : Budget
            What a row group's descriptors may take in memory: as much may be in one list.

        Raises
        ------
        PredictionError
            It has no such column, or lists of several lengths.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            chunks = [one for group in row_groups(path) for one in group if one.column == COLUMN]
            schema = pq.read_schema(path)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise UnreadableError(
                f"not a readable parquet file: {(str(error) or 'damaged').splitlines()[0]}",
                where=path,
                expected=f"parquet with the columns id and {COLUMN}",
                fix="write or copy the file again",
            ) from error
        dtype = _number_type(path, schema)
        rows = np.array([chunk.rows for chunk in chunks], np.int64)
        width = _width(path, chunks)
        _hold(path, chunks, dtype, budget)
        starts = np.concatenate([[0], np.cumsum(rows)[:-1]]) if len(rows) else rows
        return cls((int(rows.sum()), width), dtype, 0, path, tuple(starts.tolist()))

    def _grain(self, row: int) -> tuple[int, int]:
        number = bisect_right(self.starts, row) - 1
        return number, self.starts[number]

    def _pieces(self, grain: int) -> Iterator[NDArray[Any]]:
        import pyarrow as pa
        import pyarrow.parquet as pq

        step = max(1, _BATCH_BYTES // (self.shape[1] * self.itemsize))
        try:
            with pq.ParquetFile(self.path, buffer_size=1 << 20, pre_buffer=False) as file:
                for batch in file.iter_batches(step, row_groups=[grain], columns=[COLUMN]):
                    yield self._numbers(batch.column(0))
        except (pa.ArrowException, OSError, ValueError) as error:
            if getattr(error, "errno", None) is not None:  # of the disk, not of what it holds
                raise
            raise self._damaged(str(error)) from error
        raise self._damaged(f"row group {grain} ends before its rows")

    def _numbers(self, lists: Any) -> NDArray[Any]:
        import pyarrow.compute as pc

        values = lists.flatten()
        if lists.null_count or values.null_count:
            raise PredictionError(
                f"column '{COLUMN}' has nulls", where=self.path, expected="a number in every place"
            )
        lengths = pc.list_value_length(lists).to_numpy(zero_copy_only=False)
        if (lengths != self.shape[1]).any():
            raise _ragged(self.path, f"of {lengths.min()} to {lengths.max()} numbers")
        rows: NDArray[Any] = values.to_numpy(zero_copy_only=False).reshape(-1, self.shape[1])
        count_read(rows.nbytes)
        return rows

    def _damaged(self, why: str) -> PredictionError:
        return PredictionError(
            f"column '{COLUMN}' is damaged or cut off: {why[:200]}",
            where=self.path,
            fix="write or copy the file again",
        )


def _number_type(path: Path, schema: Any) -> np.dtype[Any]:
    if schema.names.count(COLUMN) > 1:
        raise PredictionError(
            f"has {schema.names.count(COLUMN)} columns '{COLUMN}'", where=path, expected="one"
        )
    found = schema.field(COLUMN).type if COLUMN in schema.names else None
    name = str(getattr(found, "value_type", found))
    if name not in _FLOATS or found is None or str(found) == name:
        raise PredictionError(
            f"column '{COLUMN}' is {'not there' if found is None else f'of type {found}'[:80]}",
            where=path,
            expected="a list of float16, float32 or float64 in each row, all of one length",
            fix=f"pa.table({{'id': ids, '{COLUMN}': pa.FixedSizeListArray.from_arrays("
            "rows.ravel(), rows.shape[1])})",
        )
    return np.dtype(_FLOATS[name])


def _width(path: Path, chunks: list[Chunk]) -> int:
    """Return how many numbers each row has, as the row groups state it."""
    filled = [chunk for chunk in chunks if chunk.rows]
    widths = {chunk.values // chunk.rows for chunk in filled}
    if len(widths) > 1 or any(chunk.values % chunk.rows for chunk in filled):
        raise _ragged(path, "of several lengths")
    return widths.pop() if widths else 0


def _hold(path: Path, chunks: list[Chunk], dtype: np.dtype[Any], budget: Budget) -> None:
    largest = max((chunk.values for chunk in chunks), default=0) * dtype.itemsize
    page = max((page for chunk in chunks for page in chunk.pages), default=0)
    budget.hold(
        path,
        f"a row group of column '{COLUMN}'",
        largest + page,
        "write smaller row groups, such as pq.write_table(table, path, row_group_size=50_000)",
    )


def _ragged(path: Path, what: str) -> PredictionError:
    return PredictionError(
        f"column '{COLUMN}' has lists {what}",
        where=path,
        expected="lists of one length",
        fix="describe all tiles with one model",
    )

"""Reading ``.parquet`` predictions in bounded batches.

Text is read as a dictionary with indices: a file can state one long text a billion times in a few
bytes, and so it stays as small as it is stored until its lengths have been looked at.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, first_of
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.parquet_pages import claimed_bytes

__all__ = ["read_columns"]

_BATCH_ROWS = 65_536
_PANDAS_INDEX = "__index_level_"
_LONGEST_TEXT = 512
_TEXT_OBJECT = 64  # bytes that a text takes in Python besides its letters


def read_columns(path: Path, columns: tuple[str, ...], budget: Budget) -> dict[str, NDArray[Any]]:
    """Read the named columns that a parquet file has."""
    if not path.is_file():
        raise UnreadableError(
            "no such prediction file",
            where=path,
            expected=".npz or .parquet",
            fix="`airzoo-bench template` writes an example",
        )
    with _told_as_damage(path):
        return _read(path, columns, budget, _pandas_index(path))


def _pandas_index(path: Path) -> tuple[str, ...]:
    import pyarrow.parquet as pq

    claimed_bytes(path)  # Arrow may end the process over metadata that are damaged
    names = pq.read_schema(path).names
    return tuple(name for name in names if name.startswith(_PANDAS_INDEX))


@contextmanager
def _told_as_damage(path: Path) -> Iterator[None]:
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UnreadableError(
            f"not a readable parquet file: {(str(error) or type(error).__name__).splitlines()[0]}",
            where=path,
            expected="parquet with one row a query",
            fix="write or copy the file again",
        ) from error


def _opened(path: Path, budget: Budget, passed_over: tuple[str, ...]) -> Any:
    """Open a file whose pages are sound, and whose texts stay as small as they are stored."""
    import pyarrow.parquet as pq

    budget.hold(path, "its pages", claimed_bytes(path, passed_over))
    with pq.ParquetFile(path) as file:
        # A walk through all pages in small pieces, which finds damage: Arrow ends the process when
        # it is asked for the metadata of a damaged column.
        read = [name for name in file.schema_arrow.names if name not in passed_over]
        file.scan_contents(columns=read if passed_over else None, batch_size=_BATCH_ROWS)
        texts = [file.schema.column(i).path for i in range(file.metadata.num_columns)]
    return pq.ParquetFile(path, read_dictionary=texts)


def _read(
    path: Path, columns: tuple[str, ...], budget: Budget, passed_over: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    with _opened(path, budget, passed_over) as file:
        names = [name for name in file.schema_arrow.names if name not in passed_over]
        _check_columns(path, names, columns)
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
        row = 0
        for batch in _batches(file, names if passed_over else None):
            for name in names:
                taken = sum(array.nbytes for array in parts[name])
                piece = _Piece(path, name, batch.column(name), row, taken, budget)
                parts[name].append(piece.as_array())
            row += batch.num_rows
    return {name: _joined(arrays, name, path) for name, arrays in parts.items()}


def _batches(file: Any, names: list[str] | None) -> Iterator[Any]:
    # Group by group: each has a dictionary of its own, and lists cannot change theirs in a batch.
    for group in range(file.metadata.num_row_groups):
        yield from file.iter_batches(_BATCH_ROWS, row_groups=[group], columns=names)


def _check_columns(path: Path, names: list[str], columns: tuple[str, ...]) -> None:
    unknown = [repr(name[:80]) for name in names if name not in columns]
    if unknown:
        raise PredictionError(
            f"has unknown columns: {first_of(unknown)}",
            where=path,
            expected="only " + ", ".join(columns),
            fix="rename or leave them out; descriptors go into an .npz",
        )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise PredictionError(
            f"has columns more than once: {first_of(twice)}", where=path, expected="each once"
        )


@dataclass(frozen=True)
class _Piece:
    """A column of one batch."""

    path: Path
    name: str
    values: Any
    first_row: int
    held_bytes: int
    budget: Budget

    def as_array(self) -> NDArray[Any]:
        import pyarrow as pa
        import pyarrow.compute as pc

        column = self.values
        column.validate(full=True)
        self._check_nulls(column, 1)
        lists = pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list
        if not any(is_list(column.type) for is_list in lists):
            return self._as_vector(column)
        lengths = np.unique(pc.list_value_length(column).to_numpy(zero_copy_only=False))
        if lengths.size > 1:
            raise _ragged(lengths, self.name, self.path)
        length = int(lengths[0]) if lengths.size else 0
        values = column.flatten()
        self._check_nulls(values, length)
        return self._as_vector(values).reshape(len(column), length)

    def _check_nulls(self, values: Any, a_row: int) -> None:
        if values.null_count:
            places = np.flatnonzero(values.is_null().to_numpy(zero_copy_only=False))
            rows = np.unique(places // a_row) + self.first_row
            raise PredictionError(
                f"column '{self.name}' has nulls in rows, counted from 0: "
                f"{first_of(rows.tolist())}",
                where=self.path,
                expected="a value in every place",
                fix="leave such rows out; fill the end of a shorter list with ''",
            )

    def _as_vector(self, values: Any) -> NDArray[Any]:
        import pyarrow as pa

        if pa.types.is_dictionary(values.type):
            texts = self._as_vector(values.dictionary)
            self._hold(texts.itemsize * len(values))
            indices: NDArray[Any] = values.indices.to_numpy(zero_copy_only=False)
            return np.take(texts, indices)
        if pa.types.is_string(values.type) or pa.types.is_large_string(values.type):
            return self._as_text(values)
        if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
            self._hold(8 * len(values))
            return np.asarray(values.to_numpy(zero_copy_only=False))
        raise PredictionError(
            f"column '{self.name}' has values of type {values.type}",
            where=self.path,
            expected="text, numbers, or lists of them",
        )

    def _as_text(self, values: Any) -> NDArray[np.str_]:
        import pyarrow.compute as pc

        # NumPy gives every entry the width of the longest: one huge text would take all memory.
        longest = pc.max(pc.utf8_length(values)).as_py() or 0
        if longest > _LONGEST_TEXT:
            raise PredictionError(
                f"column '{self.name}' has a text of {longest:,} characters",
                where=self.path,
                expected=f"at most {_LONGEST_TEXT} characters",
            )
        self._hold(len(values) * (_TEXT_OBJECT + 4 * longest))
        return np.array(values.to_pylist(), dtype=str)

    def _hold(self, nbytes: int) -> None:
        # Twice: the pieces of a column are joined at the end.
        self.budget.hold(self.path, f"column '{self.name}'", 2 * (self.held_bytes + nbytes))


def _ragged(lengths: NDArray[Any], name: str, path: Path) -> PredictionError:
    return PredictionError(
        f"column '{name}' has lists of {lengths[0]} to {lengths[-1]} entries",
        where=path,
        expected="lists of one length",
        fix="fill shorter ones with '' (scores: with 0) at the end",
    )


def _joined(arrays: list[NDArray[Any]], name: str, path: Path) -> NDArray[Any]:
    lengths = np.unique([array.shape[1] for array in arrays if array.ndim == 2])
    if lengths.size > 1:
        raise _ragged(lengths, name, path)
    return np.concatenate(arrays) if arrays else np.array([], dtype=str)

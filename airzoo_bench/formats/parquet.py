"""Tables of predictions in parquet files, by pyarrow."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, first_of, readable
from airzoo_bench.formats.npz import Budget

_PANDAS_INDEX = "__index_level_"
_LONGEST_TEXT = 512
_LISTS = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)


class ParquetFile:
    """The columns of a parquet file as `airzoo_bench.formats.arrays.Arrays`."""

    def __init__(self, path: Path, limit_bytes: int, columns: tuple[str, ...]) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        self._arrays = read_columns(path, columns)

    def names(self) -> set[str]:
        """Return the names of the columns."""
        return set(self._arrays)

    def read(self, name: str) -> NDArray[Any]:
        """Return a column; the protocol as its one text."""
        array = self._arrays[name]
        if name != "protocol":
            return array
        return np.unique(array) if array.size else np.array([""])

    map = read


def read_columns(path: Path, columns: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read the columns of predictions; lists of one length become rows of an array."""
    if not path.is_file():
        raise UnreadableError("no such prediction file", where=path, expected=".npz or .parquet")
    what, expected = "not a readable parquet file", "parquet with one row a query"
    with readable(path, what, kind=UnreadableError, expected=expected):
        with pq.ParquetFile(path) as file:
            parts = [file.schema.column(i).path for i in range(file.metadata.num_columns)]
            names = [one for one in file.schema_arrow.names if not one.startswith(_PANDAS_INDEX)]
        unknown = [repr(one[:80]) for one in names if one not in columns or names.count(one) > 1]
        if unknown:
            raise PredictionError(
                f"has columns that are unknown, or there twice: {first_of(unknown)}",
                where=path,
                expected="only " + ", ".join(columns) + ", each once",
                fix="rename or leave them out; descriptors go into an .npz",
            )
        # Texts stay as dictionaries, as small as they are stored, until their lengths are known.
        with pq.ParquetFile(path, read_dictionary=parts) as file:
            groups = range(file.num_row_groups)  # each has dictionaries of its own
            tables = [file.read_row_group(group, columns=names) for group in groups]
            table = pa.concat_tables(tables or [file.read(columns=names)])
        return {name: _read_column(path, name, table.column(name)) for name in names}


def _read_column(path: Path, name: str, column: Any) -> NDArray[Any]:
    """Return a column: a vector, or a matrix where its rows are lists."""
    refusal = partial(_refusal, path, name)
    column.validate(full=True)
    shape: tuple[int, ...] = (len(column),)
    if any(is_list(column.type) for is_list in _LISTS) and not column.null_count:
        lengths = np.unique(pc.list_value_length(column).to_numpy())
        if lengths.size > 1:
            raise refusal(f"lists of {lengths[0]} to {lengths[-1]} entries")
        column, shape = pc.list_flatten(column), (len(column), *map(int, lengths))
    if column.null_count:
        row = int(np.argmax(pc.is_null(column).to_numpy())) // max(*shape[1:], 1, 1)
        raise refusal(f"nulls, first in row {row:,}, counted from 0")
    vectors = [_as_vector(refusal, chunk) for chunk in column.chunks]
    return np.concatenate(vectors or [np.array([], str)]).reshape(shape)


def _as_vector(refusal: Any, values: Any) -> NDArray[Any]:
    if pa.types.is_dictionary(values.type):
        texts = _as_vector(refusal, values.dictionary)
        found: NDArray[Any] = texts[values.indices.to_numpy(zero_copy_only=False)]
        return found
    if pa.types.is_string(values.type) or pa.types.is_large_string(values.type):
        # NumPy gives every entry the width of the longest: one huge text would take all memory.
        longest = pc.max(pc.utf8_length(values)).as_py() or 0
        if longest > _LONGEST_TEXT:
            raise refusal(f"a text of {longest:,} characters, more than {_LONGEST_TEXT}")
        return np.array(values.to_pylist(), dtype=str)
    if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
        return np.asarray(values.to_numpy(zero_copy_only=False))
    raise refusal(f"values of type {values.type}")


def _refusal(path: Path, name: str, what: str) -> PredictionError:
    return PredictionError(
        f"column '{name}' has {what}",
        where=path,
        expected="text, numbers, or lists of them of one length, a value in every place",
        fix="fill shorter lists with '' (scores: with 0) at the end",
    )

"""Tables of predictions and of points in parquet files, by pyarrow."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, first_of
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, columns_to_points, refusal

__all__ = ["open_points", "read_columns"]

_BATCH_ROWS = 65_536
_PANDAS_INDEX = "__index_level_"
_LONGEST_TEXT = 512
_AXES = ["x", "y", "z"]
_PRECISIONS: dict[str, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "float": np.dtype(np.float32),
}


def read_columns(path: Path, columns: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Read the columns of predictions; lists of one length become rows of an array."""
    if not path.is_file():
        raise UnreadableError(
            "no such prediction file",
            where=path,
            expected=".npz or .parquet",
            fix="`airzoo-bench template` writes an example",
        )
    with _readable(path), pq.ParquetFile(path) as file:
        texts = [file.schema.column(i).path for i in range(file.metadata.num_columns)]
        names = [one for one in file.schema_arrow.names if not one.startswith(_PANDAS_INDEX)]
    _check_columns(path, names, columns)
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    row = 0
    # Texts stay as dictionaries, as small as they are stored, until their lengths are known.
    with _readable(path), pq.ParquetFile(path, read_dictionary=texts) as file:
        for group in range(file.metadata.num_row_groups):  # each has dictionaries of its own
            for batch in file.iter_batches(_BATCH_ROWS, row_groups=[group], columns=names):
                for name in names:
                    parts[name].append(_read_rows(path, name, batch.column(name), row))
                row += batch.num_rows
    for name, arrays in parts.items():
        _check_lengths(path, name, np.unique([one.shape[1] for one in arrays if one.ndim == 2]))
    return {
        name: np.concatenate(some) if some else np.array([], str) for name, some in parts.items()
    }


def open_points(path: Path) -> FileCloud:
    """Open a parquet file of points: columns x, y and z of floating point, others passed over."""
    with _readable(path), pq.ParquetFile(path) as file:
        count, schema = file.metadata.num_rows, file.schema_arrow
    kinds = [[str(field.type) for field in schema if field.name == axis] for axis in _AXES]
    if any(len(kind) != 1 or kind[0] not in _PRECISIONS for kind in kinds):
        there = ", ".join(f"{field.name} {field.type}"[:40] for field in list(schema)[:8])
        raise refusal(
            path,
            f"has the columns {there or 'of nothing'}",
            expected="columns x, y and z, each once, of 32 or 64 bit floating point",
        )
    precision = min((_PRECISIONS[kind[0]] for kind in kinds), key=lambda dtype: dtype.itemsize)
    return FileCloud(path, "Parquet", count, partial(_read_points, path, count), precision)


def _read_points(path: Path, count: int, points: int) -> Iterator[Cloud]:
    done = 0
    with _readable(path), pq.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=points, columns=_AXES):
            columns = [batch.column(axis) for axis in _AXES]
            if any(column.null_count for column in columns):
                raise refusal(path, "has nulls among its coordinates", expected="numbers, or NaN")
            done += batch.num_rows
            yield Cloud(columns_to_points(*(column.to_numpy() for column in columns)))
    if done != count:
        raise refusal(path, f"states {count:,} rows, and holds {done:,}", expected="as many")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UnreadableError(
            f"not a readable parquet file: {(str(error) or type(error).__name__).splitlines()[0]}",
            where=path,
            expected="parquet with one row a query, or a point",
            fix="write or copy the file again",
        ) from error


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


def _read_rows(path: Path, name: str, column: Any, first_row: int) -> NDArray[Any]:
    """Return the rows of one batch: a vector, or a matrix where they are lists."""
    column.validate(full=True)
    _check_nulls(path, name, column, 1, first_row)
    lists = pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list
    if not any(is_list(column.type) for is_list in lists):
        return _as_vector(path, name, column)
    lengths = np.unique(pc.list_value_length(column).to_numpy(zero_copy_only=False))
    _check_lengths(path, name, lengths)
    values, length = column.flatten(), int(lengths[0]) if lengths.size else 0
    _check_nulls(path, name, values, length, first_row)
    return _as_vector(path, name, values).reshape(len(column), length)


def _as_vector(path: Path, name: str, values: Any) -> NDArray[Any]:
    if pa.types.is_dictionary(values.type):
        texts = _as_vector(path, name, values.dictionary)
        found: NDArray[Any] = texts[values.indices.to_numpy(zero_copy_only=False)]
        return found
    if pa.types.is_string(values.type) or pa.types.is_large_string(values.type):
        # NumPy gives every entry the width of the longest: one huge text would take all memory.
        longest = pc.max(pc.utf8_length(values)).as_py() or 0
        if longest > _LONGEST_TEXT:
            raise PredictionError(
                f"column '{name}' has a text of {longest:,} characters",
                where=path,
                expected=f"at most {_LONGEST_TEXT} characters",
            )
        return np.array(values.to_pylist(), dtype=str)
    if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
        return np.asarray(values.to_numpy(zero_copy_only=False))
    raise PredictionError(
        f"column '{name}' has values of type {values.type}",
        where=path,
        expected="text, numbers, or lists of them",
    )


def _check_nulls(path: Path, name: str, values: Any, a_row: int, first_row: int) -> None:
    if values.null_count:
        places = np.flatnonzero(values.is_null().to_numpy(zero_copy_only=False))
        rows = np.unique(places // a_row) + first_row
        raise PredictionError(
            f"column '{name}' has nulls in rows, counted from 0: {first_of(rows.tolist())}",
            where=path,
            expected="a value in every place",
            fix="leave such rows out; fill the end of a shorter list with ''",
        )


def _check_lengths(path: Path, name: str, lengths: NDArray[Any]) -> None:
    if lengths.size > 1:
        raise PredictionError(
            f"column '{name}' has lists of {lengths[0]} to {lengths[-1]} entries",
            where=path,
            expected="lists of one length",
            fix="fill shorter ones with '' (scores: with 0) at the end",
        )

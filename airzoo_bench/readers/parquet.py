"""Reading ``.parquet`` predictions in bounded batches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import PredictionError

__all__ = ["read_columns"]

_BATCH_ROWS = 65_536
_LONGEST_TEXT = 512


def read_columns(path: Path, columns: tuple[str, ...], limit_bytes: int) -> dict[str, NDArray[Any]]:
    """Read the named columns that a parquet file has.

    Parameters
    ----------
    path : Path
        The file, one row a query; a list column becomes a matrix (rows, length).
    columns : tuple of str
        The columns to read where they exist; others are left alone.
    limit_bytes : int
        The most that the columns may take in memory together.

    Returns
    -------
    dict of str to array
        Text as ``str``, lists as 2D arrays.

    Raises
    ------
    PredictionError
        Not a parquet file, damaged, larger than the limit, null values, or lists of
        differing lengths.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.is_file():
        raise PredictionError("no such prediction file", where=path)
    try:
        with pq.ParquetFile(path) as file:
            present = [name for name in columns if name in file.schema_arrow.names]
            table = _read_bounded(file, present, path, limit_bytes)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError, OSError) as error:
        raise PredictionError(
            f"not a readable parquet file: {str(error).splitlines()[0]}",
            where=path,
            mend="write or copy the file again",
        ) from error
    return {name: _as_array(table[name].combine_chunks(), name, path) for name in present}


def _read_bounded(file: Any, columns: list[str], path: Path, limit_bytes: int) -> Any:
    import pyarrow as pa

    batches, used = [], 0
    for batch in file.iter_batches(batch_size=_BATCH_ROWS, columns=columns):
        used += batch.nbytes
        if used > limit_bytes:
            raise PredictionError(
                f"its columns take more than the limit of {limit_bytes:,} bytes",
                where=path,
                mend="raise --max-memory",
            )
        batches.append(batch)
    schema = pa.schema([file.schema_arrow.field(name) for name in columns])
    return pa.Table.from_batches(batches, schema)


def _as_array(column: Any, name: str, path: Path) -> NDArray[Any]:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        return _as_array(column.dictionary_decode(), name, path)
    if column.null_count:
        raise PredictionError(f"field '{name}' has {column.null_count:,} nulls", where=path)
    if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        return _as_matrix(column, name, path)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _as_text(column, name, path)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        return np.asarray(column.to_numpy(zero_copy_only=False))
    raise PredictionError(
        f"field '{name}' has type {kind}", where=path, expected="text, numbers, or lists of them"
    )


def _as_text(column: Any, name: str, path: Path) -> NDArray[Any]:
    import pyarrow.compute as pc

    # NumPy gives every entry the width of the longest: one huge text would take all memory.
    longest = pc.max(pc.utf8_length(column)).as_py() or 0
    if longest > _LONGEST_TEXT:
        raise PredictionError(
            f"field '{name}' has a text of {longest:,} characters",
            where=path,
            expected=f"ids of at most {_LONGEST_TEXT} characters",
        )
    return np.array(column.to_pylist(), dtype=str)


def _as_matrix(column: Any, name: str, path: Path) -> NDArray[Any]:
    import pyarrow.compute as pc

    lengths = np.unique(pc.list_value_length(column).to_numpy(zero_copy_only=False))
    if lengths.size > 1:
        raise PredictionError(
            f"field '{name}' has lists of {lengths[0]} to {lengths[-1]} entries",
            where=path,
            expected="lists of one length; fill shorter ones with '' at the end",
        )
    flat = _as_array(column.flatten(), name, path)
    return flat.reshape(len(column), int(lengths[0]) if lengths.size else 0)

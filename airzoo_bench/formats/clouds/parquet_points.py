"""Points in parquet files: columns x, y and z of floating point, others passed over.

Arrow takes the memory that a page asks for before anyone can look at it, so what the pages state is
first held against the limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    columns_to_points,
    refusal,
)
from airzoo_bench.formats.parquet_pages import claimed_bytes

__all__ = ["open_parquet"]

_AXES = ("x", "y", "z")
# Of a point, by the pages of its columns: `claimed_bytes` counts 12 for a value.
_LEAST_BYTES = 36


def open_parquet(path: Path, limit_bytes: int) -> FileCloud:
    """Open a parquet file of points, whose pages may state so many bytes."""
    with _readable(path) as arrow:
        stated = claimed_bytes(path)
        Budget(limit_bytes).hold(path, "its pages", stated, "write smaller shards")
        with arrow.ParquetFile(path) as file:
            count, schema = file.metadata.num_rows, file.schema_arrow
    if count * _LEAST_BYTES > stated:
        raise refusal(path, f"states {count:,} rows, more than its pages hold", fix=FIX_COPY)
    precision = _precision(path, schema)
    return FileCloud(path, "Parquet", count, partial(_pieces, path), precision)


def _precision(path: Path, schema: Any) -> np.dtype[Any]:
    kinds = [[str(field.type) for field in schema if field.name == axis] for axis in _AXES]
    known: dict[str, np.dtype[Any]] = {
        "double": np.dtype(np.float64),
        "float": np.dtype(np.float32),
    }
    if any(len(kind) != 1 or kind[0] not in known for kind in kinds):
        told = ", ".join(f"{field.name} {field.type}"[:40] for field in list(schema)[:8])
        raise refusal(
            path,
            f"has the columns {told or 'of nothing'}",
            expected="columns x, y and z, each once, of 32 or 64 bit floating point",
        )
    return min((known[kind[0]] for kind in kinds), key=lambda dtype: dtype.itemsize)


def _pieces(path: Path, points: int) -> Iterator[Cloud]:
    with _readable(path) as arrow, arrow.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=points, columns=list(_AXES)):
            columns = [batch.column(axis) for axis in _AXES]
            if any(column.null_count for column in columns):
                raise refusal(path, "has nulls among its coordinates", expected="numbers, or NaN")
            yield Cloud(columns_to_points(*(column.to_numpy() for column in columns)))


@contextmanager
def _readable(path: Path) -> Iterator[Any]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        yield pq
    except FileNotFoundError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0][:200]
        raise refusal(path, f"not a readable parquet file: {reason}", fix=FIX_COPY) from error

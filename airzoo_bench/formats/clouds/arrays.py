"""Clouds in npz and npy files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import counted
from airzoo_bench.formats.arrays import Arrays, check_fields, open_arrays, wrong_type
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    as_confidence,
    refusal,
    uncounted,
)
from airzoo_bench.formats.clouds.columns import Columns
from airzoo_bench.formats.npy import read_header

__all__ = ["open_npy", "open_npz"]

_COLOURS = ("colours", "colors")
_CONFIDENCE = ("confidence", "conf")
_ALLOWED = ("protocol", "points", *_COLOURS, *_CONFIDENCE)
_EXPECTED = "points (N, 3), and perhaps colours (N, 3) and confidence (N,)"
_NUMBERS = "fiu"


def open_npz(path: Path, limit_bytes: int) -> FileCloud:
    """Open an npz file with ``points`` (N, 3), perhaps ``confidence`` (N,)."""
    arrays = open_arrays(path, limit_bytes)
    check_fields(arrays, ("points",), _ALLOWED, _EXPECTED)
    if arrays.names() >= set(_CONFIDENCE):
        raise refusal(path, f"holds both {' and '.join(_CONFIDENCE)}", fix="keep one of the two")
    points = _column(arrays, "points", 3)
    named = next((name for name in _CONFIDENCE if name in arrays.names()), None)
    confidence = None if named is None else _column(arrays, named, 1)
    if confidence is not None and len(confidence) != len(points):
        raise refusal(
            path,
            f"has {len(points):,} points and {len(confidence):,} rows of confidence",
            expected="a row a point",
        )
    read = partial(_slices, points, confidence)
    return FileCloud(path, "npz", len(points), read, points.dtype)


def open_npy(path: Path) -> FileCloud:
    """Open an npy file of points (N, 3), or of points with up to three columns more (N, 4 to 6)."""
    try:
        with path.open("rb") as stream:
            shape, fortran, dtype = read_header(stream)
            start = stream.tell()
    except ValueError as error:
        raise refusal(path, "the npy header is damaged", fix=FIX_COPY) from error
    plain = dtype.kind in _NUMBERS and not dtype.hasobject and dtype.itemsize <= 8
    if not plain or len(shape) != 2 or not 3 <= shape[1] <= 6 or shape[0] < 0:
        raise refusal(
            path,
            f"an array of {str(dtype)[:40]} and shape {str(shape)[:40]}",
            expected="points (N, 3), or with colours (N, 6), numbers of at most 64 bits",
            fix="np.save(file, np.asarray(points, dtype=np.float64))",
        )
    left = path.stat().st_size - start - math.prod(shape) * dtype.itemsize
    if left < 0:
        raise refusal(path, f"ends before {counted(shape[0], 'point')}", fix=FIX_COPY)
    rows = partial(np.memmap, path, dtype, "r", start, shape, "F" if fortran else "C")
    columns = Columns(shape[1])
    read = partial(_stream, rows, shape[0], columns)
    notes = uncounted(left, "bytes", shape[0])
    notes += (columns.note(),) if shape[1] > 3 else ()
    return FileCloud(path, "npy", shape[0], read, dtype, notes)


def _column(arrays: Arrays, name: str, width: int) -> NDArray[Any]:
    values = arrays.map(name)
    row = (width,) if width > 1 else ()
    is_plain = values.dtype.kind in _NUMBERS and values.dtype.itemsize <= 8
    if not is_plain or values.ndim != 1 + len(row) or values.shape[1:] != row:
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=_EXPECTED,
            fix=f"np.asarray({name}, dtype=np.float64) of that shape",
        )
    return values


def _slices(points: NDArray[Any], confidence: NDArray[Any] | None, size: int) -> Iterator[Cloud]:
    for start in range(0, len(points), size):
        part = slice(start, start + size)
        yield Cloud(
            np.array(points[part], np.float64),
            None,
            None if confidence is None else as_confidence(np.asarray(confidence[part])),
        )


def _stream(
    rows: Callable[[], NDArray[Any]], count: int, columns: Columns, points: int
) -> Iterator[Cloud]:
    """Yield the points of a file that is mapped by `rows`, which is small to send."""
    for first in range(0, count, points):
        yield columns.cloud(np.asarray(rows()[first : first + points]))

"""Clouds in npz and npy files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.arrays import Arrays, check_fields, open_arrays, wrong_type
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    as_colours,
    as_confidence,
    read_records,
    refusal,
    uncounted,
)
from airzoo_bench.formats.clouds.columns import Columns, columns_of_sample
from airzoo_bench.formats.npy import read_header

__all__ = ["open_npy", "open_npz"]

_COLOURS = ("colours", "colors")
_CONFIDENCE = ("confidence", "conf")
_ALLOWED = ("protocol", "points", *_COLOURS, *_CONFIDENCE)
_EXPECTED = "points (N, 3), and perhaps colours (N, 3) and confidence (N,)"
_NUMBERS = "fiu"
_SAMPLE = 1000


def open_npz(path: Path, limit_bytes: int) -> FileCloud:
    """Open an npz file with ``points`` (N, 3), ``colours`` (N, 3) and ``confidence`` (N,).

    Parameters
    ----------
    path : Path
    limit_bytes : int
        The most that the arrays may take in memory together; points that
        `numpy.savez` wrote are mapped and may be larger.

    Raises
    ------
    PredictionError
        Another kind of file, a field of another name, type or shape.
    """
    arrays = open_arrays(path, limit_bytes)
    check_fields(arrays, ("points",), _ALLOWED, _EXPECTED)
    for names in (_COLOURS, _CONFIDENCE):
        if len(arrays.names() & set(names)) > 1:
            raise refusal(path, f"holds both {' and '.join(names)}", fix="keep one of the two")
    points = _column(arrays, "points", 3)
    colours, confidence = _optional(arrays, _COLOURS, 3), _optional(arrays, _CONFIDENCE, 1)
    for name, values in (("colours", colours), ("confidence", confidence)):
        if values is not None and len(values) != len(points):
            raise refusal(
                path,
                f"has {len(points):,} points and {len(values):,} rows of {name}",
                expected="a row a point",
            )
    read = partial(_slices, points, colours, confidence)
    return FileCloud(path, "npz", len(points), read, points.dtype)


def open_npy(path: Path) -> FileCloud:
    """Open an npy file of points (N, 3), or of points with up to three columns more (N, 4 to 6).

    A fourth and fifth column are passed over; three are colours where they look so, see `columns`.

    Raises
    ------
    PredictionError
        Another kind of array, or a file that holds less than its header says.
    """
    try:
        with path.open("rb") as stream:
            shape, fortran, dtype = read_header(stream)
            start = stream.tell()
    except ValueError as error:
        raise refusal(path, "the npy header is damaged", fix=FIX_COPY) from error
    plain = dtype.kind in _NUMBERS and not dtype.hasobject and dtype.itemsize <= 8
    if not plain or len(shape) != 2 or not 3 <= shape[1] <= 6 or shape[0] < 0 or fortran:
        raise refusal(
            path,
            f"an array of {str(dtype)[:40]} and shape {str(shape)[:40]}"
            + (" in Fortran's order" if fortran else ""),
            expected="points (N, 3), or with colours (N, 6), numbers of at most 64 bits",
            fix="np.save(file, np.ascontiguousarray(points, dtype=np.float64))",
        )
    left = path.stat().st_size - start - math.prod(shape) * dtype.itemsize
    if left < 0:
        raise refusal(path, f"ends before {counted(shape[0], 'point')}", fix=FIX_COPY)
    record = np.dtype((dtype, (shape[1],)))
    columns = columns_of_sample(_first_rows(path, record, start, shape[0]))
    read = partial(_stream, path, record, start, shape[0], columns)
    notes = uncounted(left, "bytes", shape[0])
    notes += (columns.note(),) if shape[1] > 3 else ()
    return FileCloud(path, "npy", shape[0], read, dtype, notes)


def _optional(arrays: Arrays, names: tuple[str, str], width: int) -> NDArray[Any] | None:
    for name in names:
        if name in arrays.names():
            return _column(arrays, name, width)
    return None


def _column(arrays: Arrays, name: str, width: int) -> NDArray[Any]:
    values = arrays.map(name)
    shape = values.shape[1:] if width > 1 else (*values.shape[1:], 1)
    if values.dtype.kind not in _NUMBERS or values.dtype.itemsize > 8 or shape != (width,):
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=_EXPECTED,
            fix=f"np.asarray({name}, dtype=np.float64) of that shape",
        )
    return values


def _slices(
    points: NDArray[Any],
    colours: NDArray[Any] | None,
    confidence: NDArray[Any] | None,
    size: int,
) -> Iterator[Cloud]:
    for start in range(0, len(points), size):
        part = slice(start, start + size)
        yield Cloud(
            np.array(points[part], np.float64),
            None if colours is None else as_colours(*np.asarray(colours[part]).T),
            None if confidence is None else as_confidence(np.asarray(confidence[part])),
        )


def _first_rows(path: Path, record: np.dtype[Any], start: int, count: int) -> NDArray[Any]:
    rows = min(count, _SAMPLE)
    return next(read_records(path, record, start, rows, _SAMPLE), np.empty(0, record))


def _stream(
    path: Path, record: np.dtype[Any], start: int, count: int, columns: Columns, points: int
) -> Iterator[Cloud]:
    for block in read_records(path, record, start, count, points):
        yield columns.cloud(block)

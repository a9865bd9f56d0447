"""Clouds in npz and npy files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from airzoo_bench.core.errors import counted
from airzoo_bench.formats.arrays import Arrays, check_fields, open_arrays, wrong_type
from airzoo_bench.formats.clouds.cloud import ArrayPieces, FileCloud, refusal
from airzoo_bench.formats.npz import map_numbers

_CONFIDENCE = ("confidence", "conf")
_ALLOWED = ("protocol", "points", "colours", "colors", *_CONFIDENCE)
_EXPECTED = "points (N, 3), and perhaps colours (N, 3) and confidence (N,)"
_NUMBERS = "fiu"


def open_npz(path: Path, limit_bytes: int) -> FileCloud:
    """Open an npz file with ``points`` (N, 3), perhaps ``confidence`` (N,)."""
    arrays = open_arrays(path, limit_bytes)
    check_fields(arrays, ("points",), _ALLOWED, _EXPECTED)
    columns = {"points": _column(arrays, "points", (3,))}
    columns |= {name: _column(arrays, name, ()) for name in _CONFIDENCE if name in arrays.names()}
    lengths = {len(column) for column in columns.values()}
    if len(columns) > 2 or len(lengths) > 1:
        stated = ", ".join(f"{len(column):,} of {name}" for name, column in columns.items())
        raise refusal(path, f"holds {stated}", expected="one confidence a point, named once")
    points = columns.pop("points")
    read = ArrayPieces(points, *columns.values())
    return FileCloud(path, "npz", len(points), read, points.dtype)


def _column(arrays: Arrays, name: str, row: tuple[int, ...]) -> NDArray[Any]:
    values = arrays.map(name)
    is_plain = values.dtype.kind in _NUMBERS and values.dtype.itemsize <= 8
    if not is_plain or values.ndim != 1 + len(row) or values.shape[1:] != row:
        fix = f"np.asarray({name}, dtype=np.float64) of that shape"
        raise wrong_type(arrays.path, name, values, expected=_EXPECTED, fix=fix)
    return values


def open_npy(path: Path) -> FileCloud:
    """Open an npy file of points (N, 3), or of points with up to three columns more (N, 4 to 6)."""
    rows = map_numbers(path)
    if rows.ndim != 2 or not 3 <= rows.shape[1] <= 6 or rows.dtype.kind not in _NUMBERS:
        raise refusal(
            path,
            f"an array of {rows.dtype} and shape {rows.shape}",
            expected="points (N, 3), or with colours (N, 6), numbers of at most 64 bits",
            fix="np.save(file, np.asarray(points, dtype=np.float64))",
        )
    passed = rows.shape[1] - 3
    notes = (f"x y z from columns 1, 2, 3; {counted(passed, 'column')} passed over",)
    read = ArrayPieces(rows[:, :3])
    return FileCloud(path, "npy", len(rows), read, rows.dtype, notes if passed else ())

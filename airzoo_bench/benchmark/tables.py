"""Tables of a benchmark folder, read with the type that each column has.

What a column holds follows from its name, in whatever table it stands; columns with other names are
conditions (weather, time of day) and keep the type that they look like.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import BenchmarkError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read_table"]

_POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
_TEXTS = frozenset(("id", "image", "reason"))
_WHOLE = frozenset(("width", "height", "size_px", "crop_x", "crop_y", "crop_width", "crop_height"))
_NUMBERS = frozenset(
    (
        *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", *_POSE),
        *(f"prior_{name}" for name in _POSE),
        *("size_m", "lon_min", "lat_min", "lon_max", "lat_max", "footprint_lon", "footprint_lat"),
        *(f"anchor{i}_{axis}" for i in range(4) for axis in ("lon", "lat")),
    )
)
_LARGEST_WHOLE = 1 << 31
_LARGEST, _LARGEST_LON, _LARGEST_LAT = 1e9, 540.0, 90.0
_NAMED = 3
_SHOWN = 40
_FIX = "correct it, or prepare the benchmark again"


def read_table(path: Path, columns: Sequence[str], *, complete: Sequence[str] = ()) -> pd.DataFrame:
    """Read a CSV or parquet table of a scene.

    Parameters
    ----------
    path : Path
    columns : sequence of str
        Those that there must be.
    complete : sequence of str
        Those of them in which no number may be missing.

    Returns
    -------
    DataFrame
        Ids, names and reasons are text, sizes and windows int64, coordinates float64 rounded
        correctly (or the integers that a parquet file holds), NaN where nothing stands.

    Raises
    ------
    BenchmarkError
        The file is missing or damaged, lacks a column, or a value is none of its column's kind: the
        message names column, row and value.
    """
    import pandas as pd
    import pyarrow as pa

    if not path.is_file():
        raise BenchmarkError(
            "the benchmark folder has no truth here",
            where=path,
            fix="prepare the benchmark again; `check` needs no truth, `eval` does",
        )
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else _csv(path)
    except (ValueError, OSError, OverflowError, csv.Error, pa.ArrowException) as error:
        raise BenchmarkError(
            f"not a readable table: {(str(error) or type(error).__name__).splitlines()[0][:200]}",
            where=path,
            expected="a table in UTF-8" if path.suffix == ".csv" else None,
            fix="prepare the benchmark again",
        ) from error
    lacking = [name for name in columns if name not in table.columns]
    if lacking:
        raise BenchmarkError(
            f"lacks the columns {', '.join(lacking)}",
            where=path,
            expected=", ".join(columns),
            fix="prepare the benchmark again",
        )
    typed = table.assign(**{name: _typed(path, table[name]) for name in _known(table)})
    for name in complete:
        values = typed[name]
        _refuse(path, name, table[name].tolist(), values.isna().tolist(), "a number")
    return typed


def _csv(path: Path) -> pd.DataFrame:
    import pandas as pd

    as_text = dict.fromkeys((*_TEXTS, *_WHOLE, *_NUMBERS), str)
    with path.open(encoding="utf-8-sig", newline="") as stream:
        names = next(csv.reader(stream), [])
    missing = {name: ["nan", ""] for name in names if name not in _TEXTS}
    return pd.read_csv(
        path, dtype=as_text, keep_default_na=False, na_values=missing, low_memory=False
    )


def _typed(path: Path, column: pd.Series[Any]) -> pd.Series[Any]:
    """Return a column as what its name promises, or refuse the first values that are none."""
    import pandas as pd

    name, values = str(column.name), column.tolist()
    if name in _TEXTS:
        odd = [not (isinstance(v, str) and v and v.isprintable()) for v in values]
        _refuse(path, name, values, odd, "text that prints")
        if name == "id":
            _refuse(path, name, values, column.duplicated().tolist(), "each id once")
        return column.astype(str)
    numbers = np.array([_number(value) for value in values], np.float64)
    missing = np.array([_is_missing(value) for value in values], np.bool_)
    limit = _limit(name)
    wrong = ~(np.abs(numbers) <= limit) & ~missing
    _refuse(path, name, values, wrong.tolist(), f"a number, at most {limit:.12g} in size")
    if name in _NUMBERS and column.dtype.kind in "iu":
        return column
    if name in _NUMBERS:
        return pd.Series(numbers, column.index, name=name)
    wrong = ~((numbers == np.round(numbers)) & (np.abs(numbers) < _LARGEST_WHOLE))
    _refuse(path, name, values, wrong.tolist(), "a whole number")
    return pd.Series(numbers.astype(np.int64), column.index, name=name)


def _limit(name: str) -> float:
    """Return the largest size of a column's numbers: degrees are degrees, metres on this planet."""
    parts = name.split("_")
    if "lon" in parts or "lat" in parts:
        return _LARGEST_LON if "lon" in parts else _LARGEST_LAT
    return _LARGEST


def _number(value: object) -> float:
    """Return a cell as a number, NaN where it is none; Python rounds texts correctly."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return np.nan
    if isinstance(value, str) and "_" in value:
        return np.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return np.nan


def _is_missing(value: object) -> bool:
    return value is None or value != value


def _refuse(path: Path, name: str, values: list[Any], wrong: list[bool], expected: str) -> None:
    rows = [row for row, is_wrong in enumerate(wrong) if is_wrong]
    if rows:
        named = [f"row {row + 1}: {_shown(values[row])}" for row in rows[:_NAMED]]
        more = f" and {len(rows) - _NAMED} more" if len(rows) > _NAMED else ""
        raise BenchmarkError(
            f"column '{name}', {'; '.join(named)}{more}",
            where=path,
            expected=f"{expected} (rows are counted from 1, below the head)",
            fix=_FIX,
        )


def _shown(value: object) -> str:
    return "nothing" if _is_missing(value) else repr(value)[:_SHOWN]


def _known(table: pd.DataFrame) -> list[str]:
    return [name for name in table.columns if name in _TEXTS | _WHOLE | _NUMBERS]

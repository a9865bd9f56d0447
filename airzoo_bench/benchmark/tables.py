"""Tables of a benchmark folder, read with the type that each column has.

What a column holds follows from its name, in whatever table it stands; columns with other names are
conditions (weather, time of day) and keep the type that they look like, except for names of digits,
such as 007.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, readable
from airzoo_bench.geometry.arrays import Bools, Floats

_POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
_TEXTS = frozenset(("id", "image", "reason"))
_WHOLE = frozenset(("width", "height", "size_px", "crop_x", "crop_y", "crop_width", "crop_height"))
_NUMBERS = frozenset(
    (
        *("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", *_POSE),
        *(f"prior_{name}" for name in _POSE),
        *("size_m", "lon_min", "lat_min", "lon_max", "lat_max", "footprint_lon", "footprint_lat"),
        *(f"anchor{i}_{axis}" for i in range(4) for axis in ("lon", "lat")),
        *("image_lon", "image_lat", "image_x_m", "image_y_m"),
    )
)
_KNOWN = _TEXTS | _WHOLE | _NUMBERS
_LARGEST_WHOLE = 1 << 31
_LARGEST, _LARGEST_LON, _LARGEST_LAT = 1e9, 540.0, 90.0  # metres on this planet, and degrees
_NAMED = 3
_SHOWN = 40
_CODE = "^([+-]?0[0-9]|[0-9]+[eE][0-9]+$)"
_PLAIN = r"^-?[0-9]{1,20}(\.[0-9]{1,30})?(e[+-]?[0-9]{1,2})?$"
_AGAIN = "prepare the benchmark again"


def read_table(path: Path, columns: Sequence[str], *, complete: Sequence[str] = ()) -> pd.DataFrame:
    """Read a CSV or parquet table of a scene."""
    if not path.is_file():
        raise BenchmarkError(
            "the benchmark folder has no truth here",
            where=path,
            fix=f"{_AGAIN}; `check` needs no truth, `eval` does",
        )
    expected = "a table in UTF-8" if path.suffix == ".csv" else None
    with readable(path, "not a readable table", kind=BenchmarkError, expected=expected, fix=_AGAIN):
        table: Any = pd.read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
    typed = {
        name: _typed(path, name, table[name]) if name in _KNOWN else table[name] for name in table
    }
    # Each column keeps an array of its own: from one that methods see no other is reached.
    return require_columns(path, pd.DataFrame(typed, copy=False), columns, complete)


def require_columns(
    path: Path, table: pd.DataFrame, columns: Sequence[str], complete: Sequence[str]
) -> pd.DataFrame:
    """Return a table, unless it lacks columns, or numbers in those that must be complete."""
    lacking = [name for name in columns if name not in table]
    if lacking:
        what = f"lacks the columns {', '.join(lacking)}"
        raise BenchmarkError(what, where=path, expected=", ".join(columns), fix=_AGAIN)
    for name in complete:
        refuse_cells(path, name, table[name], table[name].isna().to_numpy(), "a number")
    return table


def _read_csv(path: Path) -> dict[str, Any]:
    """Return known columns as texts, others with the type that they look like, by name."""
    with path.open(encoding="utf-8-sig", newline="") as stream:
        names = next(csv.reader(stream), [])
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice:
        raise ValueError(f"the column {twice[0]!r} stands twice")
    kinds = dict.fromkeys(names, pa.large_string())
    texts = pacsv.ConvertOptions(column_types=kinds, null_values=[""], strings_can_be_null=True)
    one_thread, lines = pacsv.ReadOptions(use_threads=False), pacsv.ParseOptions
    found = pacsv.read_csv(path, one_thread, lines(newlines_in_values=True), texts)
    columns = {name: found[name].combine_chunks() for name in names}
    conditions = [name for name in names if name not in _KNOWN]
    likes = {name: pc.match_substring_regex(columns[name], _CODE) for name in conditions}
    codes = {name: str for name, like in likes.items() if pc.any(like, min_count=0).as_py()}
    if conditions:
        empty: dict[str, Any] = {"keep_default_na": False, "na_values": ["nan", ""]}
        columns |= pd.read_csv(path, usecols=conditions, dtype=codes, low_memory=False, **empty)
    return columns


def _typed(path: Path, name: str, column: Any) -> Any:
    """Return a column as its name promises, or refuse the first values that are not so."""
    if name in _TEXTS:
        values = np.asarray(column, object)
        odd = [not isinstance(v, str) or v == "" or not v.isprintable() for v in values]
        refuse_cells(path, name, values, np.array(odd, np.bool_), "text that prints")
        texts = pd.Series(values, dtype=str)
        if name == "id":
            refuse_cells(path, name, values, texts.duplicated().to_numpy(), "each id once")
        return texts
    numbers, missing = _numbers(column)
    parts = name.split("_")
    limit = _LARGEST_LON if "lon" in parts else _LARGEST_LAT if "lat" in parts else _LARGEST
    wrong = ~(np.abs(numbers) <= limit) & ~missing
    refuse_cells(path, name, column, wrong, f"a number, at most {limit:.12g} in size")
    if name in _NUMBERS:
        whole = isinstance(column, pd.Series) and column.dtype.kind in "iu"
        return column if whole else numbers
    wrong = ~((numbers == np.round(numbers)) & (np.abs(numbers) < _LARGEST_WHOLE))
    refuse_cells(path, name, column, wrong, "a whole number")
    return numbers.astype(np.int64)


def _numbers(column: Any) -> tuple[Floats, Bools]:
    """Return a column as numbers, NaN where a cell is none, and which cells are empty."""
    if isinstance(column, pd.Series):
        if isinstance(column.dtype, np.dtype) and column.dtype.kind in "iuf":
            numbers = column.to_numpy(np.float64)
            return numbers, np.isnan(numbers)
    elif pc.all(pc.match_substring_regex(column, _PLAIN), min_count=0).as_py():
        missing = column.is_null().to_numpy(zero_copy_only=False)
        return np.array(column.cast(pa.float64())), missing
    values = column.tolist()
    missing = np.array([_is_missing(value) for value in values], np.bool_)
    return np.array([_number(value) for value in values], np.float64), missing


def _number(value: object) -> float:
    """Return a cell as a number, NaN where it is none; Python rounds texts correctly."""
    is_number = isinstance(value, int | float | str) and not isinstance(value, bool)
    try:
        return np.nan if not is_number or "_" in str(value) else float(value)  # type: ignore[arg-type]
    except (ValueError, OverflowError):
        return np.nan


def _is_missing(value: object) -> bool:
    return value is None or value != value or value == "nan"


def refuse_cells(
    path: Path,
    name: str,
    values: Sequence[Any] | NDArray[Any] | pd.Series[Any],
    wrong: Bools,
    expected: str,
    ids: Sequence[str] = (),
) -> None:
    """Refuse the values of a column that are wrong, if any is."""
    rows = np.flatnonzero(wrong).tolist()
    if not rows:
        return
    values, named = np.asarray(values, object), []
    for row in rows[:_NAMED]:
        whose = f" ({ids[row]})" if ids else ""
        value = "nothing" if _is_missing(values[row]) else repr(values[row])[:_SHOWN]
        named.append(f"row {row + 1}{whose}: {value}")
    more = f" and {len(rows) - _NAMED} more" if len(rows) > _NAMED else ""
    raise BenchmarkError(
        f"column '{name}', {'; '.join(named)}{more}",
        where=path,
        expected=f"{expected} (rows are counted from 1, below the head)",
        fix=f"correct it, or {_AGAIN}",
    )

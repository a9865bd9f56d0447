"""Files of flights, CSV and JSON, that people write by hand and with other tools: hostile input."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import SAFE_NAME, nearest
from airzoo_bench.datasets.mini.flights.trajectory import Trajectory, rounded
from airzoo_bench.datasets.mini.rendering.weather import TIMES, WEATHERS
from airzoo_bench.geometry.arrays import Floats

__all__ = ["read_trajectory", "write_trajectory"]

_BOUNDS = {
    "longitude": (-180.0, 180.0),
    "latitude": (-90.0, 90.0),
    "altitude": (-math.inf, math.inf),
    "roll": (-180.0, 180.0),
    "pitch": (-90.0, 90.0),
    "yaw": (-360.0, 360.0),
    "time": (-math.inf, math.inf),
}
_FIXES = {
    "latitude": "where it is the longitude, exchange the two columns",
    "pitch": "pitch is 0 at the horizon and -90 straight down",
}
_WORDS: dict[str, tuple[str, ...]] = {"weather": WEATHERS, "time_of_day": TIMES}
_TEXTS = ("name", *_WORDS)
_COLUMNS = f"{', '.join(_BOUNDS)}; if wanted also {', '.join(_TEXTS)}"
_JSON_FORM = '{"frames": [{"longitude": 113.0, "latitude": 28.2, ...}, ...]}'

_MOST_ROWS = 200_000
_LIMIT_BYTES = 64 << 20
_SHOWN_CELL = 30
# Python's own float() also takes 1_000 and digits of other scripts.
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)


@dataclass(frozen=True)
class _Table:
    """The cells of a file, not yet understood; labels are what messages call the rows."""

    path: Path
    labels: Sequence[str]
    columns: dict[str, list[Any]]

    def fault(self, what: str, **hints: str | None) -> CameraError:
        """Return what is wrong with the file."""
        return CameraError(what, where=self.path, **hints)

    def refuse(
        self, bad: ArrayLike, what: str, cells: Sequence[object] | None = None, **hints: str | None
    ) -> None:
        """Raise CameraError where any row is bad: how many, the first three with their cells."""
        rows = np.flatnonzero(np.asarray(bad, dtype=np.bool_)).tolist()
        if rows:
            shown = [
                self.labels[row] if cells is None else f"{self.labels[row]}: {_shown(cells[row])}"
                for row in rows
            ]
            named = first_of(shown, len(self.labels))
            raise self.fault(f"{what} in {named}", **hints)

    def numbers(self, column: str) -> Floats:
        """Return a column as finite numbers within its bounds."""
        cells, (low, high) = self.columns[column], _BOUNDS[column]
        values = np.array([_number(cell) for cell in cells], dtype=np.float64)
        fix = "write it in digits, as in 113.25"
        self.refuse(~np.isfinite(values), f"{column} is not a finite number", cells, fix=fix)
        self.refuse(
            (values < low) | (values > high),
            f"{column} is out of bounds",
            [f"{value:g}" for value in values],
            expected=f"degrees from {low:g} to {high:g}",
            fix=_FIXES.get(column),
        )
        return values

    def texts(self, column: str) -> tuple[str, ...]:
        """Return a column as text."""
        cells = self.columns[column]
        bad = [not isinstance(cell, str) for cell in cells]
        self.refuse(bad, f"{column} is not text", cells, fix='put it in quotes, as in "sunny"')
        return tuple(cells)


def read_trajectory(path: Path) -> Trajectory:
    """Read a flight from CSV, a frame a line, or JSON, a list of objects under ``frames``.

    Columns, or keys: longitude, latitude, altitude, roll, pitch, yaw, time; if wanted name (by
    default the row's number, from 000000), weather, time_of_day. Others are left aside.

    Raises
    ------
    CameraError
        No such file, too large, not UTF-8, not CSV or JSON, no rows, too many, ragged rows, a
        column is missing or mistyped; and values that cannot be: not finite, out of bounds,
        longitude and latitude swapped, times that do not ascend, names that are no names of files
        or stand twice, an unknown weather or time of day. Rows are named by their line.
    """
    read = _read_json if _is_json(path) else _read_csv
    text = read_text(path, CameraError, "trajectory file", _LIMIT_BYTES).removeprefix("\ufeff")
    table = read(path, text)
    if not table.labels:
        raise table.fault("holds no frame", expected="a row a frame")
    numbers = {name: table.numbers(name) for name in _BOUNDS}
    time_s = numbers["time"]
    table.refuse(
        np.append(False, np.diff(time_s) <= 0.0),
        "time does not ascend",
        [f"{value:.15g}" for value in time_s],
        expected="seconds, each later than the one before",
        fix="sort the frames by time, and keep one of each time",
    )
    return Trajectory(
        names=_names(table),
        time_s=time_s,
        lonlat=np.stack((numbers["longitude"], numbers["latitude"]), axis=-1),
        altitude_m=numbers["altitude"],
        roll_deg=numbers["roll"],
        pitch_deg=numbers["pitch"],
        yaw_deg=numbers["yaw"],
        **{column: _words(table, column) for column in _WORDS},
    )


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a flight as .csv or .json, which is its ending, with the digits of `rounded`."""
    is_json, flight = _is_json(path), rounded(trajectory)
    texts = zip(_TEXTS, (flight.names, flight.weather, flight.time_of_day), strict=True)
    cells: dict[str, Any] = {name: values for name, values in texts if values is not None}
    angles = (flight.roll_deg, flight.pitch_deg, flight.yaw_deg)
    numbers = (*flight.lonlat.T, flight.altitude_m, *angles, flight.time_s)
    cells |= {name: values.tolist() for name, values in zip(_BOUNDS, numbers, strict=True)}
    rows = zip(*cells.values(), strict=True)
    with atomic_write(path, "w") as stream:
        if is_json:
            frames = [dict(zip(cells, row, strict=True)) for row in rows]
            stream.write(json.dumps({"frames": frames}, indent=1, allow_nan=False) + "\n")
        else:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(cells)
            writer.writerows(rows)


def _is_json(path: Path) -> bool:
    """Say whether a file's ending calls it JSON, not CSV; it may call it nothing else."""
    ending = path.suffix.lower()
    if ending not in (".csv", ".json"):
        found = f"ends in {path.suffix!r}" if ending else "has no ending"
        raise CameraError(
            f"{found}, so that its format is not known",
            where=path,
            expected="a trajectory in .csv or .json",
            fix="name it by its format",
        )
    return ending == ".json"


def _read_csv(path: Path, text: str) -> _Table:
    labels: list[str] = []
    rows: list[list[str]] = []
    table = _Table(path, labels, {})
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        _check_columns(table, header)
        for row in filter(None, reader):
            _check_count(table, len(rows) + 1)
            rows.append(row)
            labels.append(f"line {reader.line_num}")
    except csv.Error as error:
        what = f"line {reader.line_num} is not CSV: {error}"
        raise table.fault(what, expected="fields with commas") from error
    table.refuse(
        [len(row) != len(header) for row in rows],
        "another number of cells than the header's",
        [f"{len(row)} cells" for row in rows],
        expected=f"{len(header)} cells a row",
        fix="a decimal comma must be a point",
    )
    return _Table(path, labels, {name: [row[k] for row in rows] for k, name in enumerate(header)})


def _read_json(path: Path, text: str) -> _Table:
    table = _Table(path, (), {})
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter of values nested too deep
        raise table.fault(f"not valid JSON: {error}", expected=_JSON_FORM) from error
    frames = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(frames, list):
        hint = nearest("frames", [str(key) for key in data]) if isinstance(data, dict) else ""
        raise table.fault(f'has no list "frames"{hint}', expected=_JSON_FORM)
    _check_count(table, len(frames))
    table = _Table(path, [f"frames[{k}]" for k in range(len(frames))], {})
    no_object = [not isinstance(frame, dict) for frame in frames]
    table.refuse(no_object, "no object", expected=_JSON_FORM)
    given = list(dict.fromkeys(key for frame in frames for key in frame))
    if frames:
        _check_columns(table, given)
    known = [name for name in (*_BOUNDS, *_TEXTS) if name in given]
    for name in known:
        lacking = [name not in frame for frame in frames]
        table.refuse(lacking, f"{name} is missing", fix="give it in every frame, or in none")
    return _Table(path, table.labels, {name: [frame[name] for frame in frames] for name in known})


def _check_columns(table: _Table, given: list[str]) -> None:
    """Refuse missing, doubled and mistyped columns; those of other tools are left aside."""
    if len(given) <= 1 and any(mark in "".join(given) for mark in ";\t"):
        raise table.fault("its columns are not parted by commas", expected=_COLUMNS)
    others = [name for name in given if name not in _BOUNDS]
    missing = [f"{name}{nearest(name, others)}" for name in _BOUNDS if name not in given]
    if missing:
        raise table.fault(
            f"no column {', '.join(missing)}",
            expected=_COLUMNS,
            fix="name the columns so in the first line, or the keys of the frames",
        )
    doubled = sorted(name for name, count in Counter(filter(None, given)).items() if count > 1)
    if doubled:
        raise table.fault(f"columns more than once: {first_of(doubled)}", expected="each once")
    absent = [name for name in _TEXTS if name not in given]
    for name in others:
        hint = nearest(name, absent)
        if name not in _TEXTS and hint:
            raise table.fault(f"unknown column {_shown(name)}{hint}", expected=_COLUMNS)


def _check_count(table: _Table, count: int) -> None:
    if count > _MOST_ROWS:
        expected = f"at most {_MOST_ROWS:,}"
        what, fix = f"more than {_MOST_ROWS:,} frames", "thin it, or split it into several files"
        raise table.fault(what, expected=expected, fix=fix)


def _names(table: _Table) -> tuple[str, ...]:
    if "name" not in table.columns:
        return tuple(f"{row:06d}" for row in range(len(table.labels)))
    names = table.texts("name")
    table.refuse(
        [re.fullmatch(SAFE_NAME, name) is None for name in names],
        "name cannot be that of a file",
        names,
        expected="a letter or digit, then at most 63 of letters, digits, '.', '_' and '-'",
    )
    # Some disks do not tell capitals from small letters.
    count = Counter(name.casefold() for name in names)
    table.refuse(
        [count[name.casefold()] > 1 for name in names],
        "name stands more than once",
        names,
        expected="each once, whether in capitals or small letters",
    )
    return names


def _words(table: _Table, column: str) -> tuple[str, ...] | None:
    if column not in table.columns:
        return None
    words, known = table.texts(column), _WORDS[column]
    bad = [word not in known for word in words]
    table.refuse(bad, f"unknown {column}", words, expected=f"one of {', '.join(known)}")
    return words


def _number(cell: object) -> float:
    """Return the number in a cell; NaN where there is none."""
    if isinstance(cell, str):
        return float(cell) if _NUMBER.fullmatch(cell) else math.nan
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        return math.nan
    try:
        return float(cell)
    except OverflowError:
        return math.inf


def _shown(cell: object) -> str:
    text = repr(cell)
    return text if len(text) <= _SHOWN_CELL else text[: _SHOWN_CELL - 3] + "..."

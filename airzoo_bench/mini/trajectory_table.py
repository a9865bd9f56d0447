"""Trajectory files as hostile input: CSV and JSON into columns, mistakes into messages."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["MAX_ROWS", "NUMBERS", "TEXTS", "TrajectoryTable", "read_table"]

NUMBERS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw", "time")
TEXTS = ("name", "weather", "time_of_day")

MAX_ROWS = 200_000
_LIMIT_BYTES = 64 << 20
_LONGEST_LINE = 10_000
_SHOWN_CELL = 30
# Python's own float() also takes 1_000 and digits of other scripts.
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)


@dataclass(frozen=True)
class TrajectoryTable:
    """The cells of a trajectory file, not yet understood.

    Attributes
    ----------
    path : Path
    labels : sequence of str
        What messages call the rows: ``"line 5"``, ``"frames[3]"``.
    columns : dict of str to list
        A value a row; text in CSV, anything in JSON.
    """

    path: Path
    labels: Sequence[str]
    columns: dict[str, list[Any]]

    def __len__(self) -> int:
        return len(self.labels)

    def numbers(self, column: str) -> Floats:
        """Return a column as finite numbers (N,).

        Raises
        ------
        CameraError
            Cells that are no number, or NaN or infinite; the first three rows are named.
        """
        cells = self.columns[column]
        values = np.array([_number(cell) for cell in cells], dtype=np.float64)
        self.refuse(
            ~np.isfinite(values),
            f"{column} is not a finite number",
            cells,
            mend="write it in digits, as in 113.25",
        )
        return values

    def texts(self, column: str) -> tuple[str, ...]:
        """Return a column as text.

        Raises
        ------
        CameraError
            Cells of a JSON file that are no text.
        """
        cells = self.columns[column]
        bad = np.array([not isinstance(cell, str) for cell in cells])
        self.refuse(bad, f"{column} is not text", cells, mend='put it in quotes, as in "sunny"')
        return tuple(cells)

    def refuse(
        self,
        bad: Bools,
        what: str,
        cells: Sequence[object] | None = None,
        *,
        expected: str | None = None,
        mend: str | None = None,
    ) -> None:
        """Raise CameraError where any row is bad: how many, the first three with their cells."""
        rows = np.flatnonzero(bad).tolist()
        if rows:
            shown = [
                self.labels[row] if cells is None else f"{self.labels[row]}: {_shown(cells[row])}"
                for row in rows
            ]
            named = first_of(shown, len(self))
            raise CameraError(f"{what} in {named}", where=self.path, expected=expected, mend=mend)


def read_table(path: Path) -> TrajectoryTable:
    """Read the columns of a trajectory file, which its ending calls CSV or JSON.

    Raises
    ------
    CameraError
        No such file, too large, not UTF-8, not CSV or JSON, no rows, too many, ragged rows, a
        column is missing or mistyped.
    """
    kinds = {".csv": _read_csv, ".json": _read_json}
    reader = kinds.get(path.suffix.lower())
    if reader is None:
        raise CameraError(
            f"ends in {path.suffix!r}, so that its format is not known"
            if path.suffix
            else "has no ending, so that its format is not known",
            where=path,
            expected="a trajectory in .csv or .json",
            mend="name it by its format",
        )
    text = read_text(path, CameraError, "trajectory file", _LIMIT_BYTES).removeprefix("\ufeff")
    table = reader(path, text)
    if not len(table):
        _refuse(path, "holds no frame", expected="a row a frame")
    return table


def _read_csv(path: Path, text: str) -> TrajectoryTable:
    reader = csv.reader(_lines(path, text), strict=True)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        _check_columns(path, header)
        rows: list[list[str]] = []
        labels: list[str] = []
        for row in reader:
            if row:
                _check_count(path, len(rows) + 1)
                rows.append(row)
                labels.append(f"line {reader.line_num}")
    except csv.Error as error:
        _refuse(path, f"line {reader.line_num} is not CSV: {error}", expected="fields with commas")
    _check_widths(path, rows, labels, len(header))
    columns = {name: [row[k] for row in rows] for k, name in enumerate(header)}
    return TrajectoryTable(path, labels, columns)


def _lines(path: Path, text: str) -> Iterator[str]:
    for number, line in enumerate(io.StringIO(text, newline=""), start=1):
        if len(line) > _LONGEST_LINE:
            _refuse(
                path,
                f"line {number} has {len(line):,} characters",
                expected=f"a frame a line, at most {_LONGEST_LINE:,}",
            )
        yield line


def _check_widths(path: Path, rows: list[list[str]], labels: list[str], width: int) -> None:
    table = TrajectoryTable(path, labels, {})
    table.refuse(
        np.array([len(row) != width for row in rows], dtype=bool),
        "another number of cells than the header's",
        [f"{len(row)} cells" for row in rows],
        expected=f"{width} cells a row",
        mend="a decimal comma must be a point",
    )


def _read_json(path: Path, text: str) -> TrajectoryTable:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter of values nested too deep
        _refuse(path, f"not valid JSON: {error}", expected=_json_form())
    frames = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(frames, list):
        known = list(data) if isinstance(data, dict) else []
        near = nearest("frames", [str(key) for key in known])
        _refuse(path, f'has no list "frames"{near}', expected=_json_form())
    _check_count(path, len(frames))
    labels = [f"frames[{k}]" for k in range(len(frames))]
    table = TrajectoryTable(path, labels, {})
    table.refuse(
        np.array([not isinstance(frame, dict) for frame in frames], dtype=bool),
        "no object",
        expected=_json_form(),
    )
    return TrajectoryTable(path, labels, _columns(table, frames))


def _columns(table: TrajectoryTable, frames: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Turn objects into columns; a key is there in all of them or in none."""
    given = list(dict.fromkeys(key for frame in frames for key in frame))
    if frames:
        _check_columns(table.path, given)
    known = [name for name in (*NUMBERS, *TEXTS) if name in given]
    for name in known:
        lacking = np.array([name not in frame for frame in frames], dtype=bool)
        table.refuse(lacking, f"{name} is missing", mend="give it in every frame, or in none")
    return {name: [frame[name] for frame in frames] for name in known}


def _check_columns(path: Path, given: list[str]) -> None:
    """Refuse missing, doubled and mistyped columns; those of other tools are left aside."""
    expected = f"{', '.join(NUMBERS)}; if wanted also {', '.join(TEXTS)}"
    if len(given) <= 1 and any(mark in "".join(given) for mark in ";\t"):
        _refuse(path, "its columns are not parted by commas", expected=expected)
    missing = [name for name in NUMBERS if name not in given]
    if missing:
        offered = [
            f"{name}{nearest(name, [g for g in given if g not in NUMBERS])}" for name in missing
        ]
        _refuse(
            path,
            f"no column {', '.join(offered)}",
            expected=expected,
            mend="name the columns so in the first line, or the keys of the frames",
        )
    doubled = sorted({name for name in given if given.count(name) > 1 and name})
    if doubled:
        _refuse(path, f"columns more than once: {first_of(doubled)}", expected="each once")
    absent = [name for name in TEXTS if name not in given]
    for name in given:
        hint = nearest(name, absent)
        if name not in (*NUMBERS, *TEXTS) and hint:
            _refuse(path, f"unknown column {_shown(name)}{hint}", expected=expected)


def _check_count(path: Path, count: int) -> None:
    if count > MAX_ROWS:
        _refuse(
            path,
            f"more than {MAX_ROWS:,} frames",
            expected=f"at most {MAX_ROWS:,}",
            mend="thin it, or split it into several files",
        )


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


def _json_form() -> str:
    return '{"frames": [{"longitude": 113.0, "latitude": 28.2, ...}, ...]}'


def _refuse(path: Path, what: str, *, expected: str, mend: str | None = None) -> NoReturn:
    raise CameraError(what, where=path, expected=expected, mend=mend)

"""What commands print of results, read back and held to the results."""

from __future__ import annotations

import csv
import html
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.result import ScoreColumn
from tests.cli.results_of_all_tracks import NAMES, Scored

FORMATS = ("terminal", "latex", "csv", "markdown", "html", "json")
WIDE, NARROW = 250, 80


def strict_json(text: str) -> Any:
    """Read JSON as the standard has it: without NaN and Infinity."""

    def refuse(constant: str) -> NoReturn:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


@dataclass(frozen=True)
class Grid:
    """A printed table: cells by the column's name, group before title."""

    columns: tuple[str, ...]
    rows: tuple[Mapping[str, Any], ...]

    def column(self, name: str) -> list[Any]:
        return [row[name] for row in self.rows]

    def where(self, **cells: Any) -> Grid:
        """Return the rows that have these cells."""
        kept = [row for row in self.rows if cells.items() <= row.items()]
        return Grid(self.columns, tuple(kept))

    def one(self, **cells: Any) -> Mapping[str, Any]:
        (row,) = self.where(**cells).rows
        return row


def json_grid(text: str) -> Grid:
    table = strict_json(text)
    names = tuple(f"{c.get('group', '')} {c['title']}".strip() for c in table["columns"])
    return Grid(names, tuple(dict(zip(names, row, strict=True)) for row in table["rows"]))


def csv_grid(text: str) -> Grid:
    names, *rows = csv.reader(io.StringIO(text))
    return Grid(tuple(names), tuple(dict(zip(names, row, strict=True)) for row in rows))


def number(cell: Any) -> float | None:
    """Return a cell's number, infinite ones too, or None where it has none."""
    try:
        return None if isinstance(cell, bool) or cell is None else float(cell)
    except ValueError:
        return None


def plain(text: str, form: str) -> str:
    """Return a table's words without the marks and escapes of its format."""
    if form == "latex":
        text = text.replace(r"$-$", "-").replace(r"$^\circ$", "°").replace("{[}", "[")
        text = re.sub(r"\\(?:textbf|underline|multicolumn\{\d+\}\{\w\})\{([^{}]*)\}", r"\1", text)
    if form in ("latex", "markdown"):
        text = re.sub(r"\\(\W|_)", r"\1", text).replace("**", "")
    if form == "html":
        text = re.sub(r"<[^>]*>", " ", text)
    if form in ("html", "markdown"):
        text = html.unescape(text)
    if form == "json":
        text = json.dumps(strict_json(text), ensure_ascii=False)
    return " ".join(text.split())


def shown_numbers(text: str) -> list[str]:
    """Return numbers of two decimals, in order, as all formats print scores."""
    return re.findall(r"(?<![\w.])-?\d+\.\d\d(?![\d%])", text)


def says_not_a_number(text: str) -> bool:
    return re.search(r"\bnan\b", text, re.IGNORECASE) is not None


@dataclass(frozen=True)
class Said:
    """What a command printed."""

    out: str
    err: str


def check_cell(exact: Any, shown: str) -> None:
    """Hold what CSV prints to the number that JSON holds."""
    value = number(exact)
    if value is None:
        return
    printed = float(shown)
    digits = len(shown.partition(".")[2]) if "e" not in shown else 17
    assert printed == value or abs(printed - value) <= 0.5 * 10.0**-digits + 1e-9


def as_shown(column: ScoreColumn, value: float) -> float:
    return value * 100 if column.unit == "share" else value


def with_unit(column: ScoreColumn) -> str:
    return f"{column.title} [{'%' if column.unit == 'share' else column.unit}]"


def same(one: Any, other: float) -> bool:
    found = number(one)
    return found is not None and (found == other or bool(np.isclose(found, other, rtol=1e-9)))


def conditions(scored: Scored) -> list[str]:
    """Return the columns that are conditions; a scene of reconstruction has its counts only."""
    records = scored.records[NAMES[0]]
    if scored.track == "reconstruction":
        return ["scene", "answered", "points"]
    known = ("altitude_m", "pitch_deg", "weather", "time_of_day", "sequence")
    return ["scene", *(name for name in known if name in records.columns)]


Run = Callable[..., Said]


def read_json(run: Run, *ask: object) -> Grid:
    """Return what a command prints as JSON."""
    return json_grid(run(*ask, "--format", "json").out)


def check_formats(run: Run, *ask: object) -> Grid:
    """Hold all formats to the JSON, which is returned."""
    printed = {form: run(*ask, "--format", form).out for form in FORMATS}
    exact, shown = json_grid(printed["json"]), csv_grid(printed["csv"])
    assert set(exact.columns) <= set(shown.columns)
    assert len(exact.rows) == len(shown.rows)
    for exact_row, shown_row in zip(exact.rows, shown.rows, strict=True):
        for name in exact.columns:
            check_cell(exact_row[name], shown_row[name])
    numbers = [text for row in shown.rows for cell in row.values() for text in shown_numbers(cell)]
    narrow = run(*ask, "--format", "terminal", width=NARROW).out
    for form, out in (*printed.items(), ("terminal", narrow)):
        text = plain(out, form)
        if form != "json":
            missing = pd.Series(shown_numbers(text)).value_counts()
            wanted = pd.Series(numbers).value_counts()
            assert (missing.reindex(wanted.index, fill_value=0) >= wanted).all(), (form, text)
        for row in exact.rows:
            for name in exact.columns[:2]:
                if number(row[name]) is None and row[name]:
                    assert " ".join(row[name].split()) in text, (form, text)
    return exact


def check_gains(printed: Grid, title: str) -> None:
    """Hold gains over the first row to the difference of the printed values."""
    baseline, *values = (float(cell) for cell in printed.column(title))
    if not np.isfinite(baseline):
        assert f"{title} gain" not in printed.columns
        return
    _, *gains = printed.column(f"{title} gain")
    for value, gain in zip(values, gains, strict=True):
        assert float(gain) == pytest.approx(value - baseline, abs=1e-9)

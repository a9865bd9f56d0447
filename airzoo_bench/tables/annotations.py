"""Marks on a table of methods: gains over a baseline, coloured rows, citations."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest, read_toml
from airzoo_bench.tables.model import Cell, Row, Table

__all__ = [
    "BY_NAME",
    "add_citations",
    "add_gains",
    "cite",
    "highlight",
    "parse_baselines",
    "row_named",
    "sort_rows",
    "with_decimals",
]

BY_NAME = "method"
"""What rows are sorted by instead of a score, to be in the order of their names."""

_KEYS = re.compile(r"[A-Za-z0-9][A-Za-z0-9:._/+-]*(,[A-Za-z0-9][A-Za-z0-9:._/+-]*)*")


def with_decimals(table: Table, decimals: int) -> Table:
    """Show so many digits behind the point of every score."""
    columns = (
        column if column.higher_is_better is None else replace(column, decimals=decimals)
        for column in table.columns
    )
    return replace(table, columns=tuple(columns))


def sort_rows(table: Table, title: str, average: str) -> Table:
    """Put the best rows of a score on top, or all in the order of their names; floors stay last."""
    if title == BY_NAME:
        rows = sorted(table.rows, key=lambda row: (row.floor, str(row.cells[0].value).casefold()))
        return replace(table, rows=tuple(rows))
    places = [i for i, column in enumerate(table.columns) if column.title == title]
    place = min(places, key=lambda i: table.columns[i].group != average)
    sign = -1 if table.columns[place].higher_is_better else 1

    def rank(row: Row) -> tuple[bool, int, float]:
        value = row.cells[place].value
        if not isinstance(value, float):
            return row.floor, 2, 0.0
        return row.floor, int(math.isinf(value)), sign * value

    return replace(table, rows=tuple(sorted(table.rows, key=rank)))


def highlight(table: Table, methods: Sequence[str]) -> Table:
    """Set rows on a coloured ground."""
    chosen = {row_named(table, name, "--highlight") for name in methods}
    rows = (replace(row, highlighted=i in chosen) for i, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))


def parse_baselines(table: Table, given: Sequence[str]) -> dict[int, int]:
    """Find whose gain over whom is asked for."""
    found: dict[int, int] = {}
    for text in given:
        for row, baseline in _pairs(table, text):
            if found.setdefault(row, baseline) != baseline:
                name = table.rows[row].cells[0].value
                raise UsageError(f"{name} has two baselines", where=f"--baseline {text[:80]}")
    return found


def _pairs(table: Table, text: str) -> list[tuple[int, int]]:
    names = {str(row.cells[0].value) for row in table.rows}
    # A name may itself hold the sign.
    splits = [(text[:i], text[i + 1 :]) for i, c in enumerate(text) if c == "="]
    fitting = [pair for pair in splits if names.issuperset(pair)]
    if text not in names and fitting:
        method, baseline = (row_named(table, name, "--baseline") for name in fitting[0])
        return [(method, baseline)]
    baseline = row_named(table, text, "--baseline")
    chosen = [i for i, row in enumerate(table.rows) if row.highlighted]
    own = [i for i, row in enumerate(table.rows) if row.is_own]
    return [(row, baseline) for row in chosen or own or range(len(table.rows)) if row != baseline]


def add_gains(table: Table, baselines: Mapping[int, int]) -> Table:
    """Write the gains of rows over their baselines next to the values."""
    rows = list(table.rows)
    for number, baseline in baselines.items():
        pairs = zip(table.rows[number].cells, table.rows[baseline].cells, strict=True)
        gains = [
            _gain(*pair, column.decimals) if column.higher_is_better is not None else None
            for pair, column in zip(pairs, table.columns, strict=True)
        ]
        cells = zip(rows[number].cells, gains, strict=True)
        rows[number] = replace(
            rows[number], cells=tuple(replace(cell, gain=gain) for cell, gain in cells)
        )
    over = [table.rows[baseline] for baseline in baselines.values()]
    notes = dict.fromkeys(map(_gain_note, over))
    return replace(
        table,
        rows=tuple(rows),
        notes=(*table.notes, *notes),
        legend=(*table.legend, *notes),
    )


def _gain(cell: Cell, baseline: Cell, decimals: int) -> float | None:
    if not (_is_printed(cell) and _is_printed(baseline)):
        return None
    difference = float(cell.text(decimals)) - float(baseline.text(decimals))
    return round(difference, decimals) + 0.0


def _is_printed(cell: Cell) -> bool:
    """Whether a cell shows its number in digits."""
    return isinstance(cell.value, float) and math.isfinite(cell.value) and not cell.is_too_small


def _gain_note(baseline: Row) -> str:
    reported = ", whose numbers are reported, not re-scored" if baseline.reported else ""
    name = baseline.cells[0].value
    return f"in brackets: difference from {name}{reported}, of the values as printed"


def cite(table: Table, keys: Mapping[str, str], *, names_must_exist: bool = False) -> Table:
    """Attach citations to the rows of methods; LaTeX prints them."""
    names = [str(row.cells[0].value) for row in table.rows]
    keys = {name: ",".join(map(str.strip, key.split(","))) for name, key in keys.items()}
    for name, key in keys.items():
        if not _KEYS.fullmatch(key):
            raise UsageError(
                f"{key[:80]!r} is no citation key",
                where=f"--cite, {name[:80]}",
                expected="letters a to z, digits, and behind the first any of : . _ / + -",
            )
        if names_must_exist and name not in names:
            raise _unknown(name, names, "--cite")
    rows = (
        replace(row, cells=(replace(row.cells[0], cite=keys.get(name, "")), *row.cells[1:]))
        for row, name in zip(table.rows, names, strict=True)
    )
    return replace(table, rows=tuple(rows))


def row_named(table: Table, name: str, option: str) -> int:
    """Return the row of a method; one that was scored here goes before a reported one."""
    names = [str(row.cells[0].value) for row in table.rows]
    found = [i for i, own in enumerate(names) if own == name]
    own = [i for i in found if not table.rows[i].reported] or found
    if not own:
        raise _unknown(name, names, option)
    if len(own) > 1:
        raise UsageError(
            f"{len(own)} rows are called {name[:80]!r}",
            where=option,
            expected="a name that one row has",
            fix="give results different names with `airzoo-bench eval ... --method NAME`",
        )
    return own[0]


def _unknown(name: str, names: list[str], option: str) -> UsageError:
    return UsageError(
        f"no row is called {name[:80]!r}{nearest(name[:80], names)}",
        where=option,
        expected="one of " + ", ".join(names[:20]),
    )


def add_citations(
    table: Table, given: Sequence[str], sources: Mapping[str, Mapping[str, str]]
) -> Table:
    """Attach citations; what is given later goes before what was given earlier."""
    keys: dict[str, str] = {}
    named: dict[str, str] = {}
    for text in given:
        method, sign, key = text.rpartition("=")
        if text.endswith(".toml"):
            keys |= _read(Path(text))
        elif text in sources:
            keys |= sources[text]
        elif sign and method:
            named[method] = key
        else:
            raise UsageError(
                f"--cite {text[:80]!r} is no citation",
                expected="METHOD=KEY, a .toml file, or one of " + ", ".join(sources),
            )
    cite(table, named, names_must_exist=True)
    return cite(table, keys | named)


def _read(path: Path) -> dict[str, str]:
    content = read_toml(path, UsageError, "file of citations")
    found = content.get("citations", content)
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found.values()):
        raise UsageError(
            "holds something else than citation keys",
            where=path,
            expected='a line such as "MegaLoc" = "berton2025megaloc" for each method',
        )
    return found

"""Marks on a table: the best values, gains over a baseline, coloured rows, citations."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest, read_toml
from airzoo_bench.tables.model import Cell, Column, Row, Table

_KEYS = re.compile(r"[A-Za-z0-9][A-Za-z0-9:._/+-]*(,[A-Za-z0-9][A-Za-z0-9:._/+-]*)*")


def mark_best(table: Table, *, second: bool = False) -> Table:
    """Mark the best cell of each score, and every cell that is shown with the same digits.

    Reported rows compete only where no row was scored here; a note says so.
    """
    own = [i for i, row in enumerate(table.rows) if row.is_own]
    racing = own or [i for i, row in enumerate(table.rows) if not row.floor]
    rows = [list(row.cells) for row in table.rows]
    for index, column in enumerate(table.columns):
        if column.higher_is_better is not None:
            cells = mark_cells(column, [rows[i][index] for i in racing], second=second)
            for i, cell in zip(racing, cells, strict=True):
                rows[i][index] = cell
    marked = [replace(row, cells=tuple(new)) for row, new in zip(table.rows, rows, strict=True)]
    rule = []
    if own and any(row.reported for row in table.rows):
        rule = ["the best of each score is that of the rows that were scored here"]
    notes, legend = (*rule, *table.notes), (*rule, *table.legend)
    return replace(table, rows=tuple(marked), notes=notes, legend=legend)


def mark_cells(column: Column, cells: Sequence[Cell], *, second: bool = False) -> list[Cell]:
    """Mark the best of several cells of a score, and the second best where it is asked for."""
    several = sum(isinstance(cell.value, float) for cell in cells) > 1
    ranked = best_texts(column, cells) if several else []
    best, runner_up = ranked[:1], ranked[1:2] if second else []
    texts = [cell.text(column.decimals) for cell in cells]
    return [
        replace(cell, best=text in best, second=text in runner_up)
        for cell, text in zip(cells, texts, strict=True)
    ]


def best_texts(column: Column, cells: Sequence[Cell]) -> list[str]:
    """Return the different texts of a column's finite numbers, the best first."""
    numbers = [c for c in cells if isinstance(c.value, float) and math.isfinite(c.value)]
    better = bool(column.higher_is_better)
    ordered = sorted(numbers, key=lambda cell: float(cell.value or 0), reverse=better)
    return list(dict.fromkeys(cell.text(column.decimals) for cell in ordered))


def with_decimals(table: Table, decimals: int) -> Table:
    """Show `decimals` digits behind the point of every score."""
    columns = (
        column if column.higher_is_better is None else replace(column, decimals=decimals)
        for column in table.columns
    )
    return replace(table, columns=tuple(columns))


def highlight(table: Table, methods: Sequence[str]) -> Table:
    """Set rows on a coloured ground."""
    chosen = {find_row(table, name, "--highlight") for name in methods}
    rows = (replace(row, highlighted=i in chosen) for i, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))


def find_row(table: Table, name: str, option: str) -> int:
    """Return the row of a method; one that was scored here goes before a reported one."""
    found = [i for i, row in enumerate(table.rows) if row.name == name]
    own = [i for i in found if not table.rows[i].reported] or found
    if len(own) != 1:
        names = [row.name for row in table.rows]
        near = "" if own else nearest(name[:80], names)
        raise UsageError(
            f"{len(own) or 'no'} row{'s are' if own else ' is'} called {name[:80]!r}{near}",
            where=option,
            expected="one of " + ", ".join(names[:20]),
            fix="give methods different names with --rename OLD=NEW" if own else None,
        )
    return own[0]


def parse_baselines(table: Table, names: Sequence[str]) -> dict[int, int]:
    """Return the row of each method's baseline, by the method's row."""
    found: dict[int, int] = {}
    for text in names:
        for row, baseline in _baseline_pairs(table, text):
            if found.setdefault(row, baseline) != baseline:
                name = table.rows[row].name
                raise UsageError(f"{name} has two baselines", where=f"--baseline {text[:80]}")
    return found


def _baseline_pairs(table: Table, text: str) -> list[tuple[int, int]]:
    """Return the rows of METHOD=NAME, or all that are compared with the row of NAME."""
    names = {row.name for row in table.rows}
    # A name may itself hold an equals sign.
    splits = [(text[:i], text[i + 1 :]) for i, c in enumerate(text) if c == "="]
    for pair in splits:
        if text not in names and names.issuperset(pair):
            method, baseline = (find_row(table, name, "--baseline") for name in pair)
            return [(method, baseline)]
    baseline = find_row(table, text, "--baseline")
    chosen = [i for i, row in enumerate(table.rows) if row.highlighted]
    own = [i for i, row in enumerate(table.rows) if row.is_own]
    return [(row, baseline) for row in chosen or own or range(len(table.rows)) if row != baseline]


def add_gains(table: Table, baselines: Mapping[int, int]) -> Table:
    """Write the gains of rows over their baselines next to the values."""
    rows, notes = list(table.rows), dict[str, None]()
    for number, place in baselines.items():
        baseline = table.rows[place]
        pairs = zip(table.columns, rows[number].cells, baseline.cells, strict=True)
        cells = tuple(replace(cell, gain=_gain(c, cell, other)) for c, cell, other in pairs)
        rows[number] = replace(rows[number], cells=cells)
        reported = ", whose numbers are reported, not re-scored" * bool(baseline.reported)
        note = f"difference from {baseline.name}{reported}, of the values as printed"
        notes[f"in brackets: {note}"] = None
    return replace(
        table, rows=tuple(rows), notes=(*table.notes, *notes), legend=(*table.legend, *notes)
    )


def _gain(column: Column, cell: Cell, baseline: Cell) -> float | None:
    for one in (cell, baseline):
        is_number = isinstance(one.value, float) and math.isfinite(one.value)
        if column.higher_is_better is None or not is_number:
            return None
    difference = float(cell.text(column.decimals)) - float(baseline.text(column.decimals))
    return round(difference, column.decimals) + 0.0


def add_citations(table: Table, texts: Sequence[str], sources: Mapping[str, Path]) -> Table:
    """Attach citations: METHOD=KEY, a TOML file of such, or the name of a source of numbers."""
    keys: dict[str, str] = {}
    named: dict[str, str] = {}
    for text in texts:
        method, _, key = text.rpartition("=")
        path = sources.get(text, Path(text))
        if path.suffix == ".toml":
            content = read_toml(path, UsageError, "file of citations")
            keys |= content.get("citations", content)
        elif method:
            named[method] = key
            find_row(table, method, "--cite")
        else:
            raise UsageError(
                f"--cite {text[:80]!r} is no citation",
                expected="METHOD=KEY, a .toml file, or one of " + ", ".join(sources),
            )
    return cite(table, keys | named)


def cite(table: Table, keys: Mapping[str, str]) -> Table:
    """Attach citations to the rows of methods; LaTeX prints them."""
    rows = []
    for row in table.rows:
        key = str(keys.get(row.name, ""))
        if row.name in keys and not _KEYS.fullmatch(key):
            raise UsageError(
                f"{key[:80]!r} is no citation key",
                where=f"--cite, {row.name[:80]}",
                expected="letters a to z, digits, and behind the first any of : . _ / + -",
            )
        rows.append(_cited(row, key))
    return replace(table, rows=tuple(rows))


def _cited(row: Row, key: str) -> Row:
    return replace(row, cells=(replace(row.cells[0], cite=key), *row.cells[1:]))

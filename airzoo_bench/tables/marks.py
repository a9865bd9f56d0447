"""Marks on a table: the best values, gains over a baseline, coloured rows, citations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest, read_toml
from airzoo_bench.tables.model import Cell, Column, Table
from airzoo_bench.tables.published import published_sources


def mark_best(table: Table) -> Table:
    """Mark the best cell of each score, and every cell that is shown with the same digits.

    Reported rows compete only where no row was scored here; a note says so.
    """
    own = [i for i, row in enumerate(table.rows) if row.is_own]
    racing = own or [i for i, row in enumerate(table.rows) if not row.floor]
    rows = [list(row.cells) for row in table.rows]
    for index, column in enumerate(table.columns):
        if column.higher_is_better is not None:
            cells = mark_cells(column, [rows[i][index] for i in racing])
            for i, cell in zip(racing, cells, strict=True):
                rows[i][index] = cell
    marked = (replace(row, cells=tuple(new)) for row, new in zip(table.rows, rows, strict=True))
    rule = "the best of each score is that of the rows that were scored here"
    rules = [rule] if own and any(row.reported for row in table.rows) else []
    return replace(table, rows=tuple(marked), notes=(*rules, *table.notes))


def mark_cells(column: Column, cells: Sequence[Cell]) -> list[Cell]:
    """Mark the best of several cells of a score."""
    numbers = [cell.value for cell in cells if isinstance(cell.value, float)]
    finite = list(filter(math.isfinite, numbers))
    if len(numbers) < 2 or not finite:
        return list(cells)
    best = Cell(max(finite) if column.higher_is_better else min(finite)).text(column.decimals)
    return [replace(cell, best=cell.text(column.decimals) == best) for cell in cells]


def with_decimals(table: Table, decimals: int) -> Table:
    """Show `decimals` digits behind the point of every score."""
    columns = (
        column if column.higher_is_better is None else replace(column, decimals=decimals)
        for column in table.columns
    )
    return replace(table, columns=tuple(columns))


def highlight(table: Table, methods: Sequence[str]) -> Table:
    """Set rows on a coloured ground."""
    chosen = {_find_row(table, name, "--highlight") for name in methods}
    rows = (replace(row, highlighted=i in chosen) for i, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))


def _find_row(table: Table, name: str, option: str) -> int:
    """Return the row of a method; one that was scored here goes before a reported one."""
    found = [i for i, row in enumerate(table.rows) if row.name == name]
    if not found:
        names = [row.name for row in table.rows]
        what = f"no row is called {name[:80]!r}{nearest(name[:80], names)}"
        raise UsageError(what, where=option, expected="one of " + ", ".join(names[:20]))
    return min(found, key=lambda i: bool(table.rows[i].reported))


def add_gains(table: Table, baselines: Sequence[str]) -> Table:
    """Write gains over baselines next to the values.

    A baseline is the NAME of a row, for all highlighted rows or else for all that were scored here,
    or METHOD=NAME.
    """
    rows, notes = list(table.rows), dict[str, None]()
    for text in baselines:
        method, _, name = text.rpartition("=")
        if text in {row.name for row in rows}:
            method, name = "", text
        place = _find_row(table, name, "--baseline")
        chosen = [_find_row(table, method, "--baseline")] if method else []
        for kind in ("highlighted", "is_own", "cells"):
            chosen = chosen or [i for i, row in enumerate(rows) if getattr(row, kind)]
        baseline = table.rows[place]
        for number in chosen:
            if number != place:
                triples = zip(table.columns, rows[number].cells, baseline.cells, strict=True)
                cells = tuple(replace(cell, gain=_gain(c, cell, b)) for c, cell, b in triples)
                rows[number] = replace(rows[number], cells=cells)
        reported = ", whose numbers are reported, not re-scored" * bool(baseline.reported)
        note = f"difference from {baseline.name}{reported}, of the values as printed"
        notes[f"in brackets: {note}"] = None
    return replace(table, rows=tuple(rows), notes=(*table.notes, *notes))


def _gain(column: Column, *cells: Cell) -> float | None:
    values = [cell.value for cell in cells if isinstance(cell.value, float)]
    if column.higher_is_better is None or len(values) < 2 or not all(map(math.isfinite, values)):
        return None
    own, baseline = (float(cell.text(column.decimals)) for cell in cells)
    return round(own - baseline, column.decimals) + 0.0


def add_citations(table: Table, files: Sequence[str]) -> Table:
    """Attach keys of a bibliography by method, from TOML files or sources of published numbers."""
    sources, keys = published_sources(), dict[str, object]()
    for name in files:
        content = read_toml(sources.get(name, Path(name)), UsageError, "file of citations")
        keys = content.get("citations", content) | keys
    rows = (replace(row, cite=str(keys.get(row.name, ""))) for row in table.rows)
    return replace(table, rows=tuple(rows))

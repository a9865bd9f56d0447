"""What decides which numbers of a table are bold, the best, or underlined, the second best."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from airzoo_bench.tables.model import Cell, Column, Table

__all__ = ["best_texts", "mark_best"]


def mark_best(table: Table, *, second: bool = False) -> Table:
    """Mark the best cell of each score, and every cell that is shown with the same digits."""
    open_to_all = not any(row.is_own for row in table.rows)
    competes = [row.is_own or (open_to_all and not row.floor) for row in table.rows]
    rows = [list(row.cells) for row in table.rows]
    for index, column in enumerate(table.columns):
        if column.higher_is_better is None:
            continue
        racing = [row[index] for row, runs in zip(rows, competes, strict=True) if runs]
        several = sum(isinstance(cell.value, float) for cell in racing) > 1
        first, runner_up = [*(best_texts(column, racing) if several else []), None, None][:2]
        for row, runs in zip(rows, competes, strict=True):
            text = row[index].text(column.decimals)
            is_second = runs and second and text == runner_up
            row[index] = replace(row[index], best=runs and text == first, second=is_second)
    marked = [replace(row, cells=tuple(new)) for row, new in zip(table.rows, rows, strict=True)]
    return replace(table, rows=tuple(marked))


def best_texts(column: Column, cells: Sequence[Cell]) -> list[str]:
    """Return the different texts of a column's finite numbers, the best first."""
    numbers = [c for c in cells if isinstance(c.value, float) and math.isfinite(c.value)]
    ordered = sorted(numbers, key=_value, reverse=bool(column.higher_is_better))
    return list(dict.fromkeys(cell.text(column.decimals) for cell in ordered))


def _value(cell: Cell) -> float:
    return float(cell.value or 0)

"""The one table model: values apart from how they are shown."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

__all__ = ["Cell", "Column", "Row", "Table", "mark_best", "plain", "share_to_percent"]


@dataclass(frozen=True)
class Column:
    """A column's head.

    Attributes
    ----------
    title : str
    unit : str
        Shown beside the title; empty for none.
    higher_is_better : bool or None
        None for what is not a score.
    decimals : int
        How many digits follow the point.
    """

    title: str
    unit: str = ""
    higher_is_better: bool | None = None
    decimals: int = 2

    @property
    def heading(self) -> str:
        """Title, unit and direction, such as ``R@1 [%] ↑``."""
        unit = f" [{self.unit}]" if self.unit else ""
        arrow = {None: "", True: " ↑", False: " ↓"}[self.higher_is_better]
        return f"{self.title}{unit}{arrow}"


@dataclass(frozen=True)
class Cell:
    """A value and whether it is the best of its column."""

    value: float | int | str | None
    best: bool = False

    def text(self, decimals: int) -> str:
        """Return what is shown; a missing value is a dash, an infinite one says so."""
        if self.value is None:
            return "–"
        if isinstance(self.value, str | int):
            return plain(str(self.value))
        if math.isinf(self.value):
            return "inf" if self.value > 0 else "-inf"
        return f"{self.value:.{decimals}f}"


@dataclass(frozen=True)
class Row:
    """A row's cells; a summary row is set apart from those above it."""

    cells: tuple[Cell, ...]
    summary: bool = False


@dataclass(frozen=True)
class Table:
    """A title, columns, rows, and notes that belong to the numbers."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    def texts(self) -> list[list[str]]:
        """Return every cell as it is shown."""
        return [
            [cell.text(col.decimals) for cell, col in zip(row.cells, self.columns, strict=True)]
            for row in self.rows
        ]


def plain(text: str) -> str:
    """Put a text on one line and replace what does not print.

    Names come from strangers: an escape sequence in one could steer a terminal, whatever the
    format that it is printed in.
    """
    printed = (
        c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(text.split())
    )
    return "".join(printed)


def share_to_percent(value: float) -> float:
    """Turn a share into percent."""
    return 100.0 * value


def mark_best(table: Table) -> Table:
    """Mark the best cell of each score, and every cell that is shown with the same digits.

    An infinite value, which is a failure, is never the best.

    Parameters
    ----------
    table : Table
        Rows to be compared with each other, such as methods.

    Returns
    -------
    Table
    """
    rows = [list(row.cells) for row in table.rows]
    for index, column in enumerate(table.columns):
        if column.higher_is_better is None:
            continue
        best = _best(column, [row[index] for row in rows])
        for row in rows:
            row[index] = replace(row[index], best=row[index].text(column.decimals) == best)
    marked = [replace(row, cells=tuple(new)) for row, new in zip(table.rows, rows, strict=True)]
    return replace(table, rows=tuple(marked))


def _best(column: Column, cells: list[Cell]) -> str | None:
    numbers = [c for c in cells if isinstance(c.value, float) and math.isfinite(c.value)]
    if not numbers:
        return None
    pick: Literal[1, -1] = 1 if column.higher_is_better else -1
    return max(numbers, key=lambda cell: pick * float(cell.value or 0)).text(column.decimals)

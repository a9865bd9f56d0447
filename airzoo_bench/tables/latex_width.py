"""How wide a table is on paper, by estimate: TeX alone knows it, and only when all is settled."""

from __future__ import annotations

from airzoo_bench.tables.model import Cell, Column, Table

__all__ = ["COLUMN", "PAGE", "latex_width", "text_width"]

PAGE = 50.0
"""The width of a usual page of two columns, in em of its text."""

COLUMN = 24.0
"""The width of one of its columns."""

_BETWEEN = 1.2  # two gaps of LaTeX, of 6 pt at 10 pt
_BOLD = 1.15
_CITATION = 2.0

# Of Computer Modern, which is as wide as most.
_LETTERS = {
    **dict.fromkeys(" ()[]", 0.36),
    **dict.fromkeys(".,:;'|!ijl", 0.28),
    **dict.fromkeys("+-−<>=±", 0.78),
    **dict.fromkeys("↑↓", 0.5),
    **dict.fromkeys("0123456789", 0.5),
    **dict.fromkeys("@%mMwW", 0.85),
}
_LOWER, _UPPER = 0.47, 0.72


def latex_width(table: Table, *, aligned: bool = False) -> float:
    """Estimate the width of a table in em, with the gaps between its columns.

    Parameters
    ----------
    table : Table
    aligned : bool
        Whether heads stand above the numbers alone, and not above what stands beside them too.
    """
    widest = [_column(table, index, aligned) for index in range(len(table.columns))]
    for group in dict.fromkeys(column.group for column in table.columns if column.group):
        members = [i for i, column in enumerate(table.columns) if column.group == group]
        inner = sum(widest[i] for i in members) + _BETWEEN * (len(members) - 1)
        widest[members[-1]] += max(0.0, text_width(group, bold=True) - inner)
    return sum(widest) + _BETWEEN * len(widest)


def text_width(text: str, *, bold: bool = False) -> float:
    """Estimate the width of a text in em."""
    width = sum(_LETTERS.get(c, _UPPER if c.isupper() else _LOWER) for c in text)
    return width * _BOLD if bold else width


def _column(table: Table, index: int, aligned: bool) -> float:
    column = table.columns[index]
    head = text_width(column.title, bold=True) + text_width(column.title_suffix)
    cells = [_cell(row.cells[index], column) for row in table.rows]
    if not aligned:
        return max(head, *(value + beside for value, beside in cells), 0)
    return max(head, *(value for value, _ in cells), 0) + max((b for _, b in cells), default=0)


def _cell(cell: Cell, column: Column) -> tuple[float, float]:
    value = text_width(cell.text(column.decimals), bold=cell.best)
    beside = text_width("".join(f" {part}" for part in cell.suffix(column.decimals)))
    return value + _CITATION * bool(cell.cite), beside

"""Tables of a few cells, and results for wide ones."""

from __future__ import annotations

from dataclasses import replace

from airzoo_bench.tables.marks import add_gains
from airzoo_bench.tables.model import Between, Cell, Column, Row, Table

UP, DOWN = Column("R@1", "%", True), Column("Error", "m", False)


def table(*rows: tuple[str, float | None, float | None]) -> Table:
    made = tuple(Row(tuple(Cell(value) for value in row)) for row in rows)
    return Table("T", (Column("Method"), UP, DOWN), made)


def grouped(groups: int, methods: tuple[str, ...] = ("a", "b")) -> Table:
    """Return a table whose every value says where it stands: row, group, score."""
    columns = [
        replace(score, group=f"Scene {group}") for group in range(groups) for score in (UP, DOWN)
    ]
    rows = tuple(
        Row((Cell(name), *(Cell(100.0 * (r + 1) + c) for c in range(2 * groups))))
        for r, name in enumerate(methods)
    )
    return Table("T", (Column("Method"), *columns), rows)


SPAN = Between(12.34, 56.78)


def scored(kind: str, groups: int = 2) -> Table:
    """Return two methods with four scores in each group, and what stands beside these."""
    columns = [Column(f"R@{s}", "%", True, group=f"G{g}") for g in range(groups) for s in range(4)]
    lower = tuple(Cell(12.34) for _ in columns)
    upper = tuple(Cell(56.78, best=True) for _ in columns)
    rows = (Row((Cell("NetVLAD"), *lower)), Row((Cell("MegaLoc (Ours)"), *upper)))
    made = Table("T", (Column("Method"), *columns), rows)
    if kind == "gains":
        return add_gains(made, {1: 0})
    if kind == "intervals":
        spans = [
            Row((row.cells[0], *(replace(c, uncertainty=SPAN) for c in row.cells[1:])))
            for row in rows
        ]
        return replace(made, rows=tuple(spans))
    return made

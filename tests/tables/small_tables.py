"""Tables of a few cells, and wide ones."""

from __future__ import annotations

from dataclasses import replace

from airzoo_bench.tables.model import Cell, Column, Row, Table

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

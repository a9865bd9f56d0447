"""Numbers of a siunitx column stand at one point, marked or not: read off the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.tables.annotations import add_gains, highlight
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.latex_float import LatexStyle
from airzoo_bench.tables.model import Between, Cell, Column, Row, Table
from tests.tables.typeset import MINUS, typeset, words

# Widths in Computer Modern at 10 pt.
DIGIT = {False: 4.98, True: 5.73}
SIGN = {MINUS: 7.75, "<": 7.75}
PACKAGE = "siunitx}"

CELLS = {
    "plain": Cell(12.34),
    "wide": Cell(123.45),
    "best": Cell(56.78, best=True),
    "narrow": Cell(6.78, best=True),
    "second": Cell(90.12, second=True),
    "small": Cell(9.12, second=True),
    "below": Cell(-3.21),
    "worse": Cell(-4.32, best=True),
    "less": Cell(0.001, least=0.01),
}


def made(kind: str) -> Table:
    rows = [
        Row((Cell(name), cell, replace(cell, uncertainty=None))) for name, cell in CELLS.items()
    ]
    table = Table(
        "T", (Column("M"), Column("A", "", True), Column("B head", "", True)), tuple(rows)
    )
    table = highlight(table, ["narrow", "small", "plain"])
    if kind == "gains":
        return add_gains(table, dict.fromkeys(range(1, len(rows)), 0))
    if kind == "intervals":
        span = Between(-1.5, 100.0)
        cells = [
            (row.cells[0], *(replace(c, uncertainty=span) for c in row.cells[1:])) for row in rows
        ]
        return replace(table, rows=tuple(map(Row, cells)))
    return table


def points(folder: Path) -> list[list[float]]:
    """Return where the points of each column's numbers stand."""
    found: list[list[float]] = [[], []]
    shown = words(folder)
    for name, cell in CELLS.items():
        start = [text for text, _ in shown].index(name)
        text = cell.text(2).replace("-", MINUS)
        places = [x for word, x in shown[start:] if word.startswith(text)][:2]
        whole = text.partition(".")[0]
        width = sum(SIGN.get(letter, DIGIT[cell.best]) for letter in whole)
        for column, x in zip(found, places, strict=True):
            column.append(x + width)
    return found


@pytest.mark.parametrize("version", ["", "[=v2]"])
@pytest.mark.parametrize("kind", ["alone", "gains", "intervals"])
def test_points_stand_at_one_place(kind: str, version: str, tmp_path: Path) -> None:
    source = latex(made(kind), LatexStyle(siunitx=True, standalone=True))
    assert source.count(PACKAGE) == 2  # once in a comment
    typeset(source.replace(PACKAGE, PACKAGE + version), tmp_path)
    for column in points(tmp_path):
        assert len(column) == len(CELLS)
        assert max(column) - min(column) < 0.5, dict(zip(CELLS, column, strict=True))

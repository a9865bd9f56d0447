"""Tables: what strangers' names become in each format, and which cell is the best."""

from __future__ import annotations

import csv
import html.parser
import io
import json
import math
from typing import Any

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.layouts import methods_table, scenes_table
from airzoo_bench.tables.marks import mark_best
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.render import FORMATS, render
from tests.results.made import result

UP, DOWN = Column("R@1", "%", True), Column("Error", "m", False)


def table(*rows: tuple[Any, ...], notes: tuple[str, ...] = (), title: str = "T") -> Table:
    cells = tuple(Row(tuple(Cell(value) for value in row)) for row in rows)
    return Table(title, (Column("Method"), UP, DOWN), cells, notes)


def best(made: Table) -> list[list[bool]]:
    return [[cell.best for cell in row.cells] for row in mark_best(made).rows]


def named(name: str) -> Table:
    return table((name, 1.0, 2.0), notes=(name,), title=name)


class TestBest:
    def test_direction(self) -> None:
        made = best(table(("a", 90.0, 3.0), ("b", 80.0, 2.0)))
        assert made == [[False, True, False], [False, False, True]]

    def test_ties_are_those_of_the_digits_shown(self) -> None:
        made = best(table(("a", 90.001, 1.0), ("b", 90.004, 1.0), ("c", 90.006, 1.01)))
        assert [row[1] for row in made] == [False, False, True]
        made = best(table(("a", 90.001, 1.0), ("b", 90.004, 1.0), ("c", 89.99, 1.01)))
        assert made == [[False, True, True], [False, True, True], [False, False, False]]

    def test_an_infinite_error_is_never_the_best(self) -> None:
        made = best(table(("a", 0.0, math.inf), ("b", 0.0, math.inf)))
        assert [row[2] for row in made] == [False, False]
        made = best(table(("a", 0.0, math.inf), ("b", 0.0, 900.0)))
        assert [row[2] for row in made] == [False, True]

    def test_missing_values(self) -> None:
        made = best(table(("a", None, None), ("b", 1.0, None)))
        assert made == [[False, False, False], [False, False, False]]  # the best of one is none
        assert best(table(("a", 1.0, 2.0))) == [[False, False, False]]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", ["a\x1b[2Jb", "a\x9bb", "a\u202eb", "a\ud800b", "a\x00b"])
def test_nothing_steers_a_terminal(form: str, name: str) -> None:
    text = render(named(name), form)
    if form == "json":
        assert json.loads(text)["rows"][0][0] == name
        text = text.encode("ascii").decode()
    assert all(c.isprintable() or c == "\n" for c in text)
    text.encode()


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", ["two\nlines", "two\r\nlines", "two\u2028lines"])
def test_a_line_is_a_line(form: str, name: str) -> None:
    plain = render(named("two lines"), form)
    text = render(named(name), form)
    assert text.count("\n") == plain.count("\n")
    if form != "json":
        assert text == plain


@pytest.mark.parametrize(("name", "start"), [("[1] Ours", "{[}1] Ours"), ("*ours", "{*}ours")])
def test_latex_takes_no_cell_for_an_argument_of_the_line_before(name: str, start: str) -> None:
    # After \\ or \midrule, LaTeX reads [ as an optional argument, and * as the starred form.
    lines = render(table(("a", 1.0, 2.0), (name, 1.0, 2.0)), "latex").splitlines()
    assert any(line.startswith(start) for line in lines)


class Cells(html.parser.HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert {name for name, _ in attrs} <= {"align", "scope"}
        self.tags.add(tag)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>", "</td><img src=x onerror=y>", "\"&amp;'", "--><!--"]
)
def test_html(name: str) -> None:
    reader = Cells()
    reader.feed(render(named(name), "html"))
    assert reader.tags <= {"table", "caption", "thead", "tbody", "tr", "th", "td", "p", "strong"}
    assert reader.texts.count(name) == 3  # caption, cell, note


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a|b", r"a\|b"),
        ("a\\|b", r"a\\\|b"),
        ("**bold** _it_ `x`", r"\*\*bold\*\* \_it\_ \`x\`"),
        ("[x](http://y)", r"\[x\](http://y)"),
        ("![x](y)", r"\!\[x\](y)"),
        ("~~no~~ $x$", r"\~\~no\~\~ \$x\$"),
        ("<b>&", "&lt;b&gt;&amp;"),
    ],
)
def test_markdown(name: str, shown: str) -> None:
    lines = render(named(name), "markdown").splitlines()
    assert lines[2] == f"| {shown} | 1.00 | 2.00 |"
    assert lines[1] == "| --- | ---: | ---: |"


@pytest.mark.parametrize(
    ("name", "stored"),
    [
        ('=HYPERLINK("http://x")', '\'=HYPERLINK("http://x")'),
        ("+1+1", "'+1+1"),
        ("-1+1", "'-1+1"),
        ("--1", "'--1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\t=1+1", "'=1+1"),
        (" =1+1", "'=1+1"),
        ('a,"b"', 'a,"b"'),
        ("-1.5", "-1.5"),
    ],
)
def test_csv_runs_no_formulas(name: str, stored: str) -> None:
    rows = list(csv.reader(io.StringIO(render(named(name), "csv"))))
    assert rows == [["Method", "R@1", "Error"], [stored, "1.00", "2.00"]]


def test_infinite_and_missing_values() -> None:
    made = table(("a", -math.inf, math.inf), ("b", None, 7))
    assert "a & -inf & inf" in render(made, "latex")
    assert "b & -- & 7" in render(made, "latex")
    assert "a,-inf,inf\nb,–,7\n" in render(made, "csv")

    def refuse(name: str) -> Any:
        raise AssertionError(f"{name} is no JSON")

    content = json.loads(render(made, "json"), parse_constant=refuse)
    assert content["rows"] == [["a", "-Infinity", "Infinity"], ["b", None, 7]]


@pytest.mark.parametrize("name", ["[bold red]x[/]", "[/]", "x" * 300, "名前" * 40, "\U0001f6a9"])
def test_a_terminal_shows_names_whole_and_as_they_are(name: str) -> None:
    text = render(named(name), "terminal")
    assert name in text
    line = next(line for line in text.splitlines() if "1.00" in line)
    assert name in line
    assert line.split()[-2:] == ["1.00", "2.00"]


def test_one_result_by_scene() -> None:
    made = scenes_table(result(), every_score=True)
    assert made.texts() == [
        ["Scene", "3", "30.00", "inf"],
        ["Average", "–", "30.00", "inf"],
        ["Pooled", "3", "30.00", "inf"],
    ]
    assert [column.heading for column in made.columns][2:] == ["R@1 [%] ↑", "Distance [m] ↓"]
    assert len(scenes_table(result()).columns) == 3
    assert made.notes[0] == "A note."


def test_several_results_side_by_side() -> None:
    one, other = result("one", **{"recall@1": 0.5}), result("other", **{"recall@1": 0.6})
    for scene in (None, "s", "Scene"):
        made = methods_table([one, other], scene=scene)
        assert made.texts() == [["one", "50.00"], ["other", "60.00"]]
        assert [row.cells[1].best for row in made.rows] == [False, True]
    assert "one, other: A note." in made.notes
    with pytest.raises(ResultError, match="no scene 'x' in the results"):
        methods_table([one, other], scene="x")

"""Tables in every format: strangers' names, wide ones, all that cells have; a real LaTeX."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.marks import add_gains, highlight, mark_best
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.render import FORMATS, render
from tests.tables.typeset import document, typeset

UP, DOWN = Column("R@1", "%", True), Column("Error", "m", False)


def table(*rows: tuple[Any, ...], notes: tuple[str, ...] = (), title: str = "T") -> Table:
    cells = tuple(Row(tuple(Cell(value) for value in row)) for row in rows)
    return Table(title, (Column("Method"), UP, DOWN), cells, notes)


def grouped(groups: int) -> Table:
    """Return a table whose every value says where it stands: row, group, score."""
    columns = [
        replace(one, group=f"Scene {group}") for group in range(groups) for one in (UP, DOWN)
    ]
    rows = [
        Row((Cell(name), *(Cell(1000.0 * r + c) for c in range(2 * groups))))
        for r, name in enumerate(("a method", "another"), 1)
    ]
    return Table("T", (Column("Method"), *columns), tuple(rows))


def with_everything() -> Table:
    made = table(("mine", 50.0, 3.0), ("yours", 40.0, -4.0), ("theirs", 30.0, 5.0))
    spans = [(45.5, 54.5), (1.25, 2.5), (-9.0, math.inf)]
    rows = [
        replace(row, cells=(row.cells[0], replace(row.cells[1], uncertainty=span), row.cells[2]))
        for row, span in zip(made.rows, spans, strict=True)
    ]
    rows[2] = replace(rows[2], reported="a paper")
    rows[0] = replace(rows[0], cite="me2026")
    made = mark_best(replace(made, rows=tuple(rows)))
    return add_gains(highlight(made, ["mine"]), ["yours"])


def named(name: str) -> Table:
    return table((name, 1.0, 2.0), notes=(name,), title=name)


INF = math.inf
BEST = [  # pairs of R@1 and error by method; which cells are the best
    ([(90.0, 3.0), (80.0, 2.0)], "b. .b"),
    ([(90.001, 1.0), (90.004, 1.0), (90.006, 1.01)], ".b .b b."),  # by the digits shown
    ([(0.0, INF), (0.0, INF)], "b. b."),  # an infinite error is never the best
    ([(0.0, INF), (0.0, 900.0)], "b. bb"),
    ([(None, None), (1.0, None)], ".. .."),  # the best of one is none
    ([(1.0, 2.0)], ".."),
]


@pytest.mark.parametrize(("values", "marks"), BEST)
def test_the_best(values: list[tuple[Any, Any]], marks: str) -> None:
    made = mark_best(table(*(("m", *pair) for pair in values)))
    shown = ["".join("b" if c.best else "." for c in row.cells[1:]) for row in made.rows]
    assert " ".join(shown) == marks


def test_gains_are_those_of_the_printed_digits() -> None:
    made = table(("a", 1.006, 5.0), ("b", 3.014, 2.0), ("x=y", 1.0, 1.0))
    gains = [[cell.gain for cell in row.cells[1:]] for row in add_gains(made, ["a"]).rows]
    assert gains == [[None, None], [2.0, -3.0], [-0.01, -4.0]]
    for given, rows in {"b=a": [1], "x=y": [0, 1], "x=y=a": [2]}.items():
        found = add_gains(made, [given]).rows
        assert [i for i, row in enumerate(found) if row.cells[1].gain is not None] == rows


def test_everything_in_csv_and_json() -> None:
    rows = list(csv.DictReader(io.StringIO(render(with_everything(), "csv"))))
    assert ",".join(rows[0]) == "Method,R@1,R@1 from,R@1 to,R@1 gain,Error,Error gain,Marked"
    assert ",".join(rows[0].values()) == "mine,50.00,45.50,54.50,10.00,3.00,7.00,"
    assert [rows[2][key] for key in ("R@1 from", "R@1 to")] == ["-9.00", "inf"]
    assert rows[2]["Marked"] == "reported, not re-scored: a paper"
    shown = json.loads(render(with_everything(), "json"))
    assert shown["gains"] == [[None, 10.0, 7.0], [None] * 3, [None] * 3]
    assert shown["uncertainties"][0] == [None, {"low": 45.5, "high": 54.5}, None]
    assert shown["uncertainties"][2][1] == {"low": -9.0, "high": "Infinity"}
    assert shown["marked"] == ["", "", "reported, not re-scored: a paper"]
    assert set(json.loads(render(grouped(2), "json"))) == {"title", "columns", "rows", "notes"}
    assert json.loads(render(grouped(2), "json"))["columns"][3]["group"] == "Scene 1"


def test_a_real_latex_prints_everything(tmp_path: Path) -> None:
    source = latex(with_everything())
    assert re.findall(r"textbf\{([-$0-9.]+)\}", source) == ["50.00", "$-$4.00"]
    text = typeset(document(source), tmp_path)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "mine [me2026] 50.00 [45.50, 54.50] (+10.00) 3.00 (+7.00)" in lines
    assert any("30.00 [\u22129.00, inf] 5.00" in line for line in lines)


HOSTILE = (
    r"\input{x} & 100% $a_b^c$ #1 ~ {y} <z> |w|",
    r'"quoted" `x` --dashes-- ,,',
    "[1] Ours",
    "*starred",
    r"\\[9cm]",
    r"\end{tabular}",
    "Čeština é ß",
    "°±×µ†–…",
)


def test_a_real_latex_prints_any_name(tmp_path: Path) -> None:
    made = table(*((name, 10.0 + i, 1.0) for i, name in enumerate(HOSTILE)))
    made = replace(made, columns=(Column(r"M_1 & \x"), *made.columns[1:]), title="% \\x")
    # After \\ or \midrule, LaTeX reads [ as an optional argument, and * as the starred form.
    assert {"{[}1] Ours", "{*}starred"} <= {
        line.partition(" &")[0] for line in latex(made).splitlines()
    }
    text = typeset(document(latex(made)), tmp_path)
    words = [line.split() for line in text.splitlines() if line.strip()]
    lines = {line[-2]: " ".join(line[:-2]) for line in words if len(line) > 2}
    shown = [lines[f"{10 + i}.00"] for i in range(len(HOSTILE))]
    # The font draws an underscore as a rule, and has accents for ^ and ~.
    seen = shown[0].replace("\u02c6", "^").replace("\u02dc", "~")
    assert seen.replace(" ", "") == HOSTILE[0].replace(" ", "").replace("_", "")
    assert "--dashes--" in shown[1]
    assert shown[2:6] == list(HOSTILE[2:6])


@pytest.mark.parametrize("width", [40, 60, 80, 120, 500])
def test_a_terminal_shows_every_number_once_and_within_its_width(width: int) -> None:
    made = grouped(9)
    text = render(made, "terminal", width=width)
    assert max(map(len, text.splitlines())) <= width
    words = text.split()
    assert all(words.count(value) == 1 for row in made.texts() for value in row[1:])
    assert words.count("Scene") == 9
    lines = text.splitlines()
    assert {line.find("a") for line in lines if re.search("a method|another", line)} == {2}
    # A scene stands above the first of its scores.
    for above, line in pairwise(lines):
        scenes, scores = re.finditer(r"Scene \d", above), re.finditer("R@1 ↑", line)
        if "Scene" in above:
            assert [one.end() for one in scenes] == [one.end() for one in scores]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", ["a\x1b[2Jb", "a\x9bb", "a\u202eb", "a\ud800b", "a\x00b", "a\nb"])
def test_nothing_steers_a_terminal_and_a_line_is_a_line(form: str, name: str) -> None:
    text = render(named(name), form)
    assert text.count("\n") == render(named("a b"), form).count("\n")
    if form == "json":
        assert json.loads(text)["rows"][0][0] == name
        text = text.encode("ascii").decode()
    assert all(c.isprintable() or c == "\n" for c in text)
    text.encode()


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "</td><img src=x>", "\"&amp;'"])
def test_html_holds_names_as_text(name: str) -> None:
    shown = render(named(name), "html")
    tags = re.findall(r"<(\w+)([^>]*)>", shown)
    known = {"table", "caption", "thead", "tbody", "tr", "th", "td", "p", "strong"}
    assert {tag for tag, _ in tags} <= known
    assert {one for _, said in tags for one in re.findall(r"(\w+)=", said)} <= {"align", "scope"}
    texts = [html.unescape(text) for text in re.findall(r">([^<]+)<", shown)]
    assert texts.count(name) == 3  # caption, cell, note


MARKDOWN = {
    "a\\|b": r"a\\\|b",
    "**bold** _it_ `x`": r"\*\*bold\*\* \_it\_ \`x\`",
    "![x](y)": r"\!\[x\](y)",
    "~~no~~ $x$": r"\~\~no\~\~ \$x\$",
    "<b>&": "&lt;b&gt;&amp;",
}
CSV = {name: f"'{name}" for name in ('=HYPERLINK("http://x")', "+1+1", "-1+1", "@SUM(A1)")}
CSV |= {"\t=1+1": "'=1+1", 'a,"b"': 'a,"b"', "-1.5": "-1.5", "@5m,1°": "@5m,1°"}


def test_markdown_has_no_markup_and_csv_no_formulas_of_strangers() -> None:
    for name, shown in MARKDOWN.items():
        lines = render(named(name), "markdown").splitlines()
        assert lines[1:3] == ["| --- | ---: | ---: |", f"| {shown} | 1.00 | 2.00 |"]
    for name, stored in CSV.items():
        rows = list(csv.reader(io.StringIO(render(named(name), "csv"))))
        assert rows == [["Method", "R@1", "Error"], [stored, "1.00", "2.00"]]


def test_infinite_and_missing_values() -> None:
    made = table(("a", -math.inf, math.inf), ("b", None, 7))
    assert "a & -inf & inf" in render(made, "latex")
    assert "b & -- & 7" in render(made, "latex")
    assert "a,-inf,inf\nb,–,7\n" in render(made, "csv")
    content = json.loads(render(made, "json"), parse_constant=pytest.fail)
    assert content["rows"] == [["a", "-Infinity", "Infinity"], ["b", None, 7]]


@pytest.mark.parametrize("name", ["[bold red]x[/]", "x" * 300, "名前" * 40, "\U0001f6a9"])
def test_a_terminal_shows_names_whole_and_as_they_are(name: str) -> None:
    text = render(named(name), "terminal")
    line = next(line for line in text.splitlines() if "1.00" in line)
    assert name in line
    assert line.split()[-2:] == ["1.00", "2.00"]

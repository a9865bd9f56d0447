"""What cells and rows may have beside their values, in every format; wide tables; a real LaTeX."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.marks import add_gains, cite, highlight, mark_best, parse_baselines
from airzoo_bench.tables.model import Between, Column, Table
from airzoo_bench.tables.render import render
from tests.tables.small_tables import grouped, table
from tests.tables.typeset import bold_words, document, typeset


class TestMarks:
    def test_the_second_best_is_the_next_other_text(self) -> None:
        made = mark_best(
            table(("a", 9.001, 1.0), ("b", 9.004, 2.0), ("c", 8.0, math.inf), ("d", 8.0, 3.0)),
            second=True,
        )
        assert [row.cells[1].best for row in made.rows] == [True, True, False, False]
        assert [row.cells[1].second for row in made.rows] == [False, False, True, True]
        assert [row.cells[2].second for row in made.rows] == [False, True, False, False]

    def test_gains_are_those_of_the_printed_digits(self) -> None:
        made = add_gains(table(("a", 1.006, 5.0), ("b", 3.014, 2.0)), {1: 0})
        assert [made.rows[1].cells[i].gain for i in (1, 2)] == [2.0, -3.0]
        assert made.rows[0].cells[1].gain is None
        assert made.notes == ("in brackets: difference from a, of the values as printed",)

    @pytest.mark.parametrize(
        ("given", "expected"),
        [
            (["a"], {1: 0, 2: 0}),
            (["b=a"], {1: 0}),
            (["x=y=a"], {2: 0}),
            (["b=x=y"], {1: 2}),
            (["x=y"], {0: 2, 1: 2}),
        ],
    )
    def test_names_may_hold_the_sign(self, given: list[str], expected: dict[int, int]) -> None:
        made = table(("a", 1.0, 1.0), ("b", 1.0, 1.0), ("x=y", 1.0, 1.0))
        assert parse_baselines(made, given) == expected


def with_everything() -> Table:
    made = table(("mine", 50.0, 3.0), ("yours", 40.0, -4.0), ("theirs", 30.0, 5.0))
    spans = [Between(45.5, 54.5), Between(1.25, 2.5), Between(-9.0, math.inf)]
    rows = [
        replace(row, cells=(row.cells[0], replace(row.cells[1], uncertainty=span), row.cells[2]))
        for row, span in zip(made.rows, spans, strict=True)
    ]
    rows[2] = replace(rows[2], reported="a paper")
    made = mark_best(replace(made, rows=tuple(rows)), second=True)
    return cite(add_gains(highlight(made, ["mine"]), {0: 1}), {"mine": "me2026"})


def test_everything_in_csv() -> None:
    rows = list(csv.DictReader(io.StringIO(render(with_everything(), "csv"))))
    assert rows[0] == {
        "Method": "mine",
        "R@1": "50.00",
        "R@1 from": "45.50",
        "R@1 to": "54.50",
        "R@1 gain": "10.00",
        "Error": "3.00",
        "Error gain": "7.00",
        "Marked": "",
    }
    assert [rows[2][key] for key in ("R@1 from", "R@1 to")] == ["-9.00", "inf"]
    assert rows[2]["Marked"] == "reported, not re-scored: a paper"


def test_everything_in_json() -> None:
    shown = json.loads(render(with_everything(), "json"))
    assert shown["gains"] == [[None, 10.0, 7.0], [None] * 3, [None] * 3]
    assert shown["uncertainties"][0] == [None, {"low": 45.5, "high": 54.5}, None]
    assert shown["uncertainties"][2][1] == {"low": -9.0, "high": "Infinity"}
    assert shown["reported"] == [None, None, "reported, not re-scored: a paper"]
    assert set(json.loads(render(grouped(2), "json"))) == {"title", "columns", "rows", "notes"}
    assert json.loads(render(grouped(2), "json"))["columns"][3]["group"] == "Scene 1"


def test_a_real_latex_prints_everything(tmp_path: Path) -> None:
    made = with_everything()
    text = typeset(document(latex(made)), tmp_path)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "mine [me2026] 50.00 [45.50, 54.50] (+10.00) 3.00 (+7.00)" in lines
    assert any("30.00 [\u22129.00, inf] 5.00" in line for line in lines)
    assert "† reported, not re-scored" in text
    bold = [word.strip("\u2212") for word in bold_words(tmp_path)]
    assert [word for word in bold if word[:1].isdigit()] == ["50.00", "4.00"]


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
    made = grouped(9, ("a method", "another"))
    text = render(made, "terminal", width=width)
    assert max(map(len, text.splitlines())) <= width
    words = text.split()
    for row in made.texts():
        assert all(words.count(value) == 1 for value in row[1:])
    blocks = text.count("Method")
    assert blocks == {40: 9, 60: 5, 80: 3, 120: 2, 500: 1}[width]
    assert words.count("Scene") == 9

"""Columns of words and of small numbers, columns that every block repeats, notes that are seen."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.annotations import add_gains
from airzoo_bench.tables.interval_layout import with_intervals
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.method_table import OVERALL, method_table
from airzoo_bench.tables.model import Cell, Column, Row, Table, show_number
from airzoo_bench.tables.render import FORMATS, render
from tests.results.made import result
from tests.support import run_main
from tests.tables.typeset import document, typeset, words


def compared() -> Table:
    """Return a table as of comparisons: two columns of names, a number, a tiny p, a verdict."""
    columns = (
        Column("Score"),
        Column("Method"),
        Column("Value", "%", True),
        Column("p", decimals=4),
        Column("Verdict"),
    )
    rows = [
        ("R@1", "mine", 12.5, 0.00003, "better"),
        ("R@1", "theirs, which is long", 7.25, 0.0123, "the same, or not to be told apart"),
    ]
    made = [
        Row(tuple(Cell(v, least=1e-4) if i == 3 else Cell(v) for i, v in enumerate(row)))
        for row in rows
    ]
    return Table("T", columns, tuple(made), leading=2)


class TestSmallNumbers:
    def test_in_text(self) -> None:
        assert "<0.0001" in render(compared(), "terminal", width=200)
        assert "| &lt;0.0001 |" in render(compared(), "markdown")
        assert '<td align="right">&lt;0.0001</td>' in render(compared(), "html")
        assert r"& \textless{}0.0001 &" in render(compared(), "latex")

    def test_in_data(self) -> None:
        assert ",3e-05,better" in render(compared(), "csv")
        assert json.loads(render(compared(), "json"))["rows"][0][3] == 0.00003

    def test_zero_is_small_and_a_loss_is_not(self) -> None:
        assert Cell(0.0, least=0.1).text(1) == "<0.1"
        assert Cell(-0.01, least=0.1).text(2) == "-0.01"
        assert Cell(0.1, least=0.1).text(1) == "0.1"

    def test_on_a_page(self, tmp_path: Path) -> None:
        text = typeset(document(latex(compared())), tmp_path)
        assert "<0.0001" in text.replace(" ", "")


class TestLeading:
    def test_every_block_repeats_the_columns(self) -> None:
        text = render(compared(), "terminal", width=60)
        lines = [line.split() for line in text.splitlines()]
        heads = [line for line in lines if line[:2] == ["Score", "Method"]]
        assert [head[2:] for head in heads] == [["Value", "[%]", "↑", "p"], ["Verdict"]]
        assert text.count("theirs, which is long") == text.count("mine") == 2

    @pytest.mark.parametrize("form", ["latex", "markdown", "html", "csv", "json"])
    def test_other_formats_do_not_break(self, form: str) -> None:
        assert render(compared(), form).count("theirs, which is long") == 1

    def test_none_leads(self) -> None:
        made = replace(compared(), leading=0)
        assert render(made, "terminal", width=40).count("mine") == 1


class TestSides:
    def test_words_stand_left_and_numbers_right(self) -> None:
        assert "\n| --- | --- | ---: | ---: | --- |\n" in render(compared(), "markdown")
        assert r"\begin{tabular}{llrrl}" in render(compared(), "latex")
        heads = render(compared(), "html")
        assert '<th scope="col" align="left">Verdict</th>' in heads
        assert '<th scope="col" align="right">p</th>' in heads

    def test_on_a_page(self, tmp_path: Path) -> None:
        typeset(document(latex(compared())), tmp_path)
        places = dict(words(tmp_path))
        assert places["better"] == pytest.approx(places["Verdict"], abs=0.5)
        assert places["mine"] == pytest.approx(places["Method"], abs=0.5)
        assert places["12.50"] > places["Value"] + 5


NOTES = [
    "reported, not re-scored: airzoo-paper, tab:ourflight-retrieval",
    "the best of each score is that of the rows that were scored here",
    "in brackets: difference from SALAD, whose numbers are reported, not re-scored",
]


def test_what_belongs_to_reported_rows_is_seen_on_the_page(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--published", "--baseline", "SALAD", "--format", "latex"]
    assert run_main("table", *files, *options) == 0
    printed = capsys.readouterr().out
    comments = [line for line in printed.splitlines() if line.startswith("%")]
    text = " ".join(typeset(document(printed), tmp_path).split())
    for note in NOTES:
        assert note in text
        assert not any(note in line for line in comments)
    # What else there is to say stays out of the way.
    assert "A note." not in text
    assert any("Mine, MegaLoc: A note." in line for line in comments)


def test_notes_do_not_stretch_their_table(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for option in ([], ["--layout", "scenes"], ["--all"]):
        options = ["--published", *option, "--format", "latex"]
        assert run_main("table", *files, *options) == 0
        printed = capsys.readouterr().out
        places = []
        bare = [line for line in printed.splitlines() if "footnotesize" not in line]
        assert len(bare) == len(printed.splitlines()) - 1
        for source in (printed, "\n".join(bare)):
            typeset(document(source), tmp_path)
            places.append([x for word, x in words(tmp_path) if word in ("R@1", "50.00", "42.50")])
        assert places[0] == pytest.approx(places[1], abs=0.5), option


def test_what_brackets_mean_stands_under_the_table(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, "--baseline", "MegaLoc", "--format", "latex") == 0
    out = capsys.readouterr().out
    assert "% in brackets" not in out
    (legend,) = [line for line in out.splitlines() if "footnotesize" in line]
    said = legend.replace(r"\\ ", "")
    assert "in brackets: difference from MegaLoc, of the values as printed" in said
    assert "reported" not in legend


def scored(name: str, values: dict[str, Sequence[float]]) -> Scored:
    """Return records of scenes a and b, by scene the values of R@1; the distance is always 1."""
    base = result(name)
    means = {
        scene: {"recall@1": float(np.mean(v)), "distance_m": 1.0} for scene, v in values.items()
    }
    parts = {
        "scenes": means,
        "overall": means["a"],
        "truth": base.truth.model_copy(update={"scene_titles": {"a": "Alp", "b": "Bay"}}),
        "counts": {scene: {"queries": len(v)} for scene, v in values.items()},
        "notes": (),
    }
    frame = pd.DataFrame(
        [
            {"scene": scene, "query": f"{scene}{i}", "recall@1": value, "distance_m": 1.0}
            for scene, found in values.items()
            for i, value in enumerate(found)
        ]
    )
    return Scored(name, base.model_copy(update=parts).with_checksum(), frame)


MIXED, SAME = [0.0, 1.0] * 4, [1.0] * 8
ALIKE = "all queries are alike: resamples cannot differ"


@pytest.mark.parametrize(
    ("one", "two", "shown", "expected"),
    [
        ((MIXED, MIXED), (MIXED, MIXED), (OVERALL,), [f"the average (Distance): {ALIKE}"]),
        ((MIXED, SAME), (MIXED, MIXED), ("b",), [f"Bay (Distance): {ALIKE}"]),
        (
            (SAME, SAME),
            (SAME, SAME),
            ("a", "b", OVERALL),
            [f"Alp, Bay, the average (Distance): {ALIKE}"],
        ),
        (
            (MIXED, MIXED[:3]),
            (MIXED, MIXED[:3]),
            ("b", OVERALL),
            ["Bay, the average: only 3 queries in scene b: an interval needs 5"],
        ),
    ],
)  # fmt: skip
def test_why_there_is_no_interval(
    one: tuple[list[float], ...],
    two: tuple[list[float], ...],
    shown: tuple[str, ...],
    expected: list[str],
) -> None:
    methods = [
        scored(name, dict(zip("ab", values, strict=True)))
        for name, values in (("one", one), ("two", two))
    ]
    board = method_table([method.result for method in methods], every_score=True)
    made = with_intervals(board, methods, ResamplingConfig(resamples=200), shown)
    notes = [note for note in made.notes if not note.startswith("in square brackets")]
    assert notes == [f"no interval for {note}" for note in expected]


def test_a_scene_of_one_record_has_no_interval() -> None:
    method = scored("one", {"a": [0.5], "b": [0.25]})
    method = replace(method, result=method.result.model_copy(update={"track": "reconstruction"}))
    board = method_table([method.result])
    made = with_intervals(board, [method], ResamplingConfig(resamples=200), ("a", "b", OVERALL))
    assert made.notes == (
        "no interval for Alp, Bay: a scene has one record",
        "no interval for the average: only 2 scenes: an interval needs 5",
    )


def test_a_number_that_is_too_small_has_no_gain() -> None:
    rows = tuple(Row((Cell(name), Cell(v, least=0.1))) for name, v in (("a", 0.01), ("b", 0.5)))
    made = add_gains(Table("T", (Column("M"), Column("p", "", False)), rows), {1: 0, 0: 1})
    assert [row.cells[1].gain for row in made.rows] == [None, None]


class TestLargeNumbers:
    @pytest.mark.parametrize(
        ("value", "shown"),
        [
            (1e200, "1.00e+200"),
            (-1e200, "-1.00e+200"),
            (12546.333, "12546.33"),
            (999999999.0, "999999999.00"),
            (1e9, "1.00e+09"),
            (math.inf, "inf"),
            (-0.001, "0.00"),
        ],
    )
    def test_their_width_is_bounded(self, value: float, shown: str) -> None:
        assert show_number(value, 2) == shown

    @given(st.floats(-1e300, 1e300) | st.sampled_from([math.inf, -math.inf]), st.integers(0, 6))
    def test_no_number_is_wide(self, value: float, decimals: int) -> None:
        text = show_number(value, decimals)
        assert len(text) <= len("-1000000000.") + decimals
        if math.isfinite(value):
            assert float(text) == pytest.approx(value, rel=0.5, abs=0.51)

    @pytest.mark.parametrize("form", FORMATS)
    def test_in_every_format(self, form: str) -> None:
        rows = (Row((Cell("a"), Cell(1e200, gain=-9e199))), Row((Cell("b"), Cell(2.0))))
        table = Table("T", (Column("Method"), Column("Error", "m", False)), rows)
        text = render(table, form)
        assert "000000" not in text
        assert "e+200" in text
        assert "'" not in text

    def test_on_a_page(self, tmp_path: Path) -> None:
        rows = (Row((Cell("a"), Cell(1e200, gain=-9e199))), Row((Cell("b"), Cell(2.0))))
        table = Table("T", (Column("Method"), Column("Error", "m", False)), rows)
        page = typeset(document(latex(table)), tmp_path)
        assert "1.00e+200" in page

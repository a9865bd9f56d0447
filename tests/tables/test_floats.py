"""LaTeX that goes into a paper: what is shrunk, needed packages; order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from airzoo_bench.tables.annotations import sort_rows
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import Cell, Column, Row, Table
from tests.support import run_main
from tests.tables.small_tables import scored
from tests.tables.two_results import Show
from tests.tables.typeset import typeset, words

TABLE = ("table", "--published", "--protocol")
LATEX = ("--format", "latex")


def paper(table: str) -> str:
    """Return a paper around a table, with the packages that it names."""
    (needed,) = re.findall(r"^% needs (.*)$", table, re.MULTILINE)
    begin = [r"\documentclass[a4paper]{article}", needed, r"\begin{document}", r"\noindent"]
    return "\n".join([*begin, table, r"\end{document}", ""])


@pytest.mark.parametrize("protocol", ["uav-visloc-retrieval", "airzoo-real-matching"])
def test_packages_are_always_named_on_top(
    protocol: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main(*TABLE, protocol, *LATEX) == 0
    assert capsys.readouterr().out.splitlines()[0] == r"% needs \usepackage{booktabs}"
    assert run_main(*TABLE, protocol, *LATEX, "--fit") == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first == r"% needs \usepackage{booktabs} \usepackage{graphicx}"


def test_fit_shrinks_what_is_wide_and_nothing_else(tmp_path: Path) -> None:
    def right_end(table: Table, *, fit: bool) -> float:
        made = latex(table, fit=fit)
        typeset(paper(made), tmp_path)
        return max(place for _, place in words(tmp_path))

    narrow = Table("T", (Column("M"), Column("A")), (Row((Cell("m"), Cell(1.0))),))
    assert right_end(narrow, fit=True) == right_end(narrow, fit=False)
    assert right_end(scored("gains"), fit=True) < 480  # points, of 595


def test_shrinking_is_for_latex(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*TABLE, "airzoo-real-retrieval", "--fit") == 2
    assert "--fit" in capsys.readouterr().err


def test_decimals(files: list[Path], show: Show, capsys: pytest.CaptureFixture[str]) -> None:
    rows = show(*files, "--decimals", "1")
    assert [row["R@1"] for row in rows] == ["50.0", "42.5"]
    assert [row["R@1"] for row in show(*files, "--decimals", "0")] == ["50", "42"]
    # What is shown with the same digits is the best alike.
    options = ("--layout", "scenes", "--decimals", "0", "--format", "markdown")
    assert run_main(*TABLE, "airzoo-real-matching", *options) == 0
    assert "**84**" in capsys.readouterr().out
    assert show(files[0], "--decimals", "3")[0]["R@1"] == "50.000"


class TestSorting:
    def test_by_score_best_first(self, files: list[Path], show: Show) -> None:
        rows = show(*files, "--sort", "R@1", "--all")
        assert [row["Method"] for row in rows] == ["Mine", "MegaLoc"]
        rows = show(*reversed(files), "--sort", "recall@1")
        assert [row["Method"] for row in rows] == ["Mine", "MegaLoc"]

    def test_by_name(self, files: list[Path], show: Show) -> None:
        rows = show(*files, "--sort", "method", "--published")
        names = [row["Method"] for row in rows]
        assert names == sorted(names, key=str.casefold)

    def test_of_scenes_the_average_counts(self, files: list[Path], show: Show) -> None:
        rows = show(*reversed(files), "--layout", "scenes", "--sort", "R@1")
        assert [row["Method"] for row in rows] == ["Mine", "MegaLoc"]
        rows = show(*files, "--layout", "scenes", "--sort", "R@1", "--no-average")
        assert [row["Method"] for row in rows] == ["MegaLoc", "Mine"]

    def test_failures_last_then_what_is_missing_then_floors(self) -> None:
        column = Column("Error", "m", False)
        values = {"none": None, "failed": float("inf"), "near": 1.0, "far": 20.0}
        rows = [Row((Cell(name), Cell(value))) for name, value in values.items()]
        floor = Row((Cell("floor"), Cell(0.5)), floor=True)
        made = sort_rows(Table("T", (Column("M"), column), (floor, *rows)), "Error", "")
        names = [row.cells[0].value for row in made.rows]
        assert names == ["near", "far", "failed", "none", "floor"]

    def test_a_score_that_is_not_shown(
        self, files: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run_main("table", *files, "--sort", "R@2") == 2
        assert "--sort: no score here is called 'R@2' (did you mean 'R@1" in capsys.readouterr().err
        assert run_main("table", files[0], "--sort", "R@1") == 2
        assert "takes no --sort" in capsys.readouterr().err


class TestAveragesOfThePaper:
    def test_that_another_table_prints(self, capsys: pytest.CaptureFixture[str]) -> None:
        command = (*TABLE, "airzoo-real-matching", "--layout", "scenes")
        assert run_main(*command, "-f", "csv") == 0
        head, *rows = capsys.readouterr().out.splitlines()
        assert head.split(",")[9:13] == [f"Average {t}" for t in ("Median", "@5m", "@10m", "@20m")]
        assert rows[-1].startswith(
            "RoMA (Ours),3.07,76.40,83.85,83.85,2.99,83.16,86.84,90.00,3.03,79.78,85.35,86.93,"
        )
        assert run_main(*command) == 0
        shown = capsys.readouterr().out
        assert "–" not in shown
        assert "tab:matching_results; average: airzoo-paper, tab:translation_accuracy" in shown

    def test_that_nobody_prints(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        import airzoo_bench.tables.published as published

        every = published.published_tables
        monkeypatch.setattr(
            published, "published_tables", lambda *of: [t for t in every(*of) if t.has_scenes]
        )
        assert run_main(*TABLE, "airzoo-real-matching", "--layout", "scenes") == 0
        shown = capsys.readouterr().out
        assert "–" not in shown
        assert "Average" not in shown

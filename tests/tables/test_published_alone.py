"""What a paper prints, laid out without any result."""

from __future__ import annotations

import csv
import io

import pytest

from airzoo_bench.tables.published import published_tables
from tests.support import run_main


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, str]]:
    command = ("table", "--published", "--protocol", *arguments, "--format", "csv")
    assert run_main(*command) == 0
    return list(csv.DictReader(io.StringIO(capsys.readouterr().out)))


@pytest.mark.parametrize(
    ("protocol", "track", "label"),
    [
        ("uav-visloc-retrieval", "retrieval", "tab:uav-visloc"),
        ("airzoo-real-retrieval", "retrieval", "tab:ourflight-retrieval"),
        ("airzoo-real-matching", "matching", "tab:translation_accuracy"),
        ("aerialextrematch-matching", "matching", "tab:6dof_recall"),
    ],
)
def test_averages_are_those_of_the_paper(
    protocol: str, track: str, label: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = printed(capsys, protocol)
    benchmark = protocol.removesuffix(f"-{track}")
    (table,) = (t for t in published_tables(benchmark, track) if t.label == label)
    assert [row["Method"] for row in rows] == list(table.values)
    for row in rows:
        wanted = sorted(table.average_of(row["Method"]).values())
        shown = [text for head, text in row.items() if head not in ("Method", "Marked")]
        assert sorted(map(float, shown)) == wanted
        assert row["Marked"] == f"reported, not re-scored: airzoo-paper, {label}"


def test_scenes_and_chosen_scores(capsys: pytest.CaptureFixture[str]) -> None:
    rows = printed(capsys, "uav-visloc-retrieval", "--layout", "scenes", "--score", "AP@5")
    heads = [f"Scene {number} AP@5" for number in range(1, 12)]
    assert list(rows[0]) == ["Method", *heads, "Average AP@5", "Marked"]
    assert rows[-1]["Method"] == "MegaLoc (Ours)"


@pytest.mark.parametrize(
    ("arguments", "column"),
    [
        (("uav-visloc-retrieval", "--sort", "R@1"), "R@1"),
        (("uav-visloc-retrieval", "--sort", "AP@5", "--layout", "scenes"), "Average AP@5"),
        (("airzoo-real-retrieval", "--sort", "R@5", "--layout", "scenes"), "Average R@5"),
    ],
)
def test_rows_are_sorted(
    arguments: tuple[str, ...], column: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = printed(capsys, *arguments)
    values = [float(row[column]) for row in rows]
    assert len(set(values)) > 3
    assert values == sorted(values, reverse=True)


def test_a_score_to_sort_by_that_is_not_printed_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ("table", "--published", "--protocol", "uav-visloc-retrieval", "--sort")
    assert run_main(*command, "R@2") == 2
    assert "expected: one of: R@1; R@3; R@5; AP@5" in capsys.readouterr().err


def test_the_best_of_reported_rows_is_marked(capsys: pytest.CaptureFixture[str]) -> None:
    command = ("table", "--published", "--protocol", "uav-visloc-retrieval", "-f", "markdown")
    assert run_main(*command) == 0
    shown = capsys.readouterr().out
    assert "**28.64**" in shown
    assert shown.count("**") == 8
    assert "scored here" not in shown


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "nothing to lay out"),
        (("--published",), "nothing to lay out"),
        (("--protocol", "uav-visloc-retrieval"), "--published with --protocol"),
        (("--published", "--protocol", "airzoo-mini-retrieval"), "nothing is published on"),
        (("--published", "--protocol", "uav-vislok-retrieval"), "uav-visloc-retrieval"),
        (("r.json", "--published", "--protocol", "x"), "results name their own protocol"),
        (
            ("--published", "--protocol", "uav-visloc-retrieval", "--layout", "benchmarks"),
            "layout benchmarks is for results",
        ),
        (
            ("--published", "--protocol", "uav-visloc-retrieval", "--layout", "result"),
            "layout result",
        ),
        (
            ("--published", "--protocol", "uav-visloc-retrieval", "--intervals"),
            "--intervals needs results",
        ),
    ],
)
def test_what_cannot_be_laid_out(
    arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *arguments) == 2
    out, said = capsys.readouterr()
    assert out == ""
    assert message in said
    assert "Traceback" not in said

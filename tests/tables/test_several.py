"""Results of several protocols in one table: blocks of one track, and rows that have numbers."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

from airzoo_bench.results.files import method_names
from airzoo_bench.results.result import Result, ScoreColumn, write_result
from airzoo_bench.tables.blocks import by_count
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.render import render
from tests.results.made import result
from tests.support import run_main

ERROR = ScoreColumn(
    key="error", title="Error", unit="m", higher_is_better=False, average="mean", headline=True
)


def of(method: str, benchmark: str, track: str, value: float) -> Result:
    """Return a result of a track: recall in retrieval, an error elsewhere."""
    base = result(method)
    parts = {
        "track": track,
        "protocol": base.protocol.model_copy(update={"name": f"{benchmark}-{track}"}),
        "truth": base.truth.model_copy(update={"benchmark": benchmark}),
    }
    keys = [column.key for column in base.columns]
    values = dict(zip(keys, [value, 1.0], strict=True))
    columns = base.columns
    if track != "retrieval":
        columns, values = (ERROR,), {"error": value}
    scores = {"scenes": {"s": values}, "overall": values, "pooled": values, "columns": columns}
    return base.model_copy(update=parts | scores).with_checksum()


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Write results of two tracks on two benchmarks, their tracks in turns."""
    made = [
        of("Cat", "land", "retrieval", 0.5),
        of("Dog", "land", "matching", 7.0),
        of("Cow", "sea", "retrieval", 0.25),
        of("Dog", "sea", "matching", 8.0),
        of("Cat", "sea", "matching", 9.0),
    ]
    for number, one in enumerate(made):
        write_result(tmp_path / f"{number}.json", one)
    return [tmp_path / f"{number}.json" for number in range(len(made))]


def printed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert run_main("table", *arguments) == 0
    return capsys.readouterr().out


def test_benchmarks_are_the_usual_layout(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    rows = list(csv.reader(io.StringIO(printed(capsys, *files, "--format", "csv"))))
    heads = ["land, retrieval R@1", "sea, retrieval R@1"]
    heads += ["land, matching Error", "sea, matching Error"]
    assert rows == [
        ["Method", *heads],
        ["Cat", "50.00", "–", "–", "9.00"],
        ["Cow", "–", "25.00", "–", "–"],
        ["Dog", "–", "–", "7.00", "8.00"],
    ]


SHOWN = [
    [["Cat", "50.00", "–"], ["Cow", "–", "25.00"]],
    [["Cat", "–", "9.00"], ["Dog", "7.00", "8.00"]],
]


def blocks(text: str) -> list[list[list[str]]]:
    """Return the rows of each block, without their marks."""
    for mark in ("*", "|", "&", "\\", "<strong>", "</strong>", "textbf{", "}", "─"):
        text = text.replace(mark, " ")
    text = text.replace("</td>", " ").replace('<td align="right">', " ")
    text = text.replace('<tr><td align="left">', "").replace("</tr>", "").replace("--", "–")
    found: list[list[list[str]]] = []
    for line in text.splitlines():
        words = line.split()
        if "R@1" in words or "Error" in words or "<thead>" in line:
            found.append([])
        elif words and words[0] in ("Cat", "Cow", "Dog"):
            found[-1].append(words)
    return [block for block in found if block]  # a note names scores too


@pytest.mark.parametrize("form", ["terminal", "latex", "markdown", "html"])
def test_a_block_is_of_one_track_and_holds_who_has_numbers(
    form: str, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert blocks(printed(capsys, *files, "--format", form)) == SHOWN


def test_json_keeps_a_row_a_method(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    shown = json.loads(printed(capsys, *files, "--format", "json"))
    assert [row[0] for row in shown["rows"]] == ["Cat", "Cow", "Dog"]


def test_tracks_are_tabulars_of_their_own(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed(capsys, *files, "--format", "latex")
    assert text.count(r"\begin{tabular}") == 2
    assert text.count(r"\medskip") == 1


def test_a_score_that_one_track_has(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys, *files, "--score", "Error")
    assert "Cow" not in text
    assert "left out, having no Error: land-retrieval v1, sea-retrieval v1" in text
    both = printed(capsys, *files, "--score", "Error", "--score", "R@1", "--format", "csv")
    assert both.splitlines()[0].count("Error") == both.splitlines()[0].count("R@1") == 2
    assert run_main("table", *files, "--score", "R@7") == 2
    assert "no score here is called 'R@7'" in capsys.readouterr().err


def test_units_are_named_for_the_fewer_scores(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "  Error in m; all other scores in %\n" in printed(capsys, *files)
    assert "  R@1 in %\n" in printed(capsys, files[0], files[2], "--layout", "benchmarks")


def test_notes_say_of_which_benchmark_they_are(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed(capsys, *files)
    assert "  sea, retrieval: Cow: A note.\n" in text
    assert "  land-matching v1: protocol " in text


@pytest.mark.parametrize("layout", ["methods", "scenes"])
def test_layouts_of_one_protocol(
    layout: str, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, "--layout", layout) == 2
    message = capsys.readouterr().err
    assert f"layout {layout} is for results of one protocol, and these are of 4" in message
    assert "choose --layout benchmarks" in message


def test_one_name_and_different_protocols(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = of("Cat", "land", "retrieval", 0.5)
    for number in range(20):
        other = base.protocol.model_copy(update={"fingerprint": f"z{number}"})
        path = tmp_path / f"other{number}.json"
        write_result(path, base.model_copy(update={"protocol": other}).with_checksum())
        files.append(path)
    assert run_main("table", *files) == 2
    message = capsys.readouterr().err
    assert f"Cat ({files[0]}) and Cat ({tmp_path / 'other0.json'})" in message
    assert "different protocols (f and z0)" in message
    assert "20 of 21 results differ from the first" in message
    assert "fix:" in message
    assert message.count(".json") < 8


@pytest.mark.parametrize(
    ("options", "fragments"),
    [
        (["--second"], ["nothing to be compared with", "takes no --second", "more results"]),
        (["--baseline", "Cat"], ["nothing to be compared with", "--baseline"]),
        (["--layout", "result", "--scene", "s"], ["scenes for rows", "--scene", "add --layout"]),
        (["--highlight", "Cat"], ["scenes for rows", "--highlight"]),
        (["--cite", "Cat=x", "--format", "latex"], ["scenes for rows", "--cite"]),
    ],
)  # fmt: skip
def test_what_one_result_does_not_take(
    options: list[str],
    fragments: list[str],
    files: list[Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_main("table", files[0], *options) == 2
    message = capsys.readouterr().err
    for fragment in fragments:
        assert fragment in message


def test_scores_of_one_result(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    rows = printed(capsys, files[0], "--score", "Distance", "--format", "csv").splitlines()
    assert rows[:2] == ["Scene,Queries,Distance", "Scene,3,1.00"]


def test_a_wide_benchmark_stands_alone() -> None:
    columns = [
        Column(f"S{score}", "", True, group=f"G{group}") for group in range(4) for score in range(7)
    ]
    rows = (Row((Cell("a"), *(Cell(1.0) for _ in columns))),)
    table = Table("T", (Column("M"), *columns), rows, groups_per_block=4)
    assert [len(piece.columns) for piece in by_count(table)] == [8] * 4
    text = render(table, "terminal", width=500)
    assert text.count("S0") == 4
    assert len([line for line in text.splitlines() if "S0" in line]) == 1


def test_names_by_protocol_or_not() -> None:
    made = [of("Cat", "land", "retrieval", 0.5), of("Cat", "sea", "retrieval", 0.5)]
    paths = [Path("a/result.json"), Path("b/result.json")]
    assert method_names(paths, made) == ["Cat", "Cat"]
    named = ["Cat (a)", "Cat (b)"]
    assert method_names(paths, made, by_protocol=False) == named
    assert method_names(paths, [made[0], made[0]]) == named

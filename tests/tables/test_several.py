"""Results of several protocols in one table: blocks of one track, and rows that have numbers."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from airzoo_bench.results.result import Result, ScoreColumn, write_result
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


def test_tracks_are_tabulars_of_their_own(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed(capsys, *files, "--format", "latex")
    assert text.count(r"\begin{tabular}") == 2
    assert text.count(r"\medskip") == 1


@pytest.mark.parametrize("layout", ["methods", "scenes"])
def test_layouts_of_one_protocol(
    layout: str, files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, "--layout", layout) == 2
    message = capsys.readouterr().err
    assert f"layout {layout} is for results of one protocol, and these are of 4" in message
    assert "choose --layout benchmarks" in message


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

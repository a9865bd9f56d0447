"""``airzoo-bench plot`` by how it is called."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.cli import common
from airzoo_bench.cli.common import progress, working
from airzoo_bench.cli.engines import rated
from airzoo_bench.core.progress import report_progress
from tests.support import run_main, write_predictions

KINDS = "recall, errors, thresholds, intervals, scenes, condition"


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        ([], [f"plot needs a kind, one of {KINDS}; and results; and -o, the file to save"]),
        (["r.json", "-o", "x.png"], [f"one of {KINDS}", "name the kind before the results"]),
        (["recal", "r.json", "-o", "x.png"], ["'recal' is no kind", "did you mean 'recall'"]),
        (["recall", "-o", "x.png"], ["plot needs results\n", "recall results/*/result.json -o"]),
        (["scenes", "r.json"], ["plot needs -o, the file to save\n", "-o scenes.png"]),
        (["condition", "r.json"], ["condition results/*/result.json --by weather -o condition"]),
    ],
)
def test_what_a_call_lacks(
    call: list[str], parts: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("plot", *call) == 2
    out, said = capsys.readouterr()
    assert out == ""
    assert "Missing argument" not in said
    for part in parts:
        assert part in said


def test_a_folder_stands_for_the_result_in_it(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 0
    pictures = [tmp_path / name for name in ("a.svg", "b.svg")]
    for given, picture in zip(("out", "out/result.json"), pictures, strict=True):
        assert run_main("plot", "recall", tmp_path / given, "-o", picture) == 0
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    capsys.readouterr()
    assert run_main("plot", "recall", tmp_path, "-o", tmp_path / "c.png") == 2
    said = capsys.readouterr().err
    assert "a folder, not a result file, and without a result.json" in said
    assert f"name {tmp_path}/*/result.json (there are 1)" in said


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_work_is_told_to_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream, is_told in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setenv("TERM", "xterm")
        with working("drawing [red]\x07.png"):
            pass
        assert ("drawing [red]\\x07.png" in stream.getvalue()) is is_told


def test_work_that_takes_long_is_named_in_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("sys.stderr", io.StringIO())
    monkeypatch.setattr(common, "say", said.append)
    monkeypatch.setitem(report_progress.__kwdefaults__, "first_s", 0.01)
    with working("drawing"):
        until = time.monotonic() + 30
        while not said and time.monotonic() < until:
            time.sleep(0.01)
    assert said == ["drawing ..."]
    monkeypatch.setitem(report_progress.__kwdefaults__, "first_s", 0.2)
    with pytest.raises(KeyError), working("fetching"):
        raise KeyError
    time.sleep(0.4)
    assert said == ["drawing ..."]  # nothing is named any more that has failed


def test_work_within_work_is_shown_below_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one display: some versions of rich refuse a second."""
    monkeypatch.setattr("sys.stderr", Terminal())
    displays = []
    monkeypatch.setattr("rich.progress.Progress.start", lambda self: displays.append(self))
    for scene in progress(("one", "two"), "scenes", 2):
        assert list(progress(range(3), f"photos of {scene}", 3)) == [0, 1, 2]
        (shown,) = displays
        assert [task.description for task in shown.tasks] == ["scenes"]
    assert shown.tasks == []
    rows = []
    for scene in rated((piece for piece in ("one",)), "learning [words]", 1):
        rows = [(task.description, task.total) for task in displays[-1].tasks]
        assert scene == "one"
    assert rows == [("learning [words]", None)]  # one piece is not half done: its bar pulses
    assert list(progress(range(1), "scenes", 1)) == [0]
    assert len(displays) == 3


OWN = {
    "recall": ({"--up-to"}, "recall at K"),
    "errors": ({"--score"}, "share of queries whose error is below"),
    "thresholds": (set(), "precision, recall and F1"),
    "intervals": ({"--score"}, "with its 95 % interval"),
    "scenes": ({"--score"}, "by method and scene"),
    "condition": ({"--score", "--by", "--bins"}, "in groups of queries"),
}


@pytest.mark.parametrize("kind", OWN)
def test_each_kind_has_a_help_of_its_own(
    kind: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert run_main("plot", kind, "--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    own, says = OWN[kind]
    assert says in text
    assert f"Example: airzoo-bench plot {kind} results/" in text
    every = {option for options, _ in OWN.values() for option in options}
    assert {option for option in every if f" {option} " in text.partition("Options")[2]} == own


def test_the_help_of_all_names_the_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("plot", "--help") == 0
    text = capsys.readouterr().out
    assert all(kind in text for kind in OWN)

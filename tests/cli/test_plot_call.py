"""How the command line shows that work is under way."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.cli.common import progress, working
from tests.support import run_main, write_predictions


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
    for scene in progress((piece for piece in ("one",)), "learning [words]", 1):
        rows = [(task.description, task.total) for task in displays[-1].tasks]
        assert scene == "one"
    assert rows == [("learning [words]", None)]  # one piece is not half done: its bar pulses
    assert list(progress(range(1), "scenes", 1)) == [0]
    assert len(displays) == 3

"""Exit codes, pipes, stops and letters, as the operating system sees them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.cli.environment import environment
from tests.support import HANGS_S, files_below, make_place, run_main, write_predictions


def test_a_bug_keeps_its_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def bug(*arguments: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("airzoo_bench.cli.common.show_rows", bug)
    assert run_main("protocols") == 70
    message = capsys.readouterr().err
    assert "ZeroDivisionError: oops" in message
    assert "this is a bug of the suite" in message


@pytest.mark.parametrize(
    ("fault", "code", "message"),
    [
        (PermissionError(13, "Permission denied", "/x/y"), 2, "/x/y: Permission denied"),
        (OSError(28, "No space left on device"), 2, "a file: No space left on device"),
        (MemoryError("Unable to allocate 9 GiB"), 2, "run it on a machine with more memory"),
    ],
    ids=["permission", "disk", "memory"],
)
def test_what_the_machine_refuses(
    fault: BaseException,
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("airzoo_bench.cli.common.show_rows", refuse)
    assert run_main("protocols") == code
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "arguments", [["evil"], ["eval", "retrieval"], ["check", "--jobs"], ["table"]]
)
def test_a_wrong_call_exits_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*arguments) == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Error" in message or message.startswith("airzoo-bench: ")


def test_a_path_too_long_for_the_system(capsys: pytest.CaptureFixture[str], data: Path) -> None:
    assert run_main("check", "x" * 5000 + ".npz") == 2
    message = capsys.readouterr().err
    assert "File name too long" in message
    assert len(message) < 400


@pytest.mark.parametrize("form", ["terminal", "latex", "csv", "markdown", "html", "json"])
def test_a_method_s_name_is_shown_and_never_obeyed(
    form: str,
    data: Path,
    tmp_path: Path,
    perfect: dict[str, Any],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    out = tmp_path / "out"
    name = "\x1b]0;x\x07[red]\n<b>\udcff$"
    assert run_main("eval", "retrieval", path, "--method", name, "-f", form, "--out", out) == 0
    again = shutil.copy(out / "result.json", tmp_path / "again.json")
    assert run_main("table", out / "result.json", again, "-f", form) == 0
    said = capsys.readouterr()
    assert all(c.isprintable() or c == "\n" for c in said.out + said.err)
    if form == "json":
        evaluated = json.JSONDecoder().raw_decode(said.out)[0]
        assert evaluated["predictions"]["method"] == "\ufffd]0;x\ufffd[red]\ufffd<b>\ufffd$"


def test_a_reader_that_goes_away_is_no_fault() -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "airzoo_bench", "protocols", "photos-matching"]
    with os.fdopen(write, "wb") as pipe:
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, env=environment())
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interrupted_prepare_leaves_nothing(tmp_path: Path) -> None:
    # Tiles of 16 px that overlap by half, as files: a thousand of them, each made to take so long
    # that the signal comes in time on a machine of any speed.
    place = make_place(tmp_path / "sources")
    arguments = place.arguments(out=tmp_path / "out" / "park", tile_size=16, tiles="files")
    slowed = (
        "import time\n"
        "from airzoo_bench.__main__ import main\n"
        "from airzoo_bench.datasets import folder\n"
        "read = folder.read_tile\n"
        "folder.read_tile = lambda *given: (time.sleep(0.05), read(*given))[1]\n"
        "main()\n"
    )
    command = [sys.executable, "-c", slowed, *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
    )
    deadline = time.monotonic() + HANGS_S
    while not list(tmp_path.glob("out/.park.prepare/.park.*/scenes/park/retrieval/tiles/*.png")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=HANGS_S)
    assert process.returncode == 130
    assert b"stopped; nothing was left half-written" in message
    assert b"Traceback" not in message
    assert files_below(tmp_path / "out") == set()

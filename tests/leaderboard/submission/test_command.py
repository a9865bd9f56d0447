"""``airzoo-bench submission``: made by options or by questions, checked, whole or not at all."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from airzoo_bench.core.errors import UserError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.leaderboard.submission import read_submission
from airzoo_bench.results.result import write_result
from tests.leaderboard.submission.support import PROTOCOL, write, write_board
from tests.support import write_predictions

Command = Callable[..., Result]
OPTIONS = [
    *("--protocol", PROTOCOL, "--method", "SALAD", "--team", "Example Lab"),
    *("--contact", "ada@example.org", "--author", "Ada Example", "--author", "Grace Example"),
    *("--licence", "CC-BY-4.0", "--training-data", "none", "--stages", "single-stage"),
]


@pytest.fixture
def board(tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_board(tmp_path / "board")
    monkeypatch.chdir(tmp_path / "board")
    return tmp_path / "board"


@pytest.fixture
def preds(tmp_path: Path, perfect: Any) -> Path:
    return write_predictions(tmp_path / "preds.npz", PROTOCOL, **perfect)


def test_what_is_made_is_found_sound(
    board: Path, data: Path, preds: Path, command: Command
) -> None:
    claimed = preds.with_name("result.json")
    write_result(claimed, evaluate(preds, data=data, method="SALAD").result)
    made = command("submission", "new", preds, *OPTIONS, "--uses", "prior", "--result", claimed)
    assert made.exit_code == 0, made.output
    assert made.stdout == "submissions/made/retrieval/salad\n"
    assert "next: airzoo-bench submission check submissions/made/retrieval/salad" in made.stderr
    home = board / "submissions" / "made" / "retrieval" / "salad"
    assert sorted(path.name for path in home.iterdir()) == [
        "preds.npz",
        "result.json",
        "submission.toml",
    ]
    stated = read_submission(home / "submission.toml")
    assert stated.training_data == ()
    assert stated.pipeline.uses == ("prior",)
    found = command("submission", "check", home)
    assert found.exit_code == 0, found.output
    assert "every score is as claimed" in found.stdout
    assert "checked and scored, nothing wrong was found" in found.stdout


def test_modes_are_not_copied(board: Path, preds: Path, command: Command) -> None:
    """Of a disk where every file is executable; no board takes such a file."""
    folder = preds.with_name("many")
    folder.mkdir()
    preds = preds.rename(folder / preds.name)
    preds.chmod(0o755)
    assert command("submission", "new", folder, *OPTIONS).exit_code == 0
    copied = board / "submissions" / "made" / "retrieval" / "salad" / "many" / preds.name
    assert copied.stat().st_mode & 0o111 == 0


def test_what_a_claim_says_does_nothing_to_the_terminal(
    board: Path, data: Path, perfect: Any, command: Command
) -> None:
    home = write(board, perfect)
    result = evaluate(home / "preds.npz", data=data, method="SALAD").result
    versions = result.versions | {"scipy": "\x1b[2J"}
    changed = result.model_copy(update={"versions": versions}).with_checksum()
    write_result(home / "result.json", changed)
    found = command("submission", "check", home)
    assert found.exit_code == 0
    assert r"\x1b[2J" in found.stdout
    assert "\x1b[2J" not in found.output


def test_predictions_at_an_address_are_not_copied(
    board: Path, preds: Path, command: Command
) -> None:
    url = "https://example.org/preds.npz"
    made = command("submission", "new", preds, *OPTIONS, "--url", url)
    assert made.exit_code == 0, made.output
    home = board / made.stdout.strip()
    assert [path.name for path in home.iterdir()] == ["submission.toml"]
    given = read_submission(home / "submission.toml").predictions
    assert (given.url, given.size) == (url, preds.stat().st_size)
    found = command("submission", "check", home)
    assert found.exit_code == 0
    assert "add --fetch" in found.stderr


def test_without_a_terminal_nothing_is_asked(board: Path, preds: Path, command: Command) -> None:
    made = command("submission", "new", preds, *OPTIONS[2:])
    assert made.exit_code == 1
    assert "missing: --protocol" in str(made.exception)
    missing = command("submission", "new", preds.with_name("nothing.npz"))
    assert "no such file or folder" in str(missing.exception)
    assert not (board / "submissions").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--method", "=1+1"), "begins with '=', as formulas"),
        (("--licence", "free"), "no licence of SPDX is called that"),
        (("--stages", "two"), "key 'pipeline.stages' is 'two'"),
        (("--date", "yesterday"), "--date 'yesterday' is no date"),
        (("--protocol", "mad-retrieval"), "did you mean 'made-retrieval'?"),
        (("--folder", "../x"), "no name for a folder: '../x'"),
        (("--method", "Сова"), "name one by --folder"),
        (("--url", "http://example.org/p.npz"), "an address begins with https://"),
        (("--setting", "words"), "--setting 'words' is no setting"),
        (("--result", "nothing.json"), "no such file"),
    ],
)
def test_nothing_is_written_where_an_option_is_wrong(
    board: Path, preds: Path, command: Command, more: tuple[str, str], said: str
) -> None:
    made = command("submission", "new", preds, *OPTIONS, *more)
    assert isinstance(made.exception, UserError)
    assert said in str(made.exception)
    assert not (board / "submissions").exists()


def test_an_earlier_version_is_replaced_only_when_asked(
    board: Path, preds: Path, command: Command
) -> None:
    for _ in range(2):
        made = command("submission", "new", preds, *OPTIONS)
    assert "the folder exists already" in str(made.exception)
    changed = command("submission", "new", preds, *OPTIONS, "--date", "2026-01-02", "--force")
    assert changed.exit_code == 0, changed.output
    home = board / changed.stdout.strip()
    assert str(read_submission(home / "submission.toml").date) == "2026-01-02"
    assert [path.name for path in home.parent.iterdir()] == ["salad"]


def test_exit_codes_and_json(board: Path, perfect: Any, command: Command) -> None:
    home = write(board, perfect)
    sound = command("submission", "check", home, "--format", "json")
    assert sound.exit_code == 0
    values = json.loads(sound.stdout)
    assert values["passes"] is True
    assert values["result"]["predictions"]["method"] == "SALAD"
    (home / "notes.txt").write_text("x", encoding="utf-8")
    wrong = command("submission", "check", home, "--format", "json")
    assert wrong.exit_code == 1
    values = json.loads(wrong.stdout)
    assert values["passes"] is False
    assert values["errors"][0]["fix"] == "remove it"
    assert values["result"] is None
    missing = command("submission", "check", board / "nothing")
    assert "no such folder" in str(missing.exception)
    above = command("submission", "check", home.parent)
    assert "no submission.toml here" in str(above.exception)
    outside = command("submission", "check", board.parent / "data")
    assert "not in the repository of a board" in str(outside.exception)


def test_a_benchmark_that_is_not_here_is_said(
    board: Path, perfect: Any, command: Command, tmp_path: Path, data: Path
) -> None:
    home = write(board, perfect)
    elsewhere = tmp_path / "elsewhere"
    protocols = elsewhere / "other" / "protocols"
    protocols.mkdir(parents=True)
    source = data / "made" / "protocols" / f"{PROTOCOL}.toml"
    (protocols / source.name).write_bytes(source.read_bytes())
    found = command("submission", "check", home, "--data", elsewhere)
    assert found.exit_code == 0
    assert "not scored: benchmark made is not there" in found.stderr
    asked = command("submission", "check", home, "--data", elsewhere, "--score")
    assert "not scored: benchmark made is not there" in str(asked.exception)


@pytest.mark.parametrize("none", ["none", "[]"])
def test_questions_on_a_terminal(board: Path, preds: Path, none: str) -> None:
    answers = [
        *("made-retrival", PROTOCOL),
        "SALAD",
        "Example Lab",
        "Ada",
        "ada@example.org",
        "Ada Example, Grace Example",
        "CC-BY-4.0",
        *("", none),
        *("single", "single-stage"),
    ]
    text, code = _typed(["submission", "new", str(preds)], answers)
    assert code == 0, text
    # Each asked again, and what is right is said:
    assert "did you mean 'made-retrieval'?" in text
    assert "an e-mail address" in text
    assert text.count("none for a method without training") == 2
    assert text.count("one of single-stage, re-ranked") == 2
    stated = read_submission(board / "submissions/made/retrieval/salad/submission.toml")
    assert stated.authors == ("Ada Example", "Grace Example")
    assert stated.training_data == ()


def test_who_stops_at_a_question_stops(board: Path, preds: Path) -> None:
    text, code = _typed(["submission", "new", str(preds)], ["\x04"])
    assert code in (130, -signal.SIGINT)
    assert "stopped" in text
    assert not (board / "submissions").exists()


def _typed(arguments: list[str], answers: list[str]) -> tuple[str, int]:
    """Run a command on a terminal, type answers, and return what it shows, and its exit code."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "airzoo_bench", *arguments]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
        shown = b""
        while process.poll() is None or select.select([ours], [], [], 0)[0]:
            if select.select([ours], [], [], 0.2)[0]:
                try:
                    shown += os.read(ours, 4096)
                except OSError:  # the other end is closed
                    break
        code = process.wait()
    os.close(ours)
    return shown.decode(errors="replace"), code


def test_an_interrupted_one_leaves_nothing_half(board: Path, preds: Path, command: Command) -> None:
    script = (
        "import shutil, time\n"
        "copy = shutil.copyfile\n"
        "def slow(*a): print('copying', flush=True); time.sleep(600)\n"
        "shutil.copyfile = slow\n"
        "from airzoo_bench.__main__ import main\n"
        "main()\n"
    )
    call = [sys.executable, "-c", script, "submission", "new", str(preds), *OPTIONS]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "copying\n"
        process.send_signal(signal.SIGKILL)
    home = board / "submissions" / "made" / "retrieval"
    assert not (home / "salad").exists()
    made = command("submission", "new", preds, *OPTIONS)
    assert made.exit_code == 0, made.output
    assert [path.name for path in home.iterdir()] == ["salad"]

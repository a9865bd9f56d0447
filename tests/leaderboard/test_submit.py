"""``airzoo-bench submit``: from a prediction file to a branch with one folder, or a question."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from airzoo_bench.leaderboard.submission import read_submission
from tests.leaderboard.hosting import AUTHOR, git
from tests.leaderboard.submission.support import PROTOCOL, write_board
from tests.support import write_predictions

Command = Callable[..., Result]
OPTIONS = [
    *("--method", "SALAD", "--team", "Example Lab", "--contact", "ada@example.org"),
    *("--author", "Ada Example", "--author", "Grace Example", "--licence", "CC-BY-4.0"),
    *("--training-data", "none", "--stages", "single-stage", "--set", "account=1001"),
]
FOLDER = "submissions/made/retrieval/salad"


@pytest.fixture
def board(tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, value in AUTHOR.items():
        monkeypatch.setenv(name, value)
    root = tmp_path / "board"
    write_board(root)
    git(root, "init", "--quiet", "-b", "main")
    git(root, "add", "-A")
    git(root, "commit", "--quiet", "-m", "A board")
    monkeypatch.chdir(root)
    return root


@pytest.fixture
def preds(tmp_path: Path, perfect: Any) -> Path:
    return write_predictions(tmp_path / "preds.npz", PROTOCOL, **perfect)


def test_one_command_makes_a_branch_with_the_checked_folder(
    board: Path, data: Path, preds: Path, command: Command
) -> None:
    more = ("--set", 'pipeline.uses=["prior"]', "--set", "code=https://example.org/salad")
    made = command("submit", preds, *OPTIONS, *more)
    assert made.exit_code == 0, made.output
    assert "checked and scored, nothing wrong" in made.stdout
    assert made.stdout.splitlines()[-2:] == [
        "git push -u origin submit-salad",
        "gh pr create --fill",
    ]
    assert git(board, "branch", "--show-current") == "submit-salad"
    changed = git(board, "show", "--name-only", "--format=%s").splitlines()
    names = ("preds.npz", "submission.toml")
    assert changed == ["SALAD on made, retrieval", "", *(f"{FOLDER}/{name}" for name in names)]
    stated = read_submission(board / FOLDER / "submission.toml")
    assert (stated.protocol, stated.account, stated.training_data) == (PROTOCOL, 1001, ())
    assert stated.pipeline.uses == ("prior",)


def test_missing_options_are_named_where_nobody_can_be_asked(
    board: Path, preds: Path, command: Command
) -> None:
    made = command("submit", preds, "--method", "SALAD")
    assert made.exit_code != 0
    said = str(made.exception)
    assert "--team, --contact, --author, --licence, --training-data, --stages" in said
    assert not (board / "submissions").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--protocol", "made-retrieva"), "did you mean 'made-retrieval'"),
        (("--set", "paper"), "is no key with a value"),
        (("--set", "papr=https://a.org"), "papr"),
        (("--url", "ftp://a.org/p.npz"), "https"),
        (("--names", "nothing.txt"), "no such file"),
    ],
)
def test_options_that_are_wrong(
    board: Path, preds: Path, command: Command, options: tuple[str, ...], said: str
) -> None:
    made = command("submit", preds, *OPTIONS, *options)
    assert made.exit_code != 0
    assert said in str(made.exception) + made.output
    assert not (board / "submissions").exists()


def test_an_earlier_version_is_replaced_only_by_force(
    board: Path, preds: Path, command: Command
) -> None:
    assert command("submit", preds, *OPTIONS, "--no-commit").exit_code == 0
    assert "--force" in str(command("submit", preds, *OPTIONS).exception)
    again = command("submit", preds, *OPTIONS, "--force", "--set", "summary=Newer")
    assert again.exit_code == 0
    assert read_submission(board / FOLDER / "submission.toml").summary == "Newer"


def test_predictions_at_an_address_are_not_copied(
    board: Path, preds: Path, command: Command
) -> None:
    made = command("submit", preds, *OPTIONS, "--url", "https://example.org/preds.npz")
    assert made.exit_code == 0, made.output
    assert [path.name for path in (board / FOLDER).iterdir()] == ["submission.toml"]
    given = read_submission(board / FOLDER / "submission.toml").predictions
    assert (given.url, given.size) == ("https://example.org/preds.npz", preds.stat().st_size)


def test_eight_questions_at_most_on_a_terminal(board: Path, preds: Path) -> None:
    leader, follower = pty.openpty()
    call = [sys.executable, "-m", "airzoo_bench", "submit", preds, "--no-commit"]
    child = subprocess.Popen(call, cwd=board, stdin=follower, stdout=follower, stderr=follower)
    os.close(follower)
    given = ("SALAD", "Example Lab", "nobody", "ada@example.org", "Ada Example", "CC-BY-4.0")
    answers = iter((*given, "none", "single-stage"))
    said = ""
    try:
        while select.select([leader], [], [], 60)[0]:
            said += os.read(leader, 4096).decode()
            if re.search(r"\n[a-z_]+: $", said):
                os.write(leader, f"{next(answers, '')}\n".encode())
    except OSError:  # the child has closed its end
        pass
    assert child.wait(60) == 0, said
    assert "an e-mail address" in said  # asked again
    assert read_submission(board / FOLDER / "submission.toml").method == "SALAD"

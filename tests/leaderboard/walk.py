"""A board and its steps, as workflows call them one after another."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from typer.testing import Result

from tests.leaderboard.hosting import Hosted, event, git, write_event
from tests.support import write_predictions

ADA, BOB, MAINTAINER = 1001, 1002, 1
BOARD = """
schema = 1
title = "Made board"
maintainers = [1]
[[benchmarks]]
name = "made"
title = "Made"
protocols = ["made-retrieval"]
"""
Run = Callable[..., Result]


class Board:
    """The hosted repository, and what CI and people do with it."""

    def __init__(self, home: Path, command: Run) -> None:
        self.home, self.command = home, command
        self.runs = 0
        self.hosted = Hosted.create(home / "hosted.git", {".keep": b""})
        self.main = self.clone("main")

    def clone(self, name: str) -> Path:
        git(self.home, "clone", "--quiet", str(self.hosted.folder), name)
        return self.home / name

    def run(self, *arguments: object, code: int = 0) -> Result:
        done = self.command(*arguments)
        assert done.exit_code == code, (done.output, done.exception)
        return done

    def push_main(self, message: str) -> None:
        git(self.main, "add", "-A")
        git(self.main, "commit", "--quiet", "-m", message)
        git(self.main, "push", "--quiet", "origin", "HEAD:main")

    def propose(self, fork: Path, number: int, *what: str) -> str:
        """Commit in a fork and let a pull request point to it."""
        git(fork, "add", "-A", *what)
        git(fork, "commit", "--quiet", "-m", f"change of {number}")
        git(fork, "push", "--quiet", "--force", "origin", f"HEAD:refs/pull/{number}/head")
        return git(fork, "rev-parse", "HEAD")

    def ci(self, number: int, head: str, account: int, *, code: int = 0) -> str:
        """Play the workflow's jobs, and return the comment."""
        self.runs += 1
        work = self.home / f"run{self.runs}"
        work.mkdir()
        file = write_event(work / "event.json", event(number, head, account))
        found, remote = work / "found-score.json", self.hosted.folder
        self.run(
            "leaderboard", "score", "--event", file, "--remote", remote, "--out", found,
            "--work", work / "work", "--root", self.main, code=code,
        )  # fmt: skip
        self.run("leaderboard", "comment", found, "--out", work / "comment.md")
        return (work / "comment.md").read_text()

    def keep(self, found: Path, *arguments: object, code: int = 0) -> Result:
        remote = self.hosted.folder
        return self.run(
            "leaderboard", "keep", found, "--remote", remote, "--root", self.main, *arguments,
            code=code,
        )  # fmt: skip

    def merge(self, number: int, head: str) -> None:
        git(self.main, "pull", "--quiet", "--ff-only", "origin", "main")
        git(self.main, "fetch", "--quiet", "origin", f"refs/pull/{number}/head")
        git(self.main, "merge", "--quiet", "--squash", head)
        git(self.main, "commit", "--quiet", "-m", f"merge of {number}")
        git(self.main, "push", "--quiet", "origin", "HEAD:main")

    def rescore(self, *, said: str | None = None, code: int = 0) -> Path:
        """Score what was merged, and return the folder of all runs; `said` stands in the log."""
        self.runs += 1
        data = self.home / f"data{self.runs}"
        done = self.run(
            "leaderboard", "score", "--remote", self.hosted.folder, "--out", data,
            "--root", self.main, code=code,
        )  # fmt: skip
        assert said is None or (said in done.stderr and bool(said) == bool(done.stderr))
        return data

    def build(self, *, said: str | None = None) -> Path:
        """Play the workflow of the board, and return the site."""
        data = self.rescore(said=said)
        site = self.home / f"site{self.runs}"
        self.run(
            "leaderboard", "build", "--runs", data, "--out", site, "--root", self.main,
        )  # fmt: skip
        self.keep(data)
        return site

    def data_file(self, path: str) -> str:
        return git(self.hosted.folder, "show", f"leaderboard-data:{path}")


def submit(
    board: Board,
    fork: Path,
    arrays: dict[str, Any],
    method: str,
    *more: object,
    account: int = ADA,
) -> Path:
    """Make a submission by the documented command, and return its folder."""
    predictions = write_predictions(fork.parent / f"{method}.npz", "made-retrieval", **arrays)
    board.run(
        "submit", predictions, "--board", fork, "--method", method, "--team", "Example Lab",
        "--contact", "ada@example.org", "--author", "Ada Example", "--licence", "CC-BY-4.0",
        "--stages", "single-stage", "--training-data", "none",
        "--set", f"account={account}", "--no-commit", *more,
    )  # fmt: skip
    return fork / "submissions/made/retrieval" / method.lower()


def worse(perfect: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Return predictions whose every second query is answered badly."""
    ranked = [row[::-1] if n % 2 else row for n, row in enumerate(perfect["ranked_ids"])]
    return {**perfect, "ranked_ids": ranked}

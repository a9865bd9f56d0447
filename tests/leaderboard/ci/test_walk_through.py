"""A board from nothing to a page: init, new, check, pull request, comment, merge, board."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from airzoo_bench.leaderboard.ci import merging
from airzoo_bench.leaderboard.ci.git import BoardError
from tests.leaderboard.ci.repositories import Hosted, event, git, write_event
from tests.support import MadeScene, write_predictions

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
            "leaderboard", "ci", "score", "--event", file, "--remote", remote, "--out", found,
            "--work", work / "work", "--root", self.main, "--outputs", work / "outputs", code=code,
        )  # fmt: skip
        if (work / "outputs").read_text() == "kind=scored\n":
            self.ledger("scored", "--artifact", found)
        self.run("leaderboard", "ci", "comment", found, "--out", work / "comment.md")
        return (work / "comment.md").read_text()

    def ledger(self, outcome: str, *arguments: object) -> Result:
        return self.run(
            "leaderboard", "ci", "ledger", outcome, *arguments,
            "--remote", self.hosted.folder, "--root", self.main,
        )  # fmt: skip

    def merge(self, number: int, head: str, account: int) -> None:
        git(self.main, "pull", "--quiet", "--ff-only", "origin", "main")
        git(self.main, "fetch", "--quiet", "origin", f"refs/pull/{number}/head")
        git(self.main, "merge", "--quiet", "--squash", head)
        git(self.main, "commit", "--quiet", "-m", f"merge of {number}")
        git(self.main, "push", "--quiet", "origin", "HEAD:main")
        file = self.home / "closed.json"
        write_event(file, event(number, head, account, merged=True))
        self.ledger("merged", "--event", file)

    def rescore(self) -> Path:
        """Score what was merged, and return the folder of all runs."""
        self.runs += 1
        data = self.home / f"data{self.runs}"
        self.run(
            "leaderboard", "ci", "rescore", "--remote", self.hosted.folder, "--out", data,
            "--root", self.main,
        )  # fmt: skip
        return data

    def build(self) -> Path:
        """Play the workflow of the board, and return the site."""
        data = self.rescore()
        site = self.home / f"site{self.runs}"
        self.run(
            "leaderboard", "build", "--runs", data / "runs", "--out", site, "--submissions",
            self.main / "submissions", "--board", self.main / "leaderboard.toml", "--jobs", 1,
        )  # fmt: skip
        self.run("leaderboard", "ci", "record", data, "--remote", self.hosted.folder)
        return site

    def data_file(self, path: str) -> str:
        return git(self.hosted.folder, "show", f"leaderboard-data:{path}")


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run) -> Board:
    """Return a board of the made benchmark, as `leaderboard init` begins it."""
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--repository", "lab/board")
    (made.main / "leaderboard.toml").write_text(BOARD)
    made.push_main("A board")
    return made


def submit(board: Board, fork: Path, arrays: dict[str, Any], method: str, *more: object) -> Path:
    """Make a submission by the documented commands, and return its folder."""
    predictions = write_predictions(fork.parent / f"{method}.npz", "made-retrieval", **arrays)
    board.run(
        "submission", "new", predictions, "--board", fork, "--protocol", "made-retrieval",
        "--method", method, "--summary", "Ranks tiles.", "--team", "Example Lab",
        "--contact", "ada@example.org", "--author", "Ada Example", "--licence", "CC-BY-4.0",
        "--stages", "single-stage", "--training-data", "none", *more,
    )  # fmt: skip
    [folder] = (fork / "submissions/made/retrieval").glob(f"{method.lower()}*")
    board.run("submission", "check", folder)
    return folder


def worse(perfect: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Return predictions whose every second query is answered badly."""
    ranked = [row[::-1] if n % 2 else row for n, row in enumerate(perfect["ranked_ids"])]
    return {**perfect, "ranked_ids": ranked}


@pytest.fixture
def home(board: Board) -> Path:
    return board.home


def test_from_an_empty_repository_to_a_board(
    board: Board, home: Path, perfect: dict[str, list[Any]], scenes: list[MadeScene]
) -> None:
    fork = board.clone("ada")
    folder = submit(board, fork, worse(perfect), "Salad")
    head = board.propose(fork, 1)
    comment = board.ci(1, head, ADA)
    assert "### `Salad` by `Example Lab`" in comment
    assert "Rank **1** of 1" in comment
    assert "| `Scene east` | 6 |" in comment
    assert f"--match-head-commit {head}" in comment
    assert "ada@example.org" not in comment
    board.merge(1, head, ADA)
    site = board.build()
    assert "Salad" in (site / "index.html").read_text() or list(site.rglob("*salad*"))
    assert "ada@example.org" not in "".join(
        path.read_text(errors="replace") for path in site.rglob("*") if path.is_file()
    )
    run = json.loads(board.data_file("runs/made/retrieval/salad/1/run.json"))
    assert run["tree"] == git(board.main, "rev-parse", "HEAD:submissions/made/retrieval/salad")
    assert "contact" not in board.data_file("runs/made/retrieval/salad/1/submission.toml")
    rows = board.data_file("ledger.csv").splitlines()
    assert [row.split(",")[0] for row in rows[1:]] == [str(ADA), str(ADA)]
    assert ["scored" in rows[1], "merged" in rows[2]] == [True, True]

    # The next version of the same account says what has changed; another account may not.
    git(fork, "fetch", "--quiet", "origin")
    git(fork, "reset", "--quiet", "--hard", "origin/main")
    submit(board, fork, perfect, "Salad", "--force")
    head = board.propose(fork, 2)
    assert "belongs to another account" in board.ci(2, head, BOB, code=1)
    comment = board.ci(2, head, ADA)
    assert "Changed since the last version" in comment
    assert "→ 100.00" in comment
    board.merge(2, head, ADA)
    board.run("leaderboard", "ci", "record", board.rescore(), "--remote", board.hosted.folder)
    assert json.loads(board.data_file("runs/made/retrieval/salad/2/run.json"))["commit"]
    assert folder.name == "salad"

    # A second method is placed beside the first.
    other = board.clone("bob")
    submit(board, other, worse(perfect), "Vinegar", "--team", "Other Lab")
    comment = board.ci(3, board.propose(other, 3), BOB)
    assert "of 2 by" in comment
    assert "Not told apart from `Salad`" in comment

    # Nobody supersedes what another account has submitted, whatever team they say they are.
    submit(board, other, worse(perfect), "Vinegar", "--force", "--supersedes", "salad")
    comment = board.ci(3, board.propose(other, 3), BOB, code=1)
    assert "supersedes salad, which belongs to another account" in comment

    # Anybody can write a team's name: then the maintainers are told.
    submit(board, other, worse(perfect), "Vinegar", "--force")
    comment = board.ci(3, board.propose(other, 3), BOB)
    assert "team 'Example Lab' is on the board with salad, by another account" in comment

    # Ranks are among what the board shows, and not what its owner has replaced or withdrawn.
    newer = board.clone("ada2")
    submit(board, newer, worse(perfect), "Cress", "--supersedes", "salad")
    comment = board.ci(4, board.propose(newer, 4), ADA)
    assert "of 1 by" in comment
    assert "by another account" not in comment


def test_nothing_is_scored_twice_and_what_is_withdrawn_goes(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    head = board.propose(fork, 1)
    board.ci(1, head, ADA)
    board.merge(1, head, ADA)
    first = board.build()
    tip = board.hosted.tip("leaderboard-data")
    again = board.build()
    assert board.hosted.tip("leaderboard-data") == tip
    pages = {path.relative_to(first): path.read_bytes() for path in first.rglob("*.*")}
    assert pages == {path.relative_to(again): path.read_bytes() for path in again.rglob("*.*")}

    # Withdrawn, it leaves the board and stays in the data's history.
    git(fork, "fetch", "--quiet", "origin")
    git(fork, "reset", "--quiet", "--hard", "origin/main")
    git(fork, "rm", "-r", "--quiet", "submissions/made/retrieval/salad")
    head = board.propose(fork, 2)
    assert "is withdrawn" in board.ci(2, head, ADA)
    assert "belongs to another account" in board.ci(2, head, BOB, code=1)
    board.merge(2, head, ADA)
    assert not list(board.rescore().rglob("run.json"))
    assert board.data_file("runs/made/retrieval/salad/1/run.json")
    other = board.clone("bob")
    submit(board, other, perfect, "Vinegar", "--team", "Other Lab")
    assert "Rank **1** of 1" in board.ci(3, board.propose(other, 3), BOB)


def test_claimed_result_that_is_not_so_is_refused_and_shown(
    board: Board, home: Path, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    predictions = write_predictions(home / "p.npz", "made-retrieval", **worse(perfect))
    board.run("eval", "retrieval", predictions, "--out", home / "eval", "--method", "Salad")
    folder = submit(board, fork, worse(perfect), "Salad", "--result", home / "eval/result.json")
    assert "agrees with the re-scored one" in board.ci(1, board.propose(fork, 1), ADA)
    result = json.loads((folder / "result.json").read_text())
    from airzoo_bench.results.result import Result as Scores

    for part in (*result["scenes"].values(), result["overall"], result["pooled"]):
        part["recall@1"] = 1.0
    better = Scores.model_validate(result | {"checksum": ""}).with_checksum()
    (folder / "result.json").write_text(better.model_dump_json(by_alias=True))
    comment = board.ci(1, board.propose(fork, 1), ADA, code=1)
    assert "differs from the re-scored one" in comment
    assert "claimed 1, re-scored 0.5" in comment


def test_name_that_another_took_meanwhile_stays_off_the_board(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    """Two pull requests were both sound when they were looked at; the first to be scored stays."""
    forks = {name: board.clone(name) for name in ("zoe", "mallory")}
    heads = {}
    for number, (name, method) in enumerate((("zoe", "Salad"), ("mallory", "S-A-L-A-D")), start=1):
        submit(board, forks[name], perfect, method, "--team", f"Team {name}")
        heads[name] = board.propose(forks[name], number)
        assert "is refused" not in board.ci(number, heads[name], number)
    board.merge(1, heads["zoe"], 1)
    board.run("leaderboard", "ci", "record", board.rescore(), "--remote", board.hosted.folder)
    board.merge(2, heads["mallory"], 2)
    data = board.home / "late"
    done = board.command(
        "leaderboard", "ci", "rescore", "--remote", board.hosted.folder, "--out", data,
        "--root", board.main,
    )  # fmt: skip
    assert done.exit_code == 1
    assert "'S-A-L-A-D', which looks like 'Salad' on this board" in done.stderr
    assert [path.name for path in data.glob("runs/made/retrieval/*")] == ["salad"]


def test_no_account_fills_a_table(board: Board, perfect: dict[str, list[Any]]) -> None:
    """Every two of a table are compared: clones would weaken what is found of all others."""
    (board.main / "leaderboard.toml").write_text(f"{BOARD}\n[limits]\nentries = 1\n")
    board.push_main("One each")
    fork = board.clone("fork")
    submit(board, fork, perfect, "Salad")
    head = board.propose(fork, 1)
    assert "is refused" not in board.ci(1, head, ADA)
    board.merge(1, head, ADA)
    newer = board.clone("newer")
    submit(board, newer, worse(perfect), "Cress")
    head = board.propose(newer, 2)
    refused = board.ci(2, head, ADA, code=1)
    assert "this account has 1 submission in this table already" in refused
    assert "is refused" not in board.ci(2, head, BOB)
    assert "is refused" not in board.ci(2, head, MAINTAINER)
    submit(board, newer, worse(perfect), "Cress", "--force", "--supersedes", "salad")
    assert "is refused" not in board.ci(2, board.propose(newer, 2), ADA)


def test_no_board_is_built_of_a_folder_that_is_not_there(board: Board) -> None:
    board.build()  # without a submission there is a folder, and nothing in it
    site = board.home / "site"
    done = board.command("leaderboard", "build", "--runs", board.home / "rnus", "--out", site)
    assert "the board would lose all that were scored" in str(done.exception)
    assert not site.exists()


def test_run_that_breaks_off_has_read_all_older_runs(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board is built of what is there: rows must not depend on how far scoring came."""
    submit(board, board.main, perfect, "Salad")
    board.push_main("One")
    board.run("leaderboard", "ci", "record", board.rescore(), "--remote", board.hosted.folder)
    submit(board, board.main, worse(perfect), "Aaa")
    board.push_main("Another, which comes first")

    def broken(*_: Any, **__: Any) -> None:
        raise BoardError("no space left")

    monkeypatch.setattr(merging, "rescore", broken)
    data = board.home / "broken"
    done = board.command(
        "leaderboard", "ci", "rescore", "--remote", board.hosted.folder, "--out", data,
        "--root", board.main,
    )  # fmt: skip
    assert isinstance(done.exception, BoardError)
    assert [path.name for path in data.glob("runs/made/retrieval/*")] == ["salad"]


def test_folder_that_is_already_on_main_by_a_maintainer_has_no_other_owner(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    submit(board, board.main, perfect, "Baseline")
    board.push_main("The baseline")
    fork = board.clone("ada")
    (fork / "submissions/made/retrieval/baseline/extra.txt").write_text("x")
    comment = board.ci(1, board.propose(fork, 1), ADA, code=1)
    assert "belongs to another account" in comment
    assert list(board.rescore().glob("runs/made/retrieval/baseline/1/run.json"))


def test_pull_request_without_submission_passes(board: Board) -> None:
    fork = board.clone("ada")
    (fork / "README.md").write_text("# Other\n")
    assert "changes no submission" in board.ci(1, board.propose(fork, 1), ADA)


def test_faulty_metadata_is_refused_with_the_message_of_check(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    folder = submit(board, fork, perfect, "Salad")
    path = folder / "submission.toml"
    path.write_text(path.read_text().replace('method = "Salad"', 'method = "<img src=x>"'))
    comment = board.ci(1, board.propose(fork, 1), ADA, code=1)
    assert "which is markup" in comment
    assert "run1" not in comment
    assert str(board.home) not in comment

"""A board from nothing to a page: init, new, check, pull request, comment, merge, board."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core import sandbox
from airzoo_bench.evaluation import opening
from airzoo_bench.leaderboard import scoring
from airzoo_bench.leaderboard.git import BoardError
from tests.leaderboard.hosting import git
from tests.leaderboard.walk import ADA, BOARD, BOB, MAINTAINER, Board, submit, worse
from tests.support import MadeScene, made_protocol, write_benchmark


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
    board.merge(1, head)
    site = board.build()
    assert "Salad" in (site / "index.html").read_text() or list(site.rglob("*salad*"))
    assert "ada@example.org" not in "".join(
        path.read_text(errors="replace") for path in site.rglob("*") if path.is_file()
    )
    run = json.loads(board.data_file("runs/made/retrieval/salad/1/run.json"))
    assert run["tree"] == git(board.main, "rev-parse", "HEAD:submissions/made/retrieval/salad")
    assert "contact" not in board.data_file("runs/made/retrieval/salad/1/submission.toml")

    # The next version of the same account says what has changed; another account may not.
    git(fork, "fetch", "--quiet", "origin")
    git(fork, "reset", "--quiet", "--hard", "origin/main")
    submit(board, fork, perfect, "Salad", "--force")
    head = board.propose(fork, 2)
    assert "belongs to another account" in board.ci(2, head, BOB, code=1)
    comment = board.ci(2, head, ADA)
    assert "Changed since the last version" in comment
    assert "→ 100.00" in comment
    board.merge(2, head)
    board.keep(board.rescore())
    assert json.loads(board.data_file("runs/made/retrieval/salad/2/run.json"))["commit"]
    assert folder.name == "salad"

    # A second method is placed beside the first.
    other = board.clone("bob")
    submit(board, other, worse(perfect), "Vinegar", "--team", "Other Lab", account=BOB)
    comment = board.ci(3, board.propose(other, 3), BOB)
    assert "of 2 by" in comment
    assert "Not told apart from `Salad`" in comment

    # Anybody can write a team's name: then the maintainers are told.
    submit(board, other, worse(perfect), "Vinegar", "--force", account=BOB)
    comment = board.ci(3, board.propose(other, 3), BOB)
    assert "team 'Example Lab' is on the board with salad, by another account" in comment


def test_nothing_is_scored_twice_and_what_is_withdrawn_goes(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    head = board.propose(fork, 1)
    board.ci(1, head, ADA)
    board.merge(1, head)
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
    board.merge(2, head)
    assert not list(board.rescore().rglob("run.json"))
    assert board.data_file("runs/made/retrieval/salad/1/run.json")
    other = board.clone("bob")
    submit(board, other, perfect, "Vinegar", "--team", "Other Lab", account=BOB)
    assert "Rank **1** of 1" in board.ci(3, board.propose(other, 3), BOB)
    git(other, "mv", "submissions/made/retrieval/vinegar", "submissions/made/retrieval/salad")
    assert "belongs to another account" in board.ci(4, board.propose(other, 4), BOB, code=1)


def test_new_words_on_the_same_predictions_keep_their_scores(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    submit(board, board.main, perfect, "Salad")
    board.push_main("One")
    board.keep(board.rescore())
    submit(board, board.main, perfect, "Salad", "--force", "--set", "summary=Other words")
    board.push_main("Other words")
    monkeypatch.setattr(scoring, "score_submission", None)
    runs = board.rescore(said="scored") / "runs/made/retrieval/salad"
    first, second = ((runs / number / "records.csv").read_bytes() for number in "12")
    assert first == second
    assert "Other words" in (runs / "2/submission.toml").read_text()
    assert "Other words" not in (runs / "1/submission.toml").read_text()


@pytest.mark.slow
def test_run_of_an_earlier_truth_or_protocol_is_scored_again(
    board: Board, data: Path, scenes: list[MadeScene], perfect: dict[str, list[Any]]
) -> None:
    submit(board, board.main, perfect, "Salad")
    board.push_main("One")
    board.build()
    protocol = data / "made/protocols/made-retrieval.toml"
    text = protocol.read_text()
    protocol.write_text(text.replace("\nversion = 3", "\nversion = 4", 1))
    again = board.rescore(said="scored again")
    assert sorted(path.name for path in again.glob("runs/made/retrieval/salad/*")) == ["1", "2"]
    protocol.write_text(text)
    shutil.rmtree(data / "made")
    first = [[(tile + 1) % scenes[0].n_tiles for tile in found] for found in scenes[0].positives]
    changed = [replace(scenes[0], positives=first), *scenes[1:]]
    write_benchmark(data / "made", made_protocol(changed), changed)
    site = board.build(said="scored again")
    table = json.loads((site / "board.json").read_text())["tables"]["made-retrieval"]
    [row] = [row for row in table["rows"] if row["kind"] == "re-scored"]
    assert (row["version"], [one["number"] for one in row["history"]]) == (2, [2, 1])
    board.rescore(said="")


@pytest.mark.slow
def test_name_that_another_took_meanwhile_stays_off_the_board(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    """Two pull requests were both sound when they were looked at; the first to be scored stays."""
    forks = {name: board.clone(name) for name in ("zoe", "mallory")}
    heads = {}
    for number, (name, method) in enumerate((("zoe", "Salad"), ("mallory", "S-A-L-A-D")), start=1):
        submit(board, forks[name], perfect, method, "--team", f"Team {name}", account=number)
        heads[name] = board.propose(forks[name], number)
        assert "is refused" not in board.ci(number, heads[name], number)
    board.merge(1, heads["zoe"])
    board.keep(board.rescore())
    board.merge(2, heads["mallory"])
    data = board.rescore(code=1, said="'S-A-L-A-D', which looks like 'Salad' on this board")
    assert [path.parent.name for path in data.glob("runs/made/retrieval/*/1")] == ["salad"]


@pytest.mark.slow
def test_run_that_breaks_off_has_read_all_older_runs(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A board is built of what is there: rows must not depend on how far scoring came."""
    submit(board, board.main, perfect, "Salad")
    board.push_main("One")
    board.keep(board.rescore())
    submit(board, board.main, worse(perfect), "Aaa")
    board.push_main("Another, which comes first")

    def broken(*_: Any, **__: Any) -> None:
        raise BoardError("no space left")

    monkeypatch.setattr(scoring, "score_submission", broken)
    data = board.home / "broken"
    done = board.command(
        "leaderboard", "score", "--remote", board.hosted.folder, "--out", data,
        "--root", board.main,
    )  # fmt: skip
    assert isinstance(done.exception, BoardError)
    assert [path.name for path in data.glob("runs/made/retrieval/*")] == ["salad"]


@pytest.mark.slow
def test_no_account_fills_a_table(board: Board, perfect: dict[str, list[Any]]) -> None:
    """Every two of a table are compared: clones would weaken what is found of all others."""
    (board.main / "leaderboard.toml").write_text(f"{BOARD}\n[limits]\nentries = 1\n")
    board.push_main("One each")
    fork = board.clone("fork")
    submit(board, fork, perfect, "Salad")
    head = board.propose(fork, 1)
    assert "is refused" not in board.ci(1, head, ADA)
    board.merge(1, head)
    newer = board.clone("newer")
    submit(board, newer, worse(perfect), "Cress")
    head = board.propose(newer, 2)
    refused = board.ci(2, head, ADA, code=1)
    assert "this account has 1 submission in this table already" in refused
    assert f"write account = {BOB}" in board.ci(2, head, BOB, code=1)
    assert "is refused" not in board.ci(2, head, MAINTAINER)


def test_folder_that_is_already_on_main_by_a_maintainer_has_no_other_owner(
    board: Board, perfect: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    submit(board, board.main, perfect, "Baseline", account=MAINTAINER)
    board.push_main("The baseline")
    fork = board.clone("ada")
    (fork / "submissions/made/retrieval/baseline/extra.txt").write_text("x")
    comment = board.ci(1, board.propose(fork, 1), ADA, code=1)
    assert "belongs to another account" in comment
    # What strangers wrote is read in a child under limits.
    children: list[object] = []
    call = sandbox.call_limited
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", sandbox.Limits)
    monkeypatch.setattr(
        opening, "call_limited", lambda *given, **more: children.append(1) or call(*given, **more)
    )
    assert list(board.rescore().glob("runs/made/retrieval/baseline/1/run.json"))
    assert children

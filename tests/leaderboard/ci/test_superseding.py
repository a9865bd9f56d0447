"""Submissions that supersede others, and what a comment says about those of others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.leaderboard.ci.repositories import git
from tests.leaderboard.ci.walk import ADA, BOB, Board, submit, worse


def _accepted(board: Board, fork: Path, number: int) -> None:
    """Let a pull request of Ada be looked at and merged, and the fork follow."""
    head = board.propose(fork, number)
    assert "is refused" not in board.ci(number, head, ADA)
    board.merge(number, head, ADA)
    git(fork, "fetch", "--quiet", "origin")
    git(fork, "reset", "--quiet", "--hard", "origin/main")


def test_what_supersedes_another_comes_onto_the_board_and_stays_when_that_is_withdrawn(
    board: Board, data: Path, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, worse(perfect), "Salad")
    _accepted(board, fork, 1)
    submit(board, fork, perfect, "Cress", "--supersedes", "salad")
    _accepted(board, fork, 2)
    site = board.build()
    table = next(site.glob("api/v1/tables/*made*/table.json"))
    assert [row["id"] for row in json.loads(table.read_text())["rows"]][:1] == ["cress"]
    assert "salad" not in [row["id"] for row in json.loads(table.read_text())["rows"]]

    git(fork, "rm", "-r", "--quiet", "submissions/made/retrieval/salad")
    _accepted(board, fork, 3)
    protocol = data / "made/protocols/made-retrieval.toml"
    protocol.write_text(protocol.read_text().replace("\nversion = 3", "\nversion = 4", 1))
    again = board.rescore(said="scored again: protocol v3, now v4")
    assert [path.name for path in again.glob("runs/made/retrieval/cress/*")]


def test_superseded_method_of_the_same_name_is_scored_again_too(
    board: Board, data: Path, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, worse(perfect), "Salad")
    _accepted(board, fork, 1)
    # By its folder it stands before the other, as in what is scored after the merges.
    submit(board, fork, perfect, "Salad", "--supersedes", "salad", folder="a-salad")
    _accepted(board, fork, 2)
    board.build()
    protocol = data / "made/protocols/made-retrieval.toml"
    protocol.write_text(protocol.read_text().replace("\nversion = 3", "\nversion = 4", 1))
    again = board.rescore(said="scored again: protocol v3, now v4")
    assert len([*again.glob("runs/made/retrieval/*/2")]) == 2


def test_no_change_brings_back_a_row_of_a_name_that_was_taken_since(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    """Two rows of one team's method would keep the whole board from being built."""
    fork = board.clone("ada")
    submit(board, fork, worse(perfect), "Salad")
    _accepted(board, fork, 1)
    submit(board, fork, worse(perfect), "Cress", "--supersedes", "salad")
    _accepted(board, fork, 2)
    submit(board, fork, perfect, "Salad", folder="new-salad")
    _accepted(board, fork, 3)
    said = "would bring salad back beside new-salad, and both are called 'Salad'"

    submit(board, fork, worse(perfect), "Cress", "--force")
    assert said in board.ci(4, board.propose(fork, 4), ADA, code=1)
    git(fork, "reset", "--quiet", "--hard", "origin/main")
    git(fork, "rm", "-r", "--quiet", "submissions/made/retrieval/cress")
    assert said in board.ci(5, board.propose(fork, 5), ADA, code=1)

    # First the one that would come back, then the one that holds it.
    git(fork, "reset", "--quiet", "--hard", "origin/main")
    git(fork, "rm", "-r", "--quiet", "submissions/made/retrieval/salad")
    _accepted(board, fork, 6)
    git(fork, "rm", "-r", "--quiet", "submissions/made/retrieval/cress")
    _accepted(board, fork, 7)
    board.build()


def test_warnings_about_others_are_not_pushed_out_of_the_comment(
    board: Board, perfect: dict[str, list[Any]]
) -> None:
    fork = board.clone("ada")
    submit(board, fork, perfect, "Salad")
    _accepted(board, fork, 1)
    submit(board, fork, worse(perfect), "Cress", "--team", "Third Lab")
    _accepted(board, fork, 2)
    board.run("leaderboard", "ci", "record", board.rescore(), "--remote", board.hosted.folder)
    other = board.clone("bob")
    trained = [part for n in range(99) for part in ("--training-data", f"made-{n}")]
    scores = [[float(n) for n in range(len(row), 0, -1)] for row in perfect["ranked_ids"]]
    submit(board, other, {**worse(perfect), "scores": scores}, "Vinegar", *trained)
    comment = board.ci(3, board.propose(other, 3), BOB)
    assert "team 'Example Lab' is on the board with salad, by another account" in comment
    # The same answers in another file.
    assert "every record is that of 'Cress' of team 'Third Lab', in cress" in comment

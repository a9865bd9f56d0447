"""What a comment says about submissions of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.ci.repositories import git
from tests.leaderboard.ci.walk import ADA, BOB, Board, submit, worse


def _accepted(board: Board, fork: Path, number: int) -> None:
    """Let a pull request of Ada be looked at and merged, and the fork follow."""
    head = board.propose(fork, number)
    assert "is refused" not in board.ci(number, head, ADA)
    board.merge(number, head, ADA)
    git(fork, "fetch", "--quiet", "origin")
    git(fork, "reset", "--quiet", "--hard", "origin/main")


@pytest.mark.slow
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

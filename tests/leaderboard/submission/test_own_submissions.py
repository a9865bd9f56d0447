"""The board of this repository, and what stands in submissions/, as far as it needs no truth.

They are scored where AirZoo-Mini is made: tests/datasets/mini/test_prepare.py, and in CI.
"""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.known import known_submissions
from airzoo_bench.leaderboard.predictions_given import size_of_tree

CHECKOUT = Path(__file__).resolve().parents[3]


def test_they_are_sound(tmp_path: Path) -> None:
    board, known = read_board(CHECKOUT / BOARD_FILE), known_submissions(CHECKOUT)
    assert {one.track for one in known} >= {"retrieval", "matching"}
    for one in known:
        folder = CHECKOUT / "submissions" / one.benchmark / one.track / one.folder
        checked = check_submission(folder, board, tmp_path, known=known)
        assert not checked.errors
        assert checked.submission is not None
        assert checked.submission.baseline is not None


def test_the_repository_stays_small() -> None:
    assert size_of_tree(CHECKOUT / "submissions") < 1_500_000

"""The board of this repository, and what stands in submissions/.

Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_submissions.py.
"""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.checks import check_submission, size_of_tree
from airzoo_bench.leaderboard.scoring import score_submission

CHECKOUT = Path(__file__).resolve().parents[3]


def test_they_are_sound(tmp_path: Path) -> None:
    board, known = read_board(CHECKOUT / BOARD_FILE), known_submissions(CHECKOUT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    for place in known:
        checked = check_submission(CHECKOUT / place.path, board, tmp_path, known=known)
        assert not checked.errors
        if place.benchmark == "airzoo-demo":
            scored = score_submission(checked, tmp_path, Run())
            assert scored.result.counts["city"]["near_prior"] == 0


def test_the_repository_stays_small() -> None:
    assert size_of_tree(CHECKOUT / "submissions") < 1_500_000

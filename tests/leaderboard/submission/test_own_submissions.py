"""The board of this repository, and what stands in submissions/.

Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_submissions.py.
"""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.known import known_submissions
from airzoo_bench.leaderboard.predictions_given import size_of_tree
from airzoo_bench.leaderboard.rescoring import rescore

CHECKOUT = Path(__file__).resolve().parents[3]


def test_they_are_sound(tmp_path: Path) -> None:
    board, known = read_board(CHECKOUT / BOARD_FILE), known_submissions(CHECKOUT)
    assert {one.benchmark for one in known} >= {"airzoo-demo", "airzoo-mini"}
    for one in known:
        folder = CHECKOUT / "submissions" / one.benchmark / one.track / one.folder
        checked = check_submission(folder, board, tmp_path, known=known)
        assert not checked.errors
        assert checked.submission is not None
        assert checked.submission.baseline is not None
        if one.benchmark == "airzoo-demo":
            rescored = rescore(checked, data=tmp_path, run=Run())
            assert rescored.agrees, rescored.lines
            assert rescored.evaluation.result.counts["city"]["near_prior"] == 0


def test_the_repository_stays_small() -> None:
    assert size_of_tree(CHECKOUT / "submissions") < 1_500_000

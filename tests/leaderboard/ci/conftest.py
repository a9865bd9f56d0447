"""A hosted repository that pull requests change."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.walk import BOARD, Board, Run


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run) -> Board:
    """Return a board of the made benchmark, as `leaderboard init` begins it."""
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--repository", "lab/board")
    (made.main / "leaderboard.toml").write_text(BOARD)
    made.push_main("A board")
    return made

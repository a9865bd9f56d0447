"""A board to submit to."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.submission.support import write_board


@pytest.fixture
def board(tmp_path: Path) -> Path:
    write_board(tmp_path / "board")
    return tmp_path / "board"

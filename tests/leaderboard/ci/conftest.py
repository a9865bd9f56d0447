"""A hosted repository that pull requests change."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.walk import BOARD, Board, Run


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a board of the made benchmark, as `leaderboard init` begins it.

    It reads predictions in this process, which takes a second less each time.
    """
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", lambda _: None)
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--repository", "lab/board")
    (made.main / "leaderboard.toml").write_text(BOARD)
    made.push_main("A board")
    return made

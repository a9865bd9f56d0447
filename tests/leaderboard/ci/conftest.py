"""A hosted repository that pull requests change."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.ci.pull_requests import HOME, World
from tests.leaderboard.ci.repositories import File, Hosted
from tests.leaderboard.ci.walk import BOARD, Board, Run


@pytest.fixture
def world(tmp_path: Path) -> World:
    files: dict[str, File] = {
        "README.md": b"a board\n",
        f"{HOME}/theirs/submission.toml": b'method = "Theirs"\n',
        f"{HOME}/theirs/p.npz": b"theirs",
        f"{HOME}/old/submission.toml": b'method = "Old"\n',
        f"{HOME}/old/p.npz": b"old",
    }
    return World(Hosted.create(tmp_path / "hosted.git", files), tmp_path / "ci")


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Run) -> Board:
    """Return a board of the made benchmark, as `leaderboard init` begins it."""
    made = Board(tmp_path / "world", command)
    made.run("leaderboard", "init", made.main, "--repository", "lab/board")
    (made.main / "leaderboard.toml").write_text(BOARD)
    made.push_main("A board")
    return made

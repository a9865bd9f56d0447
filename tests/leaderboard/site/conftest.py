"""A board that is built once a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.site.support import built, some_runs


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("board")
    some_runs(folder / "runs")
    built(folder)
    return folder

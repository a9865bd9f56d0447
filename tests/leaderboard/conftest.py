"""Boards that are made once, and a browser for their pages."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.made import AUTHOR, Board, Command, built, write_runs
from tests.report.conftest import browser

__all__ = ["browser"]


@pytest.fixture
def board(tmp_path: Path, data: Path, command: Command, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Return a board of the made benchmark, as `leaderboard init` begins it.

    It reads predictions in this process, which takes a second less each time.
    """
    for name, value in AUTHOR.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("airzoo_bench.cli.leaderboard.Limits", lambda _: None)
    return Board(tmp_path / "world", command)


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the runs of four submissions and the site that is built of them."""
    folder = write_runs(tmp_path_factory.mktemp("board"))
    built(folder)
    return folder


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    from tests.report.browser import Opened

    browser.set_window_size(1280, 900)
    yield Opened(browser)
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []

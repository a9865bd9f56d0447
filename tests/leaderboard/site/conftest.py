"""A board that is built once a file, a sample of every kind of row, and the browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.site.sample import make_sample
from tests.leaderboard.site.support import built, some_runs
from tests.report.conftest import browser

__all__ = ["browser"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("board")
    some_runs(folder / "runs")
    built(folder)
    return folder


@pytest.fixture(scope="session")
def sample(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return make_sample(tmp_path_factory.mktemp("sample"))


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    from tests.report.browser import Opened

    browser.set_window_size(1280, 900)
    yield Opened(browser)
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []

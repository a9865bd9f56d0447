"""Boards of the sample on disk, and the browser that opens their pages."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.leaderboard.site.pages import render_pages
from tests.leaderboard.site.make_sample import sample
from tests.leaderboard.site.pages.hostile import spoilt
from tests.report.conftest import browser

__all__ = ["browser"]


def written(folder: Path, files: dict[str, Any]) -> Path:
    for path, page in render_pages(files).items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(page)
    return folder


@pytest.fixture(scope="session")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a board whose scores are, in places, infinite, missing and equal."""
    files = sample()
    rows = files["tables/airzoo-mini-retrieval/table.json"]["rows"]
    rows[3]["scores"]["recall@5"] |= {"value": "Infinity", "text": "inf"}
    rows[5]["scores"]["recall@5"] |= {"value": None, "text": ""}
    del rows[6]["scores"]["recall@5"]
    rows[8]["scores"]["recall@5"] = rows[9]["scores"]["recall@5"]
    return written(tmp_path_factory.mktemp("board"), files)


@pytest.fixture(scope="session")
def hostile_board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("hostile"), spoilt(sample(14)))


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    from tests.report.browser import Opened

    browser.set_window_size(1280, 900)
    yield Opened(browser)
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []

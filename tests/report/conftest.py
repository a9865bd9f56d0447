"""Pages that several files of tests open, and the browser that opens them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.results.records import Method, read_methods
from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import ERROR, HIT, made_result
from tests.support import made_once

NAMES = ["first", "second", HOSTILE]


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "report", _make_page) / "report.html"


def _make_page(folder: Path) -> None:
    data, results = write_photo_results(folder, NAMES)
    made = [retrieval_method("made", 0), far_method("far")]
    others = write_methods(folder, [reconstruction_method("cloud", 0, scenes=5), *made])
    done = run("report", *results, *others, "--data", data, "-o", folder / "report.html")
    assert done.exit_code == 0, done.exception


def far_method(name: str) -> Method:
    """Return a method whose median errors span decades, and of one group are infinite."""
    made = retrieval_method(name, 0, truth="f" * 64)
    errors = made.records["weather"].map({"sunny": 0.7, "rainy": np.inf}).fillna(300.0)
    records = made.records.assign(error_m=errors)
    settings = made.result.protocol.settings
    result = made_result(records, (HIT, ERROR), name, settings=settings, truth="f" * 64)
    return Method(name, result, records)


@pytest.fixture(scope="session")
def shown(page: Path) -> list[Method]:
    return read_methods(sorted((page.parent / "results").glob("*/result.json")))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    # Only here: who opens no page needs no Selenium.
    from tests.report.browser import BROWSER, DRIVER, FLAGS, webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture
def opened(browser: Any, page: Path) -> Iterator[Any]:
    from tests.report.browser import Opened

    browser.set_window_size(1280, 900)
    browser.get(page.as_uri())
    found = Opened(browser)
    yield found
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []

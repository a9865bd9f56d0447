"""A made-up survey, and a data root of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.datasets.surveys.survey import Made, make_survey


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return make_survey(tmp_path / "a b 测区")

"""A made-up place whose photos have priors."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.datasets.tagged import LEVEL, NAMES, tag
from tests.support import Place, make_place, write_raster


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    made = make_place(tmp_path / "sources")
    write_raster(made.dsm, LEVEL)
    for name in NAMES:
        tag(made, name)
    return made

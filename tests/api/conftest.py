from __future__ import annotations

from pathlib import Path
from unittest import mock

import pytest

from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from tests.api.place import NAME, make_field
from tests.support import made_once


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the root of a benchmark of every track: its sources, and the data root `data`."""

    def make(root: Path) -> None:
        with mock.patch.dict("os.environ", {"AIRZOO_BENCH_DATA": str(root / "data")}):
            make_field(root)

    return made_once(tmp_path_factory, "field", make)


@pytest.fixture
def root(prepared: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the same, with its data root as the configured one."""
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(prepared / "data"))
    return prepared


@pytest.fixture
def field(root: Path) -> BlindBenchmark:
    """Return the opened benchmark."""
    return load_benchmark(NAME)

"""The made-up benchmark of three scenes, and a data root of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from airzoo_bench.core.registry import DATASETS
from tests.datasets.native.flights import SCENES, Flights, mark_photos
from tests.datasets.native.watched_flights import World
from tests.support import make_place


@pytest.fixture
def flights() -> Iterator[Flights]:
    dataset = Flights()
    DATASETS.add("flights", dataset)
    yield dataset
    DATASETS.remove("flights")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Three flights over the same place, as downloaded."""
    for scene in SCENES:
        mark_photos(make_place(tmp_path / "source" / scene).images, scene)
    return tmp_path / "source"


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def world(tmp_path: Path, data: Path) -> World:
    made = World(tmp_path)
    for scene in SCENES:
        mark_photos(make_place(made.source / scene).images, scene)
    return made

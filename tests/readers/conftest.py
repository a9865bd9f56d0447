"""A made world whose truth the samples of matching methods are written from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import airzoo_bench as ab
from tests.matching.world import World, make_world
from tests.readers import retrieval_files as files
from tests.readers.retrieval_files import Place, made_scenes


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def evaluated(world: World) -> Callable[..., Any]:
    """Return a function that scores a file on the made world."""

    def run(path: Path, **options: Any) -> Any:
        return ab.evaluate(path, protocol=world.protocol.name, data=world.root, **options)

    return run


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return Place().prepare(tmp_path / "data")


@pytest.fixture
def one(tmp_path: Path) -> Path:
    """Return the data root of a benchmark of one scene."""
    return Place(made_scenes()[:1]).prepare(tmp_path / "data")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a log folder for one scene, whose images are not on this machine."""
    files.write_log(tmp_path / "log", made_scenes()[0])
    files.write_descriptors(tmp_path / "log", Place(made_scenes()[:1]), made_scenes()[0])
    return tmp_path / "log"

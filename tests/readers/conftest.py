"""Made worlds whose truth the files of methods are written from."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.readers import retrieval_files as files
from tests.readers.cases import Worlds
from tests.readers.retrieval_files import Place, made_scenes


@pytest.fixture(scope="session")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Worlds:
    return Worlds.make(tmp_path_factory.mktemp("worlds"))


@pytest.fixture
def retrieved(worlds: Worlds) -> Callable[..., Any]:
    """Return a function that scores a path of the retrieval track."""
    return partial(worlds.evaluate, "retrieval")


@pytest.fixture
def matched(worlds: Worlds) -> Callable[..., Any]:
    return partial(worlds.evaluate, "matching")


@pytest.fixture
def reconstructed(worlds: Worlds) -> Callable[..., Any]:
    return partial(worlds.evaluate, "reconstruction")


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

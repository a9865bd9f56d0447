"""A made world whose truth the samples of matching methods are written from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import airzoo_bench as ab
from tests.matching.world import World, make_world


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def evaluated(world: World) -> Callable[..., Any]:
    """Return a function that scores a file on the made world."""

    def run(path: Path, **options: Any) -> Any:
        return ab.evaluate(path, protocol=world.protocol.name, data=world.root, **options)

    return run

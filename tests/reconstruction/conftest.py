"""A made world of two scenes, one a file, which is the data root."""

from __future__ import annotations

import pytest

from tests.reconstruction.world import World, make_world


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))

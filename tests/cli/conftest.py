"""Fixtures of tests that run commands."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.reconstruction.world import World, make_world


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def world(made: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    """Return a world of its own: nothing that a test does to it reaches another."""
    root = tmp_path / "data"
    shutil.copytree(made.root, root)
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(root))
    return World(root)

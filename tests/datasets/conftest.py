"""A made-up place whose photos have priors, and the made trees of the goldens."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.datasets.support import LEVEL, NAMES, tag
from tests.goldens.run import unpack
from tests.support import Place, made_once, make_place, write_raster


def _make_tagged(folder: Path) -> None:
    made = make_place(folder)
    write_raster(made.dsm, LEVEL)
    for name in NAMES:
        tag(made, name)


@pytest.fixture
def place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> Place:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    sources = tmp_path / "sources"
    shutil.copytree(made_once(tmp_path_factory, "tagged-place", _make_tagged), sources)
    return Place.below(sources)


@pytest.fixture(scope="session")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the folder of a golden's inputs by their name, to be read only."""

    def unpacked(name: str) -> Path:
        return made_once(tmp_path_factory, f"tree-{name}", lambda folder: unpack(name, folder))

    return unpacked

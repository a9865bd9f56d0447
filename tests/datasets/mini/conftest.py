"""AirZoo-Mini, prepared once for all that look at it, with tiles and crops as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.mini.dataset import prepare_airzoo_mini
from airzoo_bench.datasets.mini.frames import read_depth
from airzoo_bench.datasets.mini.world import World, load_world
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.engines.engine import Processes
from airzoo_bench.geometry.arrays import Floats
from tests.support import made_once


@dataclass(frozen=True)
class Prepared:
    """A data root with AirZoo-Mini in it."""

    root: Path
    benchmark: Benchmark

    def frames(self, scene: str) -> Path:
        return self.benchmark.resolve(self.benchmark.scene(scene).images).parent

    def depth(self, scene: str, image: str) -> Floats:
        return read_depth(self.frames(scene) / "depth" / f"{Path(image).stem}.tif")

    def world(self, scene: str) -> World:
        return load_world(self.root / "mini-worlds" / f"{scene}-0")


@pytest.fixture(scope="session")
def mini(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    def make(root: Path) -> None:
        folder, files = root / "airzoo-mini", {"tiles_on_disk": True, "crops_on_disk": True}
        prepare_airzoo_mini(0, PrepareSettings(folder, root, engine=Processes(2), **files))

    root = made_once(tmp_path_factory, "airzoo-mini", make)
    return Prepared(root, Benchmark.open(root / "airzoo-mini"))

"""AirZoo-Mini, prepared once for all that look at it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.mini.dataset import prepare_airzoo_mini
from airzoo_bench.engines.engine import Processes
from airzoo_bench.geometry.arrays import Floats
from tests.shared import made_once


@dataclass(frozen=True)
class Prepared:
    """A data root with AirZoo-Mini in it."""

    root: Path
    benchmark: Benchmark

    def depth(self, scene: str, image: str) -> Floats:
        photos = self.benchmark.resolve(self.benchmark.scene(scene).images)
        with Image.open(photos.parent / "depth" / f"{Path(image).stem}.tif") as picture:
            return np.asarray(picture, dtype=np.float64)


def prepared(factory: pytest.TempPathFactory) -> Prepared:
    """Return the whole benchmark, with tiles and crops as files."""

    def make(root: Path) -> None:
        files = {"tiles_on_disk": True, "crops_on_disk": True}
        prepare_airzoo_mini(
            0, PrepareSettings(root / "airzoo-mini", root, engine=Processes(2), **files)
        )

    root = made_once(factory, "airzoo-mini", make)
    return Prepared(root, Benchmark.open(root / "airzoo-mini"))

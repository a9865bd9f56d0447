"""MapAnything's files, and the same truth through VGGT's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import mapanything, vggt, vggt_colmap
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import World

__all__ = ["world"]


def test_exact_files_are_perfect(world: World, tmp_path: Path) -> None:
    found = scored(world, mapanything.write(tmp_path / "out", world), "mapanything")
    check_perfect(found)
    assert find_reader(tmp_path / "out") == "mapanything"
    models = mapanything.write_models(tmp_path / "models", world)
    check_perfect(scored(world, models, "mapanything"))
    assert find_reader(models) == "mapanything"


def test_the_same_truth_gives_the_same_row(world: World, tmp_path: Path) -> None:
    depth = row(scored(world, vggt.write(tmp_path / "depth", world)))
    without = {"depth": None, "depth_conf": None}
    points = row(scored(world, vggt.write(tmp_path / "points", world, **without)))
    other = row(scored(world, mapanything.write(tmp_path / "other", world)))
    model = row(scored(world, vggt_colmap.write(tmp_path / "model", world)))
    assert depth == points == other == model

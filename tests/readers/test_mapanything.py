"""MapAnything's files, and the same truth through VGGT's."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

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


def one(world: World, folder: Path, **changes: Any) -> Path:
    mapanything.write_scene(folder / "out" / "yard", true_views(world, "yard"), **changes)
    return folder / "out"


def test_extrinsics_are_camera_to_world(world: World, tmp_path: Path) -> None:
    given = true_views(world, "yard").w2c.astype("f4")
    with pytest.raises(PredictionError, match="the extrinsics look inverted"):
        scored(world, one(world, tmp_path, extrinsic=given))


def test_points_are_masked_too(world: World, tmp_path: Path) -> None:
    seen = true_views(world, "yard").depth > 0
    seen[:, :18] = False
    found = scored(world, one(world, tmp_path, depth=None, final_mask=seen)).scored["yard"]
    assert found.records.to_dict("records")[0]["points"] == int(seen.sum())
    found = scored(world, one(world, tmp_path / "d", final_mask=seen)).scored["yard"]
    assert found.records.to_dict("records")[0]["points"] == int(seen.sum())


def test_a_mask_of_another_size_is_refused(world: World, tmp_path: Path) -> None:
    with pytest.raises(PredictionError, match="field 'final_mask' is bool of shape"):
        scored(world, one(world, tmp_path, final_mask=np.ones((6, 3, 3), bool)))


def test_views_without_names_are_the_photos_in_order(world: World, tmp_path: Path) -> None:
    path = one(world, tmp_path)
    shutil.rmtree(path / "yard" / "images")
    found = scored(world, path)
    assert found.scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0
    assert found.result.predictions.reader is not None
    assert "which poses must fit" in found.result.predictions.reader.conventions[-1]
    turned = {k: v[::-1] for k, v in mapanything.fields(true_views(world, "yard")).items()}
    np.savez(path / "yard" / "predictions.npz", **turned)
    with pytest.raises(PredictionError, match="do not fit the photos") as caught:
        scored(world, path)
    assert "--names" in str(caught.value.fix)


def test_the_lines_of_the_recipe_save_what_is_read(world: World, tmp_path: Path) -> None:
    path = one(world, tmp_path, world_points=None, images=None)
    assert find_reader(path) == "mapanything"
    assert scored(world, path).scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0

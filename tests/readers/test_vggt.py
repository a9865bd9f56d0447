"""VGGT's files: read right, whatever branch they hold, and refused where they contradict."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import vggt
from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World

__all__ = ["world"]


def one(world: World, folder: Path, **changes: Any) -> Path:
    """Write the yard's output, in a folder of scenes."""
    vggt.write_scene(folder / "out" / "yard", true_views(world, "yard"), **changes)
    return folder / "out"


def f1(world: World, path: Path, **options: Any) -> float:
    return float(
        scored(world, path, **options).scored["yard"].records.to_dict("records")[0]["f1_0.2m"]
    )


def test_exact_depth_is_perfect(world: World, tmp_path: Path) -> None:
    path = vggt.write(tmp_path / "out", world)
    assert find_reader(path) == "vggt"
    found = scored(world, path)
    check_perfect(found)
    assert found.result.predictions.kind == "depth"
    assert found.result.predictions.reader is not None
    assert "pixel centres are integers" in " ".join(found.result.predictions.reader.conventions)


def test_a_file_is_of_the_scene_that_its_folder_is_named_by(world: World, tmp_path: Path) -> None:
    path = one(world, tmp_path)
    assert f1(world, path / "yard" / "predictions.npz") == f1(world, path) == 1.0


def test_the_pickle_in_it_is_never_opened(world: World, tmp_path: Path) -> None:
    path = one(world, tmp_path)
    with zipfile.ZipFile(path / "yard" / "predictions.npz") as archive:
        assert b"'|O'" in archive.read("pose_enc_list.npy")
    assert f1(world, path) == 1.0
    evil = path / "yard" / "predictions.npz"
    given = {**vggt.fields(true_views(world, "yard")), "depth": np.array([{}], dtype=object)}
    np.savez(evil, **given)
    with pytest.raises(PredictionError, match="field 'depth' holds pickled Python objects"):
        scored(world, path)


def test_the_models_own_output_has_a_batch_axis(world: World, tmp_path: Path) -> None:
    given = vggt.fields(true_views(world, "yard"))
    batched = {name: values[None] for name, values in given.items() if values.ndim}
    assert f1(world, one(world, tmp_path, **batched)) == 1.0


def test_poses_are_decoded_where_they_are_coded_only(world: World, tmp_path: Path) -> None:
    """The code has the principal point in the middle of the integer grid, half a pixel off here."""
    path = one(world, tmp_path, extrinsic=None, intrinsic=None)
    found = scored(world, path).scored["yard"].records.to_dict("records")[0]
    assert found["ate_m"] < 1e-4
    assert found["f1_0.5m"] == 1.0
    batched = vggt.fields(true_views(world, "yard"))["pose_enc"][None]
    path = one(world, tmp_path / "b", extrinsic=None, intrinsic=None, pose_enc=batched)
    assert scored(world, path).scored["yard"].records.to_dict("records")[0]["f1_0.5m"] == 1.0


def test_names_are_of_images_beside_it_or_listed(world: World, tmp_path: Path) -> None:
    views, order = true_views(world, "yard"), [3, 0, 5, 1, 2, 4]
    turned = {k: v[order] if v.ndim else v for k, v in vggt.fields(views).items()}
    path, names = one(world, tmp_path, **turned), tmp_path / "names.txt"
    assert f1(world, path) < 0.9  # sorted images are of other views
    names.write_text("\n".join(views.names[row] for row in order))
    assert f1(world, path, names=names) == 1.0
    (path / "yard" / "images" / "another.jpg").touch()
    with pytest.raises(PredictionError, match="6 views, and there are 7 names of images in"):
        scored(world, path)


def inverted(views: TrueViews) -> Any:
    return views.c2w[:, :3].astype("f4")


def test_wrong_conventions_are_named(world: World, tmp_path: Path) -> None:
    views = true_views(world, "yard")
    with pytest.raises(PredictionError, match="the extrinsics look inverted"):
        scored(world, one(world, tmp_path / "c2w", extrinsic=inverted(views)))
    photos = views.intrinsics * 10.0
    photos[:, 2, 2] = 1.0
    with pytest.raises(PredictionError, match="the intrinsics look of images of about"):
        scored(world, one(world, tmp_path / "K", intrinsic=photos))
    flat = views.w2c[:, :3] * [[[1.0], [1.0], [0.0]]]
    with pytest.raises(PredictionError, match="rotation"):
        scored(world, one(world, tmp_path / "R", extrinsic=flat))


def test_a_scene_that_is_missing_scores_zero(world: World, tmp_path: Path) -> None:
    found = scored(world, one(world, tmp_path))
    assert found.scored["lot"].records.to_dict("records")[0]["f1_0.2m"] == 0.0
    assert "scenes that the predictions lack" in " ".join(found.result.notes)
    alone = tmp_path / "out" / "yard"
    assert row(scored(world, alone)) == row(found)
    (tmp_path / "out" / "yard").rename(tmp_path / "output")
    with pytest.raises(PredictionError, match="output of one scene, and the protocol has 2"):
        scored(world, tmp_path / "output")


def test_compressed_files_give_the_same(world: World, tmp_path: Path) -> None:
    path = one(world, tmp_path)
    plain = scored(world, path).result.overall
    file = path / "yard" / "predictions.npz"
    np.savez_compressed(file, **vggt.fields(true_views(world, "yard")))
    assert scored(world, path).result.overall == plain


def test_maps_without_views_are_refused(world: World, tmp_path: Path) -> None:
    with pytest.raises(PredictionError, match=r"field 'depth' has shape \(\)") as caught:
        scored(world, one(world, tmp_path, depth=np.array(1.0)))
    assert caught.value.expected == "shape (N, H, W)"


def test_the_lines_of_the_recipe_save_what_is_read(world: World, tmp_path: Path) -> None:
    kept = ("extrinsic", "intrinsic", "pose_enc", "depth", "depth_conf")
    given = vggt.fields(true_views(world, "yard"))
    changes = {name: given[name][None] if name in kept else None for name in given}
    path = one(world, tmp_path, **changes)
    assert find_reader(path) == "vggt"
    assert f1(world, path) == 1.0

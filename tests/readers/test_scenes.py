"""Reconstruction: outputs of scenes, names of views, and what methods leave out."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pycolmap
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.predictions import ReadRequest, find_reader
from airzoo_bench.readers.scenes import find_outputs
from tests.goldens.recipes import spoil
from tests.readers.conftest import Worlds, change_fields

PHOTOS = {"yard": ["a/1.JPG", "a/2.JPG"], "lot": ["1.JPG", "3.JPG"]}
YARD = "yard/predictions.npz"
Score = Callable[..., Any]


@pytest.fixture
def yard(reconstructed: Score) -> Score:
    """Return a function that scores a path and returns the record of the yard."""

    def record(path: Path, **options: Any) -> Any:
        return reconstructed(path, **options).records.set_index("scene").loc["yard"]

    return record


@pytest.fixture
def expected(worlds: Worlds) -> Any:
    """Return the yard's record of the noisy truth."""
    return worlds.score("vggt").records.set_index("scene").loc["yard"]


def outputs(path: Path, *scenes: str, names: Path | None = None) -> Any:
    truths = []
    for scene in scenes:
        ids = [f"{scene}/{name.removesuffix('.JPG')}" for name in PHOTOS[scene]]
        photos = pd.DataFrame({"id": ids, "image": PHOTOS[scene]})
        left_out = pd.DataFrame({"id": [f"{scene}/8"], "image": ["8.JPG"]})
        truths.append(SimpleNamespace(scene=scene, photos=photos, excluded=left_out))
    protocol: Any = SimpleNamespace(scenes=[SimpleNamespace(id=scene) for scene in scenes])
    more: Any = {"memory_bytes": 1 << 20, "scenes": (*scenes, "dock")}
    request = ReadRequest(None, names, protocol=protocol, truths=truths, **more)
    found, others = find_outputs(path, request, lambda one: (one / "out.txt").is_file())
    return {output.scene: output for output in found.values()}, others


def test_places_of_outputs_and_names_of_their_photos(tmp_path: Path) -> None:
    for name in ("p/yard", "p/lot", "x"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "out.txt").touch()
    (tmp_path / "p" / "log.txt").touch()
    lot, whole, names = tmp_path / "p" / "lot", tmp_path / "p", tmp_path / "names.txt"
    assert list(outputs(lot, "yard")[0]) == ["yard"]
    assert list(outputs(lot, *PHOTOS)[0]) == ["lot"]
    for path in (tmp_path / "x", tmp_path / "nothing"):  # one scene's of two, and none
        with pytest.raises(PredictionError, match="scene"):
            outputs(path, *PHOTOS)
    names.write_text("lot/3.JPG\n/data/yard/images/a/2.JPG\nlot/1.JPG\nyard/a/1.JPG\n")
    found, others = outputs(whole, *PHOTOS, names=names)
    assert others == ("log.txt",)
    assert found["lot"].view_names().names == ["3.JPG", "1.JPG"]
    assert found["yard"].view_names().names == ["a/2.JPG", "a/1.JPG"]
    for line in ("yard/b/9.JPG", "yard/3.JPG", "dock/3.JPG", "lot/8.JPG"):
        names.write_text(f"lot/3.JPG\nyard/a/1.JPG\n{line}\n")
        with pytest.raises(PredictionError, match="scene is not known"):
            outputs(whole, *PHOTOS, names=names)[0]["lot"].view_names()


def test_pickles_are_never_opened_and_batches_are_read(worlds, tmp_path, yard, expected) -> None:
    whole = worlds.sample("vggt", tmp_path / "whole")
    with np.load(whole / YARD, allow_pickle=True) as stored:
        given = dict(stored)
    assert given["pose_enc_list"].dtype == object
    batched = {name: values[None] for name, values in given.items() if values.ndim}
    kept = ("extrinsic", "intrinsic", "pose_enc", "depth", "depth_conf")  # by the recipe
    few = {name: batched.get(name) if name in kept else None for name in given}
    for number, changes in enumerate(({}, batched, few)):
        path = worlds.sample("vggt", tmp_path / str(number))
        change_fields(path / YARD, **changes)
        assert find_reader(path)[0] == "vggt"
        found = yard((path, path / "yard", path / YARD)[number])
        assert found["f1_0.5m"] == expected["f1_0.5m"]
    # The code has the principal point in the middle of the integer grid, half a pixel off.
    change_fields(whole / YARD, extrinsic=None, intrinsic=None)
    found = yard(whole)
    assert found["ate_m"] == pytest.approx(expected["ate_m"], abs=1e-4)
    assert 0 < abs(found["chamfer_m"] - expected["chamfer_m"]) < 0.2


def test_names_are_of_images_beside_it_or_listed(worlds, tmp_path, yard, expected) -> None:
    path, order = worlds.sample("vggt", tmp_path), np.array([3, 0, 5, 1, 2, 4])
    spoil(path, "lot: rm")
    with np.load(path / YARD, allow_pickle=True) as stored:
        change_fields(path / YARD, **{k: v[order] for k, v in stored.items() if v.ndim})
    assert yard(path)["ate_m"] > 2  # sorted images are of other views
    names = tmp_path / "names.txt"
    names.write_text("\n".join(f"yard_{row}.jpg" for row in order))
    found = yard(path, names=names)
    assert found["f1_0.5m"] == expected["f1_0.5m"]
    spoil(path, "yard/images: rm")
    with pytest.raises(PredictionError, match="do not fit the photos") as caught:
        yard(path)
    assert "--names" in str(caught.value.fix)
    path = worlds.sample("cut3r", tmp_path / "c")
    for file in ("yard/depth/000005.npy", "yard/conf/000005.npy", "yard/camera/000005.npz", "lot"):
        spoil(path, f"{file}: rm")
    with pytest.raises(PredictionError, match="has no image_names"):
        yard(path)
    for row in range(5):
        spoil(path, f"yard/images/yard_{row}.jpg: text x")
    assert yard(path)["ate_m"] < 1


@pytest.mark.parametrize("depth", [{}, {"depth": None}], ids=["depth", "points"])
def test_pixels_outside_a_mask_are_no_surface(depth, worlds, tmp_path, yard) -> None:
    path = worlds.sample("mapanything", tmp_path)
    with np.load(path / YARD) as stored:
        seen = stored["final_mask"]
    seen[:, :9] = False
    change_fields(path / YARD, final_mask=seen, **depth)
    assert yard(path)["points"] == int(seen.sum()) > 0


def test_mini_npz_of_depth_anything_3_goes_before_npz(worlds, tmp_path, yard, expected) -> None:
    path = worlds.sample("depth-anything-3", tmp_path)
    other, file = "yard/exports/npz/results.npz", "yard/exports/mini_npz/results.npz"
    spoil(path, f"{other}: from {file}")
    spoil(path, f"{other}: do depth = depth[:, :9] * 2")
    assert yard(path)["chamfer_m"] == pytest.approx(expected["chamfer_m"], abs=1e-4)


def test_images_without_a_pose_are_absent(worlds, tmp_path, reconstructed) -> None:
    path = worlds.sample("vggt-colmap", tmp_path)
    images = path / "yard" / "sparse" / "images.bin"
    content, head = images.read_bytes(), 8 + struct.calcsize("<I7dI") + len("yard_0.jpg") + 1
    (seen,) = struct.unpack_from("<Q", content, head)
    images.write_bytes(struct.pack("<Q", 5) + content[head + 8 + 24 * seen :])
    found = reconstructed(path, reader="vggt-colmap")
    assert "1 of 6 photos" in " ".join(found.result.notes)
    assert found.records.set_index("scene").loc["yard", "cameras_missing"] == 1


def test_models_that_pycolmap_writes(worlds, tmp_path, yard, expected) -> None:
    """Rigs and frames as Depth Anything 3 makes them, written by COLMAP itself."""
    path = tmp_path / "out"
    source = worlds.sample("vggt-colmap", tmp_path / "f") / "yard" / "sparse"
    found = pycolmap.Reconstruction(str(source))
    count = found.num_points3D()
    (path / "yard").mkdir(parents=True)
    found.write(str(path / "yard"))
    assert find_reader(path)[0] == "depth-anything-3"
    record = yard(path)
    assert record["points"] == count
    assert record["chamfer_m"] == pytest.approx(expected["chamfer_m"], abs=1e-4)
    assert record["ate_m"] == pytest.approx(expected["ate_m"], abs=1e-4)

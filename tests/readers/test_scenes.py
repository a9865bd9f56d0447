"""Reconstruction: outputs of scenes, names of views, and what methods leave out."""

from __future__ import annotations

import shutil
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
from airzoo_bench.evaluation.predictions import Reading, find_reader
from airzoo_bench.readers.scenes import find_outputs
from tests.readers import method_files as files
from tests.readers.conftest import Worlds
from tests.readers.method_files import SCENES, WRITERS, true_views, write_yard
from tests.reconstruction.world import PHOTO_SIZE

PHOTOS = {"yard": ["a/1.JPG", "a/2.JPG"], "lot": ["1.JPG", "3.JPG"]}
Score = Callable[..., Any]


@pytest.fixture
def yard(reconstructed: Score) -> Score:
    """Return a function that scores a path and returns the record of the yard."""

    def record(path: Path, **options: Any) -> Any:
        return reconstructed(path, **options).records.set_index("scene").loc["yard"]

    return record


def outputs(path: Path, *scenes: str, names: Path | None = None) -> Any:
    truths = []
    for scene in scenes:
        ids = [f"{scene}/{name.removesuffix('.JPG')}" for name in PHOTOS[scene]]
        photos = pd.DataFrame({"id": ids, "image": PHOTOS[scene]})
        left_out = pd.DataFrame({"id": [f"{scene}/8"], "image": ["8.JPG"]})
        truths.append(SimpleNamespace(scene=scene, photos=photos, excluded=left_out))
    protocol: Any = SimpleNamespace(scenes=[SimpleNamespace(id=scene) for scene in scenes])
    reading = Reading(protocol, truths, names, 1 << 20, scenes=(*scenes, "dock"))
    found, others = find_outputs(path, reading, lambda one: (one / "out.txt").is_file())
    return {output.scene: output for output in found.values()}, others


def test_places_of_outputs_and_names_of_their_photos(tmp_path: Path) -> None:
    for name in ("p/yard", "p/lot", "x"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "out.txt").touch()
    (tmp_path / "p" / "log.txt").touch()
    lot, whole, names = tmp_path / "p" / "lot", tmp_path / "p", tmp_path / "names.txt"
    assert list(outputs(lot, "yard")[0]) == ["yard"]
    assert list(outputs(lot, *SCENES)[0]) == ["lot"]
    with pytest.raises(PredictionError, match="output of one scene, and the protocol has 2"):
        outputs(tmp_path / "x", *SCENES)
    with pytest.raises(PredictionError, match="holds no scene's output"):
        outputs(tmp_path / "nothing", "yard")
    names.write_text("lot/3.JPG\n/data/yard/images/a/2.JPG\nlot/1.JPG\nyard/a/1.JPG\n")
    found, others = outputs(whole, *SCENES, names=names)
    assert others == ("log.txt",)
    assert found["lot"].view_names().names == ["3.JPG", "1.JPG"]
    assert found["yard"].view_names().names == ["a/2.JPG", "a/1.JPG"]
    for line in ("yard/b/9.JPG", "yard/3.JPG", "dock/3.JPG", "lot/8.JPG"):
        names.write_text(f"lot/3.JPG\nyard/a/1.JPG\n{line}\n")
        with pytest.raises(PredictionError, match="so that their scene is not known"):
            outputs(whole, *SCENES, names=names)[0]["lot"].view_names()


def test_pickles_are_never_opened_and_batches_are_read(
    worlds: Worlds, tmp_path: Path, yard: Score
) -> None:
    given = files.vggt_fields(true_views(worlds.views, "yard"))
    assert given["pose_enc_list"].dtype == object
    batched = {name: values[None] for name, values in given.items() if values.ndim}
    kept = ("extrinsic", "intrinsic", "pose_enc", "depth", "depth_conf")  # by the recipe
    few = {name: given[name][None] if name in kept else None for name in given}
    for number, changes in enumerate(({}, batched, few)):
        path = write_yard(files.vggt, tmp_path / str(number), worlds.views, **changes)
        assert find_reader(path) == "vggt"
        place = (path, path / "yard", path / "yard" / "predictions.npz")[number]
        assert yard(place)["f1_0.2m"] == 1.0
    # The code has the principal point in the middle of the integer grid, half a pixel off.
    decoded = {"extrinsic": None, "intrinsic": None}
    path = write_yard(files.vggt, tmp_path / "decoded", worlds.views, **decoded)
    found = yard(path)
    assert found["ate_m"] < 1e-4
    assert found["f1_0.5m"] == 1.0


def test_names_are_of_images_beside_it_or_listed(
    worlds: Worlds, tmp_path: Path, yard: Score
) -> None:
    views, order = true_views(worlds.views, "yard"), [3, 0, 5, 1, 2, 4]
    turned = {k: v[order] if v.ndim else v for k, v in files.vggt_fields(views).items()}
    path = write_yard(files.vggt, tmp_path, worlds.views, **turned)
    assert yard(path)["f1_0.2m"] < 0.9  # sorted images are of other views
    (tmp_path / "names.txt").write_text("\n".join(views.names[row] for row in order))
    assert yard(path, names=tmp_path / "names.txt")["f1_0.2m"] == 1.0
    shutil.rmtree(path / "yard" / "images")
    with pytest.raises(PredictionError, match="do not fit the photos") as caught:
        yard(path)
    assert "--names" in str(caught.value.fix)
    some = views.take(range(1, 6))
    files.cut3r(tmp_path / "c" / "yard", some)
    with pytest.raises(PredictionError, match="has no image_names"):
        yard(tmp_path / "c")
    files.touch_images(tmp_path / "c" / "yard" / "images", some)
    assert yard(tmp_path / "c")["ate_m"] < 1e-4


def test_pixels_outside_a_mask_are_no_surface(worlds: Worlds, tmp_path: Path, yard: Score) -> None:
    seen = true_views(worlds.views, "yard").depth > 0
    seen[:, :18] = False
    for name, changes in (("d", {}), ("p", {"depth": None})):
        given = {"final_mask": seen, **changes}
        path = write_yard(files.mapanything, tmp_path / name, worlds.views, **given)
        assert yard(path)["points"] == int(seen.sum())


def test_mini_npz_of_depth_anything_3_goes_before_npz(
    worlds: Worlds, tmp_path: Path, yard: Score
) -> None:
    path = write_yard(files.da3, tmp_path, worlds.views)
    spoilt = files.da3_fields(true_views(worlds.views, "yard")) | {"depth": np.ones((9, 36, 48))}
    files.write_fields(path / "yard" / "exports" / "npz" / "results.npz", spoilt)
    assert yard(path)["f1_0.2m"] == 1.0


def test_cameras_alone_have_no_surface(
    worlds: Worlds, tmp_path: Path, reconstructed: Score
) -> None:
    path = WRITERS["cut3r_trajectory"](tmp_path, worlds.views)
    assert find_reader(path) == "cut3r"
    found = reconstructed(path)
    assert found.overall["pose_auc_3deg"] > 0.999
    assert found.overall["f1_0.2m"] == 0.0
    assert any("cameras alone" in note for note in found.result.notes)
    text = path / "yard" / "pred_traj.txt"
    lines = [line.split() for line in text.read_text().splitlines()]
    text.write_text("\n".join(" ".join([*line[:4], *line[5:], line[4]]) for line in lines))
    with pytest.raises(PredictionError, match="order"):
        reconstructed(path)


@pytest.mark.parametrize("names", ["own", "gaps", "twice", "dates"])
def test_numbers_of_vggt_slam(names: str, worlds: Worlds, tmp_path: Path, yard: Score) -> None:
    """Those in the names of photos, or of every fifth frame of a video, say."""
    views = true_views(worlds.views, "yard")
    numbered = {
        "own": views.names,
        "dates": [f"DJI_20260101101500_{row:04d}.JPG" for row in range(6)],
    }.get(names, [f"frame_{5 * row:04d}.png" for row in range(6)])
    path = write_yard(files.vggt_slam, tmp_path, worlds.views, photos=numbered)
    lines = [f"{5 * row:04d} {name}" for row, name in enumerate(views.names)]
    lines[1] = lines[1].replace("0005", "0000" if names == "twice" else "5.0")
    listed = tmp_path / "names.txt" if names in ("gaps", "twice") else None
    (tmp_path / "names.txt").write_text("\n".join(reversed(lines)))
    if names in ("own", "gaps"):
        assert yard(path, names=listed)["f1_0.2m"] == 1.0
        return
    with pytest.raises(PredictionError, match="of no photo, or of several"):
        yard(path, names=listed)


def test_images_without_a_pose_are_absent(
    worlds: Worlds, tmp_path: Path, reconstructed: Score
) -> None:
    path = write_yard(files.vggt_colmap, tmp_path, worlds.views, tracks=False)
    images = path / "yard" / "sparse" / "images.bin"
    content = images.read_bytes()
    size = struct.calcsize("<I7dI") + len("yard_0.jpg") + 1 + 8
    images.write_bytes(struct.pack("<Q", 5) + content[8 + size :])
    found = reconstructed(path, reader="vggt-colmap")
    assert "1 of 6 photos" in " ".join(found.result.notes)
    assert found.records.set_index("scene").loc["yard", "f1_0.2m"] == 1.0


def test_models_that_pycolmap_writes(worlds: Worlds, tmp_path: Path, yard: Score) -> None:
    """Rigs and frames as Depth Anything 3 makes them, written by COLMAP itself."""
    views, found = true_views(worlds.views, "yard"), pycolmap.Reconstruction()
    for point in views.seen:
        found.add_point3D(point, pycolmap.Track(), np.zeros(3, np.uint8))
    size = {"width": PHOTO_SIZE[0], "height": PHOTO_SIZE[1], "params": [800, 800, 240, 180]}
    for number, (name, w2c) in enumerate(zip(views.names, views.w2c, strict=True), 1):
        camera = pycolmap.Camera(model="PINHOLE", camera_id=number, **size)
        found.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=name, camera_id=number, image_id=number)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(w2c[:3, :3]), w2c[:3, 3])
        found.add_image_with_trivial_frame(image, pose)
    place = tmp_path / "out" / "yard"
    place.mkdir(parents=True)
    found.write(str(place))
    assert find_reader(place.parent) == "depth-anything-3"
    record = yard(place.parent)
    assert (record["f1_0.2m"], record["points"]) == (1.0, len(views.seen))
    assert record["ate_m"] < 1e-6

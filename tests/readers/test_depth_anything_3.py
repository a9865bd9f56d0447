"""Depth Anything 3's files: each way of export, and what of them is refused."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import depth_anything_3 as da3
from tests.readers.samples import vggt
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import PHOTO_SIZE, PROTOCOL, World, save

__all__ = ["world"]

BY_ORDER = "taken for the photos in the order of their names, which their poses fit"


def check(world: World, path: Path, tolerance_m: float = 1e-4, named: bool = False) -> Any:
    assert find_reader(path) == "depth-anything-3"
    found = scored(world, path)
    notes = [note for note in found.result.notes if BY_ORDER not in note]
    assert (len(found.result.notes), notes) == (0 if named else 2, [])
    check_perfect(found, tolerance_m, notes=found.result.notes)
    return found


def test_exact_files_are_perfect(world: World, tmp_path: Path) -> None:
    mini = check(world, da3.write(tmp_path / "mini", world))
    check(world, da3.write(tmp_path / "npz", world, "npz"))  # rounded to six decimals
    assert row(mini) == row(scored(world, vggt.write(tmp_path / "vggt", world)))
    streaming = check(world, da3.write_streaming(tmp_path / "run", world))
    assert row(streaming) == row(mini)
    check(world, da3.write_models(tmp_path / "model", world), named=True)


def test_files_without_exports_above_them(world: World, tmp_path: Path) -> None:
    """The suite's own layout reads results.npz in a scene's folder, and comes to the same."""
    mini, plain = da3.write(tmp_path / "mini", world), tmp_path / "plain"
    for scene in da3.SCENES:
        (plain / scene).mkdir(parents=True)
        exported = mini / scene / "exports" / "mini_npz" / "results.npz"
        shutil.copy(exported, plain / scene / "results.npz")
    assert find_reader(plain) is None
    own = world.score(plain)
    assert own.result.predictions.reader is None
    assert own.result.overall == scored(world, mini).result.overall
    assert scored(world, plain, "depth-anything-3").result.overall == own.result.overall


def test_the_better_rounded_file_wins(world: World, tmp_path: Path) -> None:
    path = da3.write(tmp_path / "out", world)
    for scene in da3.SCENES:
        spoilt = da3.fields(true_views(world, scene)) | {"depth": np.ones((9, 36, 48), "f4")}
        da3.write_results(path / scene / "exports" / "npz" / "results.npz", **spoilt)
    check(world, path)


def one_scene(world: World, tmp_path: Path, **changes: Any) -> Path:
    given = da3.fields(true_views(world, "yard")) | changes
    place = tmp_path / "out" / "yard"
    da3.write_results(place / "exports" / "mini_npz" / "results.npz", **given)
    return place.parent


def test_names_say_which_photo_a_view_is_of(world: World, tmp_path: Path) -> None:
    views, order = true_views(world, "yard"), [3, 0, 5, 1, 2, 4]
    turned = {name: values[order] for name, values in da3.fields(views).items()}
    path, names = one_scene(world, tmp_path, **turned), tmp_path / "names.txt"
    with pytest.raises(PredictionError, match="cameras do not fit the photos in the order"):
        scored(world, path)
    names.write_text("".join(f"/data/photos/{views.names[row]}\n" for row in order))
    found = scored(world, path, names=names)
    assert found.result.predictions.reader is not None
    assert "views named by names.txt, in its order" in found.result.predictions.reader.conventions
    assert found.scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0
    names.write_text("yard_0.jpg\n")
    with pytest.raises(PredictionError, match="6 views, and there are 1 names"):
        scored(world, path, names=names)


def test_intrinsics_of_the_photos_are_refused(world: World, tmp_path: Path) -> None:
    """An export to COLMAP beside it leaves K of the photos' own size in results.npz."""
    enlarged = true_views(world, "yard").intrinsics * 10.0
    enlarged[:, 2, 2] = 1.0
    with pytest.raises(PredictionError, match="look of images of about 4"):
        scored(world, one_scene(world, tmp_path, intrinsics=enlarged))


def test_pickled_names_are_never_loaded(world: World, tmp_path: Path) -> None:
    path, views = one_scene(world, tmp_path), true_views(world, "yard")
    meta = path / "yard" / "exports" / "gt_meta.npz"
    listed = np.array([f"/data/{name}" for name in views.names], dtype=object)
    np.savez(meta, extrinsics=views.w2c, intrinsics=views.intrinsics, image_files=listed)
    # Views are in the order of the photos, which their poses fit: the names are not needed.
    assert scored(world, path).scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0
    alone = tmp_path / "alone" / "yard.npz"
    alone.parent.mkdir()
    shutil.copy(meta, alone)
    assert find_reader(alone) == "depth-anything-3"
    with pytest.raises(PredictionError, match="image_files") as caught:
        scored(world, alone)
    # The line that the message gives writes the list that is asked for.
    line, names = str(caught.value.fix).split('"')[1], tmp_path / "names.txt"
    with names.open("w") as stream:
        subprocess.run([sys.executable, "-c", line], stdout=stream, check=True)
    assert (
        scored(world, path, names=names).scored["yard"].records.to_dict("records")[0]["f1_0.2m"]
        == 1.0
    )


def spoil_streaming(place: Path, what: str) -> None:
    if what == "poses":
        (place / "camera_poses.txt").unlink()
    elif what == "frame":
        (place / "results_output" / "frame_2.npz").unlink()
    elif what == "lines":
        path = place / "camera_poses.txt"
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:-2]))
    elif what == "numbers":
        (place / "intrinsic.txt").write_text("1 2 3\n")
    else:
        shutil.rmtree(place / "results_output")


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("poses", "did not end: camera_poses.txt is missing"),
        ("frame", "did not end: 5 frames for 6 poses, without 1 .2."),
        ("lines", "did not end: 6 frames for 4 poses"),
        ("numbers", "no text of 4 numbers a line: line 1 has 3"),
        ("depth", "the run wrote no depth"),
    ],
)
def test_half_of_a_streaming_run_is_refused(
    what: str, said: str, world: World, tmp_path: Path
) -> None:
    place = da3.write_streaming_scene(tmp_path / "run" / "yard", true_views(world, "yard"))
    spoil_streaming(place, what)
    assert find_reader(place.parent) == "depth-anything-3"
    with pytest.raises(PredictionError, match=said):
        scored(world, place.parent)


def test_frames_of_two_sizes_are_refused(world: World, tmp_path: Path) -> None:
    place = da3.write_streaming_scene(tmp_path / "run" / "yard", true_views(world, "yard"))
    np.savez(place / "results_output" / "frame_3.npz", depth=np.ones((5, 5), "f4"))
    with pytest.raises(PredictionError, match=r"float32 of shape \(5, 5\)"):
        scored(world, place.parent)


def test_a_glb_is_refused_with_the_reason(world: World, tmp_path: Path) -> None:
    place = tmp_path / "out" / "yard"
    place.mkdir(parents=True)
    for name in ("scene.glb", "scene.jpg"):
        (place / name).write_bytes(b"glTF")
    assert find_reader(place.parent) == "depth-anything-3"
    with pytest.raises(PredictionError, match="turned, moved to its middle point") as caught:
        scored(world, place.parent)
    assert "mini_npz" in str(caught.value.fix)


def test_files_of_the_suite_stay_its_own(world: World, tmp_path: Path) -> None:
    for scene in da3.SCENES:
        save(tmp_path / "own" / f"{scene}.npz", world.views(scene))
    assert find_reader(tmp_path / "own") is None
    assert find_reader(tmp_path / "own" / "yard.npz") is None
    given = {**da3.fields(true_views(world, "yard")), "protocol": np.array(PROTOCOL)}
    assert find_reader(save(tmp_path / "yard.npz", given)) is None


def test_models_that_pycolmap_writes_are_recognised_and_read(world: World, tmp_path: Path) -> None:
    """Rigs and frames as Depth Anything 3 makes them, written by COLMAP itself."""
    pycolmap = pytest.importorskip("pycolmap")
    views, found = true_views(world, "yard"), pycolmap.Reconstruction()
    points = views.points[views.depth > 0]
    for point in points:
        found.add_point3D(point, pycolmap.Track(), np.zeros(3, np.uint8))
    for number, (name, w2c) in enumerate(zip(views.names, views.w2c, strict=True), 1):
        add_view(pycolmap, found, number, name, w2c)
    place = tmp_path / "out" / "yard"
    place.mkdir(parents=True)
    found.write(str(place))
    assert find_reader(place.parent) == "depth-anything-3"
    record = scored(world, place.parent).scored["yard"].records.to_dict("records")[0]
    assert (record["f1_0.2m"], record["points"]) == (1.0, len(points))
    assert record["ate_m"] < 1e-6


def add_view(pycolmap: Any, found: Any, number: int, name: str, w2c: Any) -> None:
    camera = pycolmap.Camera()
    camera.camera_id, camera.model = number, pycolmap.CameraModelId.PINHOLE
    camera.width, camera.height = PHOTO_SIZE
    camera.params = np.array([800.0, 800.0, 240.0, 180.0])
    found.add_camera(camera)
    rig = pycolmap.Rig()
    rig.rig_id = number
    rig.add_ref_sensor(camera.sensor_id)
    found.add_rig(rig)
    image = pycolmap.Image()
    image.image_id = image.frame_id = image.camera_id = number
    image.name = name
    frame = pycolmap.Frame()
    frame.frame_id = frame.rig_id = number
    frame.add_data_id(image.data_id)
    turn = pycolmap.Rotation3d(w2c[:3, :3])
    frame.rig_from_world = pycolmap.Rigid3d(turn, w2c[:3, 3])
    found.add_frame(frame)
    found.add_image(image)

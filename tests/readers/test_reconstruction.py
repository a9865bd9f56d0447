"""Reconstruction: names of views, what methods leave incomplete, and what is refused with why."""

from __future__ import annotations

import shutil
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import Reading, find_reader
from airzoo_bench.readers.scenes import find_outputs
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.samples import cut3r, mapanything, vggt, vggt_slam
from tests.readers.samples import depth_anything_3 as da3
from tests.readers.samples.network_models import write_model, write_points_ply
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import PHOTO_SIZE, World, save

__all__ = ["world"]

SCENES = ("yard", "lot")


def one(module: Any, world: World, folder: Path, **changes: Any) -> Path:
    """Write the yard's output, in a folder of scenes."""
    module.write_scene(folder / "out" / "yard", true_views(world, "yard"), **changes)
    return folder / "out"


def yard(world: World, path: Path, reader: str | None = None, **options: Any) -> dict[str, Any]:
    """Return the record of the yard."""
    found = scored(world, path, reader, **options).scored["yard"]
    record: dict[str, Any] = found.records.to_dict("records")[0]
    return record


class TestPlaces:
    """Where the outputs of scenes are found, and which photos names mean."""

    PHOTOS = {"yard": ["a/1.JPG", "a/2.JPG"], "lot": ["1.JPG", "3.JPG"]}  # noqa: RUF012

    def reading(self, *scenes: str, names: Path | None = None) -> Reading:
        truths = []
        for scene in scenes:
            ids = [f"{scene}/{name.removesuffix('.JPG')}" for name in self.PHOTOS[scene]]
            photos = pd.DataFrame({"id": ids, "image": self.PHOTOS[scene]})
            left_out = pd.DataFrame({"id": [f"{scene}/8"], "image": ["8.JPG"]})
            truths.append(SimpleNamespace(scene=scene, photos=photos, excluded=left_out))
        protocol: Any = SimpleNamespace(scenes=[SimpleNamespace(id=scene) for scene in scenes])
        return Reading(protocol, truths, names, 1 << 20, scenes=(*scenes, "dock"))

    def find(self, path: Path, *scenes: str, names: Path | None = None) -> Any:
        def is_output(place: Path) -> bool:
            return (place / "out.txt").is_file() or place.suffix == ".out"

        outputs, others = find_outputs(path, self.reading(*scenes, names=names), is_output)
        return {output.scene: output for output in outputs.values()}, others

    def output(self, place: Path) -> Path:
        place.mkdir(parents=True)
        (place / "out.txt").touch()
        return place

    def test_one_output_is_of_the_only_scene_or_of_that_which_names_it(
        self, tmp_path: Path
    ) -> None:
        place = self.output(tmp_path / "lot")
        assert list(self.find(place, "yard")[0]) == ["yard"]
        assert list(self.find(place, "yard", "lot")[0]) == ["lot"]
        with pytest.raises(PredictionError, match="output of one scene, and the protocol has 2"):
            self.find(self.output(tmp_path / "x"), "yard", "lot")
        with pytest.raises(PredictionError, match="holds no scene's output"):
            self.find(place.parent / "nothing", "yard")

    def test_a_folder_of_outputs(self, tmp_path: Path) -> None:
        self.output(tmp_path / "yard")
        for name in ("lot.out", ".hidden", "log.txt"):
            (tmp_path / name).touch()
        found, others = self.find(tmp_path, "yard", "lot")
        assert {scene: output.place.name for scene, output in found.items()} == {
            "lot": "lot.out",
            "yard": "yard",
        }
        assert others == ("log.txt",)
        (tmp_path / "yard.out").touch()
        with pytest.raises(PredictionError, match=r"two outputs of one scene: yard and yard\.out"):
            self.find(tmp_path, "yard", "lot")

    def test_names_mean_photos_of_their_scene(self, tmp_path: Path) -> None:
        for scene in SCENES:
            self.output(tmp_path / "p" / scene)
        names = tmp_path / "names.txt"
        names.write_text("lot/3.JPG\n/data/yard/images/a/2.JPG\nlot/1.JPG\nyard/a/1.JPG\n")
        found, _ = self.find(tmp_path / "p", "yard", "lot", names=names)
        assert found["lot"].view_names().names == ["3.JPG", "1.JPG"]
        assert found["yard"].view_names().names == ["a/2.JPG", "a/1.JPG"]
        assert found["lot"].photos(["lot/3.JPG", "x.png"]) == ["3.JPG", "x.png"]
        for line in ("yard/b/9.JPG", "yard/3.JPG", "dock/3.JPG", "lot/8.JPG"):
            names.write_text(f"lot/3.JPG\nyard/a/1.JPG\n{line}\n")
            found, _ = self.find(tmp_path / "p", "yard", "lot", names=names)
            with pytest.raises(PredictionError, match="so that their scene is not known"):
                found["lot"].view_names()


class TestArrays:
    """VGGT, MapAnything, Depth Anything 3 and DUSt3R: an npz a scene."""

    def test_the_pickle_in_it_is_never_opened(self, world: World, tmp_path: Path) -> None:
        path = one(vggt, world, tmp_path)
        file = path / "yard" / "predictions.npz"
        with zipfile.ZipFile(file) as archive:
            assert b"'|O'" in archive.read("pose_enc_list.npy")
        assert yard(world, path)["f1_0.2m"] == 1.0
        assert row(scored(world, path / "yard")) == row(scored(world, file))
        given = {**vggt.fields(true_views(world, "yard")), "depth": np.array([{}], dtype=object)}
        np.savez(file, **given)
        with pytest.raises(PredictionError, match="field 'depth' holds pickled Python objects"):
            scored(world, path)

    def test_the_models_own_output_and_what_the_recipe_saves(
        self, world: World, tmp_path: Path
    ) -> None:
        given = vggt.fields(true_views(world, "yard"))
        batched = {name: values[None] for name, values in given.items() if values.ndim}
        assert yard(world, one(vggt, world, tmp_path, **batched))["f1_0.2m"] == 1.0
        kept = ("extrinsic", "intrinsic", "pose_enc", "depth", "depth_conf")
        changes = {name: given[name][None] if name in kept else None for name in given}
        path = one(vggt, world, tmp_path / "kept", **changes)
        assert find_reader(path) == "vggt"
        np.savez_compressed(path / "yard" / "predictions.npz", **given)
        assert yard(world, path)["f1_0.2m"] == 1.0
        path = one(mapanything, world, tmp_path / "m", world_points=None, images=None)
        assert yard(world, path, "mapanything")["f1_0.2m"] == 1.0

    def test_poses_are_decoded_where_they_are_coded_only(
        self, world: World, tmp_path: Path
    ) -> None:
        """The code has the principal point in the middle of the integer grid, half a pixel off."""
        batched = vggt.fields(true_views(world, "yard"))["pose_enc"][None]
        for name, changes in (("a", {}), ("b", {"pose_enc": batched})):
            path = one(vggt, world, tmp_path / name, extrinsic=None, intrinsic=None, **changes)
            found = yard(world, path)
            assert found["ate_m"] < 1e-4
            assert found["f1_0.5m"] == 1.0

    def test_names_are_of_images_beside_it_or_listed(self, world: World, tmp_path: Path) -> None:
        views, order = true_views(world, "yard"), [3, 0, 5, 1, 2, 4]
        turned = {k: v[order] if v.ndim else v for k, v in vggt.fields(views).items()}
        path, names = one(vggt, world, tmp_path, **turned), tmp_path / "names.txt"
        assert yard(world, path)["f1_0.2m"] < 0.9  # sorted images are of other views
        names.write_text("\n".join(views.names[row] for row in order))
        assert yard(world, path, names=names)["f1_0.2m"] == 1.0
        (path / "yard" / "images" / "another.jpg").touch()
        with pytest.raises(PredictionError, match="6 views, and there are 7 names of images in"):
            scored(world, path)
        shutil.rmtree(path / "yard" / "images")
        with pytest.raises(PredictionError, match="do not fit the photos") as caught:
            scored(world, path)
        assert "--names" in str(caught.value.fix)

    def test_wrong_conventions_are_named(self, world: World, tmp_path: Path) -> None:
        views = true_views(world, "yard")
        large = views.intrinsics * 10.0
        large[:, 2, 2] = 1.0
        flat = views.w2c[:, :3] * [[[1.0], [1.0], [0.0]]]
        for name, module, changes, words in (
            ("a", vggt, {"extrinsic": views.c2w[:, :3].astype("f4")}, "extrinsics look inverted"),
            ("b", mapanything, {"extrinsic": views.w2c.astype("f4")}, "extrinsics look inverted"),
            ("c", vggt, {"intrinsic": large}, "the intrinsics look of images of about"),
            ("d", vggt, {"extrinsic": flat}, "rotation"),
            ("e", vggt, {"depth": np.array(1.0)}, r"field 'depth' has shape \(\)"),
            ("f", mapanything, {"final_mask": np.ones((6, 3, 3), bool)}, "'final_mask' is bool"),
        ):
            with pytest.raises(PredictionError, match=words):
                scored(world, one(module, world, tmp_path / name, **changes))

    def test_what_is_masked_is_no_surface(self, world: World, tmp_path: Path) -> None:
        seen = true_views(world, "yard").depth > 0
        seen[:, :18] = False
        for name, changes in (("d", {}), ("p", {"depth": None})):
            path = one(mapanything, world, tmp_path / name, final_mask=seen, **changes)
            assert yard(world, path)["points"] == int(seen.sum())

    def test_results_of_depth_anything_3(self, world: World, tmp_path: Path) -> None:
        """A file alone in a scene's folder is read, too, and mini_npz goes before npz."""
        mini, plain = da3.write(tmp_path / "mini", world), tmp_path / "plain"
        for scene in SCENES:
            (plain / scene).mkdir(parents=True)
            exported = mini / scene / "exports" / "mini_npz" / "results.npz"
            shutil.copy(exported, plain / scene / "results.npz")
            spoilt = da3.fields(true_views(world, scene)) | {"depth": np.ones((9, 36, 48), "f4")}
            da3.write_results(mini / scene / "exports" / "npz" / "results.npz", **spoilt)
            save(tmp_path / "own" / f"{scene}.npz", world.views(scene))
        assert find_reader(tmp_path / "own") is None
        assert scored(world, plain).result.overall == scored(world, mini).result.overall


class TestFrames:
    """CUT3R, streaming runs of Depth Anything 3 and VGGT-SLAM: a file a frame."""

    @pytest.mark.parametrize(
        ("sample", "file", "words"),
        [
            (cut3r.write_scene, "depth/000001.npy", "files are missing"),
            (cut3r.write_scene, "camera/000001.npz", "files are missing"),
            (cut3r.write_scene, "conf/000005.npy", "files are missing"),
            (da3.write_streaming_scene, "camera_poses.txt", "camera_poses"),
            (da3.write_streaming_scene, "results_output/frame_2.npz", "files are missing"),
            (da3.write_streaming_scene, "results_output", "files are missing"),
        ],
    )
    def test_missing_files(
        self, sample: Callable[..., Path], file: str, words: str, world: World, tmp_path: Path
    ) -> None:
        place = sample(tmp_path / "out" / "yard", true_views(world, "yard"))
        gone = place / file
        shutil.rmtree(gone) if gone.is_dir() else gone.unlink()
        assert find_reader(place.parent) is not None
        with pytest.raises(PredictionError, match=words):
            scored(world, place.parent)

    def test_photos_beside_its_files_name_the_views(self, world: World, tmp_path: Path) -> None:
        for scene in SCENES:
            views = true_views(world, scene)
            some = [views.depth[1:], views.intrinsics[1:], views.w2c[1:]]
            cut3r.write_scene(tmp_path / "out" / scene, type(views)(views.names[1:], *some))
        with pytest.raises(PredictionError, match="has no image_names"):
            scored(world, tmp_path / "out")
        for scene in SCENES:
            (tmp_path / "out" / scene / "images").mkdir()
            for name in true_views(world, scene).names[1:]:
                (tmp_path / "out" / scene / "images" / name).touch()
        assert scored(world, tmp_path / "out").result.overall["ate_m"] < 1e-4

    @pytest.mark.parametrize("method", ["cut3r", "vggt-slam"])
    def test_cameras_alone_have_no_surface(self, method: str, world: World, tmp_path: Path) -> None:
        for scene in SCENES:
            views, place = true_views(world, scene), tmp_path / "out" / scene
            if method == "cut3r":
                cut3r.write_trajectory(place, views)
            else:
                vggt_slam.write_scene(place, views, views.names, dense=False)
        assert find_reader(tmp_path / "out") == method
        found = scored(world, tmp_path / "out")
        assert found.result.overall["pose_auc_3deg"] > 0.999
        assert found.result.overall["f1_0.2m"] == 0.0
        assert any("cameras alone" in note for note in found.result.notes)

    def test_the_order_of_quaternions_is_cut3rs(self, world: World, tmp_path: Path) -> None:
        for scene in SCENES:
            place = cut3r.write_trajectory(tmp_path / "out" / scene, true_views(world, scene))
            lines = [line.split() for line in (place / "pred_traj.txt").read_text().splitlines()]
            turned = [" ".join([*line[:4], *line[5:], line[4]]) for line in lines]
            (place / "pred_traj.txt").write_text("\n".join(turned))
        with pytest.raises(PredictionError, match="order"):
            scored(world, tmp_path / "out")

    @pytest.mark.parametrize("names", ["own", "gaps", "twice", "dates"])
    def test_numbers_of_vggt_slam(self, names: str, world: World, tmp_path: Path) -> None:
        """Those in the names of photos, or of every fifth frame of a video, say."""
        lines, listed = [], tmp_path / "names.txt"
        for scene in SCENES:
            views = true_views(world, scene)
            frames = [f"frame_{5 * row:04d}.png" for row in range(len(views.names))]
            dated = [f"DJI_20260101101500_{row:04d}.JPG" for row in range(len(views.names))]
            given = {"own": views.names, "dates": dated}.get(names, frames)
            vggt_slam.write_scene(tmp_path / "out" / scene, views, given)
            lines += [f"{5 * row:04d} {scene}/{name}" for row, name in enumerate(views.names)]
        changed = "0000 yard" if names == "twice" else "5.0 yard"
        listed.write_text("\n".join(reversed(lines)).replace("0005 yard", changed))
        given_names = listed if names in ("gaps", "twice") else None
        if names in ("own", "gaps"):
            check_perfect(scored(world, tmp_path / "out", names=given_names), tolerance_m=1e-3)
            return
        with pytest.raises(PredictionError, match="of no photo, or of several"):
            scored(world, tmp_path / "out", names=given_names)


class TestModels:
    """COLMAP models of networks: read as pycolmap reads them, and refused where damaged."""

    def model(self, world: World, folder: Path, **options: Any) -> Path:
        views = true_views(world, "yard")
        model = write_model(folder / "out" / "yard" / "sparse", views, **options)
        write_points_ply(model, views)
        return model

    def test_images_without_a_pose_are_absent(self, world: World, tmp_path: Path) -> None:
        path = self.model(world, tmp_path, tracks=False) / "images.bin"
        content = path.read_bytes()
        size = struct.calcsize("<I7dI") + len(true_views(world, "yard").names[0]) + 1 + 8
        path.write_bytes(struct.pack("<Q", 5) + content[8 + size :])
        found = scored(world, tmp_path / "out", "vggt-colmap")
        assert "1 of 6 photos has no pose in the prediction" in " ".join(found.result.notes)
        assert found.scored["yard"].records.to_dict("records")[0]["f1_0.2m"] == 1.0

    @pytest.mark.parametrize(
        ("file", "change", "words"),
        [
            ("images", lambda content: content[:-7], "damaged"),
            ("images", lambda content: content + b"\0", "damaged"),
            ("images", lambda content: struct.pack("<Q", 1 << 60) + content[8:], "memory"),
            ("images", lambda content: content.replace(b"yard_3.jpg", b"yard\x1b[2Jg"), "text"),
            ("images", lambda content: content[:12] + struct.pack("<d", 7) + content[20:], "norm"),
            ("points3D", lambda content: content[:-7], "damaged"),
            ("points3D", lambda content: struct.pack("<Q", 1 << 60) + content[8:], "damaged"),
        ],
    )
    def test_damage(self, file: str, change: Any, words: str, world: World, tmp_path: Path) -> None:
        path = self.model(world, tmp_path) / f"{file}.bin"
        path.write_bytes(change(path.read_bytes()))
        with pytest.raises(PredictionError, match=words):
            scored(world, tmp_path / "out")

    def test_models_that_pycolmap_writes(self, world: World, tmp_path: Path) -> None:
        """Rigs and frames as Depth Anything 3 makes them, written by COLMAP itself."""
        pycolmap = pytest.importorskip("pycolmap")
        views, found = true_views(world, "yard"), pycolmap.Reconstruction()
        points = views.points[views.depth > 0]
        for point in points:
            found.add_point3D(point, pycolmap.Track(), np.zeros(3, np.uint8))
        for number, (name, w2c) in enumerate(zip(views.names, views.w2c, strict=True), 1):
            camera = pycolmap.Camera(
                model="PINHOLE",
                width=PHOTO_SIZE[0],
                height=PHOTO_SIZE[1],
                params=[800.0, 800.0, 240.0, 180.0],
                camera_id=number,
            )
            found.add_camera_with_trivial_rig(camera)
            image = pycolmap.Image(name=name, camera_id=number, image_id=number)
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(w2c[:3, :3]), w2c[:3, 3])
            found.add_image_with_trivial_frame(image, pose)
        place = tmp_path / "out" / "yard"
        place.mkdir(parents=True)
        found.write(str(place))
        assert find_reader(place.parent) == "depth-anything-3"
        record = yard(world, place.parent)
        assert (record["f1_0.2m"], record["points"]) == (1.0, len(points))
        assert record["ate_m"] < 1e-6


def test_rows_of_a_trajectory_in_another_order_are_refused(world: World, tmp_path: Path) -> None:
    from tests.readers.samples import cloud_trajectory

    path = cloud_trajectory.write(tmp_path / "out", world)
    text = path / "yard" / "trajectory.txt"
    head, *rows = text.read_text().splitlines()
    text.write_text("\n".join([head, *rows[::-1]]) + "\n")
    with pytest.raises(PredictionError, match="do not fit the photos in the order"):
        scored(world, path)

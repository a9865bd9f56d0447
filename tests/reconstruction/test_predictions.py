"""Predictions: folders and archives, clouds in shards, and maps with their cameras."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.arrays import open_arrays
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.reconstruction import predictions
from airzoo_bench.reconstruction.fusion import DepthMaps
from airzoo_bench.reconstruction.predictions import ScenePrediction, maps_of, open_reconstruction
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, refused, write_ply
from tests.reconstruction.depth_maps import H, N, W, matrices, poses
from tests.reconstruction.depth_maps import made as made_views


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of predictions of four scenes, in all the ways there are."""
    root = tmp_path / "preds"
    (root / "substation").mkdir(parents=True)
    (root / "protocol.txt").write_text("airzoo-real-reconstruction\n")
    (root / "notes.md").write_text("made")
    (root / ".DS_Store").write_text("")
    cameras = {name: made_views()[name] for name in ("image_names", "extrinsics")}
    write_ply(root / "school.ply", made())
    np.savez(root / "school.cameras.npz", **cameras)
    np.savez(root / "plaza.npz", **made_views())
    np.savez(root / "park.v2.npz", points=points_of(made()))
    write_ply(root / "substation" / "cloud.ply", made())
    np.savez(root / "substation" / "cameras.npz", **cameras)
    return root


def listed(path: Path) -> ScenePredictions:
    return open_reconstruction(path)


def pack(path: Path, files: list[tuple[str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files:
            info = zipfile.ZipInfo("x")
            info.filename, info.compress_type = name, zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return path


@pytest.mark.parametrize("suffix", ["", ".zip"])
@pytest.mark.parametrize("prefix", ["", "preds/"])
def test_folders_and_archives(suffix: str, prefix: str, folder: Path) -> None:
    files = sorted(one for one in folder.rglob("*") if one.is_file())
    content = [(prefix + one.relative_to(folder).as_posix(), one.read_bytes()) for one in files]
    predictions = listed(pack(folder.parent / f"a{suffix}", content) if suffix else folder)
    assert predictions.protocol == "airzoo-real-reconstruction"
    assert predictions.scenes == ("park.v2", "plaza", "school", "substation")
    assert predictions.unknown_files == ("notes.md",)
    for scene, cameras in (("park.v2", False), ("school", True), ("substation", True)):
        with predictions.opened(scene, limit_bytes=LIMIT, sampling=SAMPLING) as given:
            assert isinstance(given.geometry, FileCloud)
            assert (given.images is not None) == cameras
            points = np.concatenate([piece.points for piece in given.geometry.pieces(9)])
            np.testing.assert_array_equal(points, points_of(made()))
    with predictions.opened("plaza", limit_bytes=LIMIT, sampling=SAMPLING) as given:
        assert isinstance(given.geometry, DepthMaps)
        np.testing.assert_array_equal(given.geometry.values, made_views()["depth"])


def test_a_file_alone_or_a_folder_of_one_scene_is_a_scene(folder: Path) -> None:
    for name in ("school.ply", "plaza.npz"):
        assert listed(folder / name).scenes == (name[:-4],)
    content = (folder / "school.ply").read_bytes()
    assert listed(pack(folder.parent / "a.zip", [("school/cloud.ply", content)])).scenes == (
        "school",
    )


def test_nothing_there(tmp_path: Path) -> None:
    (tmp_path / "a.rar").write_bytes(b"Rar!")
    for name in ("none", "a.rar", "."):
        with refused("no such predictions|holds no cloud|no folder and no archive"):
            listed(tmp_path / name)


def test_views_with_cameras_twice(folder: Path) -> None:
    (folder / "plaza.cameras.npz").write_bytes((folder / "school.cameras.npz").read_bytes())
    with (
        refused(r"holds extrinsics, and so does plaza\.cameras\.npz"),
        listed(folder).opened("plaza", limit_bytes=LIMIT, sampling=None),
    ):
        pass


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a.ply", "A.ply"], "more than once"),
        (["a.ply", "a.laz"], "two entries: a.laz and a.ply"),
        (["a/x.ply", "a/y.ply", "b.ply"], "two entries"),
        (["a.ply", "b.zip"], "an archive inside"),
        (["a/b/c.ply", "d/e/f.ply", "a_ply"], "holds no cloud"),
        ([], "holds no cloud"),
        *(
            ([name], "leads out of it or is no plain path")
            for name in ("../a.ply", "/a.ply", "a/../../b.ply", "a\\b.ply", "C:/b.ply", "b\n.ply")
        ),
    ],
)
def test_wrong_entries(names: list[str], message: str, tmp_path: Path) -> None:
    path = pack(tmp_path / "p.zip", [(name, b"x") for name in names])
    with refused(message) as caught:
        listed(path)
    assert "\n.ply" not in str(caught.value)


def test_bombs_are_refused_before_they_are_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(predictions, "_UNPACKED_BYTES", 1 << 20)
    path = pack(tmp_path / "p.zip", [("a.ply", bytes(1 << 22)), ("b.ply", bytes(9))])
    with refused("unpacks to 4,194"):
        listed(path)


def test_links_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        info = zipfile.ZipInfo("a.ply")
        info.external_attr = 0o120777 << 16
        archive.writestr(info, "/etc/passwd")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a.ply").symlink_to("/etc/passwd")
    for name in ("a.zip", "folder"):
        with refused("is a link"):
            listed(tmp_path / name)


@pytest.mark.parametrize("name", ["../secret", "a/b", "own.toml", "two words", ""])
def test_a_protocol_is_named_not_pathed(name: str, folder: Path) -> None:
    (folder / "protocol.txt").write_text(name)
    with refused("no protocol's name"):
        listed(folder)


# --- maps ---


def read_maps(folder: Path, **changes: Any) -> ScenePrediction:
    np.savez(folder / "v.npz", **made_views(**changes))
    return maps_of(open_arrays(folder / "v.npz", LIMIT))


def test_depth_maps(tmp_path: Path) -> None:
    views = read_maps(tmp_path)
    maps = views.geometry
    assert isinstance(maps, DepthMaps)
    np.testing.assert_array_equal(maps.values, made_views()["depth"])
    np.testing.assert_array_equal(maps.confidence, made_views()["conf"])
    assert (views.kind, views.notes, views.pixel_centres) == ("depth", (), None)
    assert views.images is not None
    assert views.images.names.tolist() == made_views()["image_names"].tolist()
    assert views.images.found.all()
    np.testing.assert_allclose(views.images.poses.centres, poses().centres, atol=1e-9)
    np.testing.assert_array_equal(maps.cameras.matrices, made_views()["intrinsics"])
    with_axis = read_maps(tmp_path, depth=made_views()["depth"][..., None]).geometry
    assert isinstance(with_axis, DepthMaps)
    np.testing.assert_array_equal(with_axis.values, maps.values)


@pytest.mark.parametrize(
    ("shift", "changes"),
    [
        (0.0, {}),
        (0.0, {"pixel_centres": np.array("half")}),
        (0.5, {"pixel_centres": np.array("integer")}),
        (0.5, {"pixel_centres": np.array(["integer"])}),
        # Files without names are Depth Anything 3's, whose centres are integers.
        (0.5, {"image_names": None}),
        (0.0, {"image_names": None, "pixel_centres": np.array("half")}),
    ],
)
def test_pixel_centres_that_are_integers_are_shifted(
    shift: float, changes: dict[str, Any], tmp_path: Path
) -> None:
    maps = read_maps(tmp_path, **changes).geometry
    assert isinstance(maps, DepthMaps)
    assert maps.cameras.principal_point[0].tolist() == [W / 2 + shift, H / 2 + shift]


def changed(index: Any, value: Any) -> np.ndarray:
    extrinsics = matrices(poses())
    extrinsics[index] = value
    return extrinsics


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"intrinsics": None}, "lacks the field intrinsics"),
        ({"depth": None}, "lacks the field depth"),
        ({"depths": np.zeros(3)}, "'depths'"),
        ({"points": np.zeros((N, H, W, 3))}, "depth and points"),
        ({"depth": np.zeros((N, H, W), int)}, "is int64"),
        ({"depth": np.zeros((N, H * W))}, "is float64 of shape"),
        ({"depth": np.zeros((N, 0, W)), "conf": None}, "is float64 of shape"),
        ({"conf": np.zeros((N, W, H), "f4")}, "that of the maps"),
        ({"intrinsics": made_views()["intrinsics"][:2]}, "2 rows for 4 images"),
        ({"extrinsics": matrices(poses())[:2]}, "2 rows for 4 images"),
        ({"image_names": np.array(["a", "b", "c"])}, "3 rows for 4 images"),
        ({"image_names": np.array(["a", "b", "a", "c"])}, "not unique: 1 of 4 \\('a'\\)"),
        ({"image_names": np.array(["a", "", "b", "c"])}, "empty"),
        ({"image_names": np.array(["a", "b\x1b", "b", "c"])}, "do not print"),
        ({"extrinsics": changed((2, 0, 0), np.nan)}, "NaN or infinite in part: 1 of 4 .DJI_0002"),
        ({"extrinsics": changed((2, 0, 0), np.inf)}, "NaN or infinite in part"),
        ({"extrinsics": matrices(poses()) * 2}, "not orthonormal in 4 of 4 .first 3: DJI_0000"),
        ({"extrinsics": matrices(poses()) * [1, 1, -1, 1]}, "reflection"),
        ({"extrinsics": np.tile(np.eye(4), (N, 1, 1)) + 1e-3 * np.eye(4)[3]}, "last row"),
        ({"intrinsics": made_views()["intrinsics"] * -1}, "no positive focal length"),
    ],
)
def test_wrong_views(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with refused(message) as caught:
        read_maps(tmp_path, **changes)
    assert "v.npz" in str(caught.value)

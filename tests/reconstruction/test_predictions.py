"""Predictions: folders and archives, clouds in shards, and maps with their cameras."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.arrays import open_arrays
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.reconstruction.fusion import DepthMaps
from airzoo_bench.reconstruction.predictions import ScenePrediction, maps_of, open_reconstruction
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, refused, write_ply
from tests.reconstruction.cloud_support import (
    in_shards,
    points_in,
    surface,
    write_laz,
)
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


def archive_of(folder: Path, suffix: str, prefix: str = "") -> Path:
    path = folder.parent / f"preds{suffix}"
    files = sorted(one for one in folder.rglob("*") if one.is_file())
    names = [prefix + one.relative_to(folder).as_posix() for one in files]
    if suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as pack:
            for one, name in zip(files, names, strict=True):
                pack.write(one, name)
        return path
    mode: Any = {".tar": "w", ".tar.gz": "w:gz", ".tgz": "w:gz", ".tar.xz": "w:xz"}[suffix]
    with tarfile.open(path, mode) as tape:
        for one, name in zip(files, names, strict=True):
            tape.add(one, name)
    return path


def check_content(predictions: ScenePredictions) -> None:
    assert predictions.protocol == "airzoo-real-reconstruction"
    assert predictions.scenes == ("park.v2", "plaza", "school", "substation")
    assert predictions.unknown_files == ("notes.md",)
    for scene, kind, cameras in (
        ("park.v2", FileCloud, False),
        ("plaza", DepthMaps, True),
        ("school", FileCloud, True),
        ("substation", FileCloud, True),
    ):
        with predictions.opened(scene, limit_bytes=LIMIT, sampling=SAMPLING) as given:
            assert isinstance(given.geometry, kind)
            assert (given.images is not None) == cameras
            if isinstance(given.geometry, FileCloud):
                points = np.concatenate([piece.points for piece in given.geometry.pieces(9)])
                np.testing.assert_array_equal(points, points_of(made()))
            else:
                np.testing.assert_array_equal(given.geometry.depth, made_views()["depth"])


def test_a_folder(folder: Path) -> None:
    check_content(listed(folder))


@pytest.mark.parametrize("suffix", [".zip", ".tar", ".tar.gz", ".tgz", ".tar.xz"])
@pytest.mark.parametrize("prefix", ["", "preds/", "./"])
def test_archives(suffix: str, prefix: str, folder: Path) -> None:
    if suffix == ".zip" and prefix == "./":
        prefix = ""
    check_content(listed(archive_of(folder, suffix, prefix)))


def test_a_file_alone_is_a_scene(folder: Path) -> None:
    predictions = listed(folder / "school.ply")
    assert predictions.scenes == ("school",)
    with predictions.opened("school", limit_bytes=LIMIT, sampling=None) as given:
        assert isinstance(given.geometry, FileCloud)
    assert listed(folder / "plaza.npz").scenes == ("plaza",)


def test_a_folder_of_one_scene_is_not_stepped_over(folder: Path) -> None:
    path = folder.parent / "a.zip"
    with zipfile.ZipFile(path, "w") as pack:
        pack.write(folder / "school.ply", "school/cloud.ply")
    assert listed(path).scenes == ("school",)


def test_nothing_there(tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path):
        with refused("no such predictions|holds no cloud"):
            listed(path)
    (tmp_path / "a.rar").write_bytes(b"Rar!")
    with refused("no folder and no archive"):
        listed(tmp_path / "a.rar")


def test_views_with_cameras_twice(folder: Path) -> None:
    (folder / "plaza.cameras.npz").write_bytes((folder / "school.cameras.npz").read_bytes())
    with (
        refused(r"holds extrinsics, and so does plaza\.cameras\.npz"),
        listed(folder).opened("plaza", limit_bytes=LIMIT, sampling=None),
    ):
        pass


def listed(path: Path, room: int = 1 << 24) -> ScenePredictions:
    return open_reconstruction(path, unpacked_limit_bytes=room)


def read_maps(path: Path) -> ScenePrediction:
    return maps_of(open_arrays(path, LIMIT))


def written(path: Path, **changes: Any) -> Path:
    np.savez(path / "v.npz", **made_views(**changes))
    return path / "v.npz"


def depth_maps(path: Path) -> DepthMaps:
    maps = read_maps(path).geometry
    assert isinstance(maps, DepthMaps)
    return maps


def test_depth_maps(tmp_path: Path) -> None:
    path = written(tmp_path)
    views, maps = read_maps(path), depth_maps(path)
    np.testing.assert_array_equal(maps.depth, made_views()["depth"])
    np.testing.assert_array_equal(maps.confidence, made_views()["conf"])
    assert views.kind == "depth"
    assert views.notes == ()
    assert views.images is not None
    assert views.images.names.tolist() == made_views()["image_names"].tolist()
    assert views.images.found.all()
    np.testing.assert_allclose(views.images.poses.centres, poses().centres, atol=1e-9)
    np.testing.assert_array_equal(maps.cameras.matrices, made_views()["intrinsics"])


def principal_point(folder: Path, **changes: Any) -> list[float]:
    maps = depth_maps(written(folder, **changes))
    return list(maps.cameras.principal_point[0].tolist())


def test_pixel_centres_that_are_integers_are_shifted(tmp_path: Path) -> None:
    corner, shifted = [W / 2, H / 2], [W / 2 + 0.5, H / 2 + 0.5]
    assert principal_point(tmp_path) == corner
    assert principal_point(tmp_path, pixel_centres=np.array("half")) == corner
    assert principal_point(tmp_path, pixel_centres=np.array("integer")) == shifted
    assert principal_point(tmp_path, pixel_centres=np.array(["integer"])) == shifted
    # Files without names are Depth Anything 3's, whose centres are integers.
    assert principal_point(tmp_path, image_names=None) == shifted
    assert principal_point(tmp_path, image_names=None, pixel_centres=np.array("half")) == corner
    assert read_maps(written(tmp_path)).pixel_centres is None


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
        read_maps(written(tmp_path, **changes))
    assert "v.npz" in str(caught.value)


def pack_bytes(path: Path, files: list[tuple[str, bytes]]) -> Path:
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as pack:
            for name, content in files:
                info = zipfile.ZipInfo("x")
                info.filename = name
                info.compress_type = zipfile.ZIP_DEFLATED
                pack.writestr(info, content)
        return path
    with tarfile.open(path, "w:gz" if path.suffix == ".tgz" else "w") as tape:
        for name, content in files:
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            tape.addfile(entry, io.BytesIO(content))
    return path


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("suffix", [".zip", ".tar"])
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a.ply", "a.ply"], "more than once"),
        (["a.ply", "A.ply"], "more than once"),
        (["a.ply", "a.laz"], "two entries: a.laz and a.ply"),
        (["a/x.ply", "a/y.ply", "b.ply"], "two entries"),
        (["a.ply", "b.zip"], "an archive inside"),
        (["a.ply", "b.ply.gz"], "an archive inside"),
        (["a.doc"], "holds no cloud"),
        (["a/b/c.ply", "d/e/f.ply"], "holds no cloud"),
        ([], "holds no cloud"),
    ],
)
def test_wrong_entries(suffix: str, names: list[str], message: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"p{suffix}", [(name, b"x") for name in names])
    with refused(message):
        listed(path)


def test_an_entry_in_shards(tmp_path: Path) -> None:
    points = np.rint(surface(100, 0))
    home = tmp_path / "preds"
    in_shards(home / "harbour" / "shards", points, 3, write_laz, ".laz")
    write_laz(home / "school.laz", points)
    (home / "harbour" / "notes.txt").write_text("made by hand")
    pack = tmp_path / "preds.zip"
    with zipfile.ZipFile(pack, "w") as archive:
        for path in sorted(home.rglob("*.*")):
            archive.write(path, path.relative_to(home))
    for path in (home, pack):
        listed = open_reconstruction(path, unpacked_limit_bytes=LIMIT)
        assert listed.scenes == ("harbour", "school")
        assert listed.unknown_files == ("harbour/notes.txt",)
        with listed.opened("harbour", limit_bytes=LIMIT, sampling=None) as found:
            assert isinstance(found.geometry, FileCloud)
            np.testing.assert_allclose(points_in(found.geometry), points, atol=1e-6)
            assert found.kind == "cloud"


@pytest.mark.parametrize(
    "name",
    [
        "../school.ply",
        "/school.ply",
        "a/../../b.ply",
        "a\\b.ply",
        "C:/b.ply",
        "a//b.ply",
        "b\n.ply",
    ],
)
@pytest.mark.parametrize("suffix", [".zip", ".tar"])
def test_names_that_lead_elsewhere(name: str, suffix: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"a{suffix}", [(name, b"ply\n")])
    with refused("leads out of it or is no plain path") as caught:
        listed(path)
    assert "\n.ply" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".zip", ".tar", ".tgz"])
def test_bombs_are_refused_before_they_are_unpacked(suffix: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"p{suffix}", [("a.ply", bytes(1 << 22)), ("b.ply", bytes(9))])
    with refused("unpacks to 4,194"):
        listed(path, room=1 << 20)


def test_links_are_refused(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "a.tar", "w") as tape:
        for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE):
            entry = tarfile.TarInfo("a.ply")
            entry.type, entry.linkname = kind, "/etc/passwd"
            tape.addfile(entry)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as pack:
        info = zipfile.ZipInfo("a.ply")
        info.external_attr = 0o120777 << 16
        pack.writestr(info, "/etc/passwd")
    root = tmp_path / "folder"
    root.mkdir()
    (root / "a.ply").symlink_to("/etc/passwd")
    for path in (tmp_path / "a.tar", tmp_path / "a.zip", root):
        with refused("is a link"):
            listed(path)

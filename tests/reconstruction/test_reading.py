"""Predictions of the reconstruction track: folders and archives, whole and damaged."""

from __future__ import annotations

import os
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.reconstruction.cloud_sources import DepthMaps
from airzoo_bench.reconstruction.listed import ListedScenes
from airzoo_bench.reconstruction.reading import open_reconstruction
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, refused, write_ply
from tests.reconstruction.depth_maps import made as made_views
from tests.reconstruction.listed import listed


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


def test_nothing_is_left_behind(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    predictions = listed(archive_of(folder, ".zip"))
    with predictions.opened("school", limit_bytes=LIMIT, sampling=None):
        assert len(list(scratch.iterdir())) == 1
    assert not list(scratch.iterdir())


def test_a_tar_with_an_npz_at_its_end_is_no_zip(folder: Path) -> None:
    for name in ("school.ply", "notes.md"):
        (folder / name).unlink()
    path = folder.parent / "one.tar"
    with tarfile.open(path, "w") as tape:
        tape.add(folder / "plaza.npz", "plaza.npz")
    assert zipfile.is_zipfile(path)
    assert listed(path).scenes == ("plaza",)


def test_scenes_unknown_and_missing(folder: Path) -> None:
    predictions = listed(folder)
    known = ("plaza", "school", "harbour")
    found = ListedScenes(predictions, list(known))
    assert (found.strange, found.missing) == (("park.v2", "substation"), ("harbour",))


def test_a_file_alone_is_a_scene(folder: Path) -> None:
    predictions = listed(folder / "school.ply")
    assert predictions.scenes == ("school",)
    with predictions.opened("school", limit_bytes=LIMIT, sampling=None) as given:
        assert isinstance(given.geometry, FileCloud)
    assert listed(folder / "plaza.npz").scenes == ("plaza",)


def test_a_folder_around_all_scenes_is_stepped_over(folder: Path) -> None:
    (folder / "protocol.txt").unlink()
    assert listed(archive_of(folder, ".zip", "preds/")).scenes == listed(folder).scenes


def test_a_folder_of_one_scene_is_not_stepped_over(folder: Path) -> None:
    path = folder.parent / "a.zip"
    with zipfile.ZipFile(path, "w") as pack:
        pack.write(folder / "school.ply", "school/cloud.ply")
    assert listed(path).scenes == ("school",)


@pytest.mark.parametrize("suffix", [".zip", ".tar", ".tar.gz", ".tar.xz"])
def test_archives_cut_off_or_damaged(suffix: str, folder: Path) -> None:
    path = archive_of(folder, suffix)
    whole = path.read_bytes()
    # The end of a plain tar is padding, which nobody misses.
    for share in (0.1, 0.5) if suffix == ".tar" else (0.1, 0.5, 0.9):
        path.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(PredictionError):
            check_content(listed(path))
    path.write_bytes(os.urandom(1000))
    with pytest.raises(PredictionError):
        listed(path)


def test_a_place_in_an_archive_that_is_damaged(folder: Path) -> None:
    path = archive_of(folder, ".zip")
    raw = bytearray(path.read_bytes())
    place = raw.find(b"school.ply") + 200
    raw[place : place + 20] = bytes(20)
    path.write_bytes(raw)
    predictions = listed(path)
    with (
        refused("cannot be unpacked"),
        predictions.opened("school", limit_bytes=LIMIT, sampling=None),
    ):
        pass


@pytest.mark.parametrize("name", ["", "../x", "a b", "x" * 65, "p.toml", "a\x1b", "\xff"])
def test_protocols_that_are_no_names(name: str, folder: Path) -> None:
    (folder / "protocol.txt").write_bytes(name.encode("latin-1"))
    with refused(r"protocol '.*' is no|is not text"):
        listed(folder)


def test_endings_that_are_not_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "small.shp").write_text("0 0 0\n")
    with refused("small.shp") as caught:
        listed(tmp_path)
    assert caught.value.fix == "endings such as '.shp' are not read: write a cloud as .ply"


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


def test_cameras_of_no_scene_are_extra(folder: Path) -> None:
    (folder / "school.ply").unlink()
    assert listed(folder).unknown_files == ("notes.md", "school.cameras.npz")


def test_a_member_whose_name_ends_before_it_begins(tmp_path: Path) -> None:
    member = zipfile.ZipInfo("x")
    member.filename = "\0.ply"
    with zipfile.ZipFile(tmp_path / "p.zip", "w") as archive:
        archive.writestr(member, b"ply\n")
    with pytest.raises(PredictionError):
        open_reconstruction(tmp_path / "p.zip", unpacked_limit_bytes=1 << 20)

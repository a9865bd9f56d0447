"""Predictions: folders and archives, clouds and maps with their cameras."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.arrays import open_arrays
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.reconstruction import predictions
from airzoo_bench.reconstruction.fusion import DepthMaps
from airzoo_bench.reconstruction.predictions import ScenePrediction, maps_of, open_reconstruction
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, write_ply
from tests.reconstruction.world import MAP_SIZE, World, camera_poses, save

WORLD = World(Path())
VIEWS = WORLD.views("lot") | {"conf": np.random.default_rng(1).random((4, 36, 48), np.float32)}
WIDTH, HEIGHT = MAP_SIZE


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of predictions of four scenes, in all the ways there are."""
    root = tmp_path / "preds"
    for scene in ("school.", "substation/"):
        save(root / f"{scene}cameras.npz", WORLD.cameras("lot"))
    for name, text in (("protocol.txt", "made-reconstruction\n"), ("notes.md", ""), (".x", "")):
        (root / name).write_text(text)
    write_ply(root / "school.ply", made())
    write_ply(root / "substation" / "cloud.ply", made())
    save(root / "plaza.npz", VIEWS)
    save(root / "park.v2.npz", {"points": points_of(made())})
    return root


def pack(path: Path, files: list[tuple[str, bytes]]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files:
            info = zipfile.ZipInfo("x")
            info.filename, info.compress_type = name, zipfile.ZIP_DEFLATED
            info.external_attr = 0o120777 << 16 if content == b"/etc/passwd" else 0
            archive.writestr(info, content)
    return path


@pytest.mark.parametrize("packed", [None, "", "preds/"])
def test_folders_and_archives(packed: str | None, folder: Path) -> None:
    files = sorted(one for one in folder.rglob("*") if one.is_file())
    names = [f"{packed}{one.relative_to(folder).as_posix()}" for one in files]
    content = list(zip(names, (one.read_bytes() for one in files), strict=True))
    path = folder if packed is None else pack(folder.parent / "a.zip", content)
    found = open_reconstruction(path)
    assert found.protocol == "made-reconstruction"
    assert found.scenes == ("park.v2", "plaza", "school", "substation")
    assert found.unknown_files == ("notes.md",)
    for scene, cameras in (("park.v2", False), ("school", True), ("substation", True)):
        with found.opened(scene, limit_bytes=LIMIT, sampling=SAMPLING) as given:
            assert isinstance(given.geometry, FileCloud)
            assert (given.images is not None) == cameras
            points = np.concatenate([piece.points for piece in given.geometry.pieces(9)])
            np.testing.assert_array_equal(points, points_of(made()))
    with found.opened("plaza", limit_bytes=LIMIT, sampling=SAMPLING) as given:
        assert isinstance(given.geometry, DepthMaps)
        np.testing.assert_array_equal(given.geometry.values, VIEWS["depth"])


def test_a_file_alone_or_a_folder_of_one_scene_is_a_scene(folder: Path) -> None:
    packed = pack(folder.parent / "a.zip", [("school/cloud.ply", b"")])
    for path, scene in ((folder / "school.ply", "school"), (packed, "school")):
        assert open_reconstruction(path).scenes == (scene,)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    "names",
    [
        *([], ["a.ply", "A.ply"], ["a.ply", "a.laz"], ["a/x.ply", "a/y.ply", "b.ply"]),
        ["a/b/c.ply", "d/e/f.ply", "a_ply"],
        *([name] for name in ("../a.ply", "/a.ply", "a/../../b.ply", "a\\b.ply", "b\n.ply")),
        *(["a.ply", f"protocol.txt:{text}"] for text in ("../x", "a/b", "own.toml", "a b", "")),
        [f"a.ply:{'x' * (1 << 21)}"],  # more than may be unpacked
    ],
)
def test_wrong_entries(names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predictions, "_UNPACKED_BYTES", 1 << 20)
    files = [(name.partition(":")[0], name.partition(":")[2].encode()) for name in names]
    with pytest.raises(PredictionError) as caught:
        open_reconstruction(pack(tmp_path / "p.zip", files))
    assert "p.zip" in str(caught.value)
    assert "\n.ply" not in str(caught.value)


def test_links_other_archives_and_nothing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.rar").write_bytes(b"Rar!")
    pack(tmp_path / "link.zip", [("a.ply", b"/etc/passwd")])
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / "a.ply").symlink_to("/etc/passwd")
    for name in ("none", "a.rar", "link.zip", "link"):
        with pytest.raises(PredictionError):
            open_reconstruction(tmp_path / name)


def test_cameras_twice_are_refused(folder: Path) -> None:
    (folder / "plaza.cameras.npz").write_bytes((folder / "school.cameras.npz").read_bytes())
    found = open_reconstruction(folder)
    with pytest.raises(PredictionError), found.opened("plaza", limit_bytes=LIMIT, sampling=None):
        pass


# --- maps ---


def read_maps(folder: Path, **changes: Any) -> ScenePrediction:
    fields = {key: value for key, value in (VIEWS | changes).items() if value is not None}
    return maps_of(open_arrays(save(folder / "v.npz", fields), LIMIT))


def test_depth_maps(tmp_path: Path) -> None:
    views = read_maps(tmp_path, pixel_centres=None)
    assert isinstance(views.geometry, DepthMaps)
    np.testing.assert_array_equal(views.geometry.values, VIEWS["depth"])
    np.testing.assert_array_equal(views.geometry.confidence, VIEWS["conf"])
    assert (views.kind, views.notes, views.pixel_centres) == ("depth", (), None)
    assert views.images is not None
    assert views.images.names.tolist() == WORLD.images("lot")
    assert views.images.found.all()
    np.testing.assert_allclose(views.images.poses.centres, camera_poses("lot").centres, atol=1e-7)
    np.testing.assert_array_equal(views.geometry.cameras.matrices, VIEWS["intrinsics"])
    with_axis = read_maps(tmp_path, depth=VIEWS["depth"][..., None]).geometry
    assert isinstance(with_axis, DepthMaps)
    np.testing.assert_array_equal(with_axis.values, VIEWS["depth"])


@pytest.mark.parametrize(
    ("shift", "stated", "named"),
    [
        (0.0, None, True),
        (0.0, "half", True),
        (0.5, "integer", True),
        (0.5, ["integer"], True),
        # Files without names are Depth Anything 3's, whose centres are integers.
        (0.5, None, False),
        (0.0, "half", False),
    ],
)
def test_pixel_centres_that_are_integers_are_shifted(
    shift: float, stated: Any, named: bool, tmp_path: Path
) -> None:
    changes: dict[str, Any] = {} if named else {"image_names": None}
    centres = None if stated is None else np.array(stated)
    maps = read_maps(tmp_path, pixel_centres=centres, **changes).geometry
    assert isinstance(maps, DepthMaps)
    assert maps.cameras.principal_point[0].tolist() == [WIDTH / 2 + shift, HEIGHT / 2 + shift]


def half_nan(extrinsics: np.ndarray) -> np.ndarray:
    changed = extrinsics.copy()
    changed[2, 0, 0] = np.nan
    return changed


# Faults beyond those of tests/goldens/refusals.txt.
@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"depth": np.zeros((4, 36, 48), int)}, "depth"),
        ({"depth": np.zeros((4, 0, 48)), "conf": None}, "depth"),
        ({"image_names": np.array(["a", "b", "c"])}, "image_names"),
        ({"image_names": np.array(["a", "b", "a", "c"])}, "'a'"),
        ({"image_names": np.array(["a", "b\x1b", "b", "c"])}, "image_names"),
        ({"extrinsics": half_nan(VIEWS["extrinsics"])}, "lot_2"),
    ],
)
def test_wrong_views_are_refused_by_their_field(
    changes: dict[str, Any], field: str, tmp_path: Path
) -> None:
    with pytest.raises(PredictionError) as caught:
        read_maps(tmp_path, **changes)
    assert field in str(caught.value)
    assert "v.npz" in str(caught.value)

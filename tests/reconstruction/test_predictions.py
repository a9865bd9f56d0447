"""Predictions: folders and archives, clouds and maps with their cameras, and maps as clouds."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.arrays import open_arrays
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction import fusion, predictions
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.clouds import PieceCloud
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps, depth_cloud, fuse
from airzoo_bench.reconstruction.predictions import ScenePrediction, maps_of, open_reconstruction
from airzoo_bench.reconstruction.settings import Fusion
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, write_ply
from tests.geometry.support import looking_down
from tests.reconstruction.support import UTM, similarity
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
    assert views.images.posed.all()
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
        ({"intrinsics": VIEWS["intrinsics"] * -1}, "intrinsics"),
    ],
)
def test_wrong_views_are_refused_by_their_field(
    changes: dict[str, Any], field: str, tmp_path: Path
) -> None:
    with pytest.raises(PredictionError) as caught:
        read_maps(tmp_path, **changes)
    assert field in str(caught.value)
    assert "v.npz" in str(caught.value)


# --- depth maps and point maps as clouds, pixel by pixel and fused ---


STILL = Similarity.identity()
SLOPE = np.array((0.1, -0.05, 1.0))
ABOVE = 30.0
TSDF = Fusion(
    method="tsdf",
    confidence_above="none",
    max_depth_m=100.0,
    tsdf_voxel_m=0.5,
    tsdf_truncation_m=2.0,
    tsdf_max_voxels=10**7,
)


def joined(source: PieceCloud, points: int = 1 << 20) -> Floats:
    parts = [piece.points for piece in source.pieces(points)]
    assert all(0 < len(part) <= points for part in parts)
    return np.concatenate(parts)


def fused(maps: DepthMaps, **changes: Any) -> Floats:
    return joined(fuse(maps, STILL, TSDF.model_copy(update=changes)))


def one_view(depth: Any, focal: float = 2.0, above: float = 0.0) -> DepthMaps:
    """Return a view with the principal point (1, 1), or of a camera that looks down from above."""
    grid = np.array(depth, np.float64)[None]
    height, width = grid.shape[1:]
    x, y = (width / 2 + 1, height / 2 - 1.5) if above else (1.0, 1.0)
    cameras = Cameras.from_matrices([[[focal, 0, x], [0, focal, y], [0, 0, 1]]], width, height)
    turn = looking_down(0.0) if above else np.eye(3)[None]
    centres = UTM[None] + np.array((0.0, 0.0, above))
    return DepthMaps(grid, cameras, Poses(rotation=turn, centres=centres))


def slope_maps(views: int = 6, width: int = 64, height: int = 48) -> DepthMaps:
    """Views of the plane SLOPE . (X - UTM) = 0, from some 30 m above."""
    K = np.tile([[60.0, 0, 33.0], [0, 60.0, 22.5], [0, 0, 1]], (views, 1, 1))
    turns = np.concatenate([looking_down(5.0 * row, 40.0 * row) for row in range(views)])
    centres = UTM + np.stack([(3.0 * row, 2.0 * (row % 3), ABOVE) for row in range(views)])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack(((x - 33.0) / 60, (y - 22.5) / 60, np.ones_like(x)), axis=-1)
    down = (centres - UTM) @ SLOPE
    depth = -down[:, None, None] / np.einsum("hwi,ni->nhw", rays, turns @ SLOPE)
    cameras = Cameras.from_matrices(K, width, height)
    return DepthMaps(depth, cameras, Poses(rotation=turns, centres=centres))


def off_plane(points: Floats) -> Floats:
    return np.asarray((points - UTM) @ SLOPE / np.linalg.norm(SLOPE))


def test_pixels_by_hand() -> None:
    found = joined(depth_cloud(one_view([[4, 8], [0, 2]]), STILL, TSDF))
    # Through (0.5, 0.5), (1.5, 0.5) and (1.5, 1.5) of a camera with f = 2 and c = (1, 1).
    expected = UTM + np.array(((-1, -1, 4.0), (2, -2, 8), (0.5, 0.5, 2)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    cloud = depth_cloud(one_view([[np.nan, np.inf, -1.0], [0.0, 101.0, 7.0]]), STILL, TSDF)
    assert cloud.count == 1
    assert joined(cloud)[0, 2] == UTM[2] + 7.0


def test_the_plane_comes_back_in_another_frame_and_in_any_pieces() -> None:
    maps = slope_maps(2)
    whole = joined(depth_cloud(maps, STILL, TSDF))
    made = similarity(np.random.default_rng(1), 0.01)
    there = replace(maps, values=maps.values * 0.01, poses=made.apply_poses(maps.poses))
    found = joined(depth_cloud(there, made.inverse(), TSDF))
    assert len(found) == maps.values.size
    assert np.abs(off_plane(found)).max() < 1e-5
    np.testing.assert_allclose(found, whole, atol=1e-5)
    assert joined(depth_cloud(maps, STILL, TSDF), 7).tobytes() == whole.tobytes()


def test_point_maps() -> None:
    points = np.arange(24.0).reshape(2, 2, 2, 3)
    points[0, 0, 1, 2], points[1, 1, 1, 0] = np.nan, np.inf
    confidence = np.full((2, 2, 2), 2.0)
    confidence[1, 0, 0] = 1.0
    maps = PointMaps(points.astype(np.float32), confidence)
    used = TSDF.model_copy(update={"confidence_above": 1.0})
    cloud = fusion.point_map_cloud(maps, Similarity(2.0, np.eye(3), UTM), used)
    assert cloud.count == 6  # one of too little confidence
    expected = 2 * points.reshape(-1, 3)[[0, 2, 3, 5, 6]] + UTM
    np.testing.assert_array_equal(joined(cloud, 2), expected)


def test_tsdf_gives_the_plane_back() -> None:
    maps = slope_maps()
    found = fused(maps)
    assert len(found) > 1000
    # A voxel takes the depth of the pixel that it falls on: the slant over half a pixel, of some
    # 0.5 m, is its error, either way.
    away = off_plane(found)
    assert abs(away.mean()) < 0.01
    assert np.median(np.abs(away)) < 0.05
    assert np.abs(away).max() < 0.5
    # Half a pixel off would be 0.25 m at 30 m, seen by the border of the surface.
    seen, reach = joined(depth_cloud(maps, STILL, TSDF)), TSDF.tsdf_truncation_m
    assert ((found > seen.min(axis=0) - reach) & (found < seen.max(axis=0) + reach)).all()


def test_tsdf_pixel_centres_and_a_ground_at_a_round_height() -> None:
    # A step in depth, between columns 31 and 32, seen from straight above: it lies at u = 32.
    depth = np.full((48, 64), 30.0)
    depth[:, 32:] = 33.0
    found = fused(one_view(depth, 60.0, ABOVE), tsdf_voxel_m=0.1, tsdf_truncation_m=0.4) - UTM
    high, low = found[found[:, 2] > -0.2], found[found[:, 2] < -2.8]
    # The pixel right of the step ends at (31.5 + 0.5 - 33) / 60 * 30 = -0.5 m.
    assert high[:, 0].max() == pytest.approx(-0.5, abs=0.11)
    assert low[:, 0].min() == pytest.approx(-0.55, abs=0.11)
    # Rows 0 to 48 lie from 22.5 / 60 * 30 = 11.25 m north to 12.75 m south.
    assert high[:, 1].max() == pytest.approx(11.25, abs=0.15)
    assert high[:, 1].min() == pytest.approx(-12.75, abs=0.15)
    # Pixels of 0.5 m, five times the voxels, leave no holes.
    np.testing.assert_allclose(high[high[:, 0] < -0.6, 2], 0.0, atol=1e-4)
    assert len(np.unique(np.floor(high[:, :2] / 0.5).astype(int), axis=0)) >= 30 * 44


def test_tsdf_outliers_do_not_allocate_the_world() -> None:
    maps = slope_maps(2)
    maps.values[:, ::7, ::7] = 1e9
    maps.values[:, 1::7, ::7] = 99.0
    assert len(fused(maps)) > 1000
    with pytest.raises(PredictionError):
        fused(maps, tsdf_max_voxels=50_000)

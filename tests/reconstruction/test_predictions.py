"""Predictions: folders and archives, maps and clouds of them, and faults that users cannot see."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.arrays import open_arrays
from airzoo_bench.formats.clouds.cloud import ArrayPieces, FileCloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction import fusion, predictions
from airzoo_bench.reconstruction.alignment import PosedCameras, Similarity
from airzoo_bench.reconstruction.checks import (
    check_bounds,
    check_datum,
    check_inversion,
    check_mirror,
    check_names,
    check_resolution,
    rounding_error,
)
from airzoo_bench.reconstruction.clouds import PieceCloud
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps, depth_cloud, fuse
from airzoo_bench.reconstruction.predictions import ScenePrediction, open_reconstruction, read_maps
from airzoo_bench.reconstruction.settings import Fusion
from tests.formats.cloud_support import LIMIT, SAMPLING, made, points_of, write_ply
from tests.geometry.support import looking_down
from tests.reconstruction.world import MAP_SIZE, UTM, World, notes_of, poses, save, similarity

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
    assert set(found.entries) == {"park.v2", "plaza", "school", "substation"}
    assert found.extra_files == ("notes.md",)
    for scene, cameras in (("park.v2", False), ("school", True), ("substation", True)):
        with found.entries[scene](LIMIT, SAMPLING) as given:
            assert isinstance(given.geometry, FileCloud)
            assert (given.images is not None) == cameras
            points = np.concatenate([piece.points for piece in given.geometry.pieces(9)])
            np.testing.assert_array_equal(points, points_of(made()))
    with found.entries["plaza"](LIMIT, SAMPLING) as given:
        assert isinstance(given.geometry, DepthMaps)
        np.testing.assert_array_equal(given.geometry.values, VIEWS["depth"])


def test_a_file_alone_is_a_scene(folder: Path) -> None:
    packed = pack(folder.parent / "a.zip", [("school/cloud.ply", b"")])
    for path in (folder / "school.ply", packed):
        assert list(open_reconstruction(path).entries) == ["school"]


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    "names",
    [
        *([], ["a.ply", "A.ply"], ["a.ply", "a.laz"], ["a/x.ply", "a/y.ply", "b.ply"]),
        *(["a/b/c.ply", "d/e/f.ply", "a_ply"], ["a.ply:/etc/passwd"]),
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


# --- maps ---


def read_views(folder: Path, **changes: Any) -> ScenePrediction:
    fields = {key: value for key, value in (VIEWS | changes).items() if value is not None}
    return read_maps(open_arrays(save(folder / "v.npz", fields), LIMIT))


@pytest.mark.parametrize(
    ("shift", "stated", "named"),
    [
        *((0.0, None, True), (0.0, "half", True), (0.5, "integer", True)),
        (0.5, ["integer"], True),
        # Files without names are Depth Anything 3's, whose centres are integers.
        *((0.5, None, False), (0.0, "half", False)),
    ],
)
def test_pixel_centres_that_are_integers_are_shifted(shift, stated, named, tmp_path) -> None:
    changes: dict[str, Any] = {} if named else {"image_names": None}
    centres = None if stated is None else np.array(stated)
    maps = read_views(tmp_path, pixel_centres=centres, **changes).geometry
    assert isinstance(maps, DepthMaps)
    assert maps.cameras.principal_point[0].tolist() == [WIDTH / 2 + shift, HEIGHT / 2 + shift]


# --- depth maps and point maps as clouds, pixel by pixel and fused ---

STILL = Similarity.identity()
SLOPE, ABOVE = np.array((0.1, -0.05, 1.0)), 30.0
LENGTHS = {"max_depth_m": 100.0, "tsdf_voxel_m": 0.5, "tsdf_truncation_m": 2.0}
TSDF = Fusion(method="tsdf", confidence_above="none", tsdf_max_voxels=10**7, **LENGTHS)


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


# --- mistakes that users make and cannot see: refused or noted ---

TRUTH = np.array([[576_661.0, 5_188_114.0, 156.0], [576_768.0, 5_188_211.0, 169.0]])
LOCAL = TRUTH - TRUTH[0]


@given(st.floats(0.2, 5.0), st.floats(-200, 200))
def test_a_cloud_that_lies_about_right_raises_none(scale: float, shift: float) -> None:
    assert check_bounds(TRUTH[0] + LOCAL * scale + (shift, -shift, 0), TRUTH) is None


OTHER_COORDINATES = [
    (LOCAL * 1000, LOCAL, "millimetres"),
    (LOCAL * 97, LOCAL, "another unit"),
    (LOCAL / 1000, LOCAL, "another unit"),
    (LOCAL, TRUTH, "a local origin"),
    (TRUTH[:, [1, 0, 2]], TRUTH, "x and y exchanged"),
    (TRUTH / 0.3048, TRUTH, "feet"),
    (np.array([[-92.0, 46.7, 150.0], [-91.9985, 46.7012, 166.0]]), TRUTH, "longitude"),
]


@pytest.mark.parametrize(("cloud", "truth", "named"), OTHER_COORDINATES)
def test_other_coordinates_are_recognised(cloud: Floats, truth: Floats, named: str) -> None:
    assert named in str(check_bounds(cloud, truth))


@pytest.mark.parametrize(("up", "noted"), [(42, True), (-31.5, True), (4, False), (150, False)])
def test_heights_of_another_datum(up: float, noted: bool) -> None:
    found = check_datum(TRUTH + np.array((0, 0, up)), TRUTH)
    assert (f"{abs(up):.3g} m {'above' if up > 0 else 'below'}" in str(found)) == noted


SCENE = TRUTH[0] + np.random.default_rng(0).uniform(0, 90, (500, 3))
DIGITS = np.vectorize(lambda x: float(f"{x:.6g}"))


@pytest.mark.parametrize(
    ("points", "lost"),
    [
        *((SCENE.astype("f4"), True), (DIGITS(SCENE), True)),
        *((SCENE, False), (np.round(SCENE, 2), False), (np.zeros((0, 3)), False)),
        *(((SCENE - TRUTH[0]).astype("f4"), False), (DIGITS(SCENE - TRUTH[0]), False)),
    ],
)
def test_digits_that_were_lost(points: np.ndarray, lost: bool) -> None:
    error = rounding_error(FileCloud(Path(), "ply", len(points), ArrayPieces(points), points.dtype))
    assert (error > 0.01) == lost
    if lost:
        rms = np.sqrt(((points - SCENE) ** 2).sum(axis=1).mean())
        assert error == pytest.approx(rms, rel=0.2)


HILLS = np.random.default_rng(1).uniform(0, 100, (2000, 3))
HILLS[:, 2] = 15 * np.sin(HILLS[:, 0] / 12) + HILLS[:, 1] / 5
FLAT = HILLS * (1.0, 0.8, 0.08)  # 3 m high: all of it lies within 10 m, upside down or not
FLAT -= FLAT.mean(axis=0)
TURN = Rotation.from_euler("xyz", (10, 20, 30), degrees=True).as_matrix()


@pytest.mark.parametrize(
    ("scene", "order", "signs", "words"),
    [
        (HILLS, (0, 1, 2), (1, 1, -1), "(+x, +y, -z)"),
        (HILLS, (1, 0, 2), (1, 1, 1), "(+y, +x, +z)"),
        (FLAT, (0, 2, 1), (1, 1, -1), "(+x, -z, +y)"),
    ],
    ids=["z negated", "x and y exchanged", "y up"],
)
def test_a_cloud_that_is_mirrored_in_its_own_frame(scene, order, signs, words) -> None:
    own, limits = Similarity(3.0, TURN, TRUTH[0]), [1.0, 10.0]
    truth, wrong = own.apply(scene / 3), own.apply(scene[:, order] * signs / 3)
    assert words in str(check_mirror(wrong, truth, own, limits))
    # A cloud that fits, or is merely elsewhere, is not mirrored.
    for shift in (0.0, 4.0, 60.0):
        assert check_mirror(truth + np.array((0, 0, shift)), truth, own, limits) is None


@pytest.mark.parametrize(("width", "height"), [(504, 378), (518, 392), (720, 540)])
def test_intrinsics_of_photos_that_are_little_larger_or_smaller(width: int, height: int) -> None:
    """Depth Anything 3 and VGGT make maps of 504 and 518 px of a photo of 640x480."""
    K = np.tile(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (3, 1, 1))
    with pytest.raises(PredictionError, match=r"6[34]\d x 4[78]\d"):
        check_resolution(Cameras.from_matrices(K, width, height), None, "it")
    K[:, :2, 2] = np.array([width, height]) / 2
    with pytest.raises(PredictionError, match="height and width"):
        check_resolution(Cameras.from_matrices(K, height, width), None, "it")
    K[:, :2, 2] = np.array([width, height]) / 2 * 1.09
    check_resolution(Cameras.from_matrices(K, width, height), None, "it")


def strip(count: int = 12) -> Poses:
    """Nadir views of one heading on a straight flight: all rotations the same."""
    turn = Rotation.from_euler("zx", [30, 180], degrees=True).as_matrix()
    centres = np.stack([np.arange(count) * 20.0, np.zeros(count), np.full(count, 80.0)], axis=-1)
    return Poses.from_centres(np.tile(turn, (count, 1, 1)), centres)


RANDOM = [poses(np.random.default_rng(seed), count) for seed, count in ((0, 12), (3, 200))]


@pytest.mark.parametrize("truth", [*RANDOM, strip()], ids=["few", "many", "strip"])
def test_camera_to_world_is_refused_and_on_a_strip_noted(truth: Poses) -> None:
    assert check_inversion(truth, truth, "yard.npz") is None
    opengl = Poses.from_centres(np.diag((1.0, -1.0, -1.0)) @ truth.rotation, truth.centres)
    for claimed, fix in ((truth, "R.T and -R.T @ t"), (opengl, "diag(1, -1, -1)")):
        # Their camera-to-world matrices, taken for world-to-camera.
        given = Poses.from_translations(np.swapaxes(claimed.rotation, 1, 2), claimed.centres)
        if len({*truth.centres[:, 1]}) == 1:
            assert "0.0 once inverted" in str(check_inversion(given, truth, "yard.npz"))
            continue
        with pytest.raises(PredictionError) as caught:
            check_inversion(given, truth, "yard.npz")
        assert fix in str(caught.value.fix)


def test_names_one_off_are_refused_where_nothing_else_explains_it() -> None:
    rng, names = np.random.default_rng(0), tuple(f"DJI_{n:04}.JPG" for n in range(16))
    true = PosedCameras(names, poses(rng, 16).centres)
    spacing = float(np.median(np.linalg.norm(np.diff(true.centres, axis=0), axis=1)))
    off = tuple(np.roll(names, -1).tolist())
    for centres in (true.centres, 0.02 * true.centres[:, [1, 0, 2]] * (1, -1, 1)):
        with pytest.raises(PredictionError):
            check_names(PosedCameras(off, centres), true, "yard.npz")
    # Cameras that are poor, or none, are scored without a word.
    rough = true.centres + rng.normal(0, spacing / 6, (16, 3))
    check_names(PosedCameras(off, rough), true, "yard.npz")
    for noise in (0.0, 0.1, 0.5, 2.0):
        centres = true.centres + rng.normal(0, noise * spacing, (16, 3))
        centres[: int(4 * noise)] = np.nan
        check_names(PosedCameras(names, centres), true, "yard.npz")


@pytest.mark.parametrize(("units", "depth", "noted"), [(1e4, 1.0, False), (1.0, 1e3, True)])
def test_far_depths_are_those_after_the_alignment(units, depth, noted, world, tmp_path) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"] * np.array((1.0, 1.0, 1.0, units))
    fields["depth"] = fields["depth"] * units * depth
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    assert any("millimetres" in note for note in notes_of(world, path)) == noted


def test_half_a_pixel_is_asked_for_where_it_matters(world: World, tmp_path: Path) -> None:
    def asked() -> list[str]:
        path = save(tmp_path / "p" / "lot.npz", fields).parent
        return [note for note in notes_of(world, path) if "pixel_centres" in note]

    fields = world.views("lot")
    assert not asked()
    del fields["pixel_centres"]
    (note,) = asked()
    # Depth 35 m at a focal length of 80 px: half a pixel in x and y is 0.3 m.
    error = float(note.partition("points are ")[2].partition(" m off")[0])
    depth = fields["depth"]
    assert error == pytest.approx(np.hypot(0.5, 0.5) / 80 * np.median(depth[depth > 0]), rel=0.05)

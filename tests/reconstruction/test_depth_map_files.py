"""Depth maps and point maps with cameras: read right, or refused with the suspicion by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import PosedCameras
from airzoo_bench.reconstruction.cameras import read_image_poses
from airzoo_bench.reconstruction.checks import (
    check_image_size,
    check_resolution,
    refuse_camera_to_world,
    suspect_camera_to_world,
    suspect_names,
)
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps
from airzoo_bench.reconstruction.predictions import holds_maps, read_maps
from tests.formats.cloud_support import refused
from tests.reconstruction.depth_maps import H, N, W, made, matrices, poses

LIMIT = 1 << 24


def written(path: Path, **changes: Any) -> Path:
    np.savez(path / "v.npz", **made(**changes))
    return path / "v.npz"


def depth_maps(path: Path) -> DepthMaps:
    maps = read_maps(path, LIMIT).geometry
    assert isinstance(maps, DepthMaps)
    return maps


def test_depth_maps(tmp_path: Path) -> None:
    path = written(tmp_path)
    views, maps = read_maps(path, LIMIT), depth_maps(path)
    np.testing.assert_array_equal(maps.depth, made()["depth"])
    np.testing.assert_array_equal(maps.confidence, made()["conf"])
    assert views.kind == "depth"
    assert views.notes == ()
    assert views.images is not None
    assert views.images.names.tolist() == made()["image_names"].tolist()
    assert views.images.found.all()
    np.testing.assert_allclose(views.images.poses.centres, poses().centres, atol=1e-9)
    np.testing.assert_array_equal(maps.cameras.matrices, made()["intrinsics"])


def test_other_shapes_that_mean_the_same(tmp_path: Path) -> None:
    square = np.concatenate([matrices(poses()), np.tile([[[0.0, 0, 0, 1]]], (N, 1, 1))], axis=1)
    path = written(tmp_path, depth=made()["depth"][..., None], extrinsics=square.astype("f4"))
    maps = depth_maps(path)
    np.testing.assert_array_equal(maps.depth, made()["depth"])
    np.testing.assert_allclose(maps.poses.centres, poses().centres, atol=1e-3)


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
    assert read_maps(written(tmp_path), LIMIT).pixel_centres is None


@pytest.mark.parametrize("value", ["corner", "", 0.5, ["half", "half"], [["a"]]])
def test_other_pixel_centres_are_refused(value: object, tmp_path: Path) -> None:
    with refused("'half'.*or 'integer'") as caught:
        read_maps(written(tmp_path, pixel_centres=np.array(value)), LIMIT)
    assert "field 'pixel_centres'" in str(caught.value)


def test_an_axis_before_the_pixels_is_told_how_to_go(tmp_path: Path) -> None:
    with refused("axis of 1 before the pixels") as caught:
        read_maps(written(tmp_path, depth=made()["depth"][:, None]), LIMIT)
    assert "depth[:, 0]" in str(caught.value.fix)


def test_views_without_names_are_numbered(tmp_path: Path) -> None:
    views = read_maps(written(tmp_path, image_names=None), LIMIT)
    assert views.images is not None
    assert not views.images.named
    assert views.images.names.tolist() == ["view 0", "view 1", "view 2", "view 3"]
    np.testing.assert_allclose(views.images.poses.centres, poses().centres, atol=1e-9)
    named = read_maps(written(tmp_path), LIMIT).images
    assert named is not None
    assert named.named


@pytest.mark.parametrize("name", ["points", "world_points"])
def test_point_maps_with_cameras_or_without(name: str, tmp_path: Path) -> None:
    points = np.random.default_rng(2).random((N, H, W, 3))
    path = written(tmp_path, depth=None, **{name: points})
    views = read_maps(path, LIMIT)
    assert isinstance(views.geometry, PointMaps)
    np.testing.assert_array_equal(views.geometry.points, points)
    assert views.images is not None
    bare = {"extrinsics": None, "intrinsics": None, "image_names": None, "depth": None}
    views = read_maps(written(tmp_path, **bare, **{name: points}), LIMIT)
    assert views.images is None
    assert views.kind == "points"


def test_what_is_a_cloud_and_what_are_views(tmp_path: Path) -> None:
    cases = (
        {"points": (5, 3)},
        {"points": (1, 2, 2, 3)},
        {"depth": (1, 2, 2)},
        {"world_points": (5, 3)},
    )
    found = []
    for shapes in cases:
        np.savez(tmp_path / "a.npz", **{name: np.zeros(shape) for name, shape in shapes.items()})
        found.append(holds_maps(tmp_path / "a.npz", LIMIT))
    assert found == [False, True, True, True]


def test_a_pose_that_was_not_found_is_all_nan(tmp_path: Path) -> None:
    extrinsics = matrices(poses())
    extrinsics[1] = np.nan
    images = read_maps(written(tmp_path, extrinsics=extrinsics), LIMIT).images
    assert images is not None
    assert images.found.tolist() == [True, False, True, True]


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
        ({"depth": np.zeros((N, H, W), int)}, "'depth' is int64"),
        ({"depth": np.zeros((N, H * W))}, "'depth' is float64 of shape"),
        ({"depth": np.zeros((N, 0, W)), "conf": None}, "'depth' is float64 of shape"),
        ({"conf": np.zeros((N, W, H), "f4")}, "the size of the maps"),
        ({"intrinsics": made()["intrinsics"][:2]}, "2 rows for 4 images"),
        ({"extrinsics": matrices(poses())[:2]}, "2 rows for 4 images"),
        ({"image_names": np.array(["a", "b", "c"])}, "3 rows for 4 images"),
        ({"image_names": np.array(["a", "b", "a", "c"])}, "more than once: 1 of 4 \\('a'\\)"),
        ({"image_names": np.array(["a", "", "b", "c"])}, "empty"),
        ({"image_names": np.array(["a", "b\x1b", "b", "c"])}, "do not print"),
        ({"extrinsics": changed((2, 0, 0), np.nan)}, "NaN or infinite in part: 1 of 4 .DJI_0002"),
        ({"extrinsics": changed((2, 0, 0), np.inf)}, "NaN or infinite in part"),
        ({"extrinsics": matrices(poses()) * 2}, "not orthonormal in 4 of 4 .first 3: DJI_0000"),
        ({"extrinsics": matrices(poses()) * [1, 1, -1, 1]}, "reflection"),
        ({"extrinsics": np.tile(np.eye(4), (N, 1, 1)) + 1e-3 * np.eye(4)[3]}, "last row"),
        ({"intrinsics": made()["intrinsics"] * -1}, "no positive focal length"),
        ({"colours": np.zeros((N, H, W, 3))}, "the colours are float64"),
    ],
)
def test_wrong_views(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with refused(message) as caught:
        read_maps(written(tmp_path, **changes), LIMIT)
    assert "v.npz" in str(caught.value)


@pytest.mark.parametrize(
    ("ratio", "likely"),
    [(7.72, "about 62 x 46"), (2.0, "about 16 x 12"), (0.5, "about 4 x 3"), (1 / W, "normalised")],
)
def test_intrinsics_of_another_resolution(ratio: float, likely: str, tmp_path: Path) -> None:
    scale = np.diag([ratio, ratio, 1.0])
    if likely == "normalised":
        scale = np.diag([1 / W, 1 / H, 1.0])
    path = written(tmp_path, intrinsics=scale @ made()["intrinsics"])
    with refused(likely) as caught:
        read_maps(path, LIMIT)
    assert "times the centre of the maps in 4 (first 3: DJI_0000" in str(caught.value).replace(
        "4 of 4", "4"
    )


@pytest.mark.parametrize(("width", "height"), [(504, 378), (518, 392), (720, 540)])
def test_intrinsics_of_photos_that_are_little_larger_or_smaller(width: int, height: int) -> None:
    """Depth Anything 3 and VGGT make maps of 504 and 518 px of a photo of 640x480."""
    K = np.tile(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (3, 1, 1))
    with refused("about 6[34][0-9] x 4[78][0-9]"):
        check_resolution(Cameras.from_matrices(K, width, height), None, "it")
    K[1, :2, 2] = width / 2, height / 2
    assert check_resolution(Cameras.from_matrices(K, width, height), None, "it") == ()
    near = np.array([width, height]) / 2 * 1.09
    K[:, :2, 2] = near
    assert check_resolution(Cameras.from_matrices(K, width, height), None, "it") == ()


def test_a_principal_point_off_the_centre_is_noted(tmp_path: Path) -> None:
    K = made()["intrinsics"].copy()
    K[1, 0, 2] *= 1.8
    views = read_maps(written(tmp_path, intrinsics=K), LIMIT)
    assert "1 of 4 (DJI_0001.JPG)" in views.notes[0]
    K[1, 0, 2] = W / 2 * 1.3
    assert read_maps(written(tmp_path, intrinsics=K), LIMIT).notes == ()


def test_maps_of_another_shape_than_the_photos() -> None:
    assert check_image_size((518, 291), 4000, 2250) is None
    assert check_image_size((504, 280), 4000, 2250) is None
    assert "turned by 90 degrees" in str(check_image_size((291, 518), 4000, 2250))
    assert "cut, padded" in str(check_image_size((518, 518), 4000, 2250))


def inverted(given: Poses) -> Poses:
    """Poses whose extrinsics are the camera-to-world matrices of the given ones."""
    return Poses.from_translations(np.swapaxes(given.rotation, 1, 2), given.centres)


def strip(count: int = 12) -> Poses:
    """Nadir views of one heading on a straight flight: all rotations the same."""
    rotation = np.tile(
        Rotation.from_euler("zx", [30, 180], degrees=True).as_matrix(), (count, 1, 1)
    )
    centres = np.stack([np.arange(count) * 20.0, np.zeros(count), np.full(count, 80.0)], axis=-1)
    return Poses.from_centres(rotation, centres)


@pytest.mark.parametrize("truth", [poses(12), poses(200, 3), strip()], ids=["few", "many", "strip"])
def test_camera_to_world_is_suspected(truth: Poses) -> None:
    said = suspect_camera_to_world(inverted(truth), truth)
    assert said is not None
    assert "0.0 once inverted" in said
    assert suspect_camera_to_world(truth, truth) is None


@pytest.mark.parametrize("truth", [poses(12), poses(200, 3)], ids=["few", "many"])
def test_camera_to_world_in_opengl_axes_is_suspected(truth: Poses) -> None:
    flipped = Poses.from_centres(np.diag((1.0, -1.0, -1.0)) @ truth.rotation, truth.centres)
    said = suspect_camera_to_world(inverted(flipped), truth)
    assert said is not None
    assert "0.0 once inverted and in OpenCV's axes" in said


def test_clearly_inverted_cameras_are_refused() -> None:
    truth = poses(12)
    with pytest.raises(PredictionError, match=r"0\.0 once inverted") as caught:
        refuse_camera_to_world(inverted(truth), truth, "yard.npz")
    assert caught.value.fix == "invert them: R.T and -R.T @ t"
    flipped = Poses.from_centres(np.diag((1.0, -1.0, -1.0)) @ truth.rotation, truth.centres)
    with pytest.raises(PredictionError) as caught:
        refuse_camera_to_world(inverted(flipped), truth, "yard.npz")
    assert "diag(1, -1, -1)" in str(caught.value.fix)


@pytest.mark.parametrize("truth", [strip(), poses(4)], ids=["line", "few"])
def test_what_may_be_something_else_is_not_refused(truth: Poses) -> None:
    assert suspect_camera_to_world(inverted(truth), truth) is not None
    refuse_camera_to_world(inverted(truth), truth, "yard.npz")


@pytest.mark.parametrize("seed", range(20))
def test_names_one_off(seed: int) -> None:
    rng, names = np.random.default_rng(seed), tuple(f"DJI_{n:04}.JPG" for n in range(16))
    true = PosedCameras(names, poses(16, seed=seed).centres)
    spacing = float(np.median(np.linalg.norm(np.diff(true.centres, axis=0), axis=1)))
    for step in (1, -1):
        off = tuple(np.roll(names, step).tolist())
        for centres in (true.centres, 0.02 * true.centres[:, [1, 0, 2]] * (1, -1, 1)):
            with pytest.raises(PredictionError, match="one off"):
                suspect_names(PosedCameras(off, centres), true, "yard.npz")
        rough = PosedCameras(off, true.centres + rng.normal(0, spacing / 6, (16, 3)))
        assert "one off" in str(suspect_names(rough, true, "yard.npz"))
    # Cameras that are poor, or none, are scored without a word.
    for noise in (0.0, 0.1, 0.5, 2.0):
        shaken = true.centres + rng.normal(0, noise * spacing, (16, 3))
        shaken[: seed % 4] = np.nan
        assert suspect_names(PosedCameras(names, shaken), true, "yard.npz") is None


@pytest.mark.parametrize("seed", range(20))
def test_poses_that_failed_are_scored(seed: int) -> None:
    refuse_camera_to_world(poses(5, seed=seed + 1), poses(5), "yard.npz")
    truth = poses(12)
    turn = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 0.5, (12, 3))).as_matrix()
    shaken = Poses.from_centres(turn @ truth.rotation, truth.centres)
    refuse_camera_to_world(shaken, truth, "yard.npz")


def test_neither_another_world_nor_bad_poses_are_suspected() -> None:
    truth = poses(12)
    turn = Rotation.random(rng=5).as_matrix()
    moved = Poses.from_centres(truth.rotation @ turn.T, truth.centres @ turn.T * 0.3 + 1000)
    assert suspect_camera_to_world(moved, truth) is None
    assert "world" in str(suspect_camera_to_world(inverted(moved), truth))
    assert suspect_camera_to_world(poses(12, seed=9), truth) is None
    assert suspect_camera_to_world(inverted(poses(2)), poses(2)) is None


def test_cameras_beside_a_cloud(tmp_path: Path) -> None:
    path = written(tmp_path, depth=None, conf=None, intrinsics=None)
    images = read_image_poses(path, LIMIT)
    np.testing.assert_allclose(images.poses.centres, poses().centres, atol=1e-9)
    with refused("'depth'"):
        read_image_poses(written(tmp_path), LIMIT)

"""Cameras and poses from JSON files and COLMAP models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import CameraError
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.scenes import PosedPhotos
from tests.support import DOWN

SIZES = {"a.jpg": (64, 48), "sub/b.jpg": (64, 48)}
K = [[64.0, 0, 31], [0, 65.0, 25], [0, 0, 1]]
CENTRES = {
    "a.jpg": [500_000.125, 5_200_000.25, 200.5],
    "sub/b.jpg": [500_010.0, 5_200_020.0, 210.0],
}


def json_file(path: Path, **changes: Any) -> Path:
    content: dict[str, Any] = {
        "crs": "EPSG:32633",
        "K": K,
        "images": {name: {"R_w2c": DOWN, "center": centre} for name, centre in CENTRES.items()},
    }
    content |= changes
    kept = {key: value for key, value in content.items() if value is not None}
    (path / "poses.json").write_text(json.dumps(kept))
    return path / "poses.json"


def tilted() -> np.ndarray[Any, Any]:
    a, b = np.radians([20.0, 35.0])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    turn = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    return tilt @ np.array(DOWN) @ turn


def test_json(tmp_path: Path) -> None:
    photos = read_poses(json_file(tmp_path, note="left aside", model="pinhole"), SIZES)
    assert photos.names == ("a.jpg", "sub/b.jpg")
    assert photos.crs == "EPSG:32633"
    np.testing.assert_array_equal(photos.poses.centres, list(CENTRES.values()))
    np.testing.assert_array_equal(photos.cameras.matrices[0], K)
    np.testing.assert_array_equal(photos.cameras.distortion, np.zeros((2, 5)))
    assert photos.cameras.width.tolist() == [64, 64]


def test_what_stands_in_an_image_goes_before_the_top(tmp_path: Path) -> None:
    own = [[70.0, 0, 32], [0, 70.0, 24], [0, 0, 1]]
    images = {
        "a.jpg": {"R_w2c": DOWN, "center": [1, 2, 3], "K": own, "distortion": [1, 2, 3, 4, 5]},
        "sub/b.jpg": {"R_w2c": DOWN, "center_utm": [1, 2, 3]},
    }
    photos = read_poses(
        json_file(tmp_path, images=images, dist_k1k2p1p2=[0.1, 0.2, 0.3, 0.4]), SIZES
    )
    np.testing.assert_array_equal(photos.cameras.matrices, [own, K])
    np.testing.assert_array_equal(
        photos.cameras.distortion, [[1, 2, 3, 4, 5], [0.1, 0.2, 0.3, 0.4, 0]]
    )


def test_rotations_rounded_in_the_file_become_exact(tmp_path: Path) -> None:
    images = {"a.jpg": {"R_w2c": tilted().round(5).tolist(), "center": [1, 2, 3]}}
    rotation = read_poses(json_file(tmp_path, images=images), SIZES).poses.rotation[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rotation, tilted(), atol=1e-5)


def colmap(
    folder: Path, model: str = "PINHOLE", params: Any = (64.0, 65.0, 31.0, 25.0), **options: Any
) -> Path:
    """Write a COLMAP model of the two photos."""
    import pycolmap

    made = pycolmap.Reconstruction()
    width, height = options.get("size", (64, 48))
    camera = pycolmap.Camera(
        model=model, width=width, height=height, params=list(params), camera_id=1
    )
    made.add_camera_with_trivial_rig(camera)
    for number, (name, centre) in enumerate(CENTRES.items(), start=1):
        rotation = tilted()
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ np.array(centre))
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        made.add_image_with_trivial_frame(image, pose)
    folder.mkdir()
    (made.write_text if options.get("text") else made.write_binary)(str(folder))
    return folder


def assert_is_the_model(photos: PosedPhotos) -> None:
    assert photos.names == ("a.jpg", "sub/b.jpg")
    assert photos.crs is None
    np.testing.assert_allclose(photos.poses.centres, list(CENTRES.values()), atol=1e-8)
    np.testing.assert_allclose(photos.poses.rotation, [tilted(), tilted()], atol=1e-12)


@pytest.mark.parametrize("text", [False, True])
def test_colmap(text: bool, tmp_path: Path) -> None:
    photos = read_poses(colmap(tmp_path / "model", text=text), SIZES)
    assert_is_the_model(photos)
    np.testing.assert_array_equal(photos.cameras.matrices[0], K)


@pytest.mark.parametrize(
    ("model", "params", "distortion"),
    [
        ("SIMPLE_PINHOLE", (64, 32, 24), (0, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL", (64, 32, 24, 0.1), (0.1, 0, 0, 0, 0)),
        ("RADIAL", (64, 32, 24, 0.1, 0.2), (0.1, 0.2, 0, 0, 0)),
        ("OPENCV", (64, 64, 32, 24, 0.1, 0.2, 0.3, 0.4), (0.1, 0.2, 0.3, 0.4, 0)),
    ],
)
def test_colmap_cameras(model: str, params: Any, distortion: Any, tmp_path: Path) -> None:
    photos = read_poses(colmap(tmp_path / "model", model, params), SIZES)
    np.testing.assert_array_equal(photos.cameras.matrices[1], [[64, 0, 32], [0, 64, 24], [0, 0, 1]])
    np.testing.assert_array_equal(photos.cameras.distortion[1], distortion)


def test_colmap_models_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(CameraError, match="empty: not a COLMAP model"):
        read_poses(tmp_path / "empty", SIZES)
    path = colmap(tmp_path / "cut")
    for name in ("images.bin", "frames.bin", "cameras.bin", "rigs.bin"):
        content = (path / name).read_bytes()
        (path / name).write_bytes(content[: len(content) // 2])
        with pytest.raises(CameraError, match=r"cut: (not a COLMAP model|K has no)"):
            read_poses(path, SIZES)
        (path / name).write_bytes(content)
    assert_is_the_model(read_poses(path, SIZES))

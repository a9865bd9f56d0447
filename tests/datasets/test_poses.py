"""Cameras and poses from JSON files and COLMAP models, and rotations from three angles."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.cameras import attitudes_to_rotations
from airzoo_bench.datasets.poses import read_poses
from tests.support import DOWN

NAMES = ("a.jpg", "sub/b.jpg")
SIZES = dict.fromkeys(NAMES, (64, 48))
K = [[64.0, 0, 31], [0, 65.0, 25], [0, 0, 1]]
CENTRES = [[500_000.125, 5_200_000.25, 200.5], [500_010.0, 5_200_020.0, 210.0]]
TILTED = (Rotation.from_euler("x", 20, degrees=True).as_matrix() @ np.array(DOWN)) @ (
    Rotation.from_euler("z", 35, degrees=True).as_matrix()
)


def json_file(folder: Path, **changes: Any) -> Path:
    posed = zip(NAMES, CENTRES, strict=True)
    images = {name: {"R_w2c": DOWN, "center": centre} for name, centre in posed}
    content = {"crs": "EPSG:32633", "K": K, "images": images} | changes
    (folder / "poses.json").write_text(json.dumps(content))
    return folder / "poses.json"


def test_json(tmp_path: Path) -> None:
    photos = read_poses(json_file(tmp_path, note="left aside", model="pinhole"), SIZES)
    assert photos.names == NAMES
    assert photos.crs == "EPSG:32633"
    np.testing.assert_array_equal(photos.poses.centres, CENTRES)
    np.testing.assert_array_equal(photos.cameras.matrices[0], K)
    np.testing.assert_array_equal(photos.cameras.distortion, np.zeros((2, 5)))
    assert photos.cameras.width.tolist() == [64, 64]
    some = read_poses(tmp_path / "poses.json", {"a.jpg": (64, 48)})
    assert (some.names, some.absent) == (("a.jpg",), ("sub/b.jpg",))


def test_an_image_goes_before_the_top_and_rounded_rotations_become_exact(tmp_path: Path) -> None:
    own = [[70.0, 0, 32], [0, 70.0, 24], [0, 0, 1]]
    rounded = {"R_w2c": TILTED.round(5).tolist(), "center": [1, 2, 3]}
    images = {
        "a.jpg": rounded | {"K": own, "distortion": [1, 2, 3, 4, 5]},
        "sub/b.jpg": {"R_w2c": DOWN, "center_utm": [1, 2, 3]},
    }
    path = json_file(tmp_path, images=images, dist_k1k2p1p2=[0.1, 0.2, 0.3, 0.4])
    photos = read_poses(path, SIZES)
    np.testing.assert_array_equal(photos.cameras.matrices, [own, K])
    lenses = [[1, 2, 3, 4, 5], [0.1, 0.2, 0.3, 0.4, 0]]
    np.testing.assert_array_equal(photos.cameras.distortion, lenses)
    rotation = photos.poses.rotation[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rotation, TILTED, atol=1e-5)


def colmap(folder: Path, model: str, params: tuple[float, ...], *, text: bool = False) -> Path:
    """Write a COLMAP model of the two photos."""
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model=model, width=64, height=48, params=list(params), camera_id=1)
    made.add_camera_with_trivial_rig(camera)
    for number, (name, centre) in enumerate(zip(NAMES, CENTRES, strict=True), start=1):
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(TILTED), -TILTED @ np.array(centre))
        image = pycolmap.Image(name=name, camera_id=1, image_id=number)
        made.add_image_with_trivial_frame(image, pose)
    folder.mkdir()
    (made.write_text if text else made.write_binary)(str(folder))
    return folder


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize(
    ("model", "params", "distortion"),
    [
        ("PINHOLE", (64, 65, 31, 25), (0, 0, 0, 0, 0)),
        ("SIMPLE_PINHOLE", (64, 31, 25), (0, 0, 0, 0, 0)),
        ("SIMPLE_RADIAL", (64, 31, 25, 0.1), (0.1, 0, 0, 0, 0)),
        ("RADIAL", (64, 31, 25, 0.1, 0.2), (0.1, 0.2, 0, 0, 0)),
        ("OPENCV", (64, 65, 31, 25, 0.1, 0.2, 0.3, 0.4), (0.1, 0.2, 0.3, 0.4, 0)),
    ],
)
def test_colmap(model, params, distortion, text, tmp_path) -> None:
    photos = read_poses(colmap(tmp_path / "model", model, params, text=text), SIZES)
    assert photos.names == NAMES
    assert not photos.crs
    np.testing.assert_allclose(photos.poses.centres, CENTRES, atol=1e-8)
    np.testing.assert_allclose(photos.poses.rotation, [TILTED, TILTED], atol=1e-12)
    fy = 65 if params[1] == 65 else 64
    np.testing.assert_array_equal(photos.cameras.matrices[1], [[64, 0, 31], [0, fy, 25], [0, 0, 1]])
    np.testing.assert_array_equal(photos.cameras.distortion[1], distortion)


# --- rotations from three angles; tests/geometry has those of a gimbal ---

# Right, down and forward of the camera, in east, north, up; worked by hand.
BY_HAND = [
    ("omega-phi-kappa", (0, 0, 0), DOWN),
    # Counter-clockwise by a quarter: right is north, the lower edge points east.
    ("omega-phi-kappa", (0, 0, 90), [(0, 1, 0), (1, 0, 0), (0, 0, -1)]),
    # Turned about east by a quarter, from nadir to the north.
    ("omega-phi-kappa", (90, 0, 0), [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
    # Turned about north by a quarter: from nadir to the west, the right side down.
    ("omega-phi-kappa", (0, 90, 0), [(0, 0, -1), (0, -1, 0), (-1, 0, 0)]),
    ("airframe", (0, 0, 0), DOWN),
    # The nose is east: so is the top of the photo.
    ("airframe", (90, 0, 0), [(0, -1, 0), (-1, 0, 0), (0, 0, -1)]),
    # The nose is up: the camera below looks ahead, north.
    ("airframe", (0, 90, 0), [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
    # The right wing is down: the camera below looks left, west.
    ("airframe", (0, 0, 90), [(0, 0, -1), (0, -1, 0), (-1, 0, 0)]),
    ("gimbal", (0, -90, 0), DOWN),
]
ANGLES = np.random.default_rng(5).uniform((-180, -85, -180), (180, 85, 180), (200, 3))


@pytest.mark.parametrize(("convention", "angles", "expected"), BY_HAND)
def test_angles_by_hand(convention: str, angles: tuple[int, ...], expected: Any) -> None:
    found = attitudes_to_rotations(convention, [angles], convergence_deg=0.0)[0]
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_angles_against_scipy_and_convergence_turns_all_conventions_alike() -> None:
    to_world = Rotation.from_euler("XYZ", ANGLES, degrees=True).as_matrix()
    body_to_ned = Rotation.from_euler("ZYX", ANGLES, degrees=True).as_matrix()
    ned_to_enu = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1)])
    # Columns: the camera's right, down and forward in nose, right wing, down.
    below, ahead = [(0, -1, 0), (1, 0, 0), (0, 0, 1)], [(0, 0, 1), (1, 0, 0), (0, 1, 0)]
    convergence = np.linspace(-3, 3, 200)
    turned = Rotation.from_euler("Z", convergence[:, None], degrees=True).as_matrix()
    cases: dict[Any, Any] = {
        "omega-phi-kappa": np.diag((1.0, -1.0, -1.0)) @ to_world.transpose(0, 2, 1),
        "airframe": (ned_to_enu @ body_to_ned @ np.array(below)).transpose(0, 2, 1),
        "gimbal": (ned_to_enu @ body_to_ned @ np.array(ahead)).transpose(0, 2, 1),
    }
    for convention, expected in cases.items():
        true = attitudes_to_rotations(convention, ANGLES, convergence_deg=0.0)
        np.testing.assert_allclose(true, expected, atol=1e-14)
        # The grid's north is clockwise of true north: on the grid all azimuths are smaller.
        found = attitudes_to_rotations(convention, ANGLES, convergence_deg=convergence)
        np.testing.assert_allclose(found, expected @ turned.transpose(0, 2, 1), atol=1e-14)

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    camera_to_world,
    check_rotations,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rays_to_world,
    rotation_angle_deg,
    rotations_to_angles,
    world_to_camera,
)

from .support import quick, seeds

S = np.sqrt(0.5)
UTM = np.array((576663.3303769418, 5188165.013024779, 197.1927941946574))


def rotations(seed: int, count: int = 8) -> np.ndarray:
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


def test_world_to_camera_worked_by_hand() -> None:
    # Nadir, north up, 100 m above (10, 20, 0): a point 3 m east, 4 m north of the foot lies
    # 3 m right, 4 m up the image (y is down), 100 m ahead.
    R = [[[1, 0, 0], [0, -1, 0], [0, 0, -1]]]
    poses = Poses.from_centres(R, [[10, 20, 100]])
    seen = world_to_camera(poses, np.array([[[13.0, 24.0, 0.0]]]))
    assert seen.tolist() == [[[3.0, -4.0, 100.0]]]
    # t = -R C = (-10, 20, 100).
    assert poses.translation.tolist() == [[-10.0, 20.0, 100.0]]
    assert rays_to_world(poses, np.array([[[0.0, 1.0, 0.0]]])).tolist() == [[[0, -1, 0]]]
    assert camera_to_world(poses, seen).tolist() == [[[13.0, 24.0, 0.0]]]


@quick
@given(seeds)
def test_frames_of_a_camera_close_at_utm_size(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = UTM + rng.uniform(-500, 500, (8, 3))
    poses = Poses.from_centres(rotations(seed), centres)
    assert np.array_equal(poses.centres, centres)
    points = UTM + rng.uniform(-500, 500, (8, 5, 3))
    back = camera_to_world(poses, world_to_camera(poses, points))
    np.testing.assert_allclose(back, points, rtol=0, atol=1e-8)
    # x_cam = R X + t, as defined.
    textbook = np.einsum("nij,nmj->nmi", poses.rotation, points) + poses.translation[:, None]
    np.testing.assert_allclose(world_to_camera(poses, points), textbook, rtol=0, atol=1e-7)
    # t ~ 5e6 m holds the centre to better than 1e-6 m.
    again = Poses.from_translations(poses.rotation, poses.translation)
    np.testing.assert_allclose(again.centres, centres, rtol=0, atol=1e-8)


@quick
@given(seeds)
def test_quaternions_agree_with_scipy(seed: int) -> None:
    R = rotations(seed, 16)
    wxyz = Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(quaternion_to_matrix(wxyz), R, atol=1e-14)
    np.testing.assert_allclose(matrix_to_quaternion(R), wxyz, atol=1e-14)


@quick
@given(seeds, st.one_of(st.floats(-11, 2.2), st.floats(-9, 0).map(lambda e: -100.0 + e)))
def test_angle_is_exact_near_0_and_near_180(seed: int, exponent: float) -> None:
    # From 1e-11 to 158 degrees, and from 1e-9 to 1 degree short of 180.
    angle = 10.0**exponent if exponent > -50 else 180.0 - 10.0 ** (exponent + 100.0)
    axis = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()[0]
    Ra = rotations(seed, 1)
    Rb = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix() @ Ra
    np.testing.assert_allclose(rotation_angle_deg(Ra, Rb), [angle], rtol=0, atol=1e-13)
    oracle = (Rotation.from_matrix(Ra) * Rotation.from_matrix(Rb).inv()).magnitude()
    np.testing.assert_allclose(rotation_angle_deg(Ra, Rb), np.degrees(oracle), rtol=0, atol=1e-12)


def test_rotations_are_made_exact() -> None:
    exact = rotations(1)
    np.testing.assert_allclose(check_rotations(exact), exact, atol=1e-15)
    np.testing.assert_allclose(check_rotations(np.round(exact, 6)), exact, atol=2e-6)
    four = check_rotations(np.round(rotations(0, 20_000), 4))
    assert np.abs(np.swapaxes(four, 1, 2) @ four - np.eye(3)).max() < 1e-14


def test_matrices_that_do_not_rotate() -> None:
    R = rotations(2, 6)
    scaled = R.copy()
    scaled[1:5] *= 1.01
    with pytest.raises(CameraError) as caught:
        check_rotations(scaled, names=list("abcdef"), where="poses.json")
    # |1.01^2 - 1| = 0.0201.
    assert "poses.json: rotation is not orthonormal in 4 of 6" in str(caught.value)
    assert "first 3: b (|R^T R - I| = 0.02), c" in str(caught.value)
    with pytest.raises(CameraError, match=r"reflection in 6 of 6 \(first 3: camera 0 \(det = -1\)"):
        check_rotations(R * (1.0, 1.0, -1.0))
    R[0, 0, 0] = np.nan
    with pytest.raises(CameraError, match="NaN"):
        check_rotations(R)
    with pytest.raises(CameraError, match="shape"):
        check_rotations(np.eye(3))
    # Just within and just beyond the tolerance of 2e-4.
    check_rotations(np.eye(3)[None] * np.sqrt(1 + 1.99e-4))
    with pytest.raises(CameraError):
        check_rotations(np.eye(3)[None] * np.sqrt(1 + 2.01e-4))


# Where the image's right, its down, and the line of sight point: east, north, up.
BY_HAND = {
    "nadir, north up": ((0, -90, 0), ((1, 0, 0), (0, -1, 0), (0, 0, -1))),
    "nadir, east up": ((90, -90, 0), ((0, -1, 0), (-1, 0, 0), (0, 0, -1))),
    "east at the horizon": ((90, 0, 0), ((0, -1, 0), (0, 0, -1), (1, 0, 0))),
    "south, 45 down": ((180, -45, 0), ((-1, 0, 0), (0, S, -S), (0, -S, -S))),
    "north, rolled clockwise": ((0, 0, 90), ((0, 0, -1), (-1, 0, 0), (0, 1, 0))),
    "north, upside down": ((0, 0, 180), ((-1, 0, 0), (0, 0, 1), (0, 1, 0))),
}

angles = st.floats(-180, 180)


@pytest.mark.parametrize(("gimbal", "rows"), BY_HAND.values(), ids=BY_HAND)
def test_worked_by_hand(gimbal: tuple[float, ...], rows: tuple[tuple[float, ...], ...]) -> None:
    found = angles_to_rotations(*gimbal, convergence_deg=0.0)
    np.testing.assert_allclose(found, rows, rtol=0, atol=1e-15)


def test_convergence_is_taken_from_yaw() -> None:
    # The grid's north lies 3 degrees east of true north, so what is 10 degrees east of true north
    # is 7 degrees east of the grid's.
    found = angles_to_rotations(10.0, 0.0, 0.0, convergence_deg=3.0)
    seven = np.radians(7.0)
    np.testing.assert_allclose(found[2], (np.sin(seven), np.cos(seven), 0.0), atol=1e-15)
    assert rotations_to_angles(found, convergence_deg=3.0)[0] == pytest.approx(10.0)


@quick
@given(angles, st.floats(-90, 90), angles)
def test_against_scipy(yaw: float, pitch: float, roll: float) -> None:
    to_ned = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()
    from_enu = np.array(((0, 1, 0), (1, 0, 0), (0, 0, -1)))
    to_camera = np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0)))  # forward-right-down, renamed
    expected = to_camera @ to_ned.T @ from_enu
    found = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


@quick
@given(st.floats(-180, 179.9), st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), angles)
def test_angles_come_back(yaw: float, pitch: float, roll: float, convergence: float) -> None:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=convergence)
    found = rotations_to_angles(rotation, convergence_deg=convergence)
    found[0] += 360.0 * round((yaw - found[0]) / 360.0)  # -180 and 180 are one
    np.testing.assert_allclose(found, (yaw, pitch, roll), rtol=0, atol=1e-9)

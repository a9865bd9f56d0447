from __future__ import annotations

from typing import Any

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
from airzoo_bench.geometry.precision import (
    COARSEST_M,
    pose_errors_m,
    rounding_errors,
    was_rounded_to,
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
    # Just within the tolerance of 2e-4.
    check_rotations(np.eye(3)[None] * np.sqrt(1 + 1.99e-4))


def test_rotations_beyond_the_tolerance_are_counted() -> None:
    """What else is refused is in tests/goldens/refusals.txt."""
    slips = np.sqrt(1 + 2.01e-4 * np.array([0, 1, 1, 1, 1, 0]))[:, None, None]
    with pytest.raises(CameraError, match=r"not orthonormal[\s\S]*4 of 6 \(first 3: b "):
        check_rotations(rotations(2, 6) * slips, names=list("abcdef"), where="poses.json")


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
@given(st.floats(-180, 179.9), st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), angles)
def test_angles_come_back(yaw: float, pitch: float, roll: float, convergence: float) -> None:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=convergence)
    found = rotations_to_angles(rotation, convergence_deg=convergence)
    found[0] += 360.0 * round((yaw - found[0]) / 360.0)  # -180 and 180 are one
    np.testing.assert_allclose(found, (yaw, pitch, roll), rtol=0, atol=1e-9)


# --- digits that were lost ---

COUNT = 200
ROTATIONS = Rotation.random(COUNT, random_state=7).as_matrix()
CENTRES = np.random.default_rng(7).normal((400_000.0, 3_130_000.0, 150.0), 300.0, (COUNT, 3))
TRUE = Poses(rotation=ROTATIONS, centres=CENTRES)
QUATERNIONS = matrix_to_quaternion(ROTATIONS)


def narrow(values: Any, kind: Any = np.float32) -> Any:
    return values.astype(kind).astype(np.float64)


def moved_m(rotations: Any, translations: Any) -> float:
    """Return how far cameras truly move, by SciPy's polar rotation and plain products."""
    exact = Rotation.from_matrix(rotations).as_matrix()
    centres = -np.einsum("nji,nj->ni", exact, translations)
    return float(np.sqrt(((centres - CENTRES) ** 2).sum(axis=1).mean()))


def expected_m(errors: Any) -> float:
    return float(np.sqrt((errors**2).mean()))


@pytest.mark.parametrize(
    ("quaternions", "digits", "about"),
    [(True, 4, 260.0), (True, 8, 0.026), (False, 5, 9.1), (False, 7, 0.091)],
)
def test_poses_of_few_digits(quaternions: bool, digits: int, about: float) -> None:
    rounded = np.round(QUATERNIONS if quaternions else ROTATIONS, digits)
    rotations = quaternion_to_matrix(rounded) if quaternions else rounded
    true = moved_m(rotations, TRUE.translation)
    assert true == pytest.approx(about, rel=0.2)
    errors = pose_errors_m(rotations, TRUE.translation, rounded if quaternions else None)
    assert expected_m(errors) == pytest.approx(true, rel=0.25)
    assert (errors > COARSEST_M).all()


@pytest.mark.parametrize("digits", [4, 7, None])
def test_quaternions_that_were_normalised_again(digits: Any) -> None:
    exact = matrix_to_quaternion(Rotation.random(300, random_state=25).as_matrix())
    rounded = exact if digits is None else np.round(exact, digits)
    unit = rounded / np.linalg.norm(rounded, axis=1, keepdims=True)
    matrices, t = quaternion_to_matrix(unit), TRUE.translation[:1]
    alone = [pose_errors_m(matrices[[i]], t, unit[[i]])[0] for i in range(len(unit))]
    # A turn by an angle moves a centre at the distance |t| by as much, except the part about t.
    turned = np.radians(rotation_angle_deg(matrices, quaternion_to_matrix(exact)))
    moved = expected_m(turned) * np.linalg.norm(t) * (2 / 3) ** 0.5
    assert np.count_nonzero(alone) == (0 if digits is None else len(unit))
    for errors in (alone, pose_errors_m(matrices, np.tile(t, (len(unit), 1)), None)):
        assert expected_m(np.array(errors)) == pytest.approx(moved, rel=0.2, abs=1e-5)


@pytest.mark.parametrize("as_quaternions", [False, True])
def test_turns_by_right_angles_do_not_hide_float32(as_quaternions: bool) -> None:
    # Methods that find a place only: north is up, the camera looks down.
    R = np.tile(np.diag((1.0, -1.0, -1.0)), (COUNT, 1, 1))
    t = narrow(-np.einsum("nij,nj->ni", R, CENTRES))
    errors = pose_errors_m(R, t, matrix_to_quaternion(R) if as_quaternions else None)
    assert expected_m(errors) == pytest.approx(moved_m(R, t), rel=0.2)
    assert (errors > COARSEST_M).all()


PIXELS = np.array([[1095.0, 26.0], [1116.0, 1381.0], [2050.0, 300.0], [3998.0, 7.0]])
LATTICES = [(np.arange(200.0) + at) * step for step in (0.25, 8.0) for at in (0.0, 0.5)]


@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_lattices_and_a_few_whole_pixels_are_not_a_rounding(kind: Any) -> None:
    for values in (PIXELS, *LATTICES):
        assert (narrow(values, kind) == values).all()
        assert not was_rounded_to(values, kind)
    random = np.random.default_rng(0)
    for _ in range(200):
        pixels = random.integers(0, (4000, 3000), (5, 2)).astype(np.float64)
        assert not was_rounded_to(pixels, kind)
        subpixels = random.random((30, 2)) * (4000, 3000)
        assert was_rounded_to(narrow(subpixels, kind), kind)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1.0, 1e4))
def test_any_rounding_is_found(seed: int, scale: float) -> None:
    values = np.random.default_rng(seed).random(600) * scale
    for kind in (np.float16, np.float32):
        rounded = narrow(values, kind)
        assert was_rounded_to(rounded, kind)
        true = np.sqrt(((rounded - values) ** 2).mean())
        assert np.sqrt((rounding_errors(rounded) ** 2).mean()) == pytest.approx(true, rel=0.6)
    assert not was_rounded_to(values, np.float32)
    assert not rounding_errors(values).any()

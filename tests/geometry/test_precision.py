"""Lost digits: the estimate beside how far cameras truly move, and numbers that lost none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import (
    Poses,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_angle_deg,
)
from airzoo_bench.geometry.precision import (
    COARSEST_M,
    pose_errors_m,
    rounding_errors,
    was_rounded_to,
)

COUNT = 200
ROTATIONS = Rotation.random(COUNT, random_state=7).as_matrix()
CENTRES = np.array((400_000.0, 3_130_000.0, 150.0)) + np.random.default_rng(7).normal(
    0, 300, (COUNT, 3)
)
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


def test_a_few_whole_pixels_are_not_a_rounding() -> None:
    pixels = np.array([[1095.0, 26.0], [1116.0, 1381.0], [2050.0, 300.0], [3998.0, 7.0]])
    assert (narrow(pixels, np.float16) == pixels).all()
    assert not was_rounded_to(pixels, np.float16)
    random = np.random.default_rng(0)
    for _ in range(200):
        pixels = random.integers(0, (4000, 3000), (5, 2)).astype(np.float64)
        assert not was_rounded_to(pixels, np.float16)
        subpixels = random.random((30, 2)) * (4000, 3000)
        assert was_rounded_to(narrow(subpixels, np.float16), np.float16)


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


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("step", [0.25, 8.0])
@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_a_lattice_is_not_a_rounding(kind: Any, step: float, offset: float) -> None:
    lattice = (np.arange(200.0) + offset) * step
    assert (narrow(lattice, kind) == lattice).all()
    assert not was_rounded_to(lattice, kind)

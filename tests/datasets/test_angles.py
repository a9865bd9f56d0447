"""Angles of tables against rotations worked by hand and those of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.cameras import attitudes_to_rotations

NADIR = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)]
# Right, down and forward of the camera, in east, north, up; worked by hand.
BY_HAND = [
    ("omega-phi-kappa", (0, 0, 0), NADIR),
    # Counter-clockwise by a quarter: right is north, the lower edge points east.
    ("omega-phi-kappa", (0, 0, 90), [(0, 1, 0), (1, 0, 0), (0, 0, -1)]),
    # Turned about east by a quarter, from nadir to the north.
    ("omega-phi-kappa", (90, 0, 0), [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
    # Turned about north by a quarter: from nadir to the west, the right side down.
    ("omega-phi-kappa", (0, 90, 0), [(0, 0, -1), (0, -1, 0), (-1, 0, 0)]),
    ("airframe", (0, 0, 0), NADIR),
    # The nose is east: so is the top of the photo.
    ("airframe", (90, 0, 0), [(0, -1, 0), (-1, 0, 0), (0, 0, -1)]),
    # The nose is up: the camera below looks ahead, north.
    ("airframe", (0, 90, 0), [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
    # The right wing is down: the camera below looks left, west.
    ("airframe", (0, 0, 90), [(0, 0, -1), (0, -1, 0), (-1, 0, 0)]),
    ("gimbal", (0, -90, 0), NADIR),
    ("gimbal", (0, 0, 0), [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
]


@pytest.mark.parametrize(("convention", "angles", "expected"), BY_HAND)
def test_angles_by_hand(convention, angles, expected):
    found = attitudes_to_rotations(convention, [angles], convergence_deg=0.0)[0]

    np.testing.assert_allclose(found, expected, atol=1e-15)


def random_angles(count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform((-180, -85, -180), (180, 85, 180), (count, 3))


def test_omega_phi_kappa_against_scipy():
    angles = random_angles(200)
    to_world = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    expected = np.diag((1.0, -1.0, -1.0)) @ to_world.transpose(0, 2, 1)

    found = attitudes_to_rotations("omega-phi-kappa", angles, convergence_deg=0.0)

    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize(
    ("convention", "camera_to_body"),
    [
        # Columns: the camera's right, down and forward in nose, right wing, down.
        ("gimbal", [(0, 0, 1), (1, 0, 0), (0, 1, 0)]),
        ("airframe", [(0, -1, 0), (1, 0, 0), (0, 0, 1)]),
    ],
)
def test_yaw_pitch_roll_against_scipy(convention, camera_to_body):
    angles = random_angles(200)
    body_to_ned = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    ned_to_enu = np.array([(0, 1, 0), (1, 0, 0), (0, 0, -1)])
    expected = (ned_to_enu @ body_to_ned @ np.array(camera_to_body)).transpose(0, 2, 1)

    found = attitudes_to_rotations(convention, angles, convergence_deg=0.0)

    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("convention", ["gimbal", "airframe", "omega-phi-kappa"])
def test_convergence_turns_all_conventions_alike(convention):
    angles, convergence = random_angles(50), np.linspace(-3, 3, 50)
    turned = Rotation.from_euler("Z", convergence[:, None], degrees=True).as_matrix()
    true = attitudes_to_rotations(convention, angles, convergence_deg=0.0)

    found = attitudes_to_rotations(convention, angles, convergence_deg=convergence)

    # The grid's north is clockwise of true north: on the grid all azimuths are smaller.
    np.testing.assert_allclose(found, true @ turned.transpose(0, 2, 1), atol=1e-14)

"""Rotations from three angles, in the conventions that tables of poses use.

``gimbal``
    DJI's yaw, pitch, roll of the camera; pitch -90 is nadir (see `geometry.poses`).
``airframe``
    Yaw, pitch, roll of the body, z-y-x in north-east-down, with the camera fixed below it: at 0, 0,
    0 it looks straight down and the top of the photo is north. Metashape and Pix4D write these.
``omega-phi-kappa``
    R = Rx(omega) Ry(phi) Rz(kappa) takes photogrammetric camera axes (x right, y up, z backward) to
    the grid (x east, y north, z up). At 0, 0, 0 the camera looks straight down with north up, and
    kappa turns it counter-clockwise. R is the transpose of M = M(kappa) M(phi) M(omega) in Wolf,
    Dewitt and Wilkinson, Elements of Photogrammetry, 4th edition, 2014, appendix C.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import angles_to_rotations

Convention = Literal["gimbal", "airframe", "omega-phi-kappa"]

# Rows of a camera that looks ahead, to those of one fixed below the same body: its right stays, its
# down is the body's tail, its forward the body's down.
_BELOW = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])


def attitudes_to_rotations(
    convention: Convention, angles_deg: ArrayLike, *, convergence_deg: ArrayLike
) -> Floats:
    """Turn angles (..., 3) into world-to-camera rotations (..., 3, 3)."""
    first, second, third = np.moveaxis(np.asarray(angles_deg, dtype=np.float64), -1, 0)
    if convention == "omega-phi-kappa":
        return _photogrammetric(first, second, third) @ grid_to_true_north(convergence_deg)
    ahead = angles_to_rotations(first, second, third, convergence_deg=convergence_deg)
    return ahead if convention == "gimbal" else _BELOW @ ahead


def _photogrammetric(omega_deg: Floats, phi_deg: Floats, kappa_deg: Floats) -> Floats:
    angles = (np.radians(angle) for angle in (omega_deg, phi_deg, kappa_deg))
    (so, co), (sp, cp), (sk, ck) = ((np.sin(a), np.cos(a)) for a in angles)
    right = (cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck)
    up = (-cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk)
    backward = (sp, -so * cp, co * cp)
    down, forward = (tuple(-part for part in axis) for axis in (up, backward))
    return np.moveaxis(np.array((right, down, forward)), (0, 1), (-2, -1))


def grid_to_true_north(convergence_deg: ArrayLike) -> Floats:
    """Return the turn from the grid's axes to true east and north, (..., 3, 3)."""
    turn = np.radians(np.asarray(convergence_deg, dtype=np.float64))
    sine, cosine, zero = np.sin(turn), np.cos(turn), np.zeros_like(turn)
    rows = ((cosine, sine, zero), (-sine, cosine, zero), (zero, zero, np.ones_like(turn)))
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

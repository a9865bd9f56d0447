"""Camera rotations: checked, compared, from quaternions w x y z and gimbal angles, and back.

The angles are DJI's: yaw, then pitch, then roll turn a camera that looks north at the horizon about
its own axes down, right and forward (z-y-x in north-east-down). Yaw 0 is true north, clockwise
positive; pitch 0 is the horizon, -90 nadir; roll is clockwise, as seen by the camera.
The world is a projected CRS: x east, y north on its grid, z up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats, multiply, refuse_cameras, transposed

__all__ = [
    "angles_to_rotations",
    "check_rotations",
    "matrix_to_quaternion",
    "quaternion_to_matrix",
    "rotation_angle_deg",
    "rotations_to_angles",
    "unit_quaternion_to_matrix",
]

_QUATERNION_TOLERANCE = 1e-3
# Within this (rad) of straight down or up yaw and roll turn about one axis: with rounding at 1e-16
# they could not be told apart to better than 1e-8.
_LOCKED = 1e-8
_ROTATION_TOLERANCE = 2e-4  # entries of four decimals are off by up to 1.7e-4
# From within the tolerance the error goes 2e-4, 3e-8, 7e-16: the third step only tidies up.
_NEWTON_STEPS = 3


def quaternion_to_matrix(wxyz: ArrayLike, names: Sequence[object] | None = None) -> Floats:
    """Turn quaternions into rotation matrices.

    Parameters
    ----------
    wxyz : (N, 4) array
        w x y z, of unit norm to 1e-3 (what rounding in a file may do); normalised here.
    names : sequence of N, optional
        Names of the cameras for messages.

    Returns
    -------
    (N, 3, 3) array
        Rotations, orthonormal to rounding.

    Raises
    ------
    CameraError
        Another shape, or norms that are not 1 (or not finite).
    """
    quaternions = np.asarray(wxyz, dtype=np.float64)
    if quaternions.ndim != 2 or quaternions.shape[1] != 4:
        raise CameraError(f"quaternions have shape {quaternions.shape}", expected="shape (N, 4)")
    with np.errstate(over="ignore"):  # an infinite norm is not 1
        norm = np.sqrt((quaternions * quaternions).sum(axis=1))
    refuse_cameras(
        ~(np.abs(norm - 1.0) <= _QUATERNION_TOLERANCE),
        "quaternion is not of unit norm",
        names=names,
        details=[f"norm = {value:.6g}" for value in norm],
        expected=f"w x y z with norm 1 to {_QUATERNION_TOLERANCE:g}",
    )
    return unit_quaternion_to_matrix(quaternions / norm[:, None])


def unit_quaternion_to_matrix(wxyz: Floats) -> Floats:
    """Turn quaternions (N, 4) w x y z of exactly unit norm into rotation matrices (N, 3, 3).

    Parameters
    ----------
    wxyz : (N, 4) array
        Of exactly unit norm.

    Returns
    -------
    (N, 3, 3) array
        Orthonormal to rounding.
    """
    w, x, y, z = wxyz.T
    entries = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(entries), -1, 0)


def matrix_to_quaternion(R: ArrayLike) -> Floats:
    """Turn rotation matrices (N, 3, 3) into unit quaternions (N, 4) w x y z with w >= 0.

    Of the four rows of 4 q q^T (Shepperd 1978) the one with the largest diagonal is taken, which
    never divides by a small number.

    Parameters
    ----------
    R : (N, 3, 3) array
        Exact rotations.

    Returns
    -------
    (N, 4) array
        w x y z, of unit norm.
    """
    m = np.moveaxis(np.asarray(R, dtype=np.float64), 0, -1)
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    ww = 1.0 + m[0, 0] + m[1, 1] + m[2, 2]
    xx = 1.0 + m[0, 0] - m[1, 1] - m[2, 2]
    yy = 1.0 - m[0, 0] + m[1, 1] - m[2, 2]
    zz = 1.0 - m[0, 0] - m[1, 1] + m[2, 2]
    outer = np.array(((ww, wx, wy, wz), (wx, xx, xy, xz), (wy, xy, yy, yz), (wz, xz, yz, zz)))
    largest = np.argmax(np.array((ww, xx, yy, zz)), axis=0)
    row = outer[largest, :, np.arange(len(largest))]
    row = np.where(row[:, :1] < 0.0, -row, row)
    unit: Floats = row / np.sqrt((row * row).sum(axis=1, keepdims=True))
    return unit


def angles_to_rotations(
    yaw_deg: ArrayLike, pitch_deg: ArrayLike, roll_deg: ArrayLike, *, convergence_deg: ArrayLike
) -> Floats:
    """Turn gimbal angles into world-to-camera rotations.

    Parameters
    ----------
    yaw_deg, pitch_deg, roll_deg : (...) array or scalar
        Degrees; all four broadcast.
    convergence_deg : (...) array or scalar
        See `units.grid_convergence_deg`; 0 where yaw is already relative to the grid's north.

    Returns
    -------
    (..., 3, 3) array
        OpenCV axes: the rows are the camera's right, down and forward in the world.
    """
    given = (np.asarray(yaw_deg) - np.asarray(convergence_deg), pitch_deg, roll_deg)
    yaw, pitch, roll = np.broadcast_arrays(*(np.radians(np.asarray(a, float)) for a in given))
    (sy, cy), (sp, cp), (sr, cr) = ((np.sin(a), np.cos(a)) for a in (yaw, pitch, roll))
    forward = (cp * sy, cp * cy, sp)
    right = (sr * sp * sy + cr * cy, sr * sp * cy - cr * sy, -sr * cp)
    down = (cr * sp * sy - sr * cy, cr * sp * cy + sr * sy, -cr * cp)
    return np.moveaxis(np.array((right, down, forward)), (0, 1), (-2, -1))


def rotations_to_angles(R: ArrayLike, *, convergence_deg: ArrayLike) -> Floats:
    """Turn world-to-camera rotations into gimbal angles; the inverse of `angles_to_rotations`.

    Parameters
    ----------
    R : (..., 3, 3) array
        World-to-camera, OpenCV axes, the world in projected coordinates with z up.
    convergence_deg : (...) array or scalar
        See `units.grid_convergence_deg`.

    Returns
    -------
    (..., 3) array
        Yaw in [-180, 180), pitch in [-90, 90], roll in [-180, 180], in degrees. Looking straight
        down or up, roll is 0 and yaw takes the whole turn.
    """
    rotation = np.asarray(R, dtype=np.float64)
    right, down, forward = (rotation[..., row, :] for row in range(3))
    level = np.hypot(forward[..., 0], forward[..., 1])
    locked = level < _LOCKED
    pitch = np.arctan2(forward[..., 2], level)
    roll = np.where(locked, 0.0, np.arctan2(-right[..., 2], -down[..., 2]))
    free = np.arctan2(forward[..., 0], forward[..., 1])
    yaw = np.where(locked, np.arctan2(-right[..., 1], right[..., 0]), free)
    grid = np.degrees(yaw) + np.asarray(convergence_deg, dtype=np.float64)
    around = (grid + 180.0) % 360.0 - 180.0
    return np.stack(np.broadcast_arrays(around, np.degrees(pitch), np.degrees(roll)), axis=-1)


def check_rotations(
    R: ArrayLike, names: Sequence[object] | None = None, where: object = None
) -> Floats:
    """Refuse matrices that do not rotate, and return the nearest exact rotations.

    Parameters
    ----------
    R : (N, 3, 3) array
        World-to-camera, or any other rotations.
    names : sequence of N, optional
        Names of the cameras for messages.
    where : object, optional
        The file the rotations are from.

    Returns
    -------
    (N, 3, 3) array
        The nearest orthonormal matrices (Frobenius), the polar factors, so that digits rounded
        away in a file do not scale or shear the geometry. Found by Newton-Schulz steps
        R (3 I - R^T R) / 2 (Higham, Functions of Matrices, 2008, equation 8.20), written out, since
        LAPACK's rounding depends on the processor.

    Raises
    ------
    CameraError
        Another shape, entries not finite, |R^T R - I| above 2e-4 in any entry, or a reflection
        (det < 0). The first three cameras are named with how far they are off.
    """
    matrices = np.asarray(R, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3):
        raise CameraError(
            f"rotations have shape {matrices.shape}", where=where, expected="shape (N, 3, 3)"
        )
    not_finite = ~np.isfinite(matrices).all(axis=(1, 2))
    refuse_cameras(not_finite, "rotation has NaN or infinite entries", names=names, where=where)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(multiply(transposed(matrices), matrices) - np.eye(3)).max(axis=(1, 2))
    refuse_cameras(
        ~(off <= _ROTATION_TOLERANCE),
        "rotation is not orthonormal",
        names=names,
        details=[f"|R^T R - I| = {value:.2g}" for value in off],
        where=where,
        expected=f"|R^T R - I| <= {_ROTATION_TOLERANCE:g} in every entry",
    )
    determinant = np.linalg.det(matrices)
    refuse_cameras(
        determinant < 0.0,
        "rotation is a reflection",
        names=names,
        details=[f"det = {value:.3g}" for value in determinant],
        where=where,
        expected="det = +1",
        fix="check the axes: exactly one of them points the wrong way",
    )
    for _ in range(_NEWTON_STEPS):
        matrices = (
            multiply(matrices, 3.0 * np.eye(3) - multiply(transposed(matrices), matrices)) / 2.0
        )
    return matrices


def rotation_angle_deg(Ra: ArrayLike, Rb: ArrayLike) -> Floats:
    """Geodesic angle between rotations, in degrees.

    atan2 of sine (the skew part of Ra Rb^T) and cosine (its trace): unlike arccos of the trace, it
    keeps all digits near 0 and near 180 degrees.

    Parameters
    ----------
    Ra, Rb : (..., 3, 3) array
        Rotations; leading dimensions broadcast.

    Returns
    -------
    (...) array
        0 to 180; NaN where a rotation is NaN.
    """
    inverse = transposed(np.asarray(Rb, dtype=np.float64))
    relative = multiply(np.asarray(Ra, dtype=np.float64), inverse)
    skew = relative - transposed(relative)
    x, y, z = skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = np.trace(relative, axis1=-2, axis2=-1) - 1.0
    return np.asarray(np.degrees(np.arctan2(sine, cosine)), dtype=np.float64)

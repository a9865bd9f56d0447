"""Rotations as quaternions w x y z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats, refuse_cameras

__all__ = ["matrix_to_quaternion", "quaternion_to_matrix", "unit_quaternion_to_matrix"]

_QUATERNION_TOLERANCE = 1e-3


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

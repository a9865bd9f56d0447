"""Camera rotations from gimbal angles, and back.

The angles are DJI's: yaw, then pitch, then roll turn a camera that looks north at the horizon about
its own axes down, right and forward (z-y-x in north-east-down). Yaw 0 is true north, clockwise
positive; pitch 0 is the horizon, -90 nadir; roll is clockwise, as seen by the camera.
The world is a projected CRS: x east, y north on its grid, z up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import from_lonlat, horizontal_crs

__all__ = ["angles_to_rotations", "grid_convergence_deg", "rotations_to_angles"]

# Half the length of meridian whose direction is measured, some 11 m: the curvature of the meridian
# on the grid and the last digits of millions of metres then both stay below 1e-8 degrees.
_STEP_DEG = 1e-4

# Within this (rad) of straight down or up yaw and roll turn about one axis: with rounding at 1e-16
# they could not be told apart to better than 1e-8.
_LOCKED = 1e-8


def grid_convergence_deg(crs: Any, lonlat: ArrayLike) -> Floats:
    """Angle from true north to the grid's north, clockwise positive.

    An azimuth on the grid is the true azimuth less the convergence.

    Parameters
    ----------
    crs : Any
        A projected CRS, see `frames.horizontal_crs`.
    lonlat : (..., 2) array
        WGS84 longitude, latitude in degrees.

    Returns
    -------
    (...) array
        Degrees in (-180, 180]; NaN where `lonlat` is NaN or beyond the projection.

    Raises
    ------
    CameraError
        The CRS is not projected.
    UserError
        See `frames.horizontal_crs`.
    """
    plane = horizontal_crs(crs)
    if not plane.is_projected:
        raise CameraError(
            f"{plane.name} has no grid to turn camera poses to",
            expected="a projected CRS in metres",
        )
    place = np.asarray(lonlat, dtype=np.float64)
    south, north = place.copy(), place.copy()
    south[..., 1] = np.maximum(place[..., 1] - _STEP_DEG, -90.0)
    north[..., 1] = np.minimum(place[..., 1] + _STEP_DEG, 90.0)
    x, y = np.moveaxis(from_lonlat(plane, north) - from_lonlat(plane, south), -1, 0)
    return np.asarray(-np.degrees(np.arctan2(x, y)), dtype=np.float64)


def angles_to_rotations(
    yaw_deg: ArrayLike, pitch_deg: ArrayLike, roll_deg: ArrayLike, *, convergence_deg: ArrayLike
) -> Floats:
    """Turn gimbal angles into world-to-camera rotations.

    Parameters
    ----------
    yaw_deg, pitch_deg, roll_deg : (...) array or scalar
        Degrees; they broadcast.
    convergence_deg : (...) array or scalar
        See `grid_convergence_deg`; 0 where yaw is already relative to the grid's north.

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
        See `grid_convergence_deg`.

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

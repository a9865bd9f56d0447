"""Flights: a camera's positions and gimbal angles over time, and its poses in a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats, refuse_cameras
from airzoo_bench.geometry.attitude import (
    angles_to_rotations,
    grid_convergence_deg,
    rotations_to_angles,
)
from airzoo_bench.geometry.frames import from_lonlat, to_lonlat
from airzoo_bench.geometry.poses import Poses

__all__ = [
    "Trajectory",
    "poses_trajectory",
    "rounded",
    "trajectory_poses",
]

# Digits kept: 0.1 mm on the ground, 0.1 mm of height, 1e-4 degrees, a microsecond.
_LONLAT_DECIMALS = 9
_DECIMALS = 4
_TIME_DECIMALS = 6


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N frames of a flight.

    Angles are as in `geometry.attitude`: pitch 0 is the horizon, -90 nadir; yaw is from true north,
    clockwise positive.

    Attributes
    ----------
    names : tuple of N str
        Each once; they become names of files.
    time_s : (N,) float64
        Ascending.
    lonlat : (N, 2) float64
        WGS84 longitude, latitude in degrees.
    altitude_m : (N,) float64
        Above the WGS84 ellipsoid.
    roll_deg, pitch_deg, yaw_deg : (N,) float64
    weather, time_of_day : tuple of N str, optional
        See `weather.conditions`; None where the flight does not say.

    Raises
    ------
    CameraError
        When the fields differ in length.
    """

    names: tuple[str, ...]
    time_s: Floats
    lonlat: Floats
    altitude_m: Floats
    roll_deg: Floats
    pitch_deg: Floats
    yaw_deg: Floats
    weather: tuple[str, ...] | None = None
    time_of_day: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        count = len(self.names)
        numbers = (self.time_s, self.altitude_m, self.roll_deg, self.pitch_deg, self.yaw_deg)
        texts = [text for text in (self.weather, self.time_of_day) if text is not None]
        shapes = [*(array.shape for array in numbers), *((len(text),) for text in texts)]
        if set(shapes) != {(count,)} or self.lonlat.shape != (count, 2):
            raise CameraError(f"a trajectory of {count} names has other fields of another length")

    def __len__(self) -> int:
        return len(self.names)

    def take(self, index: Any) -> Trajectory:
        """Return the frames at an integer, index array, mask or slice, as a Trajectory."""
        rows = np.atleast_1d(np.arange(len(self))[index])
        return Trajectory(
            names=_taken(self.names, rows) or (),
            time_s=self.time_s[rows],
            lonlat=self.lonlat[rows],
            altitude_m=self.altitude_m[rows],
            roll_deg=self.roll_deg[rows],
            pitch_deg=self.pitch_deg[rows],
            yaw_deg=self.yaw_deg[rows],
            weather=_taken(self.weather, rows),
            time_of_day=_taken(self.time_of_day, rows),
        )


def rounded(trajectory: Trajectory) -> Trajectory:
    """Return the flight with as many digits as its file has: what writing and reading gives.

    Degrees of position to 1e-9, metres and degrees of angles to 1e-4, seconds to 1e-6.
    """
    return replace(
        trajectory,
        time_s=_round(trajectory.time_s, _TIME_DECIMALS),
        lonlat=_round(trajectory.lonlat, _LONLAT_DECIMALS),
        altitude_m=_round(trajectory.altitude_m, _DECIMALS),
        roll_deg=_round(trajectory.roll_deg, _DECIMALS),
        pitch_deg=_round(trajectory.pitch_deg, _DECIMALS),
        yaw_deg=_round(trajectory.yaw_deg, _DECIMALS),
    )


def trajectory_poses(trajectory: Trajectory, crs: Any) -> Poses:
    """Turn a flight into poses.

    Parameters
    ----------
    trajectory : Trajectory
        N frames.
    crs : Any
        Projected CRS in metres; see `frames.horizontal_crs`.

    Returns
    -------
    Poses
        Of N cameras; heights are the flight's altitudes.

    Raises
    ------
    CameraError
        The CRS is not projected, or a position is beyond it; the first three are named.
    """
    xy = from_lonlat(crs, trajectory.lonlat)
    refuse_cameras(
        ~np.isfinite(xy).all(axis=-1),
        "the position has no place in the CRS",
        names=trajectory.names,
        mend="check longitude and latitude, or choose another CRS",
    )
    rotation = angles_to_rotations(
        trajectory.yaw_deg,
        trajectory.pitch_deg,
        trajectory.roll_deg,
        convergence_deg=grid_convergence_deg(crs, trajectory.lonlat),
    )
    centres = np.concatenate((xy, trajectory.altitude_m[:, None]), axis=-1)
    return Poses.from_centres(rotation, centres, trajectory.names)


def poses_trajectory(poses: Poses, crs: Any, names: Sequence[str], time_s: ArrayLike) -> Trajectory:
    """Turn poses into a flight; the inverse of `trajectory_poses`.

    Parameters
    ----------
    poses : Poses
        Of N cameras, in `crs`.
    crs : Any
        Projected CRS in metres.
    names : sequence of N str
    time_s : (N,) array

    Returns
    -------
    Trajectory
        Without weather; yaw in [-180, 180). Straight down, roll is 0 and yaw takes the whole turn.

    Raises
    ------
    CameraError
        The CRS is not projected, or names and times are not N.
    """
    lonlat = to_lonlat(crs, poses.centres[:, :2])
    convergence = grid_convergence_deg(crs, lonlat)
    yaw, pitch, roll = rotations_to_angles(poses.rotation, convergence_deg=convergence).T
    times = np.asarray(time_s, dtype=np.float64)
    return Trajectory(tuple(names), times, lonlat, poses.centres[:, 2], roll, pitch, yaw)


def _taken(texts: tuple[str, ...] | None, rows: Any) -> tuple[str, ...] | None:
    return None if texts is None else tuple(texts[row] for row in rows.tolist())


def _round(values: Floats, decimals: int) -> Floats:
    # -0.0 would be written with its sign.
    whole: Floats = np.round(values, decimals) + 0.0
    return whole

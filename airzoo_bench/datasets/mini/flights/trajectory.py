"""Flights: a camera's positions and gimbal angles over time, and its poses in a grid."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError
from airzoo_bench.datasets.mini.world.model import CRS, Region
from airzoo_bench.geometry.arrays import Floats, refuse_cameras
from airzoo_bench.geometry.frames import from_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import angles_to_rotations
from airzoo_bench.geometry.units import grid_convergence_deg

__all__ = [
    "MARGIN_M",
    "Airspace",
    "Trajectory",
    "rounded",
    "trajectory_poses",
]

# Digits kept: 0.1 mm on the ground and of height, 1e-4 degrees, a microsecond.
_DECIMALS = {"altitude_m": 4, "roll_deg": 4, "pitch_deg": 4, "yaw_deg": 4, "time_s": 6, "lonlat": 9}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N frames of a flight.

    Angles are as in `geometry.attitude`: pitch 0 is the horizon, -90 nadir; yaw is from true north,
    clockwise positive.


    Raises
    ------
    CameraError
        When the fields differ in length.
    """

    names: tuple[str, ...]  # each once; they become names of files
    time_s: Floats  # (N,): ascending
    lonlat: Floats  # (N, 2): WGS84 longitude, latitude in degrees
    altitude_m: Floats  # (N,): above the WGS84 ellipsoid
    roll_deg: Floats  # (N,)
    pitch_deg: Floats  # (N,)
    yaw_deg: Floats  # (N,)

    def __post_init__(self) -> None:
        count = len(self.names)
        shapes = {np.shape(value) for value in vars(self).values() if value is not self.lonlat}
        if shapes != {(count,)} or self.lonlat.shape != (count, 2):
            raise CameraError(f"a trajectory of {count} names has other fields of another length")

    def __len__(self) -> int:
        return len(self.names)

    def take(self, index: Any) -> Trajectory:
        """Return the frames at an integer, index array, mask or slice, as a Trajectory."""
        rows = np.atleast_1d(np.arange(len(self))[index])

        def taken(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(value[row] for row in rows.tolist())
            return value[rows]

        return Trajectory(*(taken(getattr(self, field.name)) for field in fields(self)))


def rounded(trajectory: Trajectory) -> Trajectory:
    """Return the flight with as many digits as matter on the ground."""
    # -0.0 becomes 0.0.
    digits: dict[str, Any] = {
        name: np.round(getattr(trajectory, name), decimals) + 0.0
        for name, decimals in _DECIMALS.items()
    }
    return replace(trajectory, **digits)


def trajectory_poses(trajectory: Trajectory) -> Poses:
    """Turn a flight of N frames into N poses in `CRS`; heights are the flight's altitudes."""
    xy = from_lonlat(CRS, trajectory.lonlat)
    refuse_cameras(
        ~np.isfinite(xy).all(axis=-1),
        "the position has no place in the CRS",
        names=trajectory.names,
        fix="check longitude and latitude",
    )
    rotation = angles_to_rotations(
        trajectory.yaw_deg,
        trajectory.pitch_deg,
        trajectory.roll_deg,
        convergence_deg=grid_convergence_deg(CRS, trajectory.lonlat),
    )
    centres = np.concatenate((xy, trajectory.altitude_m[:, None]), axis=-1)
    return Poses.from_centres(rotation, centres, trajectory.names)


MARGIN_M = 40.0
"""Flights that are made here go no nearer to the region's border."""

_CLEARANCE_M, _ROOM_M = 40.0, 80.0


@dataclass(frozen=True)
class Airspace:
    """Where flights are made."""

    region: Region
    ground_m: float  # height of the ground, for what a camera sees
    floor_m: float  # lowest altitude of flights
    ceiling_m: float  # highest altitude of flights

    @classmethod
    def over(cls, region: Region, dsm: NDArray[np.float32]) -> Airspace:
        """Return the airspace above the highest place of a surface model; its median is ground."""
        floor = float(np.nanmax(dsm)) + _CLEARANCE_M
        return cls(region, float(np.nanmedian(dsm)), floor, floor + _ROOM_M)

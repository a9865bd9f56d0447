"""Flights: a camera's positions and gimbal angles over time, and its poses in a grid."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine

from airzoo_bench.core.errors import CameraError
from airzoo_bench.datasets.mini.world.model import CRS, Region
from airzoo_bench.geometry.arrays import Bools, Floats, refuse_cameras
from airzoo_bench.geometry.frames import from_lonlat, to_lonlat
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import angles_to_rotations
from airzoo_bench.geometry.units import grid_convergence_deg

__all__ = [
    "MARGIN_M",
    "Airspace",
    "Trajectory",
    "allowed_box",
    "check_inside",
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
    # see `weather.conditions`; None where the flight does not say
    weather: tuple[str, ...] | None = None
    time_of_day: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        count = len(self.names)
        given = [value for value in vars(self).values() if value is not None]
        shapes = {np.shape(value) for value in given if value is not self.lonlat}
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
            return None if value is None else value[rows]

        return Trajectory(*(taken(getattr(self, field.name)) for field in fields(self)))


def rounded(trajectory: Trajectory) -> Trajectory:
    """Return the flight with as many digits as its file has: what writing and reading gives.

    Degrees of position to 1e-9, metres and degrees of angles to 1e-4, seconds to 1e-6.
    """
    # -0.0 would be written with its sign.
    digits: dict[str, Any] = {
        name: np.round(getattr(trajectory, name), decimals) + 0.0
        for name, decimals in _DECIMALS.items()
    }
    return replace(trajectory, **digits)


def trajectory_poses(trajectory: Trajectory) -> Poses:
    """Turn a flight of N frames into N poses in `CRS`; heights are the flight's altitudes.

    A position that has no place in the CRS is refused.
    """
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
_ABOVE_SURFACE_M = 2.0
_BOX_DECIMALS = 6


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


def allowed_box(region: Region) -> tuple[float, float, float, float]:
    """West, south, east and north in WGS84 of a box, all of which lies in the region.

    The region is a square of the grid, which is turned against true north: the box is cut to what
    lies within whatever the latitude, to digits that people read.
    """
    ends = np.array((0.0, region.side_m))
    corners = np.stack(np.meshgrid(region.west + ends, region.south + ends), axis=-1)
    lon, lat = np.moveaxis(to_lonlat(CRS, corners), -1, 0)
    unit = 10.0**_BOX_DECIMALS
    west, south = (np.ceil(v * unit) / unit for v in (lon[:, 0].max(), lat[0].max()))
    east, north = (np.floor(v * unit) / unit for v in (lon[:, 1].min(), lat[1].min()))
    return float(west), float(south), float(east), float(north)


def check_inside(
    trajectory: Trajectory, region: Region, dsm: NDArray[np.float32], where: object = None
) -> None:
    """Refuse a flight that leaves the region, or goes below its surface model (H, W).

    `where` is the file the flight is from, for messages.

    Raises
    ------
    CameraError
        Positions outside the region, or lower than 2 m above the ground, roof or tree there;
        the first three are named. Every camera looking up, which a wrong sign of pitch makes.
    """
    xy = from_lonlat(CRS, trajectory.lonlat)
    outside = ~_inside(region, xy)
    swapped = _inside(region, from_lonlat(CRS, trajectory.lonlat[:, ::-1]))
    west, south, east, north = allowed_box(region)
    refuse_cameras(
        outside,
        f"outside the region {region.name}",
        names=trajectory.names,
        details=[f"{lon:.6f}, {lat:.6f}" for lon, lat in trajectory.lonlat],
        where=where,
        expected=f"longitude {west:.6f} to {east:.6f}, latitude {south:.6f} to {north:.6f}",
        fix="longitude and latitude look swapped: exchange them"
        if swapped[outside].all()
        else "move the flight into the region",
    )
    pixel = region.side_m / dsm.shape[1]
    place = Affine(pixel, 0.0, region.west, 0.0, -pixel, region.north)
    ground = HeightField(dsm, place, CRS).sample(xy)
    altitudes = trajectory.altitude_m
    refuse_cameras(
        # Where the surface has no height, nothing can be said against the flight.
        altitudes < ground + _ABOVE_SURFACE_M,
        "below the ground or inside a building or tree",
        names=trajectory.names,
        details=[
            f"at {altitude:.1f} m, surface {height:.1f} m"
            for altitude, height in zip(altitudes, ground, strict=True)
        ],
        where=where,
        expected=f"at least {_ABOVE_SURFACE_M:g} m above the surface",
        fix="fly higher; altitude is above the WGS84 ellipsoid, as the surface's heights are",
    )
    if (trajectory.pitch_deg > 0.0).all():
        raise CameraError(
            "every frame looks above the horizon",
            where=where,
            expected="pitch 0 at the horizon, -90 straight down",
            fix="change the sign of pitch",
        )


def _inside(region: Region, xy: Floats) -> Bools:
    steps = xy - (region.west, region.south)
    return np.asarray(((steps >= 0.0) & (steps <= region.side_m)).all(axis=-1), dtype=np.bool_)

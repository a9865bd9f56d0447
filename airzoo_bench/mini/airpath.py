"""Smooth flights through waypoints: from a line on the map to frames of a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.attitude import grid_convergence_deg
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.mini.trajectory import Trajectory, rounded
from airzoo_bench.mini.world import CRS, Region

__all__ = [
    "FPS",
    "MAX_ACCELERATION",
    "MAX_RATE",
    "SPEEDS",
    "Leg",
    "course_deg",
    "eased",
    "fly",
    "pace",
    "smooth_line",
    "way_m",
]

FPS = 30
"""Frames a second."""

SPEEDS = (5.0, 12.0)
"""Slowest and fastest of the flights made here, in metres a second."""

MAX_RATE = 30.0
"""None of them turns its yaw or pitch faster than this, in degrees a second."""

MAX_ACCELERATION = 10.0
"""Nor changes these rates faster than this, in degrees a second squared."""

_STEP_M = 1.0
_TURN_M = 18.0  # standard deviation of the smoothing of the way,
_EASE_M = 20.0  # of speed along it,
_TURN_S = 3.0  # and of yaw in time
_SLOWEST, _FASTEST = 6.0, 11.0  # wanted; what is flown keeps to `SPEEDS`
_SIDEWAYS = 2.5  # m/s^2
_PACE_WAVE_M = 900.0


@dataclass(frozen=True, eq=False)
class Leg:
    """What is wanted along a line of K points, before it is smoothed.

    Attributes
    ----------
    line : (K, 3) float64
        East, north and height of a smooth line, in metres from the region's south-west corner.
    speed : (K,) float64
        Metres a second.
    yaw_deg : (K,) float64
        From the grid's north; it may jump, and is then turned the shorter way and smoothed.
    pitch_deg : (K,) float64
        Smooth already.
    """

    line: Floats
    speed: Floats
    yaw_deg: Floats
    pitch_deg: Floats


def smooth_line(corners: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """Round the corners of a line off.

    Parameters
    ----------
    corners : (K, 2) array
        No two that follow each other are the same.
    wanted : (K, E) array
        What is wanted at the corners: linear between them, and not smoothed.

    Returns
    -------
    line : (M, 2) array
        About a metre apart, less in turns; it ends where the line ends, and bulges nowhere.
    wanted : (M, E) array
    """
    turn = round(4.0 * _TURN_M / _STEP_M)
    even = _evenly(np.concatenate((corners, wanted), axis=1))
    place, first, last = even[:, :2], even[0, :2], even[-1, :2]
    # The ends are mirrored through themselves, so that smoothing leaves them in place.
    before, after = 2 * first - place[turn:0:-1], 2 * last - place[-2 : -turn - 2 : -1]
    long = np.concatenate((before, place, after))
    even[:, :2] = gaussian_filter1d(long, _TURN_M / _STEP_M, axis=0, truncate=4.0)[turn:-turn]
    return even[:, :2], even[:, 2:]


def pace(line: Floats) -> Floats:
    """Speed wanted at points (K,) of a smooth line (K, 2): slower in turns, and in slow waves.

    No faster than a sideways acceleration of `_SIDEWAYS` allows.
    """
    step = np.gradient(line, axis=0)
    bend = np.gradient(step, axis=0)
    crossed = np.abs(step[:, 0] * bend[:, 1] - step[:, 1] * bend[:, 0])
    length = np.linalg.norm(step, axis=1)
    radius = length**3 / np.maximum(crossed, 1e-9)
    wave = np.cos(2 * np.pi * way_m(line) / _PACE_WAVE_M)
    cruise = _FASTEST - (_FASTEST - _SLOWEST) * (0.25 - 0.25 * wave)
    speed = np.clip(np.sqrt(_SIDEWAYS * radius), _SLOWEST, cruise)
    return eased(speed)


def eased(values: Floats) -> Floats:
    """Values (K,) along a line, smoothed over some 20 m."""
    smooth: Floats = gaussian_filter1d(values, _EASE_M / _STEP_M, mode="nearest", truncate=4.0)
    return smooth


def course_deg(line: Floats) -> Floats:
    """Direction of flight (K,) along a line (K, 2), in degrees from the grid's north."""
    step = np.gradient(line, axis=0)
    return np.degrees(np.arctan2(step[:, 0], step[:, 1]))


def way_m(line: Floats) -> Floats:
    """Way flown (K,) up to the points of a line (K, 2 or 3)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def fly(region: Region, leg: Leg) -> Trajectory:
    """Fly along a leg, a frame each 1/30 s, with the gimbal turning smoothly.

    Returns
    -------
    Trajectory
        Rounded as its file is; roll is 0.

    Raises
    ------
    UsageError
        The line leaves the region.
    """
    seconds_per_m = (1.0 / leg.speed[1:] + 1.0 / leg.speed[:-1]) / 2
    knots = np.append(0.0, np.cumsum(np.diff(way_m(leg.line)) * seconds_per_m))
    count = int(knots[-1] * FPS) + 1
    time_s = np.arange(count) / FPS
    place = np.asarray(CubicSpline(knots, leg.line)(time_s), dtype=np.float64)
    if not ((place[:, :2] >= 0.0) & (place[:, :2] <= region.side_m)).all():
        raise UsageError(
            f"the flight leaves the region {region.name}",
            expected=f"a flight within {region.side_m:g} m",
            mend="make it smaller, or move its centre inwards",
        )
    yaw_at_frames = np.interp(time_s, knots, np.unwrap(leg.yaw_deg, period=360.0))
    grid_yaw = gaussian_filter1d(yaw_at_frames, _TURN_S * FPS, mode="nearest", truncate=4.0)
    pitch = np.asarray(CubicSpline(knots, leg.pitch_deg)(time_s), dtype=np.float64)
    lonlat = to_lonlat(CRS, place[:, :2] + (region.west, region.south))
    yaw = (grid_yaw + grid_convergence_deg(CRS, lonlat) + 180.0) % 360.0 - 180.0
    return rounded(
        Trajectory(
            names=tuple(f"{frame:06d}" for frame in range(count)),
            time_s=time_s,
            lonlat=lonlat,
            altitude_m=place[:, 2],
            roll_deg=np.zeros(count),
            pitch_deg=np.clip(pitch, -90.0, 90.0),
            yaw_deg=yaw,
        )
    )


def _evenly(table: Floats) -> Floats:
    """Rows (M, C) along a line, whose first two columns are places, at distances of `_STEP_M`."""
    length = way_m(table[:, :2])
    places = np.linspace(0.0, length[-1], round(length[-1] / _STEP_M) + 1)
    return np.stack([np.interp(places, length, column) for column in table.T], axis=-1)

"""Flights over a region: a "barrel roll", and a survey for structure from motion.

The barrel roll is the paper's ("Flight Trajectories Generation"): orbits around a scene centre
joined by straight and S-shaped sweeps, while altitude, yaw and the gimbal's pitch go up and down.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.flights.trajectory import MARGIN_M, Airspace, Trajectory, rounded
from airzoo_bench.datasets.mini.keys import words
from airzoo_bench.datasets.mini.world.model import CRS, Region
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.geometry.units import grid_convergence_deg

__all__ = ["FPS", "barrel_roll", "survey"]

FPS = 30
"""Frames a second."""

_CLIMB_WAVE_M = 700.0
_PITCH_WAVE_M = 550.0
_SWING_WAVE_M = 300.0
_SWING_DEG = 40.0
_ROLL_PITCHES_DEG = (-90.0, -10.0)
_SURVEY_PITCHES_DEG = (-85.0, -45.0)  # of the lines, and of the orbit; lines across take the mean
_POINTS = 64  # of a curve, before it is smoothed
# Where the camera looks: to the grid's north, ahead, or to the centre.
_NORTH, _AHEAD, _INWARDS = 0.0, 1.0, 2.0

_STEP_M = 1.0
_TURN_M = 18.0  # standard deviation of the smoothing of the way,
_EASE_M = 20.0  # of speed along it,
_TURN_S = 3.0  # and of yaw in time
_SLOWEST, _FASTEST = 6.0, 11.0  # m/s wanted; what is flown keeps to 5 to 12
_SIDEWAYS = 2.5  # m/s^2
_PACE_WAVE_M = 900.0


def barrel_roll(airspace: Airspace, seed: int, *, rounds: int = 2) -> Trajectory:
    """Fly orbits joined by straight and S-shaped sweeps, at 5 to 12 m/s."""
    raw = words(seed, 5 + 3 * rounds)
    draws = np.asarray(raw >> np.uint64(11), dtype=np.float64) * 2.0**-53
    reach = airspace.region.side_m / 2 - MARGIN_M
    centre = airspace.region.side_m / 2 + (draws[:2] - 0.5) * 0.1 * reach
    parts = [_round(draws[5 + 3 * k : 8 + 3 * k], 0.9 * reach, 150.0 * k) for k in range(rounds)]
    corners = np.concatenate([_rotated(part[:, :2], 360.0 * draws[2]) for part in parts])
    line, looks = smooth_line(corners + centre, np.concatenate(parts)[:, 2:])
    way = _way_m(line)
    climb = 0.5 - 0.5 * np.cos(2 * np.pi * (way / _CLIMB_WAVE_M + draws[3]))
    height = airspace.floor_m + (airspace.ceiling_m - airspace.floor_m) * climb
    nod = 0.5 - 0.5 * np.cos(2 * np.pi * (way / _PITCH_WAVE_M + draws[4]))
    swing = _SWING_DEG * np.sin(2 * np.pi * way / _SWING_WAVE_M)
    yaw = _looking(line, looks[:, 0], centre) + np.where(looks[:, 0] < 1.5, swing, 0.0)
    low, high = _ROLL_PITCHES_DEG
    place = np.column_stack((line, height))
    return fly(airspace.region, place, _pace(line), yaw, low + (high - low) * nod)


def survey(
    airspace: Airspace,
    *,
    side_m: float = 240.0,
    spacing_m: float = 40.0,
    turn_deg: float = 0.0,
    shift_m: tuple[float, float] = (0.0, 0.0),
) -> Trajectory:
    """Fly parallel lines that look down, lines across, and an orbit that looks in at 45 degrees."""
    half = airspace.region.side_m / 2
    middle = half + np.array(shift_m)
    room = (half - MARGIN_M) - side_m / 2
    if not (0.0 < spacing_m <= side_m and room >= 0.0):
        raise UsageError(
            f"a square of {side_m:g} m with lines {spacing_m:g} m apart cannot be surveyed here",
            expected=f"within the region of {2 * half:g} m less {MARGIN_M:g} m each side",
            fix="make it smaller",
        )
    down, inwards = _SURVEY_PITCHES_DEG
    height = airspace.floor_m - airspace.ground_m
    radius = min(height / np.tan(np.radians(-inwards)), room + side_m / 2)
    along = _lawnmower(side_m, spacing_m)
    # Lines across begin where the others end, and the orbit goes on as they went.
    x, y = _lawnmower(side_m, 2 * spacing_m).T
    across = np.column_stack((-y, -x * np.sign(along[-1, 1])))
    east, north = np.sign(across[-1])
    start = 0.0 if east > 0 else 180.0
    parts = (
        _labelled(along, _NORTH, down),
        _labelled(across, _AHEAD, (down + inwards) / 2),
        _labelled(_arc(radius, start, start - 360.0 * east * north), _INWARDS, inwards),
    )
    table = np.concatenate(parts)
    corners = _rotated(table[:, :2], turn_deg) if turn_deg else table[:, :2]
    line, wanted = smooth_line(corners + middle, table[:, 2:])
    place = np.column_stack((line, np.full(len(line), airspace.floor_m)))
    yaw = _looking(line, wanted[:, 0], middle)
    return fly(airspace.region, place, _pace(line), yaw, _eased(wanted[:, 1]))


def _round(draws: Floats, reach: float, start_deg: float) -> Floats:
    """Corners (K, 3) of one round about the centre: east, north, and where the camera looks."""
    inner, outer = reach * (0.3 + 0.25 * draws[0]), reach * (0.75 + 0.25 * draws[1])
    bend = reach * (0.15 + 0.2 * draws[2])
    across = np.linspace(outer, -outer, _POINTS)[1:]
    weave = np.column_stack((-across, bend * np.sin(np.pi * across / outer)))
    # Every part goes on in about the direction in which the last one ended: no turn is sharper
    # than a right angle.
    parts = (
        _labelled(_arc(inner, 0.0, 360.0), _INWARDS),
        _labelled(_arc(outer, 180.0, -180.0), _INWARDS),
        _labelled(weave, _AHEAD),
        _labelled(_arc(outer, 5.0, 60.0), _AHEAD),
    )
    table = np.concatenate(parts)
    table[:, :2] = _rotated(table[:, :2], -start_deg)
    return table


def _labelled(line: Floats, *wanted: float) -> Floats:
    return np.column_stack((line, np.tile(wanted, (len(line), 1))))


def _arc(radius: float, start_deg: float, stop_deg: float) -> Floats:
    """Points (K, 2) of a circle, counter-clockwise from the east."""
    angle = np.radians(np.linspace(start_deg, stop_deg, _POINTS))
    return radius * np.column_stack((np.cos(angle), np.sin(angle)))


def _lawnmower(side_m: float, spacing_m: float) -> Floats:
    """Corners (K, 2) of lines to the north and back from the south-west, about the centre."""
    count = int(np.ceil(side_m / spacing_m)) + 1
    east = np.repeat(np.linspace(-0.5, 0.5, count), 2)
    north = np.resize((-0.5, 0.5, 0.5, -0.5), 2 * count)
    return side_m * np.column_stack((east, north))


def _rotated(points: Floats, degrees: float) -> Floats:
    """Turn points (K, 2) clockwise, as on a compass."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    x, y = points.T
    return np.column_stack((cosine * x + sine * y, cosine * y - sine * x))


def _looking(line: Floats, look: Floats, centre: Floats) -> Floats:
    """Yaw (K,) from the grid's north."""
    inwards = np.degrees(np.arctan2(*(centre - line).T))
    ahead = np.degrees(np.arctan2(*np.gradient(line, axis=0).T))
    kinds = np.rint(look)
    return np.select((kinds == _NORTH, kinds == _AHEAD), (0.0, ahead), inwards)


def smooth_line(corners: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """Round the corners (K, 2) of a line off; what is wanted at them (K, E) is linear between."""
    way = _way_m(corners)
    even = np.linspace(0.0, way[-1], round(way[-1] / _STEP_M) + 1)
    columns = [np.interp(even, way, column) for column in (*corners.T, *wanted.T)]
    place = np.stack(columns[:2], axis=-1)
    # The ends are mirrored through themselves, so that smoothing leaves them in place.
    turn = round(4.0 * _TURN_M / _STEP_M)
    before = 2 * place[0] - place[turn:0:-1]
    after = 2 * place[-1] - place[-2 : -turn - 2 : -1]
    long = np.concatenate((before, place, after))
    smooth = gaussian_filter1d(long, _TURN_M / _STEP_M, axis=0, truncate=4.0)[turn:-turn]
    return smooth, np.stack(columns[2:], axis=-1)


def _pace(line: Floats) -> Floats:
    """Speed wanted at points (K,) of a smooth line (K, 2): slower in turns, and in slow waves."""
    step = np.gradient(line, axis=0)
    bend = np.gradient(step, axis=0)
    crossed = np.abs(step[:, 0] * bend[:, 1] - step[:, 1] * bend[:, 0])
    radius = np.linalg.norm(step, axis=1) ** 3 / np.maximum(crossed, 1e-9)
    wave = np.cos(2 * np.pi * _way_m(line) / _PACE_WAVE_M)
    cruise = _FASTEST - (_FASTEST - _SLOWEST) * (0.25 - 0.25 * wave)
    return _eased(np.clip(np.sqrt(_SIDEWAYS * radius), _SLOWEST, cruise))


def _eased(values: Floats) -> Floats:
    """Values (K,) along a line, smoothed over some 20 m."""
    smooth: Floats = gaussian_filter1d(values, _EASE_M / _STEP_M, mode="nearest", truncate=4.0)
    return smooth


def _way_m(line: Floats) -> Floats:
    """Way flown (K,) up to the points of a line (K, 2 or 3)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def fly(
    region: Region, line: Floats, speed: Floats, yaw_deg: Floats, pitch_deg: Floats
) -> Trajectory:
    """Fly along a smooth line, a frame each 1/30 s, with the gimbal turning smoothly."""
    seconds_per_m = (1.0 / speed[1:] + 1.0 / speed[:-1]) / 2
    knots = np.append(0.0, np.cumsum(np.diff(_way_m(line)) * seconds_per_m))
    count = int(knots[-1] * FPS) + 1
    time_s = np.arange(count) / FPS
    place = np.asarray(CubicSpline(knots, line)(time_s), dtype=np.float64)
    if not ((place[:, :2] >= 0.0) & (place[:, :2] <= region.side_m)).all():
        raise UsageError(
            f"the flight leaves the region {region.name}",
            expected=f"a flight within {region.side_m:g} m",
            fix="make it smaller",
        )
    yaw_at_frames = np.interp(time_s, knots, np.unwrap(yaw_deg, period=360.0))
    grid_yaw = gaussian_filter1d(yaw_at_frames, _TURN_S * FPS, mode="nearest", truncate=4.0)
    pitch = np.asarray(CubicSpline(knots, pitch_deg)(time_s), dtype=np.float64)
    lonlat = to_lonlat(CRS, place[:, :2] + (region.west, region.south))
    flown = Trajectory(
        names=tuple(f"{frame:06d}" for frame in range(count)),
        time_s=time_s,
        lonlat=lonlat,
        altitude_m=place[:, 2],
        roll_deg=np.zeros(count),
        pitch_deg=np.clip(pitch, -90.0, 90.0),
        yaw_deg=(grid_yaw + grid_convergence_deg(CRS, lonlat) + 180.0) % 360.0 - 180.0,
    )
    return rounded(flown)

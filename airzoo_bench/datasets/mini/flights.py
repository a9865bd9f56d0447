"""Flights over a region: a "barrel roll", and a survey for structure from motion.

The barrel roll is the paper's ("Flight Trajectories Generation"): orbits around a scene centre
joined by straight and S-shaped sweeps, while altitude, yaw and the gimbal's pitch go up and down.
A flight is the poses of its frames, 30 a second, in `world.CRS`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from airzoo_bench.datasets.mini.world import CRS, Region
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, angles_to_rotations

FPS = 30  # frames a second
MARGIN_M = 40.0  # flights go no nearer to the region's border
_CLEARANCE_M, _ROOM_M = 40.0, 80.0  # of flights above the highest place, and above their lowest
# Digits of poses: 0.1 mm on the ground and of height, 1e-4 degrees.
_LONLAT_DECIMALS, _DECIMALS = 9, 4

# Lengths of the waves in which altitude, pitch, yaw and speed go up and down.
_CLIMB_WAVE_M, _PITCH_WAVE_M, _SWING_WAVE_M, _PACE_WAVE_M = 700.0, 550.0, 300.0, 900.0
_ROUNDS, _SWING_DEG = 2, 40.0
_ROLL_PITCHES_DEG = (-90.0, -10.0)
_SURVEY_PITCHES_DEG = (-85.0, -45.0)  # of the lines, and of the orbit; lines across take the mean
_POINTS = 64  # of a curve, before it is smoothed
# Where the camera looks: to the grid's north, ahead, or to the centre.
_NORTH, _AHEAD, _INWARDS = 0.0, 1.0, 2.0

_STEP_M = 1.0
_TURN_M = 18.0  # standard deviation of the smoothing of the way,
_EASE_M = 20.0  # of speed along it,
_TURN_S = 3.0  # and of yaw in time
_SLOWEST, _FASTEST = 6.0, 11.0  # m/s wanted; drones keep to 5 to 12
_SIDEWAYS = 2.5  # m/s^2


def flight_levels(dsm: NDArray[np.float32]) -> tuple[float, float]:
    """Return the height of the ground, for footprints, and the lowest altitude of flights."""
    return float(np.median(dsm)), float(dsm.max()) + _CLEARANCE_M


def barrel_roll(region: Region, floor_m: float, seed: int) -> Poses:
    """Fly orbits joined by straight and S-shaped sweeps, at 5 to 12 m/s."""
    raw = np.random.PCG64(seed).random_raw(5 + 3 * _ROUNDS)  # the same whatever NumPy's version
    draws = np.asarray(raw >> np.uint64(11), dtype=np.float64) * 2.0**-53
    reach = region.side_m / 2 - MARGIN_M
    centre = region.side_m / 2 + (draws[:2] - 0.5) * 0.1 * reach
    parts = [_round(draws[5 + 3 * k : 8 + 3 * k], 0.9 * reach, 150.0 * k) for k in range(_ROUNDS)]
    table = np.concatenate(parts)
    corners = _turned_clockwise(table[:, :2], 360.0 * draws[2])
    line, (look,) = _smooth_line(corners + centre, table[:, 2:])
    way = _way_m(line)
    waves = (way / _CLIMB_WAVE_M + draws[3], way / _PITCH_WAVE_M + draws[4])
    climb, nod = 0.5 - 0.5 * np.cos(2 * np.pi * np.stack(waves))
    swing = _SWING_DEG * np.sin(2 * np.pi * way / _SWING_WAVE_M)
    yaw = _looking(line, look, centre) + np.where(look < 1.5, swing, 0.0)
    low, high = _ROLL_PITCHES_DEG
    place = np.column_stack((line, floor_m + _ROOM_M * climb))
    return _fly(region, place, yaw, low + (high - low) * nod)


def _round(draws: Floats, reach: float, start_deg: float) -> Floats:
    """Corners (K, 3) of one round about the centre: east, north, and where the camera looks."""
    inner, outer = reach * (0.3 + 0.25 * draws[0]), reach * (0.75 + 0.25 * draws[1])
    bend = reach * (0.15 + 0.2 * draws[2])
    across = np.linspace(outer, -outer, _POINTS)[1:]
    weave = np.column_stack((-across, bend * np.sin(np.pi * across / outer)))
    # Every part goes on in about the direction in which the last one ended: no turn is sharper
    # than a right angle.
    inwards = np.concatenate((_arc(inner, 0.0, 360.0), _arc(outer, 180.0, -180.0)))
    ahead = np.concatenate((weave, _arc(outer, 5.0, 60.0)))
    table = np.concatenate((_labelled(inwards, _INWARDS), _labelled(ahead, _AHEAD)))
    table[:, :2] = _turned_clockwise(table[:, :2], -start_deg)
    return table


def survey(
    region: Region, ground_m: float, floor_m: float, side_m: float = 240.0, spacing_m: float = 40.0
) -> Poses:
    """Fly parallel lines that look down, lines across, and an orbit that looks in at 45 degrees.

    The lines fill a square of `side_m`, which lies in the region less `MARGIN_M` on each side.
    """
    half, (down, inwards) = region.side_m / 2, _SURVEY_PITCHES_DEG
    radius = min((floor_m - ground_m) / np.tan(np.radians(-inwards)), half - MARGIN_M)
    along = _lawnmower(side_m, spacing_m)
    # Lines across begin where the others end, and the orbit goes on as they went.
    x, y = _lawnmower(side_m, 2 * spacing_m).T
    across = np.column_stack((-y, -x * np.sign(along[-1, 1])))
    east, north = np.sign(across[-1])
    start = 0.0 if east > 0 else 180.0
    orbit = _arc(radius, start, start - 360.0 * east * north)
    ahead = _labelled(across, _AHEAD, (down + inwards) / 2)
    parts = (_labelled(along, _NORTH, down), ahead, _labelled(orbit, _INWARDS, inwards))
    table = np.concatenate(parts)
    line, (look, pitch) = _smooth_line(table[:, :2] + half, table[:, 2:])
    place = np.column_stack((line, np.full(len(line), floor_m)))
    return _fly(region, place, _looking(line, look, half), _eased(pitch))


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


def _turned_clockwise(points: Floats, degrees: float) -> Floats:
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    x, y = points.T
    return np.column_stack((cosine * x + sine * y, cosine * y - sine * x))


def _looking(line: Floats, look: Floats, centre: Floats | float) -> Floats:
    inwards = np.degrees(np.arctan2(*(centre - line).T))
    ahead = np.degrees(np.arctan2(*np.gradient(line, axis=0).T))
    kinds = np.rint(look)
    return np.select((kinds == _NORTH, kinds == _AHEAD), (0.0, ahead), inwards)


def _smooth_line(corners: Floats, wanted: Floats) -> tuple[Floats, list[Floats]]:
    """Round the corners (K, 2) of a line off; other columns (K, E) are linear between them."""
    way = _way_m(corners)
    even = np.linspace(0.0, way[-1], round(way[-1] / _STEP_M) + 1)
    x, y, *columns = (np.interp(even, way, column) for column in (*corners.T, *wanted.T))
    place = np.stack((x, y), axis=-1)
    # The ends are mirrored through themselves, so that smoothing leaves them in place.
    turn = round(4.0 * _TURN_M / _STEP_M)
    long = np.pad(place, ((turn, turn), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(long, _TURN_M / _STEP_M, axis=0, truncate=4.0)[turn:-turn]
    return smooth, columns


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
    return np.asarray(gaussian_filter1d(values, _EASE_M / _STEP_M, mode="nearest", truncate=4.0))


def _way_m(line: Floats) -> Floats:
    """Way flown (K,) up to the points of a line (K, 2 or 3)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _fly(region: Region, line: Floats, yaw_deg: Floats, pitch_deg: Floats) -> Poses:
    """Fly along a smooth line (K, 3), a frame each 1/30 s, with the gimbal turning smoothly.

    Poses are those that rounded longitudes, latitudes, altitudes and angles from true north give.
    """
    speed = _pace(line[:, :2])
    seconds_per_m = (1.0 / speed[1:] + 1.0 / speed[:-1]) / 2
    knots = np.append(0.0, np.cumsum(np.diff(_way_m(line)) * seconds_per_m))
    time_s = np.arange(int(knots[-1] * FPS) + 1) / FPS
    place = np.asarray(CubicSpline(knots, line)(time_s), dtype=np.float64)
    yaw_at_frames = np.interp(time_s, knots, np.unwrap(yaw_deg, period=360.0))
    grid_yaw = gaussian_filter1d(yaw_at_frames, _TURN_S * FPS, mode="nearest", truncate=4.0)
    pitch = np.clip(np.asarray(CubicSpline(knots, pitch_deg)(time_s)), -90.0, 90.0)
    lonlat = to_lonlat(CRS, place[:, :2] + (region.west, region.south))
    yaw = (grid_yaw + grid_convergence_deg(CRS, lonlat) + 180.0) % 360.0 - 180.0
    lonlat = np.round(lonlat, _LONLAT_DECIMALS)
    altitude, pitch, yaw = (np.round(part, _DECIMALS) + 0.0 for part in (place[:, 2], pitch, yaw))
    turn = grid_convergence_deg(CRS, lonlat)
    rotation = angles_to_rotations(yaw, pitch, np.zeros(len(yaw)), convergence_deg=turn)
    return Poses.from_centres(rotation, np.column_stack((from_lonlat(CRS, lonlat), altitude)))

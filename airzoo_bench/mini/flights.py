"""Flights over a region: a "barrel roll", and a survey for structure from motion.

The barrel roll is the paper's ("Flight Trajectories Generation"): orbits around a scene centre
joined by straight and S-shaped sweeps, while altitude, yaw and the gimbal's pitch go up and down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.airpath import Leg, course_deg, eased, fly, pace, smooth_line, way_m
from airzoo_bench.mini.trajectory import Trajectory
from airzoo_bench.mini.world import Region

__all__ = ["Airspace", "barrel_roll", "survey"]

_CLIMB_WAVE_M = 700.0
_PITCH_WAVE_M = 550.0
_SWING_WAVE_M = 300.0
_SWING_DEG = 40.0
_POINTS = 64  # of a curve, before it is smoothed
# Where the camera looks: to the grid's north, ahead, or to the centre.
_NORTH, _AHEAD, _INWARDS = 0.0, 1.0, 2.0


@dataclass(frozen=True)
class Airspace:
    """Where it is safe to fly.

    Attributes
    ----------
    region : Region
    ground_m : float
        Height of the ground, for what a camera sees.
    floor_m, ceiling_m : float
        Lowest and highest altitude of flights.
    margin_m : float
        How near to the region's border flights go.
    """

    region: Region
    ground_m: float
    floor_m: float
    ceiling_m: float
    margin_m: float = 40.0

    @classmethod
    def over(
        cls,
        region: Region,
        dsm: NDArray[np.float32],
        *,
        clearance_m: float = 40.0,
        room_m: float = 80.0,
    ) -> Airspace:
        """Return the airspace over a surface model: so far above its highest place, so high.

        The ground is the median height.
        """
        floor = float(np.nanmax(dsm)) + clearance_m
        return cls(region, float(np.nanmedian(dsm)), floor, floor + room_m)


def barrel_roll(
    airspace: Airspace,
    seed: int,
    *,
    rounds: int = 2,
    pitch_deg: tuple[float, float] = (-90.0, -10.0),
) -> Trajectory:
    """Fly orbits joined by straight and S-shaped sweeps.

    A round is an orbit, a straight sweep, an orbit the other way round, and an S. Altitude goes up
    and down once or twice an orbit, the pitch between its limits about once a minute. In orbits the
    camera looks to the scene's centre, in sweeps ahead with a slow swing.

    Parameters
    ----------
    airspace : Airspace
    seed : int
        Turns and scales the pattern; each seed is another flight.
    rounds : int
        Of about five minutes each.
    pitch_deg : tuple of float
        Lowest and highest pitch; both are reached.

    Returns
    -------
    Trajectory
        30 frames a second, at 5 to 12 m/s; the same digits for the same arguments.

    Raises
    ------
    UsageError
        `rounds` or `pitch_deg` are not possible, or the region is too small.
    """
    low, high = pitch_deg
    if rounds < 1 or not -90.0 <= low <= high <= 0.0:
        raise UsageError(
            f"{rounds} rounds with pitch from {low:g} to {high:g} cannot be flown",
            expected="at least one round, -90 <= lowest pitch <= highest <= 0 degrees",
        )
    draws = _draws(seed, 5 + 3 * rounds)
    reach = airspace.region.side_m / 2 - airspace.margin_m
    centre = airspace.region.side_m / 2 + (draws[:2] - 0.5) * 0.1 * reach
    parts = [_round(draws[5 + 3 * k : 8 + 3 * k], 0.9 * reach, 150.0 * k) for k in range(rounds)]
    corners = np.concatenate([_rotated(part[:, :2], 360.0 * draws[2]) for part in parts])
    line, looks = smooth_line(corners + centre, np.concatenate(parts)[:, 2:])
    way = way_m(line)
    climb = 0.5 - 0.5 * np.cos(2 * np.pi * (way / _CLIMB_WAVE_M + draws[3]))
    height = airspace.floor_m + (airspace.ceiling_m - airspace.floor_m) * climb
    nod = 0.5 - 0.5 * np.cos(2 * np.pi * (way / _PITCH_WAVE_M + draws[4]))
    swing = _SWING_DEG * np.sin(2 * np.pi * way / _SWING_WAVE_M)
    yaw = _looking(line, looks[:, 0], centre) + np.where(looks[:, 0] < 1.5, swing, 0.0)
    leg = Leg(np.column_stack((line, height)), pace(line), yaw, low + (high - low) * nod)
    return fly(airspace.region, leg)


def survey(
    airspace: Airspace,
    *,
    centre: tuple[float, float] | None = None,
    side_m: float = 240.0,
    spacing_m: float = 40.0,
    pitches_deg: tuple[float, float] = (-85.0, -45.0),
) -> Trajectory:
    """Fly parallel lines that look down, lines across, and an orbit that looks in at 45 degrees.

    Parameters
    ----------
    airspace : Airspace
    centre : (east, north), optional
        Of the part surveyed, in metres from the region's south-west corner; the region's centre
        where left out.
    side_m : float
        Of the square that the lines cover.
    spacing_m : float
        Between lines; those across lie twice as far apart.
    pitches_deg : tuple of float
        Of the lines, and of the orbit; lines across take the mean.

    Returns
    -------
    Trajectory
        30 frames a second, at 5 to 12 m/s, level, at the lowest altitude of the airspace.

    Raises
    ------
    UsageError
        The part reaches beyond the region less its margin, or lines are farther apart than it is
        wide.
    """
    half = airspace.region.side_m / 2
    middle = np.array((half, half) if centre is None else centre, dtype=np.float64)
    room = (half - airspace.margin_m) - np.abs(middle - half).max() - side_m / 2
    if not (0.0 < spacing_m <= side_m and room >= 0.0):
        raise UsageError(
            f"a square of {side_m:g} m with lines {spacing_m:g} m apart cannot be surveyed here",
            expected=f"within the region of {2 * half:g} m less {airspace.margin_m:g} m each side",
            mend="make it smaller, or move its centre inwards",
        )
    height = airspace.floor_m - airspace.ground_m
    radius = min(height / np.tan(np.radians(-pitches_deg[1])), room + side_m / 2)
    mean = sum(pitches_deg) / 2
    along, across = _grid(side_m, spacing_m)
    parts = (
        _labelled(along, _NORTH, pitches_deg[0]),
        _labelled(across, _AHEAD, mean),
        _labelled(_orbit_after(across, radius), _INWARDS, pitches_deg[1]),
    )
    table = np.concatenate(parts)
    line, wanted = smooth_line(table[:, :2] + middle, table[:, 2:])
    place = np.column_stack((line, np.full(len(line), airspace.floor_m)))
    yaw = _looking(line, wanted[:, 0], middle)
    return fly(airspace.region, Leg(place, pace(line), yaw, eased(wanted[:, 1])))


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


def _grid(side_m: float, spacing_m: float) -> tuple[Floats, Floats]:
    """Corners (K, 2) of lines to the north and back, and of lines across, about the centre.

    Those across begin where the others end; they lie twice as far apart.
    """
    along = _lawnmower(side_m, spacing_m)
    x, y = _lawnmower(side_m, 2 * spacing_m).T
    return along, np.column_stack((-y, -x * np.sign(along[-1, 1])))


def _lawnmower(side_m: float, spacing_m: float) -> Floats:
    """Corners (K, 2) of parallel lines from the south-west, at most so far apart."""
    count = int(np.ceil(side_m / spacing_m)) + 1
    east = np.repeat(np.linspace(-0.5, 0.5, count), 2)
    north = np.resize((-0.5, 0.5, 0.5, -0.5), 2 * count)
    return side_m * np.column_stack((east, north))


def _orbit_after(line: Floats, radius: float) -> Floats:
    """Return a circle that goes on from the end of an east-west line as that went."""
    east, north = np.sign(line[-1])
    start = 0.0 if east > 0 else 180.0
    return _arc(radius, start, start - 360.0 * east * north)


def _rotated(points: Floats, degrees: float) -> Floats:
    """Turn points (K, 2) clockwise, as on a compass."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    x, y = points.T
    return np.column_stack((cosine * x + sine * y, cosine * y - sine * x))


def _looking(line: Floats, look: Floats, centre: Floats) -> Floats:
    """Yaw (K,) from the grid's north."""
    inwards = np.degrees(np.arctan2(*(centre - line).T))
    kinds = np.rint(look)
    return np.select((kinds == _NORTH, kinds == _AHEAD), (0.0, course_deg(line)), inwards)


def _draws(seed: int, count: int) -> Floats:
    """Numbers in [0, 1), the same whatever the version of numpy."""
    raw = np.random.PCG64(seed).random_raw(count)
    return np.asarray(raw >> np.uint64(11), dtype=np.float64) * 2.0**-53

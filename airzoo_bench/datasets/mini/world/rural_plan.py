"""The layout of the country: a valley with a stream, parcels of land, a road, farms, woods."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice, direction
from airzoo_bench.datasets.mini.world.model import SIDE_M
from airzoo_bench.datasets.mini.world.parcels import parcels, use_parcel
from airzoo_bench.datasets.mini.world.plan import Plan, add_barn, add_house
from airzoo_bench.datasets.mini.world.shapes import (
    Ellipse,
    Frame,
    Line,
    Point,
    Stroke,
    bend,
    distance,
    distance_to_line,
    square,
)
from airzoo_bench.datasets.mini.world.terrain import (
    GRID_M,
    LAND_X,
    LAND_Y,
    blended,
    rolling,
    smooth_share,
)
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["rural_plan"]

_STREAM = 12
_LARGEST_M2 = 9_500.0
# Half the level ground of a farm.
_YARD_M = (34.0, 28.0)


@dataclass(frozen=True)
class _Lines:
    stream: Line
    road: Line
    tracks: tuple[Line, ...]
    paths: tuple[Line, ...]
    pond: Frame
    pond_half: Point
    farms: tuple[Frame, ...]


def rural_plan(seed: int) -> Plan:
    """Lay out the country."""
    dice = Dice(seed, _STREAM)
    lines = _lines(dice)
    plan = Plan(seed, _heights(seed, lines))
    low, high = -8.0, SIDE_M + 8
    for parcel in parcels(dice, ((low, low), (high, low), (high, high), (low, high)), _LARGEST_M2):
        use_parcel(plan, dice, parcel, lines.stream)
    _lay_water(plan, dice, lines)
    _lay_ways(plan, dice, lines)
    for farm in lines.farms:
        _add_farm(plan, dice, farm)
    _add_single_trees(plan, dice, lines)
    plan.keep_trees(_apart(*plan.tree_places(), lines))
    return plan


def _lines(dice: Dice) -> _Lines:
    stream = _winding(dice, dice.real(0.3, 0.45), 60.0)
    stream = _transposed(stream) if dice.chance(50) else stream
    farms = _farm_places(dice, stream)
    road = _road(dice, farms)
    tracks = tuple(_track(dice, farm.origin, road) for farm in farms)
    paths = tuple(_path(dice) for _ in range(4))
    half = dice.real(22, 32), dice.real(14, 19)
    # The pond lies on the middle part of the stream, as far from the road as can be.
    first, last = len(stream) * 3 // 10, len(stream) * 7 // 10
    x, y = np.array(stream[first:last]).T
    away = distance_to_line(x, y, road)
    pond = Frame(*stream[first + int(np.argmax(away))], *direction(dice.integer(0, 255)))
    farms = tuple(farm for farm in farms if distance(farm.origin, pond.origin) > 85.0)
    return _Lines(stream, road, tracks, paths, pond, half, farms)


def _winding(dice: Dice, share: float, swing_m: float) -> Line:
    """Return a line from the western border to the eastern one."""
    along = np.linspace(-70, SIDE_M + 70, 10).tolist()
    return bend(tuple((x, share * SIDE_M + dice.real(-swing_m, swing_m)) for x in along))


def _transposed(line: Line) -> Line:
    return tuple((y, x) for x, y in line)


def _farm_places(dice: Dice, stream: Line) -> tuple[Frame, ...]:
    farms: list[Frame] = []
    for _ in range(200):
        x, y = dice.real(55, SIDE_M - 55), dice.real(55, SIDE_M - 55)
        farm = Frame(x, y, *direction(dice.integer(0, 255)))
        off = distance_to_line(np.array([x]), np.array([y]), stream)[0]
        if off > 60 and all(distance(farm.origin, other.origin) > 125 for other in farms):
            farms.append(farm)
    return tuple(farms[:6])


def _road(dice: Dice, farms: tuple[Frame, ...]) -> Line:
    """Draw some winding roads, and return the one that keeps farthest from all farms."""
    x, y = np.array([farm.origin for farm in farms]).T
    drawn = []
    for _ in range(12):
        line = _winding(dice, dice.real(0.25, 0.8), 50.0)
        drawn.append(line if dice.chance(50) else _transposed(line))
    return max(drawn, key=lambda line: float(distance_to_line(x, y, line).min()))


def _track(dice: Dice, farm: Point, road: Line) -> Line:
    """Return a track from a farm's yard to the nearest point of the road."""
    near = min(road, key=lambda point: distance(point, farm))
    x, y = (near[0] + farm[0]) / 2, (near[1] + farm[1]) / 2
    return bend((farm, (x + dice.real(-18, 18), y + dice.real(-18, 18)), near))


def _path(dice: Dice) -> Line:
    line = _winding(dice, dice.real(0.1, 0.9), 75.0)
    return line if dice.chance(50) else _transposed(line)


def _heights(seed: int, lines: _Lines) -> Floats:
    hills = 88.0 + rolling(seed, 20, {110: 8, 60: 5, 26: 2, 11: 1}, 46.0)
    stream = distance_to_line(LAND_X, LAND_Y, lines.stream)
    valley = hills - 15.0 * (1.0 - smooth_share(stream, 5.0, 210.0))
    land = valley - 2.6 * (1.0 - smooth_share(stream, 1.5, 9.0))
    road = distance_to_line(LAND_X, LAND_Y, lines.road)
    land = land + 0.8 * (1.0 - smooth_share(road, 3.0, 10.0))
    u, v = lines.pond.to_local(LAND_X, LAND_Y)
    u, v = u / lines.pond_half[0], v / lines.pond_half[1]
    off = (np.sqrt(u * u + v * v) - 1.0) * lines.pond_half[1]
    land = blended(land, off, float(land[off < 0].min()), 2.0, 16.0)
    for farm in lines.farms:
        u, v = farm.to_local(LAND_X, LAND_Y)
        off = np.maximum(np.abs(u) - _YARD_M[0], np.abs(v) - _YARD_M[1])
        level = float(land[round(farm.y / GRID_M), round(farm.x / GRID_M)])
        land = blended(land, off, level, 0.0, 26.0)
    return land


def _lay_water(plan: Plan, dice: Dice, lines: _Lines) -> None:
    pond, (a, b) = lines.pond, lines.pond_half
    plan.paint("rough", Stroke(lines.stream, 17.0))
    plan.paint("shore", Stroke(lines.stream, 8.0))
    for kind, grown in (("rough", 7.0), ("shore", 3.5), ("shallow", 0.6), ("water", -0.8)):
        plan.paint(kind, Ellipse(pond, a + grown, b + grown), dice.integer(0, 9))
    plan.paint("water", Stroke(lines.stream, 3.6))
    jetty = pond.to_world(a - 3, 0), pond.to_world(a + 4, 0)
    plan.paint("wood", Stroke(jetty, 1.5))
    for start, end in pairwise(lines.stream):
        for side in (-1, 1):
            if dice.chance(42):
                place = _beside(start, end, side * dice.real(0.25, 0.4))
                radius = dice.real(1.8, 4.0)
                plan.plant(place, radius, radius * dice.real(2.2, 3.0))


def _beside(start: Point, end: Point, away: float) -> Point:
    """Return a point to the left of the start, by a share of the way to the end."""
    return start[0] - (end[1] - start[1]) * away, start[1] + (end[0] - start[0]) * away


def _lay_ways(plan: Plan, dice: Dice, lines: _Lines) -> None:
    for path in lines.paths:
        plan.paint("rough", Stroke(path, 3.2))
        plan.paint("track", Stroke(path, 1.6))
    for track in lines.tracks:
        plan.paint("rough", Stroke(track, 5.0))
        plan.paint("ruts", Stroke(track, 3.2))
    for kind, width in (("rough", 11.0), ("gravel", 8.0), ("asphalt", 6.4)):
        plan.paint(kind, Stroke(lines.road, width))
    for index, ends in enumerate(pairwise(lines.road)):
        if index % 2:
            plan.paint("marking", Stroke(ends, 0.3))
        if dice.chance(12):
            plan.paint(dice.pick(("patch", "tar", "lane")), Stroke(ends, dice.real(1, 4)))
        if dice.chance(14):
            spot = Frame.along(*ends).at(0, dice.pick((-1.6, 1.6)))
            key, season = dice.integer(0, 99), dice.integer(1, 2)
            plan.paint("car", square(spot, 2.2, 0.9), key, season=season)


def _add_farm(plan: Plan, dice: Dice, frame: Frame) -> None:
    """Lay out a farm about a frame's origin, on ground that is level already."""
    plan.paint("rough", Ellipse(frame, _YARD_M[0] + 4, _YARD_M[1] + 4))
    plan.paint("meadow", Ellipse(frame, *_YARD_M))
    cover = dice.pick(("gravel", "plates", "track"))
    plan.paint(cover, square(frame, 23.0, 15.0), dice.integer(0, 99))
    plan.paint("worn", square(frame, 25.0, 17.0), dice.integer(0, 3))
    for u, v in ((0.0, -21.5), (19.0, -21.0)):
        bed = square(frame.at(u + dice.real(-2, 2), v), 8.0, 4.5)
        plan.paint(dice.pick(("beds", "beds", "lawn")), bed, dice.integer(0, 99))
    _add_buildings(plan, dice, frame)
    _add_things(plan, dice, frame)
    for _ in range(dice.integer(7, 12)):
        u, v = dice.pick((-1, 1)) * dice.real(24, 33), dice.real(-24, 24)
        radius = dice.real(1.6, 3.6)
        kind = dice.pick(("broad", "broad", "bush", "cone"))
        plan.plant(frame.to_world(u, v), radius, radius * (3.2 if kind == "cone" else 2.4), kind)


def _add_buildings(plan: Plan, dice: Dice, frame: Frame) -> None:
    house = frame.at(dice.real(-17, -13), dice.real(-9, -6))
    add_house(plan, dice, house, dice.real(5.5, 7.5), dice.real(4.5, 5.5), dice.integer(1, 2))
    barn = frame.at(dice.real(-6, 0), dice.real(16, 18))
    plan.paint("plates", square(barn, 15.0, 8.0), dice.integer(0, 99))
    add_barn(plan, dice, barn, dice.real(10, 14), dice.real(5.5, 7), dice.real(4.5, 6.0))
    side = frame.at(dice.real(17, 20), dice.real(-4, 3), turned=True)
    add_barn(plan, dice, side, dice.real(7, 11), dice.real(4, 5.5), dice.real(3.5, 5.0))
    shed = frame.at(dice.real(-3, 3), dice.real(-12, -10))
    add_barn(plan, dice, shed, dice.real(2.5, 4), dice.real(2, 2.8), 2.6)
    if dice.chance(60):
        wing = frame.at(-25.0, dice.real(6.5, 9), turned=True)
        add_house(plan, dice, wing, dice.real(4.5, 6), dice.real(3.4, 4.2), 1)


def _add_things(plan: Plan, dice: Dice, frame: Frame) -> None:
    for season in (1, 2):
        for _ in range(dice.integer(2, 5)):
            spot = frame.at(dice.real(-9, 12), dice.real(-5, 7), turned=dice.chance(50))
            plan.paint("car", square(spot, 2.2, 0.95), dice.integer(0, 99), season=season)
    for _ in range(14):
        spot = frame.at(dice.real(-24, 24), dice.pick((-1, 1)) * dice.real(9, 14))
        half = dice.pick(((1.5, 1.0), (0.8, 0.8), (2.5, 1.2)))
        kind = dice.pick(("wood", "rubbish", "tar", "sand", "soil"))
        plan.paint(kind, square(spot, *half), season=dice.integer(0, 2))
    if dice.chance(60):
        gone = square(frame.at(dice.real(-3, 8), -21), dice.real(4, 7), dice.real(2.5, 4))
        plan.paint("old_roof", gone, dice.integer(0, 99), season=2)
    for _ in range(dice.integer(0, 6)):
        plan.plant(frame.to_world(dice.real(6, 12), dice.real(8, 11)), 0.8, 1.3, "bale")


def _apart(x: Floats, y: Floats, lines: _Lines) -> Bools:
    """Say which trees are inside the region and stand neither on ways, in water nor in a yard."""
    keep: Bools = (x > 3) & (x < SIDE_M - 3) & (y > 3) & (y < SIDE_M - 3)
    berths = ((lines.road, 6.5), (lines.stream, 4.0))
    for line, berth in (*berths, *((way, 3.4) for way in lines.tracks + lines.paths)):
        keep &= distance_to_line(x, y, line) > berth
    for frame, half in ((lines.pond, lines.pond_half), *((f, _YARD_M) for f in lines.farms)):
        u, v = frame.to_local(x, y)
        u, v = u / (half[0] + 3), v / (half[1] + 3)
        yard = half == _YARD_M
        keep &= (u * u + v * v > 1.0) | (yard & (u * u > 0.45) & (v * v < 0.5))
    return keep


def _add_single_trees(plan: Plan, dice: Dice, lines: _Lines) -> None:
    """Trees alone in the fields, and in rows along the road."""
    for _ in range(70):
        radius = dice.real(2.2, 5.0)
        place = dice.real(9, SIDE_M - 9), dice.real(9, SIDE_M - 9)
        plan.plant(place, radius, radius * dice.real(2, 2.6))
    for start, end in pairwise(lines.road):
        if dice.chance(40):
            place = _beside(start, end, dice.pick((-1, 1)) * 0.75)
            plan.plant(place, dice.real(2, 3), dice.real(7, 9))

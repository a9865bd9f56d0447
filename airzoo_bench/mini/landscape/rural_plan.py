"""The layout of the country: a valley with a stream, parcels of land, a road, farms, woods."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape import terrain
from airzoo_bench.mini.landscape.farms import YARD_M, add_farm
from airzoo_bench.mini.landscape.parcel_use import use_parcel
from airzoo_bench.mini.landscape.parcels import parcels
from airzoo_bench.mini.landscape.plan import Plan, Tree, square
from airzoo_bench.mini.landscape.randomness import Dice, direction
from airzoo_bench.mini.landscape.shapes import (
    Ellipse,
    Frame,
    Point,
    Stroke,
    bend,
    distance_to_line,
)

__all__ = ["rural_plan"]

_STREAM = 12
_LARGEST_M2 = 9_500.0
Line = tuple[Point, ...]


@dataclass(frozen=True)
class _Lines:
    stream: Line
    road: Line
    tracks: tuple[Line, ...]
    paths: tuple[Line, ...]
    pond: Frame
    pond_half: Point
    farms: tuple[Frame, ...]


def rural_plan(seed: int, side_m: float) -> Plan:
    """Lay out the country.

    Parameters
    ----------
    seed : int
    side_m : float

    Returns
    -------
    Plan
    """
    dice = Dice(seed, _STREAM)
    lines = _lines(dice, side_m)
    plan = Plan(seed, _heights(seed, side_m, lines))
    outline = ((-8.0, -8.0), (side_m + 8, -8.0), (side_m + 8, side_m + 8), (-8.0, side_m + 8))
    for parcel in parcels(dice, outline, _LARGEST_M2):
        use_parcel(plan, dice, parcel, lines.stream)
    _lay_water(plan, dice, lines)
    _lay_ways(plan, dice, lines)
    for farm in lines.farms:
        add_farm(plan, dice, farm)
    plan.trees = _apart(plan.trees, lines, side_m)
    plan.trees += _single_trees(dice, plan, lines, side_m)
    return plan


def _lines(dice: Dice, side_m: float) -> _Lines:
    stream = _winding(dice, side_m, dice.real(0.3, 0.45), 60.0)
    stream = tuple((y, x) for x, y in stream) if dice.chance(50) else stream
    farms = _farm_places(dice, side_m, stream)
    road = _road(dice, side_m, farms)
    tracks = tuple(_track(dice, farm, road) for farm in farms)
    paths = tuple(_path(dice, side_m) for _ in range(4))
    index = _far_from(road, stream)
    half = dice.real(22, 32), dice.real(14, 19)
    pond = Frame(*stream[index], *direction(dice.integer(0, 255)))
    farms = tuple(f for f in farms if _apart_of(f, pond) > 85.0)
    return _Lines(stream, road, tracks, paths, pond, half, farms)


def _far_from(road: Line, stream: Line) -> int:
    """Return the point of the stream's middle part that is farthest from the road."""
    first, last = len(stream) * 3 // 10, len(stream) * 7 // 10
    x, y = np.array(stream[first:last]).T
    return first + int(np.argmax(distance_to_line(x, y, road)))


def _apart_of(a: Frame, b: Frame) -> float:
    return float(np.sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)))


def _winding(dice: Dice, side_m: float, share: float, swing_m: float) -> Line:
    """Return a line from one border to the opposite one."""
    along = np.linspace(-70, side_m + 70, 10).tolist()
    return bend(tuple((x, share * side_m + dice.real(-swing_m, swing_m)) for x in along))


def _farm_places(dice: Dice, side_m: float, stream: Line) -> tuple[Frame, ...]:
    farms: list[Frame] = []
    for _ in range(200):
        x, y = dice.real(55, side_m - 55), dice.real(55, side_m - 55)
        farm = Frame(x, y, *direction(dice.integer(0, 255)))
        off = distance_to_line(np.array([x]), np.array([y]), stream)[0]
        if off > 60 and all(_apart_of(farm, other) > 125 for other in farms):
            farms.append(farm)
    return tuple(farms[:6])


def _road(dice: Dice, side_m: float, farms: tuple[Frame, ...]) -> Line:
    """Return the winding with the widest berth of all farms, of some that are drawn."""
    x, y = np.array([farm.x for farm in farms]), np.array([farm.y for farm in farms])
    drawn = []
    for _ in range(12):
        line = _winding(dice, side_m, dice.real(0.25, 0.8), 50.0)
        drawn.append(line if dice.chance(50) else tuple((b, a) for a, b in line))
    return max(drawn, key=lambda line: float(distance_to_line(x, y, line).min()))


def _track(dice: Dice, farm: Frame, road: Line) -> Line:
    """From a farm's yard to a point of the road that is near."""
    near = min(road, key=lambda point: _apart_of(Frame(*point), farm))
    middle = (
        (near[0] + farm.x) / 2 + dice.real(-18, 18),
        (near[1] + farm.y) / 2 + dice.real(-18, 18),
    )
    return bend(((farm.x, farm.y), middle, near))


def _path(dice: Dice, side_m: float) -> Line:
    line = _winding(dice, side_m, dice.real(0.1, 0.9), 75.0)
    return line if dice.chance(50) else tuple((y, x) for x, y in line)


def _heights(seed: int, side_m: float, lines: _Lines) -> Floats:
    hills = 88.0 + terrain.rolling(seed, 20, side_m, {110: 8, 60: 5, 26: 2, 11: 1}, 46.0)
    distance = terrain.near_line(side_m, lines.stream)
    valley = hills - 15.0 * (1.0 - terrain.smooth_share(distance, 5.0, 210.0))
    land = valley - 2.6 * (1.0 - terrain.smooth_share(distance, 1.5, 9.0))
    road = terrain.near_line(side_m, lines.road)
    land = land * 1.0 + 0.8 * (1.0 - terrain.smooth_share(road, 3.0, 10.0))
    u, v = lines.pond.to_local(*terrain.corners(side_m))
    u, v = u / lines.pond_half[0], v / lines.pond_half[1]
    off = (np.sqrt(u * u + v * v) - 1.0) * lines.pond_half[1]
    level = float(land[off < 0].min()) if (off < 0).any() else 0.0
    land = terrain.blended(land, off, level, 2.0, 16.0)
    for farm in lines.farms:
        land = terrain.levelled(land, farm, *YARD_M, 26.0)
    return land


def _lay_water(plan: Plan, dice: Dice, lines: _Lines) -> None:
    for kind, width in (("rough", 17.0), ("shore", 8.0)):
        plan.paint(kind, Stroke(lines.stream, width))
    for kind, grown in (("rough", 7.0), ("shore", 3.5), ("shallow", 0.6), ("water", -0.8)):
        plan.paint(
            kind,
            Ellipse(lines.pond, lines.pond_half[0] + grown, lines.pond_half[1] + grown),
            dice.integer(0, 9),
        )
    plan.paint("water", Stroke(lines.stream, 3.6))
    jetty = lines.pond.at(lines.pond_half[0] - 3, 0)
    plan.paint(
        "wood", Stroke(((jetty.x, jetty.y), lines.pond.to_world(lines.pond_half[0] + 4, 0)), 1.5)
    )
    for (x0, y0), (x1, y1) in pairwise(lines.stream):
        for side in (-1, 1):
            if dice.chance(42):
                away = side * dice.real(0.25, 0.4)
                x, y = x0 - (y1 - y0) * away, y0 + (x1 - x0) * away
                radius = dice.real(1.8, 4.0)
                plan.trees.append(Tree(x, y, radius, radius * dice.real(2.2, 3.0)))


def _lay_ways(plan: Plan, dice: Dice, lines: _Lines) -> None:
    for path in lines.paths:
        plan.paint("rough", Stroke(path, 3.2))
        plan.paint("track", Stroke(path, 1.6))
    for track in lines.tracks:
        plan.paint("rough", Stroke(track, 5.0))
        plan.paint("ruts", Stroke(track, 3.2))
    for kind, width in (("rough", 11.0), ("gravel", 8.0), ("asphalt", 6.4)):
        plan.paint(kind, Stroke(lines.road, width))
    for index, (start, end) in enumerate(pairwise(lines.road)):
        if index % 2:
            plan.paint("marking", Stroke((start, end), 0.3))
        if dice.chance(12):
            plan.paint(dice.pick(("patch", "tar", "lane")), Stroke((start, end), dice.real(1, 4)))
        if dice.chance(14):
            _add_car(plan, dice, start, end)


def _add_car(plan: Plan, dice: Dice, start: Point, end: Point) -> None:
    along = end[0] - start[0], end[1] - start[1]
    length = float(np.sqrt(along[0] * along[0] + along[1] * along[1]))
    frame = Frame(*start, along[0] / length, along[1] / length).at(0, dice.pick((-1.6, 1.6)))
    plan.paint("car", square(frame, 2.2, 0.9), dice.integer(0, 99), season=dice.integer(1, 2))


def _apart(trees: list[Tree], lines: _Lines, side_m: float) -> list[Tree]:
    """Trees inside the region that stand neither on ways, in water nor in a yard."""
    x, y = (np.array([getattr(tree, axis) for tree in trees]) for axis in "xy")
    keep = (x > 3) & (x < side_m - 3) & (y > 3) & (y < side_m - 3)
    keep &= distance_to_line(x, y, lines.road) > 6.5
    keep &= distance_to_line(x, y, lines.stream) > 4.0
    for track in lines.tracks + lines.paths:
        keep &= distance_to_line(x, y, track) > 3.4
    for frame, half in ((lines.pond, lines.pond_half), *((f, YARD_M) for f in lines.farms)):
        u, v = frame.to_local(x, y)
        u, v = u / (half[0] + 3), v / (half[1] + 3)
        yard = half == YARD_M
        keep &= (u * u + v * v > 1.0) | (yard & (u * u > 0.45) & (v * v < 0.5))
    return [tree for tree, kept in zip(trees, keep.tolist(), strict=True) if kept]


def _single_trees(dice: Dice, plan: Plan, lines: _Lines, side_m: float) -> list[Tree]:
    """Trees alone in the fields, and in rows along the road."""
    trees = []
    for _ in range(70):
        radius = dice.real(2.2, 5.0)
        trees.append(
            Tree(
                dice.real(9, side_m - 9),
                dice.real(9, side_m - 9),
                radius,
                radius * dice.real(2, 2.6),
            )
        )
    for start, end in pairwise(lines.road):
        if dice.chance(40):
            away = dice.pick((-1, 1)) * 0.75
            x, y = start[0] - (end[1] - start[1]) * away, start[1] + (end[0] - start[0]) * away
            trees.append(Tree(x, y, dice.real(2, 3), dice.real(7, 9)))
    return [replace(tree) for tree in _apart(trees, lines, side_m)]

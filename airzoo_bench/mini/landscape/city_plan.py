"""The layout of the city: a canal between two districts, streets, and blocks between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape import terrain
from airzoo_bench.mini.landscape.city_blocks import fill_block
from airzoo_bench.mini.landscape.plan import Plan, Tree, square
from airzoo_bench.mini.landscape.randomness import Dice, direction
from airzoo_bench.mini.landscape.shapes import (
    Frame,
    Point,
    Rect,
    Stroke,
    bend,
    distance_to_line,
)
from airzoo_bench.mini.landscape.site import Site

__all__ = ["city_plan"]

_STREAM = 11
_WIDTHS = (20.0, 18.0, 14.0, 12.0, 9.0, 8.0, 7.0, 7.0)
_WATER_M, _STREET_M = 35.5, 41.0
_BANK_M = 24.0


@dataclass
class _District:
    frame: Frame
    side: int
    blocks: list[Rect] = field(default_factory=list)
    streets: list[Rect] = field(default_factory=list)  # u along the street


def city_plan(seed: int, side_m: float) -> Plan:
    """Lay out the city.

    Parameters
    ----------
    seed : int
    side_m : float

    Returns
    -------
    Plan
    """
    dice = Dice(seed, _STREAM)
    canal = _canal(dice, side_m)
    bridges = _bridges(dice, canal)
    plan = Plan(seed, _heights(seed, side_m, canal, bridges), divide=canal)
    turn = dice.integer(2, 22)
    for side, step in ((1, turn), (2, turn - dice.integer(10, 30))):
        frame = Frame(side_m / 2, side_m / 2, *direction(step))
        district = _District(frame, side)
        _split(dice, district, (-420.0, 420.0, -420.0, 420.0), 0)
        _lay_streets(plan, dice, district, side_m)
        site = Site(plan, side, canal, _BANK_M + 2, frame)
        _fill_blocks(dice, site, district)
        _mark_streets(plan, dice, district)
    _lay_canal(plan, dice, canal, bridges)
    plan.trees = _apart(plan.trees, canal, bridges)
    return plan


def _canal(dice: Dice, side_m: float) -> tuple[Point, ...]:
    middle = dice.real(0.38, 0.62) * side_m
    points = [(x, middle + dice.real(-55, 55)) for x in np.linspace(-60, side_m + 60, 8).tolist()]
    return bend(tuple(points))


def _bridges(dice: Dice, canal: tuple[Point, ...]) -> list[Frame]:
    """Frames on the canal, u across it."""
    frames = []
    for share in (0.18, 0.5, 0.82):
        index = int(len(canal) * (share + dice.real(-0.06, 0.06)))
        (x0, y0), (x1, y1) = canal[index], canal[index + 1]
        length = float(np.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0)))
        frames.append(Frame(x0, y0, -(y1 - y0) / length, (x1 - x0) / length))
    return frames


def _heights(seed: int, side_m: float, canal: tuple[Point, ...], bridges: list[Frame]) -> Floats:
    land = _STREET_M + terrain.rolling(seed, 10, side_m, {120: 10, 60: 4, 20: 2}, 7.0)
    distance = terrain.near_line(side_m, canal)
    level = terrain.blended(land, distance, _STREET_M, 20.0, 90.0)
    carved = terrain.blended(level, distance, _WATER_M, 10.5, 16.0)
    for frame in bridges:
        carved = np.where(terrain.inside(frame, side_m, 24.0, 9.0), level, carved)
    return carved


def _split(
    dice: Dice, district: _District, box: tuple[float, float, float, float], depth: int
) -> None:
    u0, u1, v0, v1 = box
    wide, high = u1 - u0, v1 - v0
    if max(wide, high) < 118 and min(wide, high) < 100:
        district.blocks.append(Rect(district.frame, u0, u1, v0, v1))
        return
    half = _WIDTHS[min(depth, len(_WIDTHS) - 1)] / 2
    share = dice.real(0.4, 0.6)
    if wide > high:
        cut = u0 + wide * share
        frame = district.frame.at(cut, (v0 + v1) / 2, turned=True)
        district.streets.append(square(frame, high / 2, half))
        parts = (u0, cut - half, v0, v1), (cut + half, u1, v0, v1)
    else:
        cut = v0 + high * share
        district.streets.append(square(district.frame.at((u0 + u1) / 2, cut), wide / 2, half))
        parts = (u0, u1, v0, cut - half), (u0, u1, cut + half, v1)
    for part in parts:
        _split(dice, district, part, depth + 1)


def _lay_streets(plan: Plan, dice: Dice, district: _District, side_m: float) -> None:
    middle = Frame(side_m / 2, side_m / 2)
    plan.paint("asphalt", square(middle, side_m, side_m), side=district.side)
    for street in district.streets:
        if street.v1 < 5:
            plan.paint("lane", street, side=district.side)
        for _ in range(int(street.u1 / 12)):
            _add_repair(plan, dice, street, district.side)


def _add_repair(plan: Plan, dice: Dice, street: Rect, side: int) -> None:
    """Add a patch of new asphalt, a trench, or a cover in the street."""
    u, v = dice.real(street.u0, street.u1), dice.real(street.v0, street.v1)
    kind = dice.pick(("patch", "patch", "tar", "concrete"))
    half_u, half_v = dice.pick(((4.0, 1.2), (1.2, 3.0), (9.0, 0.4), (0.5, 0.5), (2.0, 1.5)))
    plan.paint(kind, square(street.frame.at(u, v), half_u, half_v), side=side)


def _mark_streets(plan: Plan, dice: Dice, district: _District) -> None:
    for street in district.streets:
        if street.v1 < 4:
            continue
        key, side, frame = dice.integer(0, 8), district.side, street.frame
        plan.paint("dashes", square(frame, street.u1, 0.15), key, side=side)
        if street.v1 > 6:
            plan.paint("yellow", square(frame, street.u1, 0.3), side=side)
            for v in (-3.4, 3.4):
                plan.paint("dashes", square(frame.at(0, v), street.u1, 0.15), key, side=side)
        ends = [street.u0 + 4.0, street.u1 - 4.0, dice.real(street.u0, street.u1)]
        for u in ends:
            plan.paint(
                "crossing",
                Rect(frame, u - 1.6, u + 1.6, street.v0 + 0.6, street.v1 - 0.6),
                side=side,
            )
            plan.paint("marking", Rect(frame, u + 2.4, u + 2.9, street.v0 + 0.6, -0.3), side=side)
        _add_traffic(plan, dice, street, side)


def _add_traffic(plan: Plan, dice: Dice, street: Rect, side: int) -> None:
    for season in (1, 2):
        for _ in range(int(street.u1 / 14)):
            u, lane = dice.real(street.u0, street.u1), dice.pick((-1, 1))
            v = lane * dice.pick((1.8, street.v1 - 1.3))
            long = dice.pick((2.2, 2.2, 2.2, 2.5, 5.0))
            car = square(street.frame.at(u, v), long, 0.9 if long < 4 else 1.25)
            plan.paint("car", car, dice.integer(0, 99), side=side, season=season)


def _fill_blocks(dice: Dice, site: Site, district: _District) -> None:
    whole = [block for block in district.blocks if site.reaches(block)]
    by_size = sorted(range(len(whole)), key=lambda i: (not site.allows(whole[i]), -_area(whole[i])))
    chosen = dict(zip(by_size, ("sports", "park", "mall"), strict=False))
    for index, block in enumerate(whole):
        fill_block(site, dice, block, chosen.get(index))


def _area(rect: Rect) -> float:
    return (rect.u1 - rect.u0) * (rect.v1 - rect.v0)


def _lay_canal(plan: Plan, dice: Dice, canal: tuple[Point, ...], bridges: list[Frame]) -> None:
    for kind, width in (("kerb", 50.0), ("paving", 49.4), ("lane", 43.0), ("kerb", 34.0)):
        plan.paint(kind, Stroke(canal, width))
    for kind, width in (("pavement", 33.4), ("bed", 31.0), ("rough", 29.0), ("concrete", 20.5)):
        plan.paint(kind, Stroke(canal, width))
    plan.paint("water", Stroke(canal, 19.0))
    for (x0, y0), (x1, y1) in pairwise(canal):
        for share in (0.2, 0.7):
            for side in (-1, 1):
                _add_bank_tree(plan, dice, (x0, y0), (x1 - x0, y1 - y0), share, side)
    for frame in bridges:
        plan.paint("pavement", square(frame, 24.5, 8.5))
        plan.paint("asphalt", square(frame, 26.0, 6.0))
        plan.paint("dashes", square(frame, 26.0, 0.2))
        for v in (-6.1, 6.1):
            plan.paint("kerb", square(frame.at(0, v), 24.5, 0.3))
            plan.paint("crossing", square(frame.at(22.0 * v / 6.1, 0), 1.5, 5.6))


def _add_bank_tree(
    plan: Plan, dice: Dice, start: Point, along: Point, share: float, side: int
) -> None:
    length = float(np.sqrt(along[0] * along[0] + along[1] * along[1]))
    off = side * (15.6 if dice.chance(70) else 23.4) / length
    share += dice.real(-0.15, 0.15)
    x = start[0] + along[0] * share - along[1] * off
    y = start[1] + along[1] * share + along[0] * off
    plan.trees.append(Tree(x, y, dice.real(1.8, 3.4), dice.real(5.5, 8.5)))


def _apart(trees: list[Tree], canal: tuple[Point, ...], bridges: list[Frame]) -> list[Tree]:
    """Trees that stand neither in the canal nor on a bridge."""
    x, y = (np.array([getattr(tree, axis) for tree in trees]) for axis in "xy")
    keep = distance_to_line(x, y, canal) > 15.0
    for frame in bridges:
        u, v = frame.to_local(x, y)
        keep &= (np.abs(u) > 30) | (np.abs(v) > 10.5)
    return [tree for tree, kept in zip(trees, keep.tolist(), strict=True) if kept]

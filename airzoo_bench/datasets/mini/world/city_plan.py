"""The layout of the city: a canal between two districts, streets, and blocks between them."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice, direction
from airzoo_bench.datasets.mini.world.city_blocks import fill_block
from airzoo_bench.datasets.mini.world.city_site import Site, anywhere
from airzoo_bench.datasets.mini.world.model import SIDE_M
from airzoo_bench.datasets.mini.world.plan import Plan
from airzoo_bench.datasets.mini.world.shapes import (
    Frame,
    Line,
    Point,
    Rect,
    Stroke,
    bend,
    distance,
    distance_to_line,
    square,
)
from airzoo_bench.datasets.mini.world.terrain import LAND_X, LAND_Y, blended, rolling
from airzoo_bench.geometry.arrays import Floats

__all__ = ["city_plan"]

_STREAM = 11
_WIDTHS = (20.0, 18.0, 14.0, 12.0, 9.0, 8.0, 7.0, 7.0)
_WATER_M, _STREET_M = 35.5, 41.0


def city_plan(seed: int) -> Plan:
    """Lay out the city."""
    dice = Dice(seed, _STREAM)
    middle = dice.real(0.38, 0.62) * SIDE_M
    along = np.linspace(-60, SIDE_M + 60, 8).tolist()
    canal = bend(tuple((x, middle + dice.real(-55, 55)) for x in along))
    bridges = _bridges(dice, canal)
    plan = Plan(seed, _heights(seed, canal, bridges), divide=canal)
    turn = dice.integer(2, 22)
    for side, step in ((1, turn), (2, turn - dice.integer(10, 30))):
        site = Site(plan, side, Frame(SIDE_M / 2, SIDE_M / 2, *direction(step)))
        _split(dice, site, (-420.0, 420.0, -420.0, 420.0), 0)
        _lay_streets(dice, site)
        _fill_blocks(dice, site)
        _mark_streets(dice, site)
    _lay_canal(plan, dice, bridges)
    x, y = plan.tree_places()
    dry = distance_to_line(x, y, canal) > 15.0
    for frame in bridges:
        u, v = frame.to_local(x, y)
        dry &= (np.abs(u) > 30) | (np.abs(v) > 10.5)
    plan.keep_trees(dry)
    return plan


def _bridges(dice: Dice, canal: Line) -> list[Frame]:
    """Frames on the canal, u across it."""
    frames = []
    for share in (0.18, 0.5, 0.82):
        index = int(len(canal) * (share + dice.real(-0.06, 0.06)))
        frames.append(Frame.along(canal[index], canal[index + 1]).at(0, 0, turned=True))
    return frames


def _heights(seed: int, canal: Line, bridges: list[Frame]) -> Floats:
    land = _STREET_M + rolling(seed, 10, {120: 10, 60: 4, 20: 2}, 7.0)
    away = distance_to_line(LAND_X, LAND_Y, canal)
    level = blended(land, away, _STREET_M, 20.0, 90.0)
    carved = blended(level, away, _WATER_M, 10.5, 16.0)
    for frame in bridges:
        u, v = frame.to_local(LAND_X, LAND_Y)
        carved = np.where((np.abs(u) <= 24.0) & (np.abs(v) <= 9.0), level, carved)
    return carved


def _split(dice: Dice, site: Site, box: tuple[float, float, float, float], depth: int) -> None:
    """Divide a box into blocks by streets."""
    u0, u1, v0, v1 = box
    wide, high = u1 - u0, v1 - v0
    if max(wide, high) < 118 and min(wide, high) < 100:
        site.blocks.append(Rect(site.axes, *box))
        return
    half = _WIDTHS[min(depth, len(_WIDTHS) - 1)] / 2
    share = dice.real(0.4, 0.6)
    if wide > high:
        cut = u0 + wide * share
        street = square(site.axes.at(cut, (v0 + v1) / 2, turned=True), high / 2, half)
        parts = (u0, cut - half, v0, v1), (cut + half, u1, v0, v1)
    else:
        cut = v0 + high * share
        street = square(site.axes.at((u0 + u1) / 2, cut), wide / 2, half)
        parts = (u0, u1, v0, cut - half), (u0, u1, cut + half, v1)
    site.streets.append(street)
    for part in parts:
        _split(dice, site, part, depth + 1)


def _lay_streets(dice: Dice, site: Site) -> None:
    """Pave the district, with patches of new asphalt, trenches and covers in its streets."""
    site.paint("asphalt", square(Frame(SIDE_M / 2, SIDE_M / 2), SIDE_M, SIDE_M))
    for street in site.streets:
        if street.v1 < 5:
            site.paint("lane", street)
        for _ in range(int(street.u1 / 12)):
            spot = anywhere(dice, street)
            kind = dice.pick(("patch", "patch", "tar", "concrete"))
            half = dice.pick(((4.0, 1.2), (1.2, 3.0), (9.0, 0.4), (0.5, 0.5), (2.0, 1.5)))
            site.paint(kind, square(spot, *half))


def _fill_blocks(dice: Dice, site: Site) -> None:
    """Fill the blocks, the largest of those that may be built on with what needs room."""
    seen = [block for block in site.blocks if site.reaches(block)]
    by_size = sorted(seen, key=lambda block: (not site.allows(block), -block.long * block.deep))
    chosen = dict(zip(by_size, ("sports", "park", "mall"), strict=False))
    for block in seen:
        fill_block(site, dice, block, chosen.get(block))


def _mark_streets(dice: Dice, site: Site) -> None:
    for street in site.streets:
        if street.v1 < 4:
            continue
        key, frame = dice.integer(0, 8), street.frame
        site.paint("dashes", square(frame, street.u1, 0.15), key)
        if street.v1 > 6:
            site.paint("yellow", square(frame, street.u1, 0.3))
            for v in (-3.4, 3.4):
                site.paint("dashes", square(frame.at(0, v), street.u1, 0.15), key)
        v0, v1 = street.v0 + 0.6, street.v1 - 0.6
        for u in (street.u0 + 4.0, street.u1 - 4.0, dice.real(street.u0, street.u1)):
            site.paint("crossing", Rect(frame, u - 1.6, u + 1.6, v0, v1))
            site.paint("marking", Rect(frame, u + 2.4, u + 2.9, v0, -0.3))
        _add_traffic(dice, site, street)


def _add_traffic(dice: Dice, site: Site, street: Rect) -> None:
    for season in (1, 2):
        for _ in range(int(street.u1 / 14)):
            u, lane = dice.real(street.u0, street.u1), dice.pick((-1, 1))
            v = lane * dice.pick((1.8, street.v1 - 1.3))
            long = dice.pick((2.2, 2.2, 2.2, 2.5, 5.0))
            car = square(street.frame.at(u, v), long, 0.9 if long < 4 else 1.25)
            site.paint("car", car, dice.integer(0, 99), season)


def _lay_canal(plan: Plan, dice: Dice, bridges: list[Frame]) -> None:
    for kind, width in (("kerb", 50.0), ("paving", 49.4), ("lane", 43.0), ("kerb", 34.0)):
        plan.paint(kind, Stroke(plan.divide, width))
    for kind, width in (("pavement", 33.4), ("bed", 31.0), ("rough", 29.0), ("concrete", 20.5)):
        plan.paint(kind, Stroke(plan.divide, width))
    plan.paint("water", Stroke(plan.divide, 19.0))
    for ends in pairwise(plan.divide):
        for share, side in product((0.2, 0.7), (-1, 1)):
            _add_bank_tree(plan, dice, ends, share, side)
    for frame in bridges:
        plan.paint("pavement", square(frame, 24.5, 8.5))
        plan.paint("asphalt", square(frame, 26.0, 6.0))
        plan.paint("dashes", square(frame, 26.0, 0.2))
        for v in (-6.1, 6.1):
            plan.paint("kerb", square(frame.at(0, v), 24.5, 0.3))
            plan.paint("crossing", square(frame.at(22.0 * v / 6.1, 0), 1.5, 5.6))


def _add_bank_tree(
    plan: Plan, dice: Dice, ends: tuple[Point, Point], share: float, side: int
) -> None:
    (x0, y0), (x1, y1) = ends
    off = side * (15.6 if dice.chance(70) else 23.4) / distance(*ends)
    share += dice.real(-0.15, 0.15)
    place = x0 + (x1 - x0) * share - (y1 - y0) * off, y0 + (y1 - y0) * share + (x1 - x0) * off
    plan.plant(place, dice.real(1.8, 3.4), dice.real(5.5, 8.5))

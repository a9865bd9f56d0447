"""What is open in the city: yards, parking lots, parks, sports fields."""

from __future__ import annotations

import numpy as np

from airzoo_bench.mini.landscape.plan import square
from airzoo_bench.mini.landscape.randomness import Dice
from airzoo_bench.mini.landscape.shapes import Ellipse, Frame, Rect, Stroke, bend, steps
from airzoo_bench.mini.landscape.site import Site

__all__ = ["fill_yard", "park", "park_cars", "scatter_trees", "sports", "store"]


def park_cars(site: Site, dice: Dice, lot: Rect) -> None:
    """Mark stalls in rows, and leave cars on some of them, others in each season."""
    site.paint("parking", lot)
    rows = max(round((lot.v1 - lot.v0) / 16.0), 1)
    high = (lot.v1 - lot.v0) / rows
    stalls = int((lot.u1 - lot.u0) / 2.75)
    for season in (1, 2):
        share = dice.integer(30, 75)
        for row in range(rows):
            for end in (2.4, high - 2.4):
                for stall in range(stalls):
                    if dice.chance(share):
                        v = lot.v0 + row * high + end + dice.real(-0.3, 0.3)
                        u = _stall_middle(lot, stall)
                        car = square(
                            lot.frame.at(u, v, turned=True), dice.pick((2.0, 2.2, 2.4)), 0.9
                        )
                        site.paint("car", car, dice.integer(0, 99), season)


def _stall_middle(lot: Rect, stall: int) -> float:
    first = float(np.floor(lot.u0 / 2.75) + 1) * 2.75
    return first + stall * 2.75 + 1.5 if first + stall * 2.75 + 2.5 < lot.u1 else lot.u1 - 1.5


def store(site: Site, dice: Dice, yard: Rect) -> None:
    """Strew crates and heaps in the open."""
    for _ in range(24):
        spot = yard.frame.at(
            dice.real(yard.u0, yard.u1), dice.real(yard.v0, yard.v1), turned=dice.chance(50)
        )
        kind = dice.pick(("car", "rubbish", "wood", "sand", "tar"))
        half = dice.pick(((3.0, 1.2), (1.5, 1.2), (2.2, 0.9)))
        site.paint(kind, square(spot, *half), dice.integer(0, 99), dice.integer(0, 2))


def park(site: Site, dice: Dice, lot: Rect) -> None:
    """Lay out lawns, winding paths, a pond and many trees."""
    site.paint("meadow", lot)
    middle = lot.frame.at((lot.u0 + lot.u1) / 2, (lot.v0 + lot.v1) / 2)
    half_u, half_v = (lot.u1 - lot.u0) / 2, (lot.v1 - lot.v0) / 2
    for _ in range(7):
        u, v = dice.real(-0.8, 0.8) * half_u, dice.real(-0.8, 0.8) * half_v
        glade = Ellipse(middle.at(u, v), dice.real(8, 20), dice.real(6, 14))
        site.paint(dice.pick(("lawn", "lawn", "rough")), glade)
    for _ in range(4):
        start, end = dice.real(-0.9, 0.9), dice.real(-0.9, 0.9)
        bends = [(start * half_u, -half_v), (dice.real(-0.8, 0.8) * half_u, dice.real(-9, 9))]
        bends += [(dice.real(-0.8, 0.8) * half_u, half_v / 2), (end * half_u, half_v)]
        points = bend(tuple(middle.to_world(u, v) for u, v in bends))
        site.paint("kerb", Stroke(points, 3.0))
        site.paint("gravel", Stroke(points, 2.4))
    for _ in range(5):
        u, v = dice.real(-0.8, 0.8) * half_u, dice.real(-0.8, 0.8) * half_v
        bed = Ellipse(middle.at(u, v), dice.real(2.5, 7), dice.real(2, 4))
        site.paint("flowers", bed, dice.integer(0, 9))
    pond = middle.at(dice.real(-0.4, 0.4) * half_u, dice.real(-0.4, 0.4) * half_v)
    long, deep = dice.real(11, 17), dice.real(7, 11)
    bay = pond.at(long * 0.7, deep * 0.6)
    for kind, grown in (("paving", 4.0), ("shore", 2.0), ("water", 0.0)):
        site.paint(kind, Ellipse(bay, long * 0.6 + grown, deep * 0.8 + grown))
        site.paint(kind, Ellipse(pond, long + grown, deep + grown))
        if kind == "water":
            site.paint("water", Ellipse(bay, long * 0.6, deep * 0.8))
    scatter_trees(site, dice, lot, int(half_u * half_v / 22), clear=(pond, 21.0))


def sports(site: Site, dice: Dice, lot: Rect) -> None:
    """Lay out a running track around a pitch, courts, and a gymnasium where there is room."""
    site.paint("plates", lot, dice.integer(0, 999))
    turned = lot.v1 - lot.v0 > lot.u1 - lot.u0
    middle = lot.frame.at((lot.u0 + lot.u1) / 2, (lot.v0 + lot.v1) / 2, turned=turned)
    half_u, half_v = (lot.u1 - lot.u0) / 2, (lot.v1 - lot.v0) / 2
    half_u, half_v = max(half_u, half_v), min(half_u, half_v)
    radius = min(half_v - 12.0, 34.0)
    centre = middle.at(0, half_v - radius - 1.5)
    reach = half_u - radius - 1.5
    ends = centre.to_world(-reach, 0), centre.to_world(reach, 0)
    site.paint("running_track", Stroke(ends, 2 * radius))
    pitch = square(centre, reach + radius * 0.3, radius - 11.0)
    site.paint("pitch", pitch)
    for place in range(int(half_u * 2 / 29)):
        court = middle.at(-half_u + 15 + 29 * place, -half_v + 9.5)
        site.paint("court_marked", square(court, 13.5, 7.5), place)
    for u in steps(-half_u + 3, half_u, 7.0):
        site.plant(dice, middle.at(u, -half_v + 1), 1.8)


def fill_yard(site: Site, dice: Dice, yard: Rect) -> None:
    """Strew beds, sheds and trees over a yard."""
    for _ in range(int(_area(yard) / 120)):
        spot = yard.frame.at(dice.real(yard.u0, yard.u1), dice.real(yard.v0, yard.v1))
        kind = dice.pick(("lawn", "flowers", "gravel", "beds", "concrete", "court"))
        site.paint(
            kind, square(spot, dice.real(1.5, 5.0), dice.real(1.5, 4.0)), dice.integer(0, 99)
        )
    scatter_trees(site, dice, yard, max(int(_area(yard) / 90), 1))


def scatter_trees(
    site: Site, dice: Dice, lot: Rect, count: int, clear: tuple[Frame, float] | None = None
) -> None:
    """Plant trees anywhere in a lot, but not within a distance of a point."""
    for _ in range(count):
        spot = lot.frame.at(dice.real(lot.u0 + 2, lot.u1 - 2), dice.real(lot.v0 + 2, lot.v1 - 2))
        if clear is not None:
            u, v = spot.x - clear[0].x, spot.y - clear[0].y
            if u * u + v * v < clear[1] * clear[1]:
                continue
        site.plant(dice, spot, 2.6, dice.pick(("broad", "broad", "broad", "cone", "bush")))


def _area(rect: Rect) -> float:
    return max(rect.u1 - rect.u0, 0.0) * max(rect.v1 - rect.v0, 0.0)

"""Convex parcels of land, and what they are used for: fields, meadows, orchards, woods."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice, direction
from airzoo_bench.datasets.mini.world.plan import Plan
from airzoo_bench.datasets.mini.world.shapes import (
    Frame,
    Line,
    Point,
    Polygon,
    distance,
    distance_to_line,
    edges,
    square,
    steps,
)

__all__ = ["parcels", "use_parcel"]

_VALLEY_M = 75.0


def parcels(dice: Dice, outline: Line, largest_m2: float) -> list[Polygon]:
    """Cut a convex polygon, counter-clockwise, until each part is small enough, some smaller."""
    x, y = middle = _middle(outline)
    longest = Frame.along(*max(edges(outline), key=lambda edge: distance(*edge)))
    frame = Frame(*middle, longest.cosine, longest.sine)
    size = _area(outline)
    if size < largest_m2 * dice.real(0.45, 1.0):
        return [Polygon(outline, frame)]
    # Roughly across the longest edge, near the middle.
    cosine, sine = direction(dice.integer(-9, 9))
    along = (-frame.sine * cosine - frame.cosine * sine, frame.cosine * cosine - frame.sine * sine)
    if dice.chance(18):
        along = (-along[1], along[0])
    off = dice.real(-0.16, 0.16) * math.sqrt(size)
    point = (x + along[1] * off, y - along[0] * off)
    halves = _half(outline, point, along), _half(outline, point, (-along[0], -along[1]))
    return [part for half in halves for part in parcels(dice, half, largest_m2)]


def _half(outline: Line, point: Point, along: Point) -> Line:
    """Return the part of a convex polygon left of a line (Sutherland and Hodgman, 1974)."""
    kept: list[Point] = []
    for start, end in edges(outline):
        a, b = (
            along[0] * (at[1] - point[1]) - along[1] * (at[0] - point[0]) for at in (start, end)
        )
        if a >= 0:
            kept.append(start)
        if (a >= 0) != (b >= 0):
            kept.append(_between(start, end, a / (a - b)))
    return tuple(kept)


def _between(start: Point, end: Point, share: float) -> Point:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def _area(outline: Line) -> float:
    # Not sum(): newer Pythons add floats with a correction.
    twice = 0.0
    for a, b in edges(outline):
        twice += a[0] * b[1] - b[0] * a[1]
    return twice / 2


def _middle(outline: Line) -> Point:
    x, y = 0.0, 0.0
    for point in outline:
        x, y = x + point[0], y + point[1]
    return x / len(outline), y / len(outline)


def _shrunk(polygon: Polygon, margin_m: float) -> Polygon:
    """Return a polygon shrunk towards its middle by about a margin."""
    middle = _middle(polygon.points)
    share = max(1.0 - margin_m / (0.5 * math.sqrt(_area(polygon.points)) + 1e-9), 0.1)
    return Polygon(tuple(_between(middle, p, share) for p in polygon.points), polygon.frame)


def use_parcel(plan: Plan, dice: Dice, parcel: Polygon, stream: Line) -> None:
    """Paint a parcel and plant what grows on it; the valley is terraced for rice."""
    plan.paint("rough", parcel)
    x, y = np.array([_middle(parcel.points)]).T
    near = float(distance_to_line(x, y, stream)[0])
    inner = _shrunk(parcel, dice.real(1.2, 3.0))
    if near < _VALLEY_M and dice.chance(75):
        plan.paint("terraces", inner, dice.integer(0, 1 << 14))
    else:
        use = dice.integer(0, 99)
        if use < 24:
            _grow_wood(plan, dice, parcel)
        elif use < 34:
            _grow_meadow(plan, dice, inner)
        elif use < 42:
            _grow_orchard(plan, dice, inner)
        else:
            _grow_field(plan, dice, inner)
    _add_hedges(plan, dice, parcel)


def _grow_field(plan: Plan, dice: Dice, inner: Polygon) -> None:
    key = dice.integer(0, 1 << 14)
    plan.paint("field", inner, key)
    if dice.chance(25):
        plan.paint("worn", inner, dice.integer(0, 3))
    if key % 9 in (4, 7):
        for place in _grid(dice, _shrunk(inner, 8.0), 13.0, 17.0):
            if dice.chance(70):
                plan.plant(place, 0.85, 1.4, "bale")


def _grow_meadow(plan: Plan, dice: Dice, inner: Polygon) -> None:
    plan.paint("meadow", inner)
    plan.paint("worn", inner, dice.integer(0, 3))
    for place in _grid(dice, inner, 22.0, 25.0):
        if dice.chance(35):
            radius = dice.real(1.0, 3.2)
            plan.plant(place, radius, radius * 2.2, dice.pick(("broad", "bush")))


def _grow_orchard(plan: Plan, dice: Dice, inner: Polygon) -> None:
    plan.paint("meadow", inner)
    gap = dice.real(5.5, 7.5)
    for place in _grid(dice, inner, gap, gap * 0.8, jitter=0.08):
        if dice.chance(93):
            spot = Frame(*place, inner.frame.cosine, inner.frame.sine)
            plan.paint("soil", square(spot, 1.2, 1.2))
            plan.plant(place, dice.real(1.2, 1.7), dice.real(2.6, 3.4), "bush")


def _grow_wood(plan: Plan, dice: Dice, parcel: Polygon) -> None:
    plan.paint("litter", parcel)
    share = dice.integer(80, 95)
    conifers = dice.pick((0, 10, 60))
    for place in _grid(dice, parcel, 5.6, 5.6, jitter=0.42):
        if dice.chance(share):
            if dice.chance(conifers):
                plan.plant(place, dice.real(1.8, 2.8), dice.real(8, 14), "cone")
            else:
                plan.plant(place, dice.real(2.2, 4.0), dice.real(7.5, 13.0))


def _grid(
    dice: Dice, polygon: Polygon, gap_u: float, gap_v: float, jitter: float = 0.25
) -> Iterator[Point]:
    """Points of a grid along a polygon's axes, each moved a little, inside it."""
    frame = polygon.frame
    u, v = frame.to_local(*np.array(polygon.points).T)
    columns = steps(float(u.min()) + gap_u / 2, float(u.max()), gap_u)
    rows = steps(float(v.min()) + gap_v / 2, float(v.max()), gap_v)
    for a, b in product(columns, rows):
        off_u, off_v = dice.real(-jitter, jitter), dice.real(-jitter, jitter)
        x, y = frame.to_world(a + off_u * gap_u, b + off_v * gap_v)
        if all(
            (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0)
            for (x0, y0), (x1, y1) in edges(polygon.points)
        ):
            yield x, y


def _add_hedges(plan: Plan, dice: Dice, parcel: Polygon) -> None:
    """Bushes, now and then a tree, along some edges; small parcels have fewer."""
    for start, end in edges(parcel.points):
        if not dice.chance(26 if _area(parcel.points) > 3000 else 12):
            continue
        length = distance(start, end)
        along = dice.real(1.0, 4.0)
        while along < length:
            x, y = _between(start, end, along / length)
            place = x + dice.real(-0.5, 0.5), y + dice.real(-0.5, 0.5)
            if dice.chance(9):
                plan.plant(place, dice.real(2, 3.4), dice.real(6, 9))
            elif dice.chance(90):
                plan.plant(place, dice.real(1.1, 1.8), dice.real(1.8, 3.0), "bush")
            along += dice.real(1.9, 3.0)

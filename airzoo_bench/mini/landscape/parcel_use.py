"""What a parcel of land is used for: fields, meadows, orchards, woods."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from airzoo_bench.mini.landscape.parcels import area, edges, middle, shrunk
from airzoo_bench.mini.landscape.plan import Plan, Tree, square
from airzoo_bench.mini.landscape.randomness import Dice
from airzoo_bench.mini.landscape.shapes import Point, Polygon, distance_to_line, steps

__all__ = ["use_parcel"]

_VALLEY_M = 75.0


def use_parcel(plan: Plan, dice: Dice, parcel: Polygon, stream: tuple[Point, ...]) -> None:
    """Paint a parcel and plant what grows on it; the valley is terraced for rice."""
    plan.paint("rough", parcel)
    x, y = middle(parcel.points)
    near = float(distance_to_line(np.array([x]), np.array([y]), stream)[0])
    inner = shrunk(parcel, dice.real(1.2, 3.0))
    if near < _VALLEY_M and dice.chance(75):
        plan.paint("terraces", inner, dice.integer(0, 1 << 14))
    else:
        use = dice.integer(0, 99)
        if use < 24:
            _wood(plan, dice, parcel)
        elif use < 34:
            _meadow(plan, dice, inner)
        elif use < 42:
            _orchard(plan, dice, inner)
        else:
            _field(plan, dice, inner)
    _hedges(plan, dice, parcel)


def _field(plan: Plan, dice: Dice, inner: Polygon) -> None:
    key = dice.integer(0, 1 << 14)
    plan.paint("field", inner, key)
    if dice.chance(25):
        plan.paint("worn", inner, dice.integer(0, 3))
    if key % 9 in (4, 7):
        for x, y in _grid(dice, shrunk(inner, 8.0), 13.0, 17.0):
            if dice.chance(70):
                plan.trees.append(Tree(x, y, 0.85, 1.4, "bale"))


def _meadow(plan: Plan, dice: Dice, inner: Polygon) -> None:
    plan.paint("meadow", inner)
    plan.paint("worn", inner, dice.integer(0, 3))
    for x, y in _grid(dice, inner, 22.0, 25.0):
        if dice.chance(35):
            radius = dice.real(1.0, 3.2)
            plan.trees.append(Tree(x, y, radius, radius * 2.2, dice.pick(("broad", "bush"))))


def _orchard(plan: Plan, dice: Dice, inner: Polygon) -> None:
    plan.paint("meadow", inner)
    gap = dice.real(5.5, 7.5)
    for x, y in _grid(dice, inner, gap, gap * 0.8, jitter=0.08):
        if dice.chance(93):
            frame = inner.frame
            plan.paint("soil", square(type(frame)(x, y, frame.cosine, frame.sine), 1.2, 1.2))
            plan.trees.append(Tree(x, y, dice.real(1.2, 1.7), dice.real(2.6, 3.4), "bush"))


def _wood(plan: Plan, dice: Dice, parcel: Polygon) -> None:
    plan.paint("litter", parcel)
    share = dice.integer(80, 95)
    conifers = dice.pick((0, 10, 60))
    for x, y in _grid(dice, parcel, 5.6, 5.6, jitter=0.42):
        if dice.chance(share):
            if dice.chance(conifers):
                plan.trees.append(Tree(x, y, dice.real(1.8, 2.8), dice.real(8, 14), "cone"))
            else:
                radius = dice.real(2.2, 4.0)
                plan.trees.append(Tree(x, y, radius, dice.real(7.5, 13.0)))


def _grid(
    dice: Dice, polygon: Polygon, gap_u: float, gap_v: float, jitter: float = 0.25
) -> Iterator[Point]:
    """Points of a grid along a polygon's axes, each moved a little, inside it."""
    frame = polygon.frame
    x, y = np.array(polygon.points).T
    u, v = frame.to_local(x, y)
    for a in steps(float(u.min()) + gap_u / 2, float(u.max()), gap_u):
        for b in steps(float(v.min()) + gap_v / 2, float(v.max()), gap_v):
            off_u, off_v = dice.real(-jitter, jitter), dice.real(-jitter, jitter)
            point = frame.to_world(a + off_u * gap_u, b + off_v * gap_v)
            if _holds(polygon, point):
                yield point


def _holds(polygon: Polygon, point: Point) -> bool:
    return all(
        (b[0] - a[0]) * (point[1] - a[1]) > (b[1] - a[1]) * (point[0] - a[0])
        for a, b in edges(polygon.points)
    )


def _hedges(plan: Plan, dice: Dice, parcel: Polygon) -> None:
    """Bushes, now and then a tree, along some edges; small parcels have fewer."""
    for (x0, y0), (x1, y1) in edges(parcel.points):
        if not dice.chance(26 if area(parcel.points) > 3000 else 12):
            continue
        length = float(np.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0)))
        along = dice.real(1.0, 4.0)
        while along < length:
            share = along / length
            x = x0 + share * (x1 - x0) + dice.real(-0.5, 0.5)
            y = y0 + share * (y1 - y0) + dice.real(-0.5, 0.5)
            if dice.chance(9):
                plan.trees.append(Tree(x, y, dice.real(2, 3.4), dice.real(6, 9)))
            elif dice.chance(90):
                plan.trees.append(Tree(x, y, dice.real(1.1, 1.8), dice.real(1.8, 3.0), "bush"))
            along += dice.real(1.9, 3.0)

"""Cutting land into convex parcels."""

from __future__ import annotations

import math

from airzoo_bench.mini.landscape.randomness import Dice, direction
from airzoo_bench.mini.landscape.shapes import Frame, Point, Polygon

__all__ = ["area", "edges", "middle", "parcels", "shrunk"]

Points = tuple[Point, ...]


def parcels(dice: Dice, outline: Points, largest_m2: float) -> list[Polygon]:
    """Cut a convex polygon until each part is small enough, some of them smaller.

    Parameters
    ----------
    dice : Dice
    outline : points, counter-clockwise
    largest_m2 : float

    Returns
    -------
    list of Polygon
        Each with axes along its longest edge.
    """
    size = area(outline)
    if size < largest_m2 * dice.real(0.45, 1.0):
        return [Polygon(outline, _along_longest(outline))]
    first, second = _cut(dice, outline)
    return parcels(dice, first, largest_m2) + parcels(dice, second, largest_m2)


def _cut(dice: Dice, outline: Points) -> tuple[Points, Points]:
    """Cut roughly across the longest edge, near the middle."""
    frame = _along_longest(outline)
    cosine, sine = direction(dice.integer(-9, 9))
    along = (-frame.sine * cosine - frame.cosine * sine, frame.cosine * cosine - frame.sine * sine)
    if dice.chance(18):
        along = (-along[1], along[0])
    x, y = middle(outline)
    off = dice.real(-0.16, 0.16) * math.sqrt(area(outline))
    point = (x + along[1] * off, y - along[0] * off)
    return _half(outline, point, along), _half(outline, point, (-along[0], -along[1]))


def _half(outline: Points, point: Point, along: Point) -> Points:
    """Return the part of a convex polygon left of a line (Sutherland and Hodgman, 1974)."""
    kept: list[Point] = []
    for start, end in edges(outline):
        a, b = _left(start, point, along), _left(end, point, along)
        if a >= 0:
            kept.append(start)
        if (a >= 0) != (b >= 0):
            share = a / (a - b)
            kept.append(
                (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
            )
    return tuple(kept)


def _left(at: Point, point: Point, along: Point) -> float:
    return along[0] * (at[1] - point[1]) - along[1] * (at[0] - point[0])


def edges(outline: Points) -> list[tuple[Point, Point]]:
    """Return the edges of a polygon."""
    return list(zip(outline, outline[1:] + outline[:1], strict=True))


def area(outline: Points) -> float:
    """Return the area of a polygon, counter-clockwise."""
    # Not sum(): newer Pythons add floats with a correction.
    twice = 0.0
    for a, b in edges(outline):
        twice += a[0] * b[1] - b[0] * a[1]
    return twice / 2


def middle(outline: Points) -> Point:
    """Return the mean of the corners."""
    x, y = 0.0, 0.0
    for point in outline:
        x, y = x + point[0], y + point[1]
    return x / len(outline), y / len(outline)


def shrunk(polygon: Polygon, margin_m: float) -> Polygon:
    """Return it drawn towards its middle, by about a margin."""
    x, y = middle(polygon.points)
    share = max(1.0 - margin_m / (0.5 * math.sqrt(area(polygon.points)) + 1e-9), 0.1)
    points = tuple((x + share * (a - x), y + share * (b - y)) for a, b in polygon.points)
    return Polygon(points, polygon.frame)


def _along_longest(outline: Points) -> Frame:
    def square(edge: tuple[Point, Point]) -> float:
        (x0, y0), (x1, y1) = edge
        return (x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0)

    edge = max(edges(outline), key=square)
    length = math.sqrt(square(edge))
    (x0, y0), (x1, y1) = edge
    return Frame(*middle(outline), (x1 - x0) / length, (y1 - y0) / length)

"""Shapes on the ground, and the pixels of a raster that they cover."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats

Point = tuple[float, float]
Line = tuple[Point, ...]
_FAR_M = 10_000.0


class Frame(NamedTuple):
    """Axes u (of direction `cosine`, `sine`) and v (to the left of u) about a point, in metres."""

    x: float
    y: float
    cosine: float = 1.0
    sine: float = 0.0

    @classmethod
    def along(cls, start: Point, end: Point) -> Frame:
        """Return axes at a point with u towards another."""
        length = distance(start, end)
        return cls(*start, (end[0] - start[0]) / length, (end[1] - start[1]) / length)

    @property
    def origin(self) -> Point:
        """Where u and v are 0."""
        return self.x, self.y

    def to_local(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return u and v of points."""
        x, y = x - self.x, y - self.y
        return x * self.cosine + y * self.sine, y * self.cosine - x * self.sine

    def to_world(self, u: float, v: float) -> Point:
        """Return x and y of a point."""
        x = self.x + u * self.cosine - v * self.sine
        return x, self.y + u * self.sine + v * self.cosine

    def at(self, u: float, v: float, *, turned: bool = False) -> Frame:
        """Return the same axes with the origin moved, and turned left by a right angle or not."""
        turn = (-self.sine, self.cosine) if turned else (self.cosine, self.sine)
        return Frame(*self.to_world(u, v), *turn)

    def box(self, half_u: float, half_v: float) -> Rect:
        """Return a rectangle about the origin."""
        return Rect(self, -half_u, half_u, -half_v, half_v)


class Patch(NamedTuple):
    """The part of a raster that a shape may cover."""

    window: tuple[slice, slice]  # rows and columns of the raster
    mask: Bools  # (h, w): where the shape does cover it
    u: Floats  # (h, w): coordinates in the axes of the shape, in metres
    v: Floats  # (h, w)


class Raster(NamedTuple):
    """A square raster over a region, first row in the north."""

    size: int
    pixel_m: float

    def window(self, points: Line, reach: float = 0.0) -> tuple[slice, slice]:
        """Return rows and columns that may lie within reach of the box of points."""
        side = self.size * self.pixel_m
        x, y = zip(*points, strict=True)
        columns = self._span(min(x) - reach, max(x) + reach)
        return self._span(side - (max(y) + reach), side - (min(y) - reach)), columns

    def _span(self, low: float, high: float) -> slice:
        start = min(max(int(low // self.pixel_m), 0), self.size)
        return slice(start, min(max(int(high // self.pixel_m) + 2, start), self.size))

    def centres(self, rows: slice, columns: slice) -> tuple[Floats, Floats]:
        """Return x of the columns, shape (1, w), and y of the rows, shape (h, 1)."""
        x = (np.arange(columns.start, columns.stop) + 0.5) * self.pixel_m
        y = (self.size - 0.5 - np.arange(rows.start, rows.stop)) * self.pixel_m
        return x[None, :], y[:, None]


class Rect(NamedTuple):
    """A rectangle along the axes of a frame, from (u0, v0) to (u1, v1)."""

    frame: Frame
    u0: float
    u1: float
    v0: float
    v1: float

    @property
    def long(self) -> float:
        """Its length along u."""
        return self.u1 - self.u0

    @property
    def deep(self) -> float:
        """Its length along v."""
        return self.v1 - self.v0

    @property
    def middle(self) -> Frame:
        """Its axes about its middle."""
        return self.frame.at((self.u0 + self.u1) / 2, (self.v0 + self.v1) / 2)

    def corners(self) -> list[Point]:
        """Return the four corners, counter-clockwise."""
        local = ((self.u0, self.v0), (self.u1, self.v0), (self.u1, self.v1), (self.u0, self.v1))
        return [self.frame.to_world(u, v) for u, v in local]

    def grid(self, steps: int) -> list[Point]:
        """Return points at even shares of its sides, the corners among them."""
        shares = [step / steps for step in range(steps + 1)]
        local = [(self.u0 + a * self.long, self.v0 + b * self.deep) for a in shares for b in shares]
        return [self.frame.to_world(u, v) for u, v in local]

    def inset(self, margin: float) -> Rect:
        """Return it smaller by a margin on each side."""
        u0, u1, v0, v1 = self.u0 + margin, self.u1 - margin, self.v0 + margin, self.v1 - margin
        return Rect(self.frame, u0, u1, v0, v1)

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        window = raster.window(tuple(self.corners()))
        u, v = self.frame.to_local(*raster.centres(*window))
        mask = (u >= self.u0) & (u < self.u1) & (v >= self.v0) & (v < self.v1)
        return Patch(window, mask, u, v)


class Ellipse(NamedTuple):
    """An ellipse along the axes of a frame, about its origin."""

    frame: Frame
    a: float
    b: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        window = raster.window((self.frame.origin,), max(self.a, self.b))
        u, v = self.frame.to_local(*raster.centres(*window))
        return Patch(window, (u / self.a) ** 2 + (v / self.b) ** 2 < 1.0, u, v)


class Polygon(NamedTuple):
    """A convex polygon, counter-clockwise, with the axes of a frame."""

    points: Line
    frame: Frame

    def holds(self, x: Any, y: Any) -> Any:
        """Return whether it covers points, which broadcast."""
        inside: Any = True
        for (x0, y0), (x1, y1) in edges(self.points):
            inside = inside & ((x1 - x0) * (y - y0) > (y1 - y0) * (x - x0))
        return inside

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        window = raster.window(self.points)
        x, y = raster.centres(*window)
        return Patch(window, self.holds(x, y), *self.frame.to_local(x, y))


class Stroke(NamedTuple):
    """A line of a width; u of its patch is the distance from the line."""

    points: Line
    width: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        reach = self.width / 2
        rows, columns = raster.window(self.points, reach)
        away = np.full((rows.stop - rows.start, columns.stop - columns.start), _FAR_M)
        for segment in pairwise(self.points):
            near = raster.window(segment, reach)
            top, left = near[0].start - rows.start, near[1].start - columns.start
            off = distance_to_line(*raster.centres(*near), segment)
            part = away[top : top + off.shape[0], left : left + off.shape[1]]
            np.minimum(part, off, out=part)
        return Patch((rows, columns), away < reach, away, np.zeros_like(away))


Shape = Rect | Ellipse | Polygon | Stroke


def edges(outline: Line) -> list[tuple[Point, Point]]:
    """Return the edges of a polygon."""
    return list(zip(outline, outline[1:] + outline[:1], strict=True))


def distance(a: Point, b: Point) -> float:
    """Return the distance of two points."""
    x, y = b[0] - a[0], b[1] - a[1]
    return math.sqrt(x * x + y * y)


def between(start: Point, end: Point, share: float) -> Point:
    """Return the point at a share of the way from one to another."""
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def distance_to_line(x: Floats, y: Floats, points: Line) -> Floats:
    """Return the distance of points, whose x and y broadcast, from a line."""
    ends = np.array(points).reshape(-1, 2, *(1,) * x.ndim)
    (x0, y0), (along_x, along_y) = ends[:-1].swapaxes(0, 1), (ends[1:] - ends[:-1]).swapaxes(0, 1)
    length2 = along_x * along_x + along_y * along_y
    share = np.clip(((x - x0) * along_x + (y - y0) * along_y) / length2, 0.0, 1.0)
    off_x, off_y = x - x0 - share * along_x, y - y0 - share * along_y
    return np.asarray(np.sqrt((off_x * off_x + off_y * off_y).min(axis=0)))


def line_height(x: Floats, points: Line) -> Floats:
    """Return y of a line from west to east at some x; beyond its ends it goes on straight."""
    knots_x, knots_y = np.array(points).T
    slopes = (knots_y[1:] - knots_y[:-1]) / (knots_x[1:] - knots_x[:-1])
    part = np.clip(np.searchsorted(knots_x, x, side="right") - 1, 0, len(slopes) - 1)
    return np.asarray(knots_y[part] + (x - knots_x[part]) * slopes[part])


def bend(points: Line) -> Line:
    """Round the corners of a line by cutting them thrice (Chaikin, 1974); the ends stay."""
    for _ in range(3):
        cut = [points[0]]
        for (x0, y0), (x1, y1) in pairwise(points):
            cut.append((0.75 * x0 + 0.25 * x1, 0.75 * y0 + 0.25 * y1))
            cut.append((0.25 * x0 + 0.75 * x1, 0.25 * y0 + 0.75 * y1))
        points = (*cut, points[-1])
    return points


def steps(start: float, stop: float, gap: float) -> list[float]:
    """Return numbers from start up to stop, a gap apart."""
    return [start + index * gap for index in range(max(math.ceil((stop - start) / gap), 0))]

"""Shapes on the ground, and the pixels of a raster that they cover."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = [
    "Ellipse",
    "Frame",
    "Patch",
    "Point",
    "Polygon",
    "Raster",
    "Rect",
    "Shape",
    "Stroke",
    "bend",
    "distance_to_line",
    "steps",
]

Point = tuple[float, float]
_FAR_M = 10_000.0


@dataclass(frozen=True)
class Frame:
    """Axes u and v turned against east and north.

    Attributes
    ----------
    x, y : float
        The origin, in metres of the region.
    cosine, sine : float
        Direction of u; v is to its left.
    """

    x: float
    y: float
    cosine: float = 1.0
    sine: float = 0.0

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
        x, y = self.to_world(u, v)
        if turned:
            return Frame(x, y, -self.sine, self.cosine)
        return Frame(x, y, self.cosine, self.sine)


@dataclass(frozen=True)
class Raster:
    """A square raster over a region, first row in the north."""

    size: int
    pixel_m: float

    def window(self, low: Point, high: Point) -> tuple[slice, slice]:
        """Return the rows and columns whose pixel centres may lie in a box; empty if outside."""
        side = self.size * self.pixel_m
        columns = self._span(low[0], high[0])
        rows = self._span(side - high[1], side - low[1])
        return rows, columns

    def _span(self, low: float, high: float) -> slice:
        start = min(max(int(low // self.pixel_m), 0), self.size)
        return slice(start, min(max(int(high // self.pixel_m) + 2, start), self.size))

    def centres(self, rows: slice, columns: slice) -> tuple[Floats, Floats]:
        """Return x of the columns, shape (1, w), and y of the rows, shape (h, 1)."""
        x = (np.arange(columns.start, columns.stop) + 0.5) * self.pixel_m
        y = (self.size - 0.5 - np.arange(rows.start, rows.stop)) * self.pixel_m
        return x[None, :], y[:, None]


@dataclass(frozen=True, eq=False)
class Patch:
    """The part of a raster that a shape may cover.

    Attributes
    ----------
    rows, columns : slice
    mask : (h, w) bool
        Where it does.
    u, v : (h, w) float64
        Coordinates in the axes of the shape, in metres.
    """

    rows: slice
    columns: slice
    mask: Bools
    u: Floats
    v: Floats

    @property
    def window(self) -> tuple[slice, slice]:
        """Both slices, to index a raster."""
        return self.rows, self.columns


class Shape(Protocol):
    """Something that covers pixels."""

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        ...


@dataclass(frozen=True)
class Rect:
    """A rectangle along the axes of a frame, from (u0, v0) to (u1, v1)."""

    frame: Frame
    u0: float
    u1: float
    v0: float
    v1: float

    def corners(self) -> list[Point]:
        """Return the four corners, counter-clockwise."""
        local = ((self.u0, self.v0), (self.u1, self.v0), (self.u1, self.v1), (self.u0, self.v1))
        return [self.frame.to_world(u, v) for u, v in local]

    def inset(self, margin: float) -> Rect:
        """Return it smaller by a margin on each side."""
        return Rect(
            self.frame, self.u0 + margin, self.u1 - margin, self.v0 + margin, self.v1 - margin
        )

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        rows, columns = raster.window(*_box(self.corners()))
        u, v = self.frame.to_local(*raster.centres(rows, columns))
        mask = (u >= self.u0) & (u < self.u1) & (v >= self.v0) & (v < self.v1)
        return Patch(rows, columns, mask, u, v)


@dataclass(frozen=True)
class Ellipse:
    """An ellipse along the axes of a frame, about its origin."""

    frame: Frame
    a: float
    b: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        reach = max(self.a, self.b)
        x, y = self.frame.x, self.frame.y
        rows, columns = raster.window((x - reach, y - reach), (x + reach, y + reach))
        u, v = self.frame.to_local(*raster.centres(rows, columns))
        scaled_u, scaled_v = u / self.a, v / self.b
        return Patch(rows, columns, scaled_u * scaled_u + scaled_v * scaled_v < 1.0, u, v)


@dataclass(frozen=True)
class Polygon:
    """A convex polygon, counter-clockwise, with the axes of a frame."""

    points: tuple[Point, ...]
    frame: Frame

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        rows, columns = raster.window(*_box(list(self.points)))
        x, y = raster.centres(rows, columns)
        mask = np.ones((y.size, x.size), np.bool_)
        for (x0, y0), (x1, y1) in zip(self.points, self.points[1:] + self.points[:1], strict=True):
            mask &= (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0)
        u, v = self.frame.to_local(x, y)
        return Patch(rows, columns, mask, u, v)


@dataclass(frozen=True)
class Stroke:
    """A line through points, of a width; u of its patch is the distance from the line."""

    points: tuple[Point, ...]
    width: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels whose centres it covers."""
        low, high = _box(list(self.points))
        reach = self.width / 2
        rows, columns = raster.window(
            (low[0] - reach, low[1] - reach), (high[0] + reach, high[1] + reach)
        )
        x, y = raster.centres(rows, columns)
        distance = _distance_within(x, y, self.points, reach)
        return Patch(rows, columns, distance < reach, distance, np.zeros_like(distance))


def _distance_within(x: Floats, y: Floats, points: tuple[Point, ...], reach: float) -> Floats:
    """Distance of pixels to a line, `_FAR_M` where it is beyond reach of a segment's box."""
    result = np.full((y.size, x.size), _FAR_M)
    for start, end in pairwise(points):
        low, high = _box([start, end])
        columns = np.flatnonzero((x[0] > low[0] - reach) & (x[0] < high[0] + reach))
        rows = np.flatnonzero((y[:, 0] > low[1] - reach) & (y[:, 0] < high[1] + reach))
        if not columns.size or not rows.size:
            continue
        part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        distance = distance_to_line(x[:, part[1]], y[part[0]], (start, end))
        result[part] = np.minimum(result[part], distance)
    return result


def distance_to_line(x: Floats, y: Floats, points: tuple[Point, ...]) -> Floats:
    """Return the distance of points (broadcast x and y) from a line through at least two points."""
    if x.ndim == 1:
        starts, ends = np.array(points[:-1]), np.array(points[1:])
        square = _square_distance(x[:, None], y[:, None], *starts.T, *ends.T)
        return np.asarray(np.sqrt(square.min(axis=1)))
    best = np.full(np.broadcast_shapes(x.shape, y.shape), _FAR_M * _FAR_M)
    for start, end in pairwise(points):
        np.minimum(best, _square_distance(x, y, *start, *end), out=best)
    return np.asarray(np.sqrt(best))


def _square_distance(x: Floats, y: Floats, x0: Any, y0: Any, x1: Any, y1: Any) -> Floats:
    """Square of the distance from segments, by broadcasting."""
    along_x, along_y = x1 - x0, y1 - y0
    length2 = along_x * along_x + along_y * along_y
    share = np.clip(((x - x0) * along_x + (y - y0) * along_y) / length2, 0.0, 1.0)
    off_x, off_y = x - x0 - share * along_x, y - y0 - share * along_y
    return np.asarray(off_x * off_x + off_y * off_y)


def _box(points: list[Point]) -> tuple[Point, Point]:
    xs, ys = [point[0] for point in points], [point[1] for point in points]
    return (min(xs), min(ys)), (max(xs), max(ys))


def bend(points: tuple[Point, ...], rounds: int = 3) -> tuple[Point, ...]:
    """Round the corners of a line by cutting them (Chaikin, 1974); the ends stay."""
    for _ in range(rounds):
        cut = [points[0]]
        for (x0, y0), (x1, y1) in pairwise(points):
            cut.append((0.75 * x0 + 0.25 * x1, 0.75 * y0 + 0.25 * y1))
            cut.append((0.25 * x0 + 0.75 * x1, 0.25 * y0 + 0.75 * y1))
        points = (*cut, points[-1])
    return points


def steps(start: float, stop: float, gap: float) -> list[float]:
    """Return numbers from start up to stop, a gap apart.

    Not ``np.arange``, which a compiler may fuse into other roundings on other machines.
    """
    count = max(math.ceil((stop - start) / gap), 0)
    return [start + index * gap for index in range(count)]

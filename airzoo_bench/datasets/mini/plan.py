"""The layout of a region: forms on the ground, and a flat list each of decals, buildings, trees."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice, octaves
from airzoo_bench.datasets.mini.world import SIDE_M
from airzoo_bench.geometry.arrays import Bools, Floats

Point = tuple[float, float]
Line = tuple[Point, ...]
Window = tuple[slice, slice]
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
    """The part of a raster that a form may cover."""

    window: Window  # rows and columns of the raster
    mask: Bools  # (h, w): where the form does cover it
    u: Floats  # (h, w): coordinates in the axes of the form, in metres
    v: Floats  # (h, w)


class Raster(NamedTuple):
    """A square raster over a region, first row in the north."""

    size: int
    pixel_m: float

    def window(self, points: Line, reach: float = 0.0) -> Window:
        """Return rows and columns that may lie within reach of the box of points."""
        side = self.size * self.pixel_m
        x, y = zip(*points, strict=True)
        spans = []
        for low, high in ((side - max(y), side - min(y)), (min(x), max(x))):
            start = min(max(int((low - reach) // self.pixel_m), 0), self.size)
            stop = max(int((high + reach) // self.pixel_m) + 2, start)
            spans.append(slice(start, min(stop, self.size)))
        return spans[0], spans[1]

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

    def corners(self) -> Line:
        """Return the four corners, counter-clockwise."""
        local = ((self.u0, self.v0), (self.u1, self.v0), (self.u1, self.v1), (self.u0, self.v1))
        return tuple(self.frame.to_world(u, v) for u, v in local)

    def grid(self, steps: int) -> Line:
        """Return points at even shares of its sides, the corners among them."""
        shares = [step / steps for step in range(steps + 1)]
        local = [(self.u0 + a * self.long, self.v0 + b * self.deep) for a in shares for b in shares]
        return tuple(self.frame.to_world(u, v) for u, v in local)

    def inset(self, margin: float) -> Rect:
        """Return it smaller by a margin on each side."""
        u0, u1, v0, v1 = self.u0 + margin, self.u1 - margin, self.v0 + margin, self.v1 - margin
        return Rect(self.frame, u0, u1, v0, v1)

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels with a centre inside."""
        window = raster.window(self.corners())
        u, v = self.frame.to_local(*raster.centres(*window))
        mask = (u >= self.u0) & (u < self.u1) & (v >= self.v0) & (v < self.v1)
        return Patch(window, mask, u, v)


class Ellipse(NamedTuple):
    """An ellipse along the axes of a frame, about its origin."""

    frame: Frame
    a: float
    b: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels with a centre inside."""
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
        """Return the pixels with a centre inside."""
        window = raster.window(self.points)
        x, y = raster.centres(*window)
        return Patch(window, self.holds(x, y), *self.frame.to_local(x, y))


class Stroke(NamedTuple):
    """A line of a width; u of its patch is the distance from the line."""

    points: Line
    width: float

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels with a centre inside."""
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


Form = Rect | Ellipse | Polygon | Stroke


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
    """Return the distance of points from a line; x and y broadcast."""
    ends = np.array(points).reshape(-1, 2, *(1,) * x.ndim)
    (x0, y0), (along_x, along_y) = ends[:-1].swapaxes(0, 1), (ends[1:] - ends[:-1]).swapaxes(0, 1)
    length2 = along_x * along_x + along_y * along_y
    share = np.clip(((x - x0) * along_x + (y - y0) * along_y) / length2, 0.0, 1.0)
    off_x, off_y = x - x0 - share * along_x, y - y0 - share * along_y
    return np.asarray(np.sqrt((off_x * off_x + off_y * off_y).min(axis=0)))


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


GRID_M = 2.0
"""Spacing of the grid on whose corners the land's heights are given."""
LAND_X: Floats = np.arange(round(SIDE_M / GRID_M) + 1).astype(np.float64)[None, :] * GRID_M
LAND_Y: Floats = LAND_X.T


def rolling(seed: int, stream: int, cells: dict[int, int], relief_m: float) -> Floats:
    """Return smooth hills about zero on the land's grid, most within half of `relief_m`."""
    return octaves(seed, stream, LAND_X.size, cells).astype(np.float64) * (relief_m / 4096)


def smooth_share(away: Floats, near: float, far: float) -> Floats:
    """Return 0 up to a distance `near`, 1 from `far` on, and smoothly between."""
    share = np.clip((away - near) / (far - near), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def blended(
    heights: Floats, away: Floats, level: Floats | float, near: float, far: float
) -> Floats:
    """Return heights that are `level` up to a distance `near`, and as they were from `far` on."""
    share = smooth_share(away, near, far)
    return heights * share + level * (1.0 - share)


Colour = tuple[int, int, int]


def colours(text: str) -> tuple[Colour, ...]:
    """Return the colours of hexadecimal triples."""
    triples = (bytes.fromhex(word) for word in text.split())
    return tuple((red, green, blue) for red, green, blue in triples)


TILES = colours("ac6048 9c5240 886456 68686e ba7654 80463a 5c585c")
METAL = colours("4e76a6 a6aaae 7c9482 b45446 c8c6be 606874")
_FLAT = colours("ccccc8 b2aea8 969290 787678 c0b09a a09688 626268 946858")
_WALLS = colours("cec6b8 bca084 d8d4cc aa745c b8baba d6be92 96928e c4ac9e")
_GLASS = colours("3a4858 4a5a68 2e363c 58686e")
_NO_WINDOWS: Colour = (70, 84, 98)
# Half the length and depth of equipment on flat roofs, and its height.
_ROOF_BOXES = (
    (2.4, 1.6, 2.7), (1.0, 1.0, 1.8), (1.8, 0.9, 1.4), (1.2, 0.8, 1.2), (3.0, 2.0, 2.8)
)  # fmt: skip


class Decal(NamedTuple):
    """Something painted on the ground."""

    kind: str  # a method of `painting.DecalBrush`, or a material
    form: Form
    key: int  # tells it from others of its kind: colours, phases and patterns come from it
    side: int  # 0: painted everywhere; 1 and 2: only on one side of `Plan.divide`
    season: int  # 0: always; 1: in the survey only; 2: in the older mosaic only


class Building(NamedTuple):
    """A box with a roof."""

    rect: Rect  # its plan, centred on the frame's origin; a ridge runs along u
    base_m: float  # height of the floor
    eaves_m: float  # height of the walls' top
    ridge_m: float  # height of the roof's highest line
    roof: str  # "flat", "gabled", "hipped" or "shed"
    cover: str  # how the roof is painted: a method of `painting.RoofBrush`
    roof_colour: Colour
    wall_colour: Colour
    window_colour: Colour = _NO_WINDOWS
    storey_m: float = 3.0
    bay_m: float = 3.2
    style: int = 0  # see `world.Buildings`
    parent: int = -1  # the building on whose roof it stands, or -1


class Tree(NamedTuple):
    """A canopy on a trunk, with its radius and the height of its top above the ground."""

    x: float
    y: float
    radius_m: float
    height_m: float
    kind: str  # "broad", "cone", "bush" or "bale"


@dataclass
class Plan:
    """The layout of a region, and the verbs that add to it."""

    seed: int
    dice: Dice
    # (n + 1, n + 1): of the land at the corners of its grid, first row in the south
    heights: Floats
    divide: Line = ()  # a line from west to east that parts side 1 (north) from side 2
    side: int = 0  # on which `paint` paints
    decals: list[Decal] = field(default_factory=list)  # in the order of painting
    buildings: list[Building] = field(default_factory=list)
    trees: list[Tree] = field(default_factory=list)

    def paint(self, kind: str, form: Form, key: int = 0, *, draw: int = 0, season: int = 0) -> None:
        """Add a decal on top of the existing ones; `draw` is the largest key that is drawn."""
        key = self.dice.integer(0, draw) if draw else key
        self.decals.append(Decal(kind, form, key, self.side, season))

    def plant(self, place: Point, radius_m: float, height_m: float, kind: str = "broad") -> None:
        """Add a tree."""
        self.trees.append(Tree(*place, radius_m, height_m, kind))

    def fell(self, stays: Callable[[Floats, Floats], Bools]) -> None:
        """Keep the trees that stay, a function of their x and y."""
        x, y = np.array([tree[:2] for tree in self.trees]).T
        self.trees = [tree for tree, kept in zip(self.trees, stays(x, y), strict=True) if kept]

    def is_north(self, x: Floats, y: Floats) -> Bools:
        """Return which points are on side 1 of the divide, which goes on straight at its ends."""
        knots_x, knots_y = np.array(self.divide).T
        slopes = (knots_y[1:] - knots_y[:-1]) / (knots_x[1:] - knots_x[:-1])
        part = np.clip(np.searchsorted(knots_x, x, side="right") - 1, 0, len(slopes) - 1)
        return np.asarray(y > knots_y[part] + (x - knots_x[part]) * slopes[part])

    def height(self, x: float, y: float) -> float:
        """Return the land's height at the nearest corner of the grid."""
        last = self.heights.shape[0] - 1
        row, column = (min(max(round(at / GRID_M), 0), last) for at in (y, x))
        return float(self.heights[row, column])

    def add_house(self, frame: Frame, half_u: float, half_v: float, storeys: float) -> None:
        """Add a house with a pitched roof, its ridge along u where that is longer."""
        rect = _lengthwise(frame, half_u, half_v)
        roof = self.dice.pick(("gabled", "gabled", "hipped"))
        rise = rect.v1 * self.dice.pick((0.5, 0.6, 0.75, 0.85))
        cover = self.dice.pick(("tiles", "tiles", "tiles", "metal"))
        colour = self.dice.pick(TILES if cover == "tiles" else METAL)
        self._raise(rect, (3.0 * storeys, 0.6), rise, (roof, cover, colour), 0)

    def add_block(self, frame: Frame, half_u: float, half_v: float, storeys: float) -> None:
        """Add a building with a flat roof and its equipment."""
        cover = self.dice.pick(("membrane", "membrane", "gravel", "slabs"))
        top, style = ("flat", cover, self.dice.pick(_FLAT)), self.dice.integer(0, 2)
        self._raise(frame.box(half_u, half_v), (3.0 * storeys, 1.2), 0.0, top, style)
        self._add_roof_boxes(len(self.buildings) - 1)

    def add_barn(self, frame: Frame, half_u: float, half_v: float, wall_m: float) -> None:
        """Add a barn, hall or shed without windows."""
        rect = _lengthwise(frame, half_u, half_v)
        roof = self.dice.pick(("gabled", "gabled", "shed"))
        rise = rect.v1 * (0.35 if roof == "gabled" else 0.3)
        self._raise(rect, (wall_m, 0.0), rise, (roof, "metal", self.dice.pick(METAL)), 3)

    def _raise(
        self, rect: Rect, wall_m: Point, rise: float, top: tuple[str, str, Colour], style: int
    ) -> None:
        pick, base = self.dice.pick, min(self.height(*point) for point in rect.grid(4))
        eaves = base + wall_m[0] + wall_m[1]
        look = pick(_WALLS), pick(_GLASS)
        sizes = pick((3.0, 3.0, 3.2, 3.5)), pick((2.6, 3.0, 3.4, 4.0))
        self.buildings.append(Building(rect, base, eaves, eaves + rise, *top, *look, *sizes, style))

    def _add_roof_boxes(self, parent: int) -> None:
        """Add stair heads, tanks and machines, each in its own stretch of the roof."""
        dice, (rect, _, low, *_) = self.dice, self.buildings[parent]
        count = min(max(int(rect.long / 9), 1), 7)
        stretch = rect.long / count
        for place in range(count):
            if dice.chance(25):
                continue
            half_u, half_v, tall = dice.pick(_ROOF_BOXES)
            room_u, room_v = stretch / 2 - half_u - 0.6, rect.v1 - half_v - 1.0
            if room_u < 0 or room_v < 0:
                continue
            u = rect.u0 + stretch * (place + 0.5) + dice.real(-room_u, room_u)
            box = rect.frame.at(u, dice.real(-room_v, room_v)).box(half_u, half_v)
            cover, top = "machine" if tall < 2 else "membrane", low + tall
            look = dice.pick(_FLAT), dice.pick(_WALLS)
            self.buildings.append(
                Building(box, low, top, top, "flat", cover, *look, style=3, parent=parent)
            )


def _lengthwise(frame: Frame, half_u: float, half_v: float) -> Rect:
    """Return a rectangle about a frame's origin that is at least as long as deep."""
    if half_v > half_u:
        return frame.at(0, 0, turned=True).box(half_v, half_u)
    return frame.box(half_u, half_v)

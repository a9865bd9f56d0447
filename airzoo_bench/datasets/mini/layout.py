"""The layout of a region: forms, and lists of decals, buildings and trees, each of a season."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice
from airzoo_bench.datasets.mini.world import SIDE_M
from airzoo_bench.geometry.arrays import Bools, Floats

Point = tuple[float, float]
Line = tuple[Point, ...]
Window = tuple[slice, slice]
Colour = tuple[int, ...]
# Of pixels that a form may cover: rows and columns, where it does, and u and v in its axes.
Patch = tuple[Window, Bools, Floats, Floats]

LOOKS = tomllib.loads(Path(__file__).with_name("looks.toml").read_text("utf-8"))
ALWAYS, SURVEY, OLDER = 0, 1, 2  # seasons: both, that of the survey, that of the older mosaic
GRID_M = 2.0  # spacing of the grid on whose corners the land's heights are given
LAND_X: Floats = np.arange(round(SIDE_M / GRID_M) + 1).astype(np.float64)[None, :] * GRID_M
LAND_Y: Floats = LAND_X.T
_FAR_M = 10_000.0


def colours(text: str) -> list[Colour]:
    """Return the colours of hexadecimal triples."""
    return [tuple(bytes.fromhex(word)) for word in text.split()]


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

    def box(self, half_u: float, half_v: float, *, is_round: bool = False) -> Box:
        """Return a rectangle about the origin, or the ellipse in it."""
        return Box(self, -half_u, half_u, -half_v, half_v, is_round)


class Raster(NamedTuple):
    """A square raster over a region, first row in the north, and its corner perhaps moved."""

    size: int
    pixel_m: float
    west: float = 0.0
    south: float = 0.0

    def window(self, points: Sequence[Point], reach: float = 0.0) -> Window:
        """Return rows and columns that may lie within reach of the box of points."""
        x, y = zip(*points, strict=True)
        north, spans = self.south + self.size * self.pixel_m, []
        for low, high in (
            (north - max(y), north - min(y)),
            (min(x) - self.west, max(x) - self.west),
        ):
            start = min(max(int((low - reach) // self.pixel_m), 0), self.size)
            stop = max(int((high + reach) // self.pixel_m) + 2, start)
            spans.append(slice(start, min(stop, self.size)))
        return spans[0], spans[1]

    def centres(self, window: Window | None = None) -> tuple[Any, Any]:
        """Return x of the columns, shape (1, w), and y of the rows, shape (h, 1)."""
        rows, columns = window or (slice(0, self.size), slice(0, self.size))
        x = (np.arange(columns.start, columns.stop) + 0.5) * self.pixel_m + self.west
        y = (self.size - 0.5 - np.arange(rows.start, rows.stop)) * self.pixel_m + self.south
        return x[None, :], y[:, None]


class Box(NamedTuple):
    """A rectangle along the axes of a frame; or, about its origin, the ellipse in it."""

    frame: Frame
    u0: float
    u1: float
    v0: float
    v1: float
    is_round: bool = False

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

    def part(self, u0: float, u1: float, v0: float, v1: float) -> Box:
        """Return another rectangle in the same axes."""
        return Box(self.frame, u0, u1, v0, v1)

    def inset(self, margin: float) -> Box:
        """Return it smaller by a margin on each side."""
        return self.part(self.u0 + margin, self.u1 - margin, self.v0 + margin, self.v1 - margin)

    def grid(self, steps: int) -> Line:
        """Return points at even shares of its sides, the corners among them."""
        shares = [step / steps for step in range(steps + 1)]
        local = [(self.u0 + a * self.long, self.v0 + b * self.deep) for a in shares for b in shares]
        return tuple(self.frame.to_world(u, v) for u, v in local)

    def patch(self, raster: Raster) -> Patch:
        """Return the pixels with a centre inside."""
        window = raster.window(self.grid(1))
        u, v = self.frame.to_local(*raster.centres(window))
        mask = (u >= self.u0) & (u < self.u1) & (v >= self.v0) & (v < self.v1)
        if self.is_round:
            mask = (u / self.u1) ** 2 + (v / self.v1) ** 2 < 1.0
        return window, mask, u, v


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
        x, y = raster.centres(window)
        return window, self.holds(x, y), *self.frame.to_local(x, y)


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
            off = distance_to_line(*raster.centres(near), segment)
            top, left = near[0].start - rows.start, near[1].start - columns.start
            part = away[top : top + off.shape[0], left : left + off.shape[1]]
            np.minimum(part, off, out=part)
        return (rows, columns), away < reach, away, np.zeros_like(away)


Form = Box | Polygon | Stroke


def edges(outline: Line) -> list[tuple[Point, Point]]:
    """Return the edges of a polygon."""
    return list(zip(outline, outline[1:] + outline[:1], strict=True))


def distance(a: Point, b: Point) -> float:
    """Return the distance of two points."""
    x, y = b[0] - a[0], b[1] - a[1]
    return math.sqrt(x * x + y * y)


def between(start: Point, end: Point, share: float, left: float = 0.0) -> Point:
    """Return the point at a share of the way, moved to the left by a share of its length."""
    x, y = end[0] - start[0], end[1] - start[1]
    return start[0] + share * x - left * y, start[1] + share * y + left * x


def distances(points: Sequence[Point], line: Line) -> Floats:
    """Return the distances of points from a line."""
    x, y = np.array(points).T
    return distance_to_line(x, y, line)


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
        cut = [between(*ends, share) for ends in pairwise(points) for share in (0.25, 0.75)]
        points = (points[0], *cut, points[-1])
    return points


def steps(start: float, stop: float, gap: float) -> list[float]:
    """Return numbers from start up to stop, a gap apart."""
    return [start + index * gap for index in range(max(math.ceil((stop - start) / gap), 0))]


def blended(land: Floats, away: Floats, level: Floats | float, near: float, far: float) -> Floats:
    """Return heights that are `level` up to a distance `near`, and as they were from `far` on."""
    share = np.clip((away - near) / (far - near), 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    return land * share + level * (1.0 - share)


class Decal(NamedTuple):
    """Something painted on the ground or a roof."""

    kind: str  # of `painting.KINDS`, or a material
    form: Form
    key: int  # tells it from others of its kind: colours, phases and patterns come from it
    season: int = ALWAYS
    side: int = 0  # 0: painted everywhere; 1 and 2: only on one side of `Plan.divide`
    colour: Colour = (0, 0, 0)  # of a roof


class Building(NamedTuple):
    """A box with a roof."""

    box: Box  # its plan, centred on the frame's origin; a ridge runs along u
    base_m: float  # height of the floor
    eaves_m: float  # height of the walls' top
    ridge_m: float  # height of the roof's highest line
    roof: str  # "flat", "gabled", "hipped" or "shed"
    decals: tuple[Decal, ...]  # on the roof
    season: int = ALWAYS
    wall: Colour = (188, 176, 158)
    window: Colour = (70, 84, 98)
    storey_m: float = 3.0
    bay_m: float = 3.2
    style: int = 3  # 0 single windows, 1 bands of windows, 2 balconies, 3 a barn's door, 4 none


class Tree(NamedTuple):
    """A canopy on a trunk, with its radius and the height of its top above the ground."""

    x: float
    y: float
    radius_m: float
    height_m: float
    kind: str  # of the table of trees
    season: int = ALWAYS


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

    def paint(self, kind: str, form: Form, key: int | None = None, season: int = ALWAYS) -> None:
        """Add a decal on top of the existing ones; its key is drawn where there is none."""
        key = self.dice.integer(0, 1 << 14) if key is None else key
        parts: list[Form] = [form]
        if isinstance(form, Box) and form.deep < 1.0:  # a long line would cover a wide window
            ends = [*steps(form.u0, form.u1, 60.0), form.u1]
            parts = [form._replace(u0=u0, u1=u1) for u0, u1 in pairwise(ends)]
        self.decals += [Decal(kind, part, key, season, self.side) for part in parts]

    def strew(self, what: str, lot: Box, count: int) -> None:
        """Paint a number of things of a kind of clutter anywhere in a lot."""
        dice, rows = self.dice, LOOKS["clutter"][what]
        for _ in range(count):
            spot = self.anywhere(lot).at(0, 0, turned=dice.chance(50))
            season = dice.integer(ALWAYS, OLDER) if rows["moves"] else ALWAYS
            half_u, half_v = dice.pick(rows["half_m"])
            grown = dice.real(*rows["grown"])
            box = spot.box(half_u * grown, half_v * grown)
            self.paint(dice.pick(rows["kinds"]), box, season=season)

    def anywhere(self, box: Box) -> Frame:
        """Return the rectangle's axes about a point in it."""
        return box.frame.at(self.dice.real(box.u0, box.u1), self.dice.real(box.v0, box.v1))

    def park(self, spot: Frame, season: int, half_u: float = 2.2) -> None:
        """Leave a car, or a lorry, at a place in one season."""
        self.paint("car", spot.box(half_u, 0.9 if half_u < 4 else 1.25), season=season)

    def plant(self, place: Point, radius_m: float, height_m: float, kind: str = "broad") -> None:
        """Plant a tree, which may lose its leaves."""
        tree = Tree(*place, radius_m, height_m, kind)
        if self.dice.chance(LOOKS["trees"][kind]["bare"]):
            bare = tree._replace(kind="bare", season=OLDER, radius_m=0.75 * radius_m)
            self.trees += [tree._replace(season=SURVEY), bare]
        else:
            self.trees.append(tree)

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

    def season_rows(self, season: int) -> tuple[list[Building], list[Tree]]:
        """Return the buildings and trees of a season; their places are the owners of triangles."""
        now = (ALWAYS, season)
        buildings = [building for building in self.buildings if building.season in now]
        return buildings, [tree for tree in self.trees if tree.season in now]

    def height(self, x: float, y: float) -> float:
        """Return the land's height at the nearest corner of the grid."""
        last = self.heights.shape[0] - 1
        row, column = (min(max(round(at / GRID_M), 0), last) for at in (y, x))
        return float(self.heights[row, column])

    def build(self, kind: str, frame: Frame, half_u: float, half_v: float, wall_m: float) -> None:
        """Add a building of a kind about a frame's origin, its ridge along the longer side."""
        pick, row = self.dice.pick, LOOKS["buildings"][kind]
        if half_v > half_u:
            frame, half_u, half_v = frame.at(0, 0, turned=True), half_v, half_u
        box = frame.box(half_u, half_v)
        base = min(self.height(*point) for point in box.grid(4))
        eaves, roof = base + wall_m + row["parapet_m"], pick(row["roofs"])
        rise = 0.0 if roof == "flat" else half_v * pick(row["rises"])
        cover, small = pick(row["covers"]), half_u * half_v < 125
        season = SURVEY if small and self.dice.chance(row["new"]) else ALWAYS
        walls, glass = (colours(LOOKS["covers"][name]) for name in ("walls", "glass"))
        look = pick(walls), pick(glass), pick((3.0, 3.2, 3.5)), pick((2.6, 3.0, 3.4, 4.0))
        decals = self._cover_roof(cover if roof != "hipped" or cover == "metal" else "hips", box)
        form = box, base, eaves, eaves + rise, roof, decals
        self.buildings.append(Building(*form, season, *look, pick(row["styles"])))
        if roof == "flat":
            self._equip_roof(box, eaves, season)

    def _cover_roof(self, cover: str, box: Box) -> tuple[Decal, ...]:
        """Return the cover of a roof, in a few cases another in the older season, and details."""
        dice, palette = self.dice, colours(LOOKS["covers"][cover])
        key, details = dice.integer(0, 1 << 14), LOOKS["details"].get(cover, {})
        decals = [Decal(cover, box, key, colour=dice.pick(palette))]
        if dice.chance(6):
            decals.append(Decal(cover, box, key, OLDER, colour=dice.pick(palette)))
        if dice.chance(details.get("often", 0)) and box.long > 6:
            u0 = dice.real(box.u0 + 1.0, box.u0 + 0.4 * box.long)
            top = -0.8 if cover in ("tiles", "hips") else 0.2 * box.v1
            part = box.part(u0, u0 + 0.45 * box.long, box.v0 + dice.real(0.9, 1.5), top)
            decals.append(Decal(dice.pick(details["large"]), part, 0))
        for _ in range(int(box.long * box.deep * details.get("density", 0.0) * dice.real(0, 1))):
            kind, half_u, half_v = dice.pick(details["small"])
            spot = self.anywhere(box.inset(1.0))
            decals.append(Decal(kind, spot.box(half_u, half_v), dice.integer(0, 99)))
        return tuple(decals)

    def _equip_roof(self, box: Box, low_m: float, season: int) -> None:
        """Add stair heads, tanks and machines, each in its own stretch of a flat roof."""
        dice, count = self.dice, min(max(int(box.long / 9), 1), 7)
        stretch = box.long / count
        for place in range(count):
            half_u, half_v, tall = dice.pick(LOOKS["buildings"]["equipment"])
            room_u, room_v = stretch / 2 - half_u - 0.6, box.v1 - half_v - 1.0
            if min(room_u, room_v) > 0 and dice.chance(75):
                u = box.u0 + stretch * (place + 0.5) + dice.real(-room_u, room_u)
                part = box.frame.at(u, dice.real(-room_v, room_v)).box(half_u, half_v)
                decals = self._cover_roof("machine" if tall < 2 else "membrane", part)[:1]
                top, wall = low_m + tall, dice.pick(colours(LOOKS["covers"]["walls"]))
                form = part, low_m, top, top, "flat", decals
                self.buildings.append(Building(*form, season, wall, style=4))

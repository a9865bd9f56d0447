"""The layout of the country: a valley with a stream, parcels of land, a road, farms, woods."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from airzoo_bench.datasets.mini import layout
from airzoo_bench.datasets.mini.layout import OLDER, SURVEY, Frame, Line, Plan, Point, Polygon
from airzoo_bench.datasets.mini.noise import Dice, direction, octaves
from airzoo_bench.datasets.mini.world import SIDE_M
from airzoo_bench.geometry.arrays import Bools, Floats

_STREAM = 12
_LARGEST_M2 = 9_500.0
_VALLEY_M = 75.0
# Half the level ground of a farm.
_YARD_M = (34.0, 28.0)


class _Lines(NamedTuple):
    stream: Line
    road: Line
    tracks: list[Line]
    paths: list[Line]
    pond: Frame
    pond_half: Point
    farms: list[Frame]


def rural_plan(seed: int) -> Plan:
    """Lay out the country."""
    dice = Dice(seed, _STREAM)
    lines = _draw_lines(dice)
    plan = _Country(seed, dice, _heights(seed, lines))
    low, high = -8.0, SIDE_M + 8
    for parcel in _cut_parcels(dice, ((low, low), (high, low), (high, high), (low, high))):
        plan.use_parcel(parcel, lines.stream)
    plan.lay_water(lines)
    plan.lay_ways(lines)
    for farm in lines.farms:
        plan.add_farm(farm)
    for _ in range(70):
        place = dice.real(9, SIDE_M - 9), dice.real(9, SIDE_M - 9)
        plan.grow(place, (2.2, 5.0))
    for ends in pairwise(lines.road):
        if dice.chance(40):
            plan.grow(layout.between(*ends, 0.0, dice.pick((-1, 1)) * 0.75), (2.0, 3.0), 3.2)
    plan.fell(lambda x, y: _is_clear(x, y, lines))
    return plan


def _draw_lines(dice: Dice) -> _Lines:
    stream = _winding(dice, (0.3, 0.45), 60.0)
    farms: list[Frame] = []
    for _ in range(200):
        x, y = dice.real(55, SIDE_M - 55), dice.real(55, SIDE_M - 55)
        farm = Frame(x, y, *direction(dice.integer(0, 255)))
        off = layout.distances([(x, y)], stream)
        if off > 60 and all(layout.distance(farm[:2], other[:2]) > 125 for other in farms):
            farms.append(farm)
    farms = farms[:6]
    # The road is that of some which keeps farthest from all farms.
    yards = [farm[:2] for farm in farms]
    roads = [_winding(dice, (0.25, 0.8), 50.0) for _ in range(12)]
    road = max(roads, key=lambda line: float(layout.distances(yards, line).min()))
    tracks = []
    for farm in farms:
        near = min(road, key=lambda point: layout.distance(point, farm[:2]))
        x, y = layout.between(near, farm[:2], 0.5)
        middle = x + dice.real(-18, 18), y + dice.real(-18, 18)
        tracks.append(layout.bend((farm[:2], middle, near)))
    paths = [_winding(dice, (0.1, 0.9), 75.0) for _ in range(4)]
    half = dice.real(22, 32), dice.real(14, 19)
    # The pond lies on the middle part of the stream, as far from the road as can be.
    middle_part = stream[len(stream) * 3 // 10 : len(stream) * 7 // 10]
    farthest = int(np.argmax(layout.distances(middle_part, road)))
    pond = Frame(*middle_part[farthest], *direction(dice.integer(0, 255)))
    dry = [farm for farm in farms if layout.distance(farm[:2], pond[:2]) > 85.0]
    return _Lines(stream, road, tracks, paths, pond, half, dry)


def _winding(dice: Dice, shares: Point, swing_m: float) -> Line:
    turned, share = dice.chance(50), dice.real(*shares)
    along = np.linspace(-70, SIDE_M + 70, 10).tolist()
    line = layout.bend(tuple((x, share * SIDE_M + dice.real(-swing_m, swing_m)) for x in along))
    return tuple((y, x) for x, y in line) if turned else line


def _heights(seed: int, lines: _Lines) -> Floats:
    x, y = layout.LAND_X, layout.LAND_Y
    hills = octaves(seed, 20, x.size, {110: 8, 60: 5, 26: 2, 11: 1})
    land = 88.0 + hills.astype(np.float64) * (46.0 / 4096)
    stream, road = (layout.distance_to_line(x, y, line) for line in lines[:2])
    for away, rise, near, far in (
        (stream, -15.0, 5.0, 210.0),
        (stream, -2.6, 1.5, 9.0),
        (road, 0.8, 3.0, 10.0),
    ):
        land = layout.blended(land, away, land + rise, near, far)
    u, v = lines.pond.to_local(x, y)
    u, v = u / lines.pond_half[0], v / lines.pond_half[1]
    off = (np.sqrt(u * u + v * v) - 1.0) * lines.pond_half[1]
    land = layout.blended(land, off, float(land[off < 0].min()), 2.0, 16.0)
    for farm in lines.farms:
        u, v = farm.to_local(x, y)
        off = np.maximum(np.abs(u) - _YARD_M[0], np.abs(v) - _YARD_M[1])
        level = float(land[round(farm.y / layout.GRID_M), round(farm.x / layout.GRID_M)])
        land = layout.blended(land, off, level, 0.0, 26.0)
    return land


def _cut_parcels(dice: Dice, outline: Line) -> list[Polygon]:
    """Cut a convex polygon, counter-clockwise, until each part is small enough, some smaller."""
    x, y = middle = _middle(outline)
    longest = Frame.along(*max(layout.edges(outline), key=lambda edge: layout.distance(*edge)))
    frame, size = Frame(*middle, *longest[2:]), _area(outline)
    if size < _LARGEST_M2 * dice.real(0.45, 1.0):
        return [Polygon(outline, frame)]
    # Roughly across the longest edge, near the middle.
    along = Frame(0.0, 0.0, *frame[2:]).to_world(*direction(dice.integer(-9, 9) + 64))
    if dice.chance(18):
        along = (-along[1], along[0])
    off = dice.real(-0.16, 0.16) * math.sqrt(size)
    point = (x + along[1] * off, y - along[0] * off)
    halves = _half(outline, point, along), _half(outline, point, (-along[0], -along[1]))
    return [part for half in halves for part in _cut_parcels(dice, half)]


def _half(outline: Line, point: Point, along: Point) -> Line:
    """Return the part of a convex polygon left of a line (Sutherland and Hodgman, 1974)."""
    left: list[Point] = []
    for edge in layout.edges(outline):
        a, b = (along[0] * (y - point[1]) - along[1] * (x - point[0]) for x, y in edge)
        if a >= 0:
            left.append(edge[0])
        if (a >= 0) != (b >= 0):
            left.append(layout.between(*edge, a / (a - b)))
    return tuple(left)


def _area(outline: Line) -> float:
    # Not sum(): newer Pythons add floats with a correction.
    twice = 0.0
    for a, b in layout.edges(outline):
        twice += a[0] * b[1] - b[0] * a[1]
    return twice / 2


def _middle(outline: Line) -> Point:
    x, y = 0.0, 0.0
    for point in outline:
        x, y = x + point[0], y + point[1]
    return x / len(outline), y / len(outline)


def _shrink(polygon: Polygon, margin_m: float) -> Polygon:
    middle = _middle(polygon.points)
    share = max(1.0 - margin_m / (0.5 * math.sqrt(_area(polygon.points)) + 1e-9), 0.1)
    return Polygon(tuple(layout.between(middle, p, share) for p in polygon.points), polygon.frame)


def _is_clear(x: Floats, y: Floats, lines: _Lines) -> Bools:
    """Return which trees are inside the region, and neither on ways nor in water nor in a yard."""
    keep: Bools = (x > 3) & (x < SIDE_M - 3) & (y > 3) & (y < SIDE_M - 3)
    berths = [(lines.road, 6.5), (lines.stream, 4.0)]
    for line, berth in [*berths, *((way, 3.4) for way in lines.tracks + lines.paths)]:
        keep &= layout.distance_to_line(x, y, line) > berth
    for frame, half in ((lines.pond, lines.pond_half), *((f, _YARD_M) for f in lines.farms)):
        u, v = frame.to_local(x, y)
        u, v = u / (half[0] + 3), v / (half[1] + 3)
        yard = half == _YARD_M
        keep &= (u * u + v * v > 1.0) | (yard & (u * u > 0.45) & (v * v < 0.5))
    return keep


class _Country(Plan):
    """The plan of the country."""

    def grow(self, place: Point, radius_m: Point, slim: float = 2.3, kind: str = "broad") -> None:
        """Plant a tree of a radius in a range, and about `slim` times as high."""
        radius = self.dice.real(*radius_m)
        self.plant(place, radius, radius * slim * self.dice.real(0.87, 1.13), kind)

    def use_parcel(self, parcel: Polygon, stream: Line) -> None:
        """Paint a parcel and plant what grows on it; the valley is terraced for rice."""
        dice = self.dice
        self.paint("rough", parcel)
        near = layout.distances([_middle(parcel.points)], stream)[0]
        inner, use = _shrink(parcel, dice.real(1.2, 3.0)), dice.integer(0, 99)
        if near < _VALLEY_M and dice.chance(75):
            self.paint("terraces", inner)
        elif use < 24:
            self._grow_wood(parcel)
        elif use < 34:
            self.paint("meadow", inner)
            self.paint("worn", inner)
            for place in self._grid(inner, (22.0, 25.0), 35):
                self.grow(place, (1.0, 3.2), 2.2, dice.pick(("broad", "bush")))
        elif use < 42:
            self.paint("meadow", inner)
            gap = dice.real(5.5, 7.5)
            for place in self._grid(inner, (gap, gap * 0.8), 93, jitter=0.08):
                self.paint("soil", Frame(*place, *inner.frame[2:]).box(1.2, 1.2))
                self.grow(place, (1.2, 1.7), 2.0, "bush")
        else:
            self._grow_field(inner)
        self._add_hedges(parcel)

    def _grow_field(self, inner: Polygon) -> None:
        dice, key = self.dice, self.dice.integer(0, 1 << 14)
        self.paint("field", inner, key)
        if dice.chance(25):
            self.paint("worn", inner)
        if key % 9 in (4, 7):
            for place in self._grid(_shrink(inner, 8.0), (13.0, 17.0), 70):
                self.plant(place, 0.85, 1.4, "bale")

    def _grow_wood(self, parcel: Polygon) -> None:
        dice = self.dice
        self.paint("litter", parcel)
        share, conifers = dice.integer(80, 95), dice.pick((0, 10, 60))
        for place in self._grid(parcel, (5.6, 5.6), share, jitter=0.42):
            if dice.chance(conifers):
                self.plant(place, dice.real(1.8, 2.8), dice.real(8, 14), "cone")
            else:
                self.plant(place, dice.real(2.2, 4.0), dice.real(7.5, 13.0))

    def _grid(
        self, polygon: Polygon, gaps: Point, percent: int, jitter: float = 0.25
    ) -> Iterator[Point]:
        """Yield a share of the points of a grid along a polygon's axes, inside it and moved."""
        dice = self.dice
        places = polygon.frame.to_local(*np.array(polygon.points).T)
        spans = ((float(p.min()), float(p.max()), gap) for p, gap in zip(places, gaps, strict=True))
        for at in product(*(layout.steps(low + gap / 2, high, gap) for low, high, gap in spans)):
            moved = (a + dice.real(-jitter, jitter) * gap for a, gap in zip(at, gaps, strict=True))
            place = polygon.frame.to_world(*moved)
            if polygon.holds(*place) and dice.chance(percent):
                yield place

    def _add_hedges(self, parcel: Polygon) -> None:
        """Plant bushes, now and then a tree, along some edges; small parcels have fewer."""
        dice = self.dice
        for edge in layout.edges(parcel.points):
            if not dice.chance(26 if _area(parcel.points) > 3000 else 12):
                continue
            along, length = dice.real(1.0, 4.0), layout.distance(*edge)
            while along < length:
                place = layout.between(*edge, along / length, dice.real(-0.5, 0.5) / length)
                if dice.chance(9):
                    self.grow(place, (2.0, 3.4), 2.8)
                elif dice.chance(90):
                    self.grow(place, (1.1, 1.8), 1.65, "bush")
                along += dice.real(1.9, 3.0)

    def lay_water(self, lines: _Lines) -> None:
        dice, pond, (a, b) = self.dice, lines.pond, lines.pond_half
        self.paint("rough", layout.Stroke(lines.stream, 17.0))
        self.paint("shore", layout.Stroke(lines.stream, 8.0))
        for kind, grown in (("rough", 7.0), ("shore", 3.5), ("shallow", 0.6), ("water", -0.8)):
            self.paint(kind, pond.box(a + grown, b + grown, is_round=True))
        self.paint("water", layout.Stroke(lines.stream, 3.6))
        self.paint("wood", layout.Stroke((pond.to_world(a - 3, 0), pond.to_world(a + 4, 0)), 1.5))
        for ends, side in product(pairwise(lines.stream), (-1, 1)):
            if dice.chance(42):
                self.grow(layout.between(*ends, 0.0, side * dice.real(0.25, 0.4)), (1.8, 4.0), 2.6)

    def lay_ways(self, lines: _Lines) -> None:
        dice = self.dice
        ways = [(line, "rough", 3.2, "track", 1.6) for line in lines.paths]
        ways += [(line, "rough", 5.0, "ruts", 3.2) for line in lines.tracks]
        ways += [(lines.road, "rough", 11.0, "gravel", 8.0)]
        for line, border, wide, kind, width in ways:
            self.paint(border, layout.Stroke(line, wide))
            self.paint(kind, layout.Stroke(line, width))
        self.paint("asphalt", layout.Stroke(lines.road, 6.4))
        for index, ends in enumerate(pairwise(lines.road)):
            if index % 2:
                self.paint("marking", layout.Stroke(ends, 0.3))
            if dice.chance(12):
                kind = dice.pick(("patch", "tar", "lane"))
                self.paint(kind, layout.Stroke(ends, dice.real(1, 4)))
            if dice.chance(14):
                spot = Frame.along(*ends).at(0, dice.pick((-1.6, 1.6)))
                self.park(spot, dice.integer(SURVEY, OLDER))

    def add_farm(self, frame: Frame) -> None:
        dice, real = self.dice, self.dice.real
        self.paint("rough", frame.box(_YARD_M[0] + 4, _YARD_M[1] + 4, is_round=True))
        self.paint("meadow", frame.box(*_YARD_M, is_round=True))
        self.paint(dice.pick(("gravel", "plates", "track")), frame.box(23.0, 15.0))
        self.paint("worn", frame.box(25.0, 17.0), dice.integer(0, 1))
        for u, v in ((0.0, -21.5), (19.0, -21.0)):
            bed = frame.at(u + real(-2, 2), v).box(8.0, 4.5)
            self.paint(dice.pick(("beds", "beds", "lawn")), bed)
        for row in layout.LOOKS["farms"]["buildings"]:
            sizes = (real(*row[name]) for name in ("u", "v", "half_u", "half_v", "wall_m"))
            u, v, half_u, half_v, wall_m = sizes
            if dice.chance(row["often"]):
                spot = frame.at(u, v, turned=row["turned"])
                self.paint("plates", spot.box(half_u + 1, half_v + 1))
                self.build(row["kind"], spot, half_u, half_v, wall_m)
        for season, _ in product((SURVEY, OLDER), range(dice.integer(2, 5))):
            self.park(frame.at(real(-9, 12), real(-5, 7), turned=dice.chance(50)), season)
        for v0, v1 in ((-14.0, -9.0), (9.0, 14.0)):
            self.strew("heaps", layout.Box(frame, -24.0, 24.0, v0, v1), 7)
        if dice.chance(60):
            self.strew("gone", frame.at(2.0, -21.0).box(4.0, 0.5), 1)
        for _ in range(dice.integer(0, 6)):
            self.plant(frame.to_world(real(6, 12), real(8, 11)), 0.8, 1.3, "bale")
        for _ in range(dice.integer(7, 12)):
            place = frame.to_world(dice.pick((-1, 1)) * real(24, 33), real(-24, 24))
            kind = dice.pick(("broad", "broad", "bush", "cone"))
            self.grow(place, (1.6, 3.6), 3.2 if kind == "cone" else 2.4, kind)

"""The layout of the city: a canal between two districts, streets, and blocks between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice, direction
from airzoo_bench.datasets.mini.plan import (
    LAND_X,
    LAND_Y,
    Ellipse,
    Frame,
    Line,
    Plan,
    Point,
    Rect,
    Stroke,
    bend,
    blended,
    distance,
    distance_to_line,
    rolling,
    steps,
)
from airzoo_bench.datasets.mini.world import SIDE_M
from airzoo_bench.geometry.arrays import Bools, Floats

_STREAM = 11
_STREETS_M = (20.0, 18.0, 14.0, 12.0, 9.0, 8.0, 7.0, 7.0)  # width, by depth of division
_WATER_M, _STREET_M = 35.5, 41.0
# Nothing is built nearer to the canal's middle, and no tree is planted.
_BANK_M, _TOWPATH_M = 26.0, 14.0
_STALL_M, _PAVEMENT_M = 2.75, 4.0
_MIDDLE = Frame(SIDE_M / 2, SIDE_M / 2)
_CANAL = (
    ("kerb", 50.0), ("paving", 49.4), ("lane", 43.0), ("kerb", 34.0), ("pavement", 33.4),
    ("bed", 31.0), ("rough", 29.0), ("concrete", 20.5), ("water", 19.0),
)  # fmt: skip

_Box = tuple[float, float, float, float]
_Add = Callable[[Plan, Frame, float, float, float], None]
_house, _flats, _hall = Plan.add_house, Plan.add_block, Plan.add_barn


def city_plan(seed: int) -> Plan:
    """Lay out the city."""
    dice = Dice(seed, _STREAM)
    middle = dice.real(0.38, 0.62) * SIDE_M
    along = np.linspace(-60, SIDE_M + 60, 8).tolist()
    canal = bend(tuple((x, middle + dice.real(-55, 55)) for x in along))
    bridges = []
    for share in (0.18, 0.5, 0.82):
        index = int(len(canal) * (share + dice.real(-0.06, 0.06)))
        bridges.append(Frame.along(canal[index], canal[index + 1]).at(0, 0, turned=True))
    city = _City(seed, dice, _heights(seed, canal, bridges), canal)
    turn = dice.integer(2, 22)
    for city.side, step in ((1, turn), (2, turn - dice.integer(10, 30))):
        city.lay_district(Frame(*_MIDDLE.origin, *direction(step)))
    city.side = 0
    _lay_canal(city, bridges)

    def is_dry(x: Floats, y: Floats) -> Bools:
        dry = distance_to_line(x, y, canal) > 15.0
        for frame in bridges:
            u, v = frame.to_local(x, y)
            dry &= (np.abs(u) > 30) | (np.abs(v) > 10.5)
        return dry

    city.fell(is_dry)
    return city


def _heights(seed: int, canal: Line, bridges: list[Frame]) -> Floats:
    land = _STREET_M + rolling(seed, 10, {120: 10, 60: 4, 20: 2}, 7.0)
    away = distance_to_line(LAND_X, LAND_Y, canal)
    level = blended(land, away, _STREET_M, 20.0, 90.0)
    carved = blended(level, away, _WATER_M, 10.5, 16.0)
    for frame in bridges:
        u, v = frame.to_local(LAND_X, LAND_Y)
        carved = np.where((np.abs(u) <= 24.0) & (np.abs(v) <= 9.0), level, carved)
    return carved


def _lay_canal(plan: Plan, bridges: list[Frame]) -> None:
    dice = plan.dice
    for kind, width in _CANAL:
        plan.paint(kind, Stroke(plan.divide, width))
    for (x0, y0), (x1, y1) in pairwise(plan.divide):
        for share, side in product((0.2, 0.7), (-1, 1)):
            off = side * (15.6 if dice.chance(70) else 23.4) / distance((x0, y0), (x1, y1))
            at = share + dice.real(-0.15, 0.15)
            place = x0 + (x1 - x0) * at - (y1 - y0) * off, y0 + (y1 - y0) * at + (x1 - x0) * off
            plan.plant(place, dice.real(1.8, 3.4), dice.real(5.5, 8.5))
    for frame in bridges:
        plan.paint("pavement", frame.box(24.5, 8.5))
        plan.paint("asphalt", frame.box(26.0, 6.0))
        plan.paint("dashes", frame.box(26.0, 0.2))
        for v in (-6.1, 6.1):
            plan.paint("kerb", frame.at(0, v).box(24.5, 0.3))
            plan.paint("crossing", frame.at(22.0 * v / 6.1, 0).box(1.5, 5.6))


@dataclass
class _City(Plan):
    """The plan of the city, which adds on one side of its divide at a time."""

    axes: Frame = _MIDDLE  # all streets and buildings of a side are parallel to these
    blocks: list[Rect] = field(default_factory=list)  # between streets
    streets: list[Rect] = field(default_factory=list)  # along u
    taken: list[_Box] = field(default_factory=list)  # buildings: u0, v0, u1, v1 in the axes

    # --- verbs ---

    def grow(self, frame: Frame, radius: float, kind: str = "broad") -> None:
        """Plant a tree at a frame's origin, of about that radius, if there is room."""
        if not self.holds([frame.origin], _TOWPATH_M):
            return
        radius *= self.dice.real(0.7, 1.3)
        height = radius * self.dice.real(2.1, 2.9) if kind == "broad" else radius * 3.4
        self.plant(frame.origin, radius, max(height, 2.5), kind)

    def grow_anywhere(
        self, lot: Rect, count: int, clear: tuple[Frame, float] | None = None
    ) -> None:
        """Plant trees in a lot, but not within a distance of a point."""
        for _ in range(count):
            spot = self.anywhere(lot.inset(2))
            if clear is not None:
                u, v = spot.x - clear[0].x, spot.y - clear[0].y
                if u * u + v * v < clear[1] * clear[1]:
                    continue
            self.grow(spot, 2.6, self.dice.pick(("broad", "broad", "broad", "cone", "bush")))

    def build(self, add: _Add, rect: Rect, storeys: int) -> bool:
        """Build on a rectangle if it may be; the building's frame is at its middle."""
        u, v = self.axes.to_local(*np.array(rect.corners()).T)
        # Less a millimetre a side, so that houses may touch.
        u0, u1 = float(u.min()) + 0.001, float(u.max()) - 0.001
        v0, v1 = float(v.min()) + 0.001, float(v.max()) - 0.001
        stands = (a0 < u1 and u0 < a1 and b0 < v1 and v0 < b1 for a0, b0, a1, b1 in self.taken)
        if not self.allows(rect) or any(stands):
            return False
        self.taken.append((u0, v0, u1, v1))
        add(self, rect.middle, rect.long / 2, rect.deep / 2, storeys)
        return True

    def allows(self, rect: Rect) -> bool:
        """Return whether there is room for a building."""
        return self.holds(rect.grid(2), _BANK_M)

    def holds(self, points: Sequence[Point], bank_m: float) -> bool:
        """Return whether points are on this side, in the region, and that far from the canal."""
        x, y = np.array(points).T
        inside = (np.minimum(x, y) > 4.0) & (np.maximum(x, y) < SIDE_M - 4.0)
        apart = distance_to_line(x, y, self.divide) > bank_m
        return bool(np.all(inside & apart & (self.is_north(x, y) == (self.side == 1))))

    def anywhere(self, rect: Rect) -> Frame:
        """Return the rectangle's axes about a point in it."""
        return rect.frame.at(self.dice.real(rect.u0, rect.u1), self.dice.real(rect.v0, rect.v1))

    def park_car(self, spot: Frame, half_u: float, half_v: float, season: int) -> None:
        """Leave a car at a place in one season."""
        self.paint("car", spot.box(half_u, half_v), draw=99, season=season)

    def park_cars(self, lot: Rect) -> None:
        """Mark stalls in rows, and leave cars on some of them, others in each season."""
        dice = self.dice
        self.paint("parking", lot)
        rows = max(round(lot.deep / 16.0), 1)
        high = lot.deep / rows
        first = float(np.floor(lot.u0 / _STALL_M) + 1) * _STALL_M
        stalls = [first + stall * _STALL_M for stall in range(int(lot.long / _STALL_M))]
        for season in (1, 2):
            share = dice.integer(30, 75)
            for row, end, stall in product(range(rows), (2.4, high - 2.4), stalls):
                if dice.chance(share):
                    v = lot.v0 + row * high + end + dice.real(-0.3, 0.3)
                    u = stall + 1.5 if stall + 2.5 < lot.u1 else lot.u1 - 1.5
                    spot = lot.frame.at(u, v, turned=True)
                    self.park_car(spot, dice.pick((2.0, 2.2, 2.4)), 0.9, season)

    def fill_yard(self, yard: Rect) -> None:
        """Strew beds and trees."""
        dice, area = self.dice, max(yard.long, 0.0) * max(yard.deep, 0.0)
        for _ in range(int(area / 120)):
            spot = self.anywhere(yard)
            kind = dice.pick(("lawn", "flowers", "gravel", "beds", "concrete", "court"))
            self.paint(kind, spot.box(dice.real(1.5, 5.0), dice.real(1.5, 4.0)), draw=99)
        self.grow_anywhere(yard, max(int(area / 90), 1))

    # --- districts ---

    def lay_district(self, axes: Frame) -> None:
        """Divide one side into blocks by streets, and fill them."""
        self.axes, self.blocks, self.streets, self.taken = axes, [], [], []
        self._split((-420.0, 420.0, -420.0, 420.0), 0)
        self._pave_streets()
        self._fill_blocks()
        for street in self.streets:
            if street.v1 >= 4:
                self._mark_street(street)

    def _split(self, box: _Box, depth: int) -> None:
        u0, u1, v0, v1 = box
        wide, high = u1 - u0, v1 - v0
        if max(wide, high) < 118 and min(wide, high) < 100:
            self.blocks.append(Rect(self.axes, *box))
            return
        half = _STREETS_M[min(depth, len(_STREETS_M) - 1)] / 2
        share = self.dice.real(0.4, 0.6)
        if wide > high:
            cut = u0 + wide * share
            street = self.axes.at(cut, (v0 + v1) / 2, turned=True).box(high / 2, half)
            parts = (u0, cut - half, v0, v1), (cut + half, u1, v0, v1)
        else:
            cut = v0 + high * share
            street = self.axes.at((u0 + u1) / 2, cut).box(wide / 2, half)
            parts = (u0, u1, v0, cut - half), (u0, u1, cut + half, v1)
        self.streets.append(street)
        for part in parts:
            self._split(part, depth + 1)

    def _pave_streets(self) -> None:
        """Pave the district, with patches of new asphalt, trenches and covers in its streets."""
        self.paint("asphalt", _MIDDLE.box(SIDE_M, SIDE_M))
        for street in self.streets:
            if street.v1 < 5:
                self.paint("lane", street)
            for _ in range(int(street.u1 / 12)):
                spot = self.anywhere(street)
                kind = self.dice.pick(("patch", "patch", "tar", "concrete"))
                half = self.dice.pick(((4.0, 1.2), (1.2, 3.0), (9.0, 0.4), (0.5, 0.5), (2.0, 1.5)))
                self.paint(kind, spot.box(*half))

    def _fill_blocks(self) -> None:
        """Fill the blocks that may be seen; the largest ones take the uses that need room."""
        seen = []
        for block in self.blocks:
            x, y = np.array(block.grid(8)).T
            inside = (np.maximum(x, y) < SIDE_M + 5) & (np.minimum(x, y) > -5)
            if np.any(inside & (self.is_north(x, y) == (self.side == 1))):
                seen.append(block)
        by_size = sorted(seen, key=lambda block: (not self.allows(block), -block.long * block.deep))
        chosen = dict(zip(by_size, (_sports, _park, _mall), strict=False))
        for block in seen:
            self.paint("kerb", block)
            self.paint("slabs", block.inset(0.35), draw=999)
            self._line_with_trees(block)
            fill = chosen.get(block) or self.dice.pick(_COMMON if self.allows(block) else _SMALL)
            fill(self, block.inset(_PAVEMENT_M))

    def _line_with_trees(self, block: Rect) -> None:
        dice = self.dice
        gap = dice.real(8.0, 13.0)
        for start, end, v, turned in (
            (block.u0, block.u1, block.v0 + 1.4, False),
            (block.u0, block.u1, block.v1 - 1.4, False),
            (block.v0, block.v1, block.u0 + 1.4, True),
            (block.v0, block.v1, block.u1 - 1.4, True),
        ):
            places = () if dice.chance(30) else steps(start + 6, end - 6, gap)
            for place in places:
                if dice.chance(80):
                    spot = block.frame.at(*((v, place) if turned else (place, v)))
                    self.paint("soil", spot.box(0.75, 0.75))
                    self.grow(spot, 2.1)

    def _mark_street(self, street: Rect) -> None:
        """Paint lanes, crossings and traffic."""
        dice, frame = self.dice, street.frame
        key = dice.integer(0, 8)
        self.paint("dashes", frame.box(street.u1, 0.15), key)
        if street.v1 > 6:
            self.paint("yellow", frame.box(street.u1, 0.3))
            for v in (-3.4, 3.4):
                self.paint("dashes", frame.at(0, v).box(street.u1, 0.15), key)
        v0, v1 = street.v0 + 0.6, street.v1 - 0.6
        for u in (street.u0 + 4.0, street.u1 - 4.0, dice.real(street.u0, street.u1)):
            self.paint("crossing", Rect(frame, u - 1.6, u + 1.6, v0, v1))
            self.paint("marking", Rect(frame, u + 2.4, u + 2.9, v0, -0.3))
        for season, _ in product((1, 2), range(int(street.u1 / 14))):
            u, lane = dice.real(street.u0, street.u1), dice.pick((-1, 1))
            v = lane * dice.pick((1.8, street.v1 - 1.3))
            long = dice.pick((2.2, 2.2, 2.2, 2.5, 5.0))
            self.park_car(frame.at(u, v), long, 0.9 if long < 4 else 1.25, season)


# --- uses of a block ---


def _park(city: _City, lot: Rect) -> None:
    """Lay out lawns, winding paths, a pond and many trees."""
    dice, real = city.dice, city.dice.real
    city.paint("meadow", lot)
    middle, half_u, half_v = lot.middle, lot.long / 2, lot.deep / 2

    def within(share: float) -> Frame:
        return middle.at(real(-share, share) * half_u, real(-share, share) * half_v)

    for _ in range(7):
        glade = Ellipse(within(0.8), real(8, 20), real(6, 14))
        city.paint(dice.pick(("lawn", "lawn", "rough")), glade)
    for _ in range(4):
        start, end = real(-0.9, 0.9), real(-0.9, 0.9)
        bends = [(start * half_u, -half_v), (real(-0.8, 0.8) * half_u, real(-9, 9))]
        bends += [(real(-0.8, 0.8) * half_u, half_v / 2), (end * half_u, half_v)]
        points = bend(tuple(middle.to_world(u, v) for u, v in bends))
        city.paint("kerb", Stroke(points, 3.0))
        city.paint("gravel", Stroke(points, 2.4))
    for _ in range(5):
        city.paint("flowers", Ellipse(within(0.8), real(2.5, 7), real(2, 4)), draw=9)
    pond = within(0.4)
    long, deep = real(11, 17), real(7, 11)
    bay = pond.at(long * 0.7, deep * 0.6)
    for kind, grown in (("paving", 4.0), ("shore", 2.0), ("water", 0.0)):
        city.paint(kind, Ellipse(bay, long * 0.6 + grown, deep * 0.8 + grown))
        city.paint(kind, Ellipse(pond, long + grown, deep + grown))
    city.grow_anywhere(lot, int(half_u * half_v / 22), clear=(pond, 21.0))


def _sports(city: _City, lot: Rect) -> None:
    """Lay out a running track around a pitch, and courts."""
    city.paint("plates", lot, draw=999)
    middle = lot.middle.at(0, 0, turned=lot.deep > lot.long)
    half_u, half_v = max(lot.long, lot.deep) / 2, min(lot.long, lot.deep) / 2
    radius = min(half_v - 12.0, 34.0)
    centre = middle.at(0, half_v - radius - 1.5)
    reach = half_u - radius - 1.5
    ends = centre.to_world(-reach, 0), centre.to_world(reach, 0)
    city.paint("running_track", Stroke(ends, 2 * radius))
    city.paint("pitch", centre.box(reach + radius * 0.3, radius - 11.0))
    for place in range(int(half_u * 2 / 29)):
        court = middle.at(-half_u + 15 + 29 * place, -half_v + 9.5)
        city.paint("court_marked", court.box(13.5, 7.5), place)
    for u in steps(-half_u + 3, half_u, 7.0):
        city.grow(middle.at(u, -half_v + 1), 1.8)


def _terrace(city: _City, lot: Rect) -> None:
    """Build rows of joined houses around a courtyard."""
    yard = lot.inset(13.0)
    city.paint(city.dice.pick(("lawn", "plates", "slabs")), yard, draw=999)
    city.paint("worn", yard, draw=3)
    city.fill_yard(yard)
    deep = city.dice.real(9.5, 12.0)
    flat = city.dice.chance(35)
    for v in (lot.v0, lot.v1 - deep):
        _build_row(city, Rect(lot.frame, lot.u0, lot.u1, v, v + deep), flat)
    for u in (lot.u0, lot.u1 - deep):
        ends = lot.v0 + deep + city.dice.pick((0.0, 5.0)), lot.v1 - deep
        # The row runs along v: its own u is v of the block.
        _build_row(city, Rect(lot.frame.at(0, 0, turned=True), *ends, -u - deep, -u), flat)


def _build_row(city: _City, strip: Rect, flat: bool) -> None:
    """Build joined houses along u of a strip, now and then leaving a gap."""
    dice, place, end = city.dice, strip.u0, strip.u1
    storeys = dice.integer(2, 5)
    while place < end - 8:
        long = min(dice.real(9.0, 22.0), end - place)
        if end - place - long < 8:
            long = end - place
        storeys = max(2, storeys + dice.integer(-1, 1))
        if not dice.chance(7):
            add = _flats if flat or dice.chance(20) else _house
            city.build(add, Rect(strip.frame, place, place + long, *strip[3:]), storeys)
        place += long


def _slab_rows(city: _City, lot: Rect) -> None:
    """Build long blocks of flats in parallel, with green and cars between."""
    dice, (frame, u0, u1, v, _) = city.dice, lot
    city.paint("lawn", lot, 1)
    gap, deep = dice.real(17.0, 24.0), dice.real(10.0, 13.0)
    storeys = dice.integer(4, 8)
    v += 2.0
    while v + deep < lot.v1:
        middle = u0 + lot.long * dice.real(0.35, 0.65)
        city.paint("slabs", Rect(frame, u0, u1, v + deep + 1, v + deep + 4), draw=99)
        for ends in ((u0 + 2, middle - 3), (middle + 3, u1 - 2)):
            if ends[1] - ends[0] > 14:
                rect = Rect(frame, *ends, v, v + deep)
                city.paint("paving", rect.inset(-1.5))
                add = _house if dice.chance(25) else _flats
                city.build(add, rect, storeys + dice.integer(-1, 1))
        strip = Rect(frame, u0, u1, v + deep + 4, v + deep + gap)
        if strip.deep > 12 and dice.chance(55):
            city.park_cars(Rect(frame, u0 + 4, u1 - 12, strip.v0, strip.v0 + 9))
        else:
            city.paint("flowers", strip.inset(3.0), draw=9)
            city.paint("gravel", strip.inset(4.0))
        for _ in range(int(strip.long / 6)):
            city.grow(city.anywhere(Rect(frame, u0, u1, strip.v1 - 4, strip.v1)), 2.2)
        v += deep + gap


def _houses(city: _City, lot: Rect) -> None:
    """Build small houses in gardens, with a lane in the middle."""
    columns = max(int(lot.long / city.dice.real(15.0, 19.0)), 1)
    rows = max(int(lot.deep / city.dice.real(18.0, 22.0)), 1)
    wide, high = lot.long / columns, lot.deep / rows
    for row, column in product(range(rows), range(columns)):
        u, v = lot.u0 + (column + 0.5) * wide, lot.v0 + (row + 0.5) * high
        _add_garden(city, lot.frame.at(u, v), wide / 2, high / 2)
    if rows > 2:
        v = lot.v0 + high * (rows // 2)
        city.paint("lane", Rect(lot.frame, lot.u0 - 3, lot.u1 + 3, v - 2.0, v + 2.0))


def _add_garden(city: _City, frame: Frame, half_u: float, half_v: float) -> None:
    dice, real = city.dice, city.dice.real
    whole = frame.box(half_u, half_v)
    city.paint("bed", whole)
    cover = dice.pick(("lawn", "lawn", "lawn", "beds", "gravel", "slabs", "rough"))
    city.paint(cover, whole.inset(0.5), draw=99)
    u, v = real(-1.0, 1.0), real(-2.5, 2.5)
    house = frame.at(u, v).box(real(4.2, half_u - 2.4), real(4.4, 6.0))
    city.paint("paving", house.inset(-1.2))
    city.paint("slabs", Rect(frame, half_u - 3.2, half_u - 0.6, -half_v, v), draw=99)
    for season in (1, 2) if dice.chance(60) else ():
        if dice.chance(70):
            spot = frame.at(half_u - 1.9, -half_v + real(2.5, 5.0), turned=True)
            city.park_car(spot, 2.2, 0.9, season)
    if dice.chance(12):
        city.paint("kerb", frame.at(-2, half_v - 3).box(3.4, 2.0))
        city.paint("pool", frame.at(-2, half_v - 3).box(3.0, 1.6))
    if city.build(_house, house, dice.integer(1, 3)) and dice.chance(35):
        city.build(_house, frame.at(u - 1.0, v + house.v1 + 2.0).box(2.4, 2.0), 1)
    for _ in range(dice.integer(0, 4)):
        u, v = real(-half_u, half_u), dice.pick((-1, 1)) * real(half_v - 3, half_v)
        city.grow(frame.at(u, v), 1.7, dice.pick(("broad", "broad", "bush", "cone")))


def _mall(city: _City, lot: Rect) -> None:
    """Lay out a big flat hall next to its parking lot."""
    city.paint("plates", lot, draw=999)
    middle = lot.u0 + lot.long * city.dice.real(0.45, 0.6)
    hall = Rect(lot.frame, lot.u0 + 3, middle, lot.v0 + 4, lot.v1 - 4)
    if not city.build(_flats, hall, city.dice.integer(2, 4)):
        city.fill_yard(hall)
    city.park_cars(Rect(lot.frame, middle + 5, lot.u1 - 1, lot.v0 + 2, lot.v1 - 2))
    for place in steps(lot.v0 + 8, lot.v1 - 4, 12.0):
        city.grow(lot.frame.at(middle + 3.4, place), 1.6)


def _towers(city: _City, lot: Rect) -> None:
    """Build tall blocks in a green, joined by paths."""
    real, middle = city.dice.real, lot.middle
    city.paint("lawn", lot, 2)
    city.paint("paving", Ellipse(middle, 14.0, 11.0))
    city.paint("flowers", Ellipse(middle, 9.0, 6.5), draw=9)
    city.paint("pool", Ellipse(middle, 4.5, 3.0))
    for a, b in product((0.24, 0.76), repeat=2):
        u, v = lot.u0 + a * lot.long, lot.v0 + b * lot.deep
        spot = lot.frame.at(u + real(-4, 4), v + real(-4, 4))
        city.paint("gravel", Stroke((spot.origin, middle.origin), 2.5))
        plaza = spot.box(real(8.0, 11.5), real(7.0, 9.5))
        city.paint("slabs", plaza.inset(-3.0), draw=999)
        city.build(_flats, plaza, city.dice.integer(7, 13))
    city.grow_anywhere(lot, 22)


def _works(city: _City, lot: Rect) -> None:
    """Build halls with metal roofs in a yard of concrete, or strew crates and heaps."""
    dice, u = city.dice, lot.u0 + 2
    city.paint("plates", lot, draw=999)
    city.paint("worn", lot, 1)
    while u < lot.u1 - 16:
        wide = min(dice.real(14.0, 26.0), lot.u1 - 2 - u)
        split = lot.v0 + lot.deep * dice.real(0.3, 0.7)
        for v0, v1 in ((lot.v0 + 2, split - 4), (split + 4, lot.v1 - 2)):
            hall = Rect(lot.frame, u, u + wide, v0, v1)
            if dice.chance(85) and city.build(_hall, hall, dice.integer(5, 9)):
                continue
            for _ in range(24):
                spot = city.anywhere(hall).at(0, 0, turned=dice.chance(50))
                kind = dice.pick(("car", "rubbish", "wood", "sand", "tar"))
                box = spot.box(*dice.pick(((3.0, 1.2), (1.5, 1.2), (2.2, 0.9))))
                city.paint(kind, box, dice.integer(0, 99), season=dice.integer(0, 2))
        u += wide + dice.real(5.0, 9.0)


# Where the border or the canal cuts a block, one big hall would leave a waste.
_SMALL = (_terrace, _slab_rows, _houses, _houses, _park)
_COMMON = (
    *(_terrace, _terrace, _slab_rows, _slab_rows, _houses, _houses),
    *(_towers, _mall, _works),
)

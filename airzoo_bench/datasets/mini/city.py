"""The layout of the city: a canal between two districts, streets, and blocks between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np

from airzoo_bench.datasets.mini import layout
from airzoo_bench.datasets.mini.layout import OLDER, SURVEY, Box, Frame, Plan, Point, Stroke
from airzoo_bench.datasets.mini.noise import Dice, direction, octaves
from airzoo_bench.datasets.mini.world import SIDE_M
from airzoo_bench.geometry.arrays import Bools, Floats

_STREAM = 17
_STREETS_M = (20.0, 18.0, 14.0, 12.0, 9.0, 8.0, 7.0, 7.0)  # width, by depth of division
_WATER_M, _STREET_M = 35.5, 41.0
# Nothing is built nearer to the canal's middle, and no tree is planted.
_BANK_M, _TOWPATH_M = 26.0, 14.0
_STALL_M, _PAVEMENT_M = 2.75, 4.0
_MIDDLE = Frame(SIDE_M / 2, SIDE_M / 2)


def city_plan(seed: int) -> Plan:
    """Lay out the city."""
    dice = Dice(seed, _STREAM)
    middle = dice.real(0.38, 0.62) * SIDE_M
    along = np.linspace(-60, SIDE_M + 60, 8).tolist()
    canal = layout.bend(tuple((x, middle + dice.real(-55, 55)) for x in along))
    starts = [int(len(canal) * (share + dice.real(-0.06, 0.06))) for share in (0.18, 0.5, 0.82)]
    bridges = [Frame.along(*canal[at : at + 2]).at(0, 0, turned=True) for at in starts]
    city = _City(seed, dice, _heights(seed, canal, bridges), canal)
    turn = dice.integer(2, 22)
    for city.side, step in ((1, turn), (2, turn - dice.integer(10, 30))):
        city.lay_district(Frame(*_MIDDLE[:2], *direction(step)))
    city.side = 0
    city.lay_canal(bridges)

    def is_dry(x: Floats, y: Floats) -> Bools:
        dry = layout.distance_to_line(x, y, canal) > 15.0
        for u, v in (frame.to_local(x, y) for frame in bridges):
            dry &= (np.abs(u) > 30) | (np.abs(v) > 10.5)
        return dry

    city.fell(is_dry)
    return city


def _heights(seed: int, canal: layout.Line, bridges: list[Frame]) -> Floats:
    hills = octaves(seed, 10, layout.LAND_X.size, {120: 10, 60: 4, 20: 2})
    land = _STREET_M + hills.astype(np.float64) * (7.0 / 4096)
    away = layout.distance_to_line(layout.LAND_X, layout.LAND_Y, canal)
    level = layout.blended(land, away, _STREET_M, 20.0, 90.0)
    carved = layout.blended(level, away, _WATER_M, 10.5, 16.0)
    for u, v in (frame.to_local(layout.LAND_X, layout.LAND_Y) for frame in bridges):
        carved = np.where((np.abs(u) <= 24.0) & (np.abs(v) <= 9.0), level, carved)
    return carved


@dataclass
class _City(Plan):
    """The plan of the city, which adds on one side of its divide at a time."""

    axes: Frame = _MIDDLE  # all streets and buildings of a side are parallel to these
    taken: list[tuple[float, ...]] = field(default_factory=list)  # buildings: u0, u1, v0, v1

    def is_free(self, points: Sequence[Point], bank_m: float = _BANK_M) -> bool:
        """Return whether points are inside, on this side of the canal and off its bank."""
        x, y = np.array(points).T
        inside = (np.minimum(x, y) > 4.0) & (np.maximum(x, y) < SIDE_M - 4.0)
        apart = layout.distance_to_line(x, y, self.divide) > bank_m
        return bool(np.all(inside & apart & (self.is_north(x, y) == (self.side == 1))))

    def grow(self, spot: Frame, radius: float, kind: str = "broad") -> None:
        """Plant a tree at a frame's origin, of about that radius, if there is room."""
        if self.is_free([spot[:2]], _TOWPATH_M):
            radius *= self.dice.real(0.7, 1.3)
            slim = self.dice.real(2.1, 2.9) if kind == "broad" else 3.4
            self.plant(spot[:2], radius, max(radius * slim, 2.5), kind)

    def grow_anywhere(self, lot: Box, count: int, pond: Frame | None = None) -> None:
        for _ in range(count):
            spot = self.anywhere(lot.inset(2))
            if pond is None or layout.distance(spot[:2], pond[:2]) > 21.0:
                self.grow(spot, 2.6, self.dice.pick(("broad", "broad", "broad", "cone", "bush")))

    def raise_on(self, kind: str, box: Box, storeys: float) -> bool:
        """Build on a rectangle if it is free; the building's frame is at its middle."""
        u, v = self.axes.to_local(*np.array(box.grid(1)).T)
        # Less a millimetre a side, so that houses may touch.
        own = (u.min() + 0.001, u.max() - 0.001, v.min() + 0.001, v.max() - 0.001)
        met = (a < own[1] and own[0] < b and c < own[3] and own[2] < d for a, b, c, d in self.taken)
        if not self.is_free(box.grid(2)) or any(met):
            return False
        self.taken.append(own)
        self.build(kind, box.middle, box.long / 2, box.deep / 2, 3.0 * storeys)
        return True

    def park_rows(self, lot: Box) -> None:
        """Mark stalls in rows, and leave cars on some of them, others in each season."""
        dice, rows = self.dice, max(round(lot.deep / 16.0), 1)
        self.paint("parking", lot)
        high = lot.deep / rows
        first = float(np.floor(lot.u0 / _STALL_M) + 1) * _STALL_M
        stalls = [first + stall * _STALL_M for stall in range(int(lot.long / _STALL_M))]
        for season in (SURVEY, OLDER):
            share = dice.integer(30, 75)
            for row, end, stall in product(range(rows), (2.4, high - 2.4), stalls):
                if dice.chance(share) and stall + 2.5 < lot.u1:
                    v = lot.v0 + row * high + end + dice.real(-0.3, 0.3)
                    spot = lot.frame.at(stall + 1.5, v, turned=True)
                    self.park(spot, season, dice.pick((2.0, 2.2, 2.4)))

    def lay_canal(self, bridges: list[Frame]) -> None:
        dice = self.dice
        for kind, width in layout.LOOKS["city"]["canal"]:
            self.paint(kind, Stroke(self.divide, width), 0)
        for ends, share, side in product(pairwise(self.divide), (0.2, 0.7), (-1, 1)):
            left = side * (15.6 if dice.chance(70) else 23.4) / layout.distance(*ends)
            place = layout.between(*ends, share + dice.real(-0.15, 0.15), left)
            self.plant(place, dice.real(1.8, 3.4), dice.real(5.5, 8.5))
        for frame in bridges:
            for kind, half_u, half_v in layout.LOOKS["city"]["bridge"]:
                self.paint(kind, frame.box(half_u, half_v))
            for v in (-6.1, 6.1):
                self.paint("kerb", frame.at(0, v).box(24.5, 0.3))
                self.paint("crossing", frame.at(22.0 * v / 6.1, 0).box(1.5, 5.6))

    # --- districts ---

    def lay_district(self, axes: Frame) -> None:
        """Divide a side into blocks by streets, fill the blocks and mark the streets."""
        self.axes, self.taken, dice = axes, [], self.dice
        blocks, streets = self._split(axes.box(420.0, 420.0), 0)
        self.paint("asphalt", _MIDDLE.box(SIDE_M, SIDE_M))
        for street in streets:
            if street.v1 < 5:
                self.paint("lane", street)
            self.strew("repairs", street, int(street.u1 / 12))
        self._fill_blocks(blocks)
        for street in (street for street in streets if street.v1 >= 4):
            frame, u0, u1, v0, v1, _ = street
            self.paint("dashes", frame.box(u1, 0.15))
            if v1 > 6:
                self.paint("yellow", frame.box(u1, 0.3))
                for v in (-3.4, 3.4):
                    self.paint("dashes", frame.at(0, v).box(u1, 0.15))
            for u in (u0 + 4.0, u1 - 4.0, dice.real(u0, u1)):
                self.paint("crossing", street.part(u - 1.6, u + 1.6, v0 + 0.6, v1 - 0.6))
                self.paint("marking", street.part(u + 2.4, u + 2.9, v0 + 0.6, -0.3))
            for season, _ in product((SURVEY, OLDER), range(int(u1 / 14))):
                v = dice.pick((-1, 1)) * dice.pick((1.8, v1 - 1.3))
                spot = frame.at(dice.real(u0, u1), v)
                self.park(spot, season, dice.pick((2.2, 2.2, 2.2, 2.5, 5.0)))

    def _split(self, box: Box, depth: int) -> tuple[list[Box], list[Box]]:
        """Return the blocks and streets, the latter along u about their middles, of a part."""
        if max(box.long, box.deep) < 118 and min(box.long, box.deep) < 100:
            return [box], []
        half = _STREETS_M[min(depth, len(_STREETS_M) - 1)] / 2
        share, (_, u0, u1, v0, v1, _) = self.dice.real(0.4, 0.6), box
        if box.long > box.deep:
            cut = u0 + box.long * share
            street = box.frame.at(cut, (v0 + v1) / 2, turned=True).box(box.deep / 2, half)
            parts = box.part(u0, cut - half, v0, v1), box.part(cut + half, u1, v0, v1)
        else:
            cut = v0 + box.deep * share
            street = box.frame.at((u0 + u1) / 2, cut).box(box.long / 2, half)
            parts = box.part(u0, u1, v0, cut - half), box.part(u0, u1, cut + half, v1)
        (first, ways), (rest, others) = (self._split(part, depth + 1) for part in parts)
        return first + rest, [street, *ways, *others]

    def _fill_blocks(self, blocks: list[Box]) -> None:
        """Fill the blocks that may be seen; the largest ones take the uses that need room."""
        seen, free = [], {}
        for block in blocks:
            x, y = np.array(block.grid(8)).T
            inside = (np.maximum(x, y) < SIDE_M + 5) & (np.minimum(x, y) > -5)
            if np.any(inside & (self.is_north(x, y) == (self.side == 1))):
                seen.append(block)
                free[block] = self.is_free(block.grid(2))
        by_size = sorted(seen, key=lambda block: (not free[block], -block.long * block.deep))
        chosen = dict(zip(by_size, self._LARGEST, strict=False))
        for block in seen:
            self.paint("kerb", block)
            self.paint("slabs", block.inset(0.35))
            gap, (frame, u0, u1, v0, v1, _) = self.dice.real(8.0, 13.0), block
            rows = [(frame, u0, u1, v) for v in (v0 + 1.4, v1 - 1.4)]
            turned = frame.at(0, 0, turned=True)
            rows += [(turned, v0, v1, -u) for u in (u0 + 1.4, u1 - 1.4)]
            for row, start, end, off in rows:
                for place in () if self.dice.chance(30) else layout.steps(start + 6, end - 6, gap):
                    if self.dice.chance(80):
                        self.paint("soil", row.at(place, off).box(0.75, 0.75))
                        self.grow(row.at(place, off), 2.1)
            fill = chosen.get(block) or self.dice.pick(self._COMMON if free[block] else self._SMALL)
            fill(self, block.inset(_PAVEMENT_M))

    # --- uses of a block ---

    def _lay_park(self, lot: Box) -> None:
        dice, real, middle = self.dice, self.dice.real, lot.middle
        half_u, half_v = lot.long / 2, lot.deep / 2
        heart = middle.box(0.8 * half_u, 0.8 * half_v)
        self.paint("meadow", lot)
        for _ in range(7):
            glade = self.anywhere(heart).box(real(8, 20), real(6, 14), is_round=True)
            self.paint(dice.pick(("lawn", "lawn", "rough")), glade)
        for _ in range(4):
            ends = [(real(-0.9, 0.9) * half_u, v) for v in (-half_v, half_v)]
            bends = [(real(-0.8, 0.8) * half_u, v) for v in (real(-9, 9), half_v / 2)]
            path = layout.bend(tuple(middle.to_world(*at) for at in (ends[0], *bends, ends[1])))
            self.paint("kerb", Stroke(path, 3.0))
            self.paint("gravel", Stroke(path, 2.4))
        for _ in range(5):
            self.paint("flowers", self.anywhere(heart).box(real(2.5, 7), real(2, 4), is_round=True))
        pond = self.anywhere(middle.box(0.4 * half_u, 0.4 * half_v))
        long, deep = real(11, 17), real(7, 11)
        bay = pond.at(long * 0.7, deep * 0.6)
        for kind, grown in (("paving", 4.0), ("shore", 2.0), ("water", 0.0)):
            self.paint(kind, bay.box(long * 0.6 + grown, deep * 0.8 + grown, is_round=True))
            self.paint(kind, pond.box(long + grown, deep + grown, is_round=True))
        self.grow_anywhere(lot, int(half_u * half_v / 22), pond)

    def _lay_sports(self, lot: Box) -> None:
        self.paint("plates", lot)
        middle = lot.middle.at(0, 0, turned=lot.deep > lot.long)
        half_u, half_v = max(lot.long, lot.deep) / 2, min(lot.long, lot.deep) / 2
        radius = min(half_v - 12.0, 34.0)
        centre, reach = middle.at(0, half_v - radius - 1.5), half_u - radius - 1.5
        ends = centre.to_world(-reach, 0), centre.to_world(reach, 0)
        self.paint("running_track", Stroke(ends, 2 * radius))
        self.paint("pitch", centre.box(reach + radius * 0.3, radius - 11.0))
        for place in range(int(half_u * 2 / 29)):
            court = middle.at(-half_u + 15 + 29 * place, -half_v + 9.5)
            self.paint("court_marked", court.box(13.5, 7.5), place)
        for u in layout.steps(-half_u + 3, half_u, 7.0):
            self.grow(middle.at(u, -half_v + 1), 1.8)

    def _build_terrace(self, lot: Box) -> None:
        """Build rows of joined houses around a courtyard."""
        yard, dice = lot.inset(13.0), self.dice
        self.paint(dice.pick(("lawn", "plates", "slabs")), yard)
        self.paint("worn", yard)
        self._fill_yard(yard)
        deep, flat = dice.real(9.5, 12.0), dice.chance(35)
        rows = [lot.part(lot.u0, lot.u1, v, v + deep) for v in (lot.v0, lot.v1 - deep)]
        across = lot.frame.at(0, 0, turned=True), lot.v0 + deep, lot.v1 - deep
        rows += [Box(*across, -u - deep, -u) for u in (lot.u0, lot.u1 - deep)]
        for row in rows:
            place, storeys = row.u0, dice.integer(2, 5)
            while place < row.u1 - 8:
                left = row.u1 - place
                long = min(dice.real(9.0, 22.0), left)
                long = left if left - long < 8 else long
                storeys = max(2, storeys + dice.integer(-1, 1))
                if not dice.chance(7):
                    kind = "flats" if flat or dice.chance(20) else "house"
                    self.raise_on(kind, row._replace(u0=place, u1=place + long), storeys)
                place += long

    def _fill_yard(self, yard: Box) -> None:
        area = max(yard.long, 0.0) * max(yard.deep, 0.0)
        self.strew("beds", yard, int(area / 120))
        self.grow_anywhere(yard, max(int(area / 90), 1))

    def _build_slabs(self, lot: Box) -> None:
        """Build long blocks of flats in parallel, with green and cars between."""
        dice, u0, u1 = self.dice, lot.u0, lot.u1
        self.paint("lawn", lot)
        gap, deep, storeys = dice.real(17.0, 24.0), dice.real(10.0, 13.0), dice.integer(4, 8)
        for v in layout.steps(lot.v0 + 2.0, lot.v1 - deep, deep + gap):
            middle = u0 + lot.long * dice.real(0.35, 0.65)
            self.paint("slabs", lot.part(u0, u1, v + deep + 1, v + deep + 4))
            for start, end in ((u0 + 2, middle - 3), (middle + 3, u1 - 2)):
                if end - start > 14:
                    box = lot.part(start, end, v, v + deep)
                    self.paint("paving", box.inset(-1.5))
                    kind = "house" if dice.chance(25) else "flats"
                    self.raise_on(kind, box, storeys + dice.integer(-1, 1))
            strip = lot.part(u0, u1, v + deep + 4, v + deep + gap)
            if strip.deep > 12 and dice.chance(55):
                self.park_rows(strip.part(u0 + 4, u1 - 12, strip.v0, strip.v0 + 9))
            else:
                self.paint("flowers", strip.inset(3.0))
                self.paint("gravel", strip.inset(4.0))
            for _ in range(int(strip.long / 6)):
                self.grow(self.anywhere(strip.part(u0, u1, strip.v1 - 4, strip.v1)), 2.2)

    def _build_houses(self, lot: Box) -> None:
        columns = max(int(lot.long / self.dice.real(15.0, 19.0)), 1)
        rows = max(int(lot.deep / self.dice.real(18.0, 22.0)), 1)
        wide, high = lot.long / columns, lot.deep / rows
        for row, column in product(range(rows), range(columns)):
            u, v = lot.u0 + (column + 0.5) * wide, lot.v0 + (row + 0.5) * high
            self._add_garden(lot.frame.at(u, v), wide / 2, high / 2)
        if rows > 2:
            v = lot.v0 + high * (rows // 2)
            self.paint("lane", lot.part(lot.u0 - 3, lot.u1 + 3, v - 2.0, v + 2.0))

    def _add_garden(self, frame: Frame, half_u: float, half_v: float) -> None:
        dice, real, whole = self.dice, self.dice.real, frame.box(half_u, half_v)
        self.paint("bed", whole)
        cover = dice.pick(("lawn", "lawn", "lawn", "beds", "gravel", "slabs", "rough"))
        self.paint(cover, whole.inset(0.5))
        u, v = real(-1.0, 1.0), real(-2.5, 2.5)
        house = frame.at(u, v).box(real(4.2, half_u - 2.4), real(4.4, 6.0))
        self.paint("paving", house.inset(-1.2))
        self.paint("slabs", whole.part(half_u - 3.2, half_u - 0.6, -half_v, v))
        for season in (SURVEY, OLDER):
            if dice.chance(42):
                self.park(frame.at(half_u - 1.9, -half_v + real(2.5, 5.0), turned=True), season)
        if dice.chance(12):
            self.paint("kerb", frame.at(-2, half_v - 3).box(3.4, 2.0))
            self.paint("pool", frame.at(-2, half_v - 3).box(3.0, 1.6))
        if self.raise_on("house", house, dice.integer(1, 3)) and dice.chance(35):
            self.raise_on("house", frame.at(u - 1.0, v + house.v1 + 2.0).box(2.4, 2.0), 1)
        for _ in range(dice.integer(0, 4)):
            u, v = real(-half_u, half_u), dice.pick((-1, 1)) * real(half_v - 3, half_v)
            self.grow(frame.at(u, v), 1.7, dice.pick(("broad", "broad", "bush", "cone")))

    def _build_mall(self, lot: Box) -> None:
        """Lay out a big flat hall next to its parking lot."""
        self.paint("plates", lot)
        middle = lot.u0 + lot.long * self.dice.real(0.45, 0.6)
        hall = lot.part(lot.u0 + 3, middle, lot.v0 + 4, lot.v1 - 4)
        if not self.raise_on("flats", hall, self.dice.integer(2, 4)):
            self._fill_yard(hall)
        self.park_rows(lot.part(middle + 5, lot.u1 - 1, lot.v0 + 2, lot.v1 - 2))
        for place in layout.steps(lot.v0 + 8, lot.v1 - 4, 12.0):
            self.grow(lot.frame.at(middle + 3.4, place), 1.6)

    def _build_towers(self, lot: Box) -> None:
        real, middle = self.dice.real, lot.middle
        self.paint("lawn", lot)
        for kind, a, b in (("paving", 14.0, 11.0), ("flowers", 9.0, 6.5), ("pool", 4.5, 3.0)):
            self.paint(kind, middle.box(a, b, is_round=True))
        for a, b in product((0.24, 0.76), repeat=2):
            u, v = lot.u0 + a * lot.long, lot.v0 + b * lot.deep
            spot = lot.frame.at(u + real(-4, 4), v + real(-4, 4))
            self.paint("gravel", Stroke((spot[:2], middle[:2]), 2.5))
            plaza = spot.box(real(8.0, 11.5), real(7.0, 9.5))
            self.paint("slabs", plaza.inset(-3.0))
            self.raise_on("flats", plaza, self.dice.integer(7, 9))
        self.grow_anywhere(lot, 22)

    def _build_works(self, lot: Box) -> None:
        """Build halls with metal roofs in a yard of concrete, or strew goods."""
        dice, u = self.dice, lot.u0 + 2
        self.paint("plates", lot)
        self.paint("worn", lot, 1)
        while u < lot.u1 - 16:
            wide = min(dice.real(14.0, 26.0), lot.u1 - 2 - u)
            split = lot.v0 + lot.deep * dice.real(0.3, 0.7)
            for v0, v1 in ((lot.v0 + 2, split - 4), (split + 4, lot.v1 - 2)):
                hall = lot.part(u, u + wide, v0, v1)
                if dice.chance(15) or not self.raise_on("barn", hall, dice.real(1.6, 3.0)):
                    self.strew("goods", hall, 24)
            u += wide + dice.real(5.0, 9.0)

    _LARGEST = (_lay_sports, _lay_park, _build_mall)
    # Where the border or the canal cuts a block, one big hall would leave a waste.
    _SMALL = (_build_terrace, _build_slabs, _build_slabs, _build_houses, _build_houses, _lay_park)
    _COMMON = (_build_terrace, *_SMALL[:5], _build_towers, _build_mall, _build_works)

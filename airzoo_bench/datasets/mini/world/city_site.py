"""Districts of the city: where they may be built on, and what is open in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from airzoo_bench.datasets.mini.noise import Dice
from airzoo_bench.datasets.mini.world.model import SIDE_M
from airzoo_bench.datasets.mini.world.plan import Plan, overlaps_border
from airzoo_bench.datasets.mini.world.shapes import (
    Ellipse,
    Frame,
    Point,
    Rect,
    Shape,
    Stroke,
    bend,
    distance_to_line,
    line_height,
    square,
    steps,
)

__all__ = ["Site", "anywhere", "fill_yard", "park", "park_cars", "scatter_trees", "sports", "store"]

# Nothing is built nearer to the canal's middle, and no tree is planted.
_BANK_M, _TOWPATH_M = 26.0, 14.0
_STALL_M = 2.75
_Box = tuple[float, float, float, float]
Adder = Callable[[Plan, Dice, Frame, float, float, int], None]


@dataclass(frozen=True, eq=False)
class Site:
    """A district, on one side of the plan's divide, that is being built on."""

    plan: Plan
    side: int
    axes: Frame  # all its streets and buildings are parallel to these
    blocks: list[Rect] = field(default_factory=list)  # what streets part; streets run along u
    streets: list[Rect] = field(default_factory=list)
    # from (u, v) to (u, v) in the axes: where buildings stand already
    taken: list[_Box] = field(default_factory=list)

    def paint(self, kind: str, shape: Shape, key: int = 0, season: int = 0) -> None:
        """Add a decal on this side."""
        self.plan.paint(kind, shape, key, side=self.side, season=season)

    def plant(self, dice: Dice, frame: Frame, radius: float, kind: str = "broad") -> None:
        """Add a tree at a frame's origin, of about that radius, where it may stand."""
        if overlaps_border([frame.origin]) or not self._holds([frame.origin], _TOWPATH_M):
            return
        radius *= dice.real(0.7, 1.3)
        height = radius * dice.real(2.1, 2.9) if kind == "broad" else radius * 3.4
        self.plan.plant(frame.origin, radius, max(height, 2.5), kind)

    def build(self, dice: Dice, add: Adder, rect: Rect, storeys: int) -> bool:
        """Build on a rectangle if it may be; the building's frame is at its middle."""
        u0, v0, u1, v1 = box = self._box(rect)
        stands = (a0 < u1 and u0 < a1 and b0 < v1 and v0 < b1 for a0, b0, a1, b1 in self.taken)
        if not self.allows(rect) or any(stands):
            return False
        self.taken.append(box)
        add(self.plan, dice, rect.middle, rect.long / 2, rect.deep / 2, storeys)
        return True

    def allows(self, rect: Rect) -> bool:
        """Return whether a building may stand there."""
        points = rect.corners()
        points += [rect.frame.to_world((rect.u0 + rect.u1) / 2, v) for v in (rect.v0, rect.v1)]
        points += [rect.frame.to_world(u, (rect.v0 + rect.v1) / 2) for u in (rect.u0, rect.u1)]
        return not overlaps_border(points) and self._holds(points, _BANK_M)

    def reaches(self, block: Rect) -> bool:
        """Return whether any of a block may be seen."""
        shares = product([share / 8 for share in range(9)], repeat=2)
        points = [
            block.frame.to_world(block.u0 + a * block.long, block.v0 + b * block.deep)
            for a, b in shares
        ]
        x, y = np.array(points).T
        seen = (np.maximum(x, y) < SIDE_M + 5) & (np.minimum(x, y) > -5)
        north = y > line_height(x, self.plan.divide)
        return bool(np.any(seen & (north == (self.side == 1))))

    def _holds(self, points: list[Point], bank_m: float) -> bool:
        """Return whether points are on this side and that far from the canal's middle."""
        x, y = np.array(points).T
        north = y > line_height(x, self.plan.divide)
        apart = distance_to_line(x, y, self.plan.divide) > bank_m
        return bool(np.all(north == (self.side == 1)) and np.all(apart))

    def _box(self, rect: Rect) -> _Box:
        """Return a rectangle in the axes, less a millimetre a side, so that houses may touch."""
        u, v = self.axes.to_local(*np.array(rect.corners()).T)
        low_u, low_v, high_u, high_v = map(float, (u.min(), v.min(), u.max(), v.max()))
        return low_u + 0.001, low_v + 0.001, high_u - 0.001, high_v - 0.001


def anywhere(dice: Dice, rect: Rect) -> Frame:
    """Draw a place in a rectangle."""
    return rect.frame.at(dice.real(rect.u0, rect.u1), dice.real(rect.v0, rect.v1))


def park_cars(site: Site, dice: Dice, lot: Rect) -> None:
    """Mark stalls in rows, and leave cars on some of them, others in each season."""
    site.paint("parking", lot)
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
                car = square(spot, dice.pick((2.0, 2.2, 2.4)), 0.9)
                site.paint("car", car, dice.integer(0, 99), season)


def store(site: Site, dice: Dice, yard: Rect) -> None:
    """Strew crates and heaps in the open."""
    for _ in range(24):
        spot = anywhere(dice, yard).at(0, 0, turned=dice.chance(50))
        kind = dice.pick(("car", "rubbish", "wood", "sand", "tar"))
        half = dice.pick(((3.0, 1.2), (1.5, 1.2), (2.2, 0.9)))
        site.paint(kind, square(spot, *half), dice.integer(0, 99), dice.integer(0, 2))


def park(site: Site, dice: Dice, lot: Rect) -> None:
    """Lay out lawns, winding paths, a pond and many trees."""
    site.paint("meadow", lot)
    middle, half_u, half_v = lot.middle, lot.long / 2, lot.deep / 2

    def within(share: float) -> Frame:
        u, v = dice.real(-share, share) * half_u, dice.real(-share, share) * half_v
        return middle.at(u, v)

    for _ in range(7):
        glade = Ellipse(within(0.8), dice.real(8, 20), dice.real(6, 14))
        site.paint(dice.pick(("lawn", "lawn", "rough")), glade)
    for _ in range(4):
        start, end = dice.real(-0.9, 0.9), dice.real(-0.9, 0.9)
        bends = [(start * half_u, -half_v), (dice.real(-0.8, 0.8) * half_u, dice.real(-9, 9))]
        bends += [(dice.real(-0.8, 0.8) * half_u, half_v / 2), (end * half_u, half_v)]
        points = bend(tuple(middle.to_world(u, v) for u, v in bends))
        site.paint("kerb", Stroke(points, 3.0))
        site.paint("gravel", Stroke(points, 2.4))
    for _ in range(5):
        bed = Ellipse(within(0.8), dice.real(2.5, 7), dice.real(2, 4))
        site.paint("flowers", bed, dice.integer(0, 9))
    pond = within(0.4)
    long, deep = dice.real(11, 17), dice.real(7, 11)
    bay = pond.at(long * 0.7, deep * 0.6)
    for kind, grown in (("paving", 4.0), ("shore", 2.0), ("water", 0.0)):
        site.paint(kind, Ellipse(bay, long * 0.6 + grown, deep * 0.8 + grown))
        site.paint(kind, Ellipse(pond, long + grown, deep + grown))
    scatter_trees(site, dice, lot, int(half_u * half_v / 22), clear=(pond, 21.0))


def sports(site: Site, dice: Dice, lot: Rect) -> None:
    """Lay out a running track around a pitch, and courts."""
    site.paint("plates", lot, dice.integer(0, 999))
    middle = lot.middle.at(0, 0, turned=lot.deep > lot.long)
    half_u, half_v = max(lot.long, lot.deep) / 2, min(lot.long, lot.deep) / 2
    radius = min(half_v - 12.0, 34.0)
    centre = middle.at(0, half_v - radius - 1.5)
    reach = half_u - radius - 1.5
    ends = centre.to_world(-reach, 0), centre.to_world(reach, 0)
    site.paint("running_track", Stroke(ends, 2 * radius))
    site.paint("pitch", square(centre, reach + radius * 0.3, radius - 11.0))
    for place in range(int(half_u * 2 / 29)):
        court = middle.at(-half_u + 15 + 29 * place, -half_v + 9.5)
        site.paint("court_marked", square(court, 13.5, 7.5), place)
    for u in steps(-half_u + 3, half_u, 7.0):
        site.plant(dice, middle.at(u, -half_v + 1), 1.8)


def fill_yard(site: Site, dice: Dice, yard: Rect) -> None:
    """Strew beds and trees over a yard."""
    area = max(yard.long, 0.0) * max(yard.deep, 0.0)
    for _ in range(int(area / 120)):
        spot = anywhere(dice, yard)
        kind = dice.pick(("lawn", "flowers", "gravel", "beds", "concrete", "court"))
        bed = square(spot, dice.real(1.5, 5.0), dice.real(1.5, 4.0))
        site.paint(kind, bed, dice.integer(0, 99))
    scatter_trees(site, dice, yard, max(int(area / 90), 1))


def scatter_trees(
    site: Site, dice: Dice, lot: Rect, count: int, clear: tuple[Frame, float] | None = None
) -> None:
    """Plant trees anywhere in a lot, but not within a distance of a point."""
    for _ in range(count):
        spot = anywhere(dice, lot.inset(2))
        if clear is not None:
            u, v = spot.x - clear[0].x, spot.y - clear[0].y
            if u * u + v * v < clear[1] * clear[1]:
                continue
        site.plant(dice, spot, 2.6, dice.pick(("broad", "broad", "broad", "cone", "bush")))

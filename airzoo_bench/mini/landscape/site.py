"""A district of the city that is being built on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from airzoo_bench.mini.landscape.canvas import line_height
from airzoo_bench.mini.landscape.houses import overlaps_border
from airzoo_bench.mini.landscape.plan import Plan, Tree
from airzoo_bench.mini.landscape.randomness import Dice
from airzoo_bench.mini.landscape.shapes import Frame, Point, Rect, Shape, distance_to_line

_Box = tuple[float, float, float, float]
_SIDE_M = 600.0
Adder = Callable[[Plan, Dice, Frame, float, float, int], int]

__all__ = ["Site", "build_on"]


@dataclass(frozen=True, eq=False)
class Site:
    """A district that is being built on.

    Attributes
    ----------
    plan : Plan
    side : int
    canal : tuple of points
    bank_m : float
        Nothing is built nearer to the canal's middle.
    axes : Frame
        Those of the district, which all its buildings are parallel to.
    taken : list of boxes
        From (u, v) to (u, v) in these axes: where buildings stand already.
    """

    plan: Plan
    side: int
    canal: tuple[Point, ...]
    bank_m: float
    axes: Frame
    taken: list[_Box] = field(default_factory=list)

    def is_free(self, rect: Rect) -> bool:
        """Return whether no building stands in a rectangle yet; houses may touch."""
        u0, v0, u1, v1 = self.box(rect)
        return not any(
            u0 < b_u1 and b_u0 < u1 and v0 < b_v1 and b_v0 < v1
            for b_u0, b_v0, b_u1, b_v1 in self.taken
        )

    def box(self, rect: Rect) -> _Box:
        """Return a rectangle in the district's axes, smaller by a millimetre on each side."""
        u, v = self.axes.to_local(*np.array(rect.corners()).T)
        low_u, high_u, low_v, high_v = (float(f) for f in (u.min(), u.max(), v.min(), v.max()))
        return low_u + 0.001, low_v + 0.001, high_u - 0.001, high_v - 0.001

    def allows(self, rect: Rect) -> bool:
        """Return whether a building may stand there."""
        points = rect.corners()
        points += [rect.frame.to_world((rect.u0 + rect.u1) / 2, v) for v in (rect.v0, rect.v1)]
        points += [rect.frame.to_world(u, (rect.v0 + rect.v1) / 2) for u in (rect.u0, rect.u1)]
        return not overlaps_border(points) and self.holds(points, self.bank_m)

    def holds(self, points: list[Point], bank_m: float) -> bool:
        """Return whether points are on this side and that far from the canal's middle."""
        x, y = np.array(points).T
        north = y > line_height(x, self.canal)
        apart = distance_to_line(x, y, self.canal) > bank_m
        return bool(np.all(north == (self.side == 1)) and np.all(apart))

    def reaches(self, block: Rect) -> bool:
        """Return whether any of a block may be seen."""
        steps = [share / 8 for share in range(9)]
        points = [
            block.frame.to_world(
                block.u0 + a * (block.u1 - block.u0), block.v0 + b * (block.v1 - block.v0)
            )
            for a in steps
            for b in steps
        ]
        x, y = np.array(points).T
        seen = (np.maximum(x, y) < _SIDE_M + 5) & (np.minimum(x, y) > -5)
        north = y > line_height(x, self.canal)
        return bool(np.any(seen & (north == (self.side == 1))))

    def paint(self, kind: str, shape: Shape, key: int = 0, season: int = 0) -> None:
        """Add a decal on this side."""
        self.plan.paint(kind, shape, key, side=self.side, season=season)

    def plant(self, dice: Dice, frame: Frame, radius: float, kind: str = "broad") -> None:
        """Add a tree at a frame's origin, of about that radius, where it may stand."""
        point = (frame.x, frame.y)
        if overlaps_border([point]) or not self.holds([point], 14.0):
            return
        radius *= dice.real(0.7, 1.3)
        height = radius * dice.real(2.1, 2.9) if kind == "broad" else radius * 3.4
        self.plan.trees.append(Tree(*point, radius, max(height, 2.5), kind))


def build_on(
    site: Site,
    dice: Dice,
    add: Adder,
    rect: Rect,
    storeys: int,
) -> bool:
    """Build on a rectangle if it may be; the building's frame is at its middle."""
    if not site.allows(rect) or not site.is_free(rect):
        return False
    site.taken.append(site.box(rect))
    frame = rect.frame.at((rect.u0 + rect.u1) / 2, (rect.v0 + rect.v1) / 2)
    add(site.plan, dice, frame, (rect.u1 - rect.u0) / 2, (rect.v1 - rect.v0) / 2, storeys)
    return True

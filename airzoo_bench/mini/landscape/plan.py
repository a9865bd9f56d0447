"""What a layout consists of, before anything is painted or meshed."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape.shapes import Frame, Rect, Shape

__all__ = ["GRID_M", "Building", "Decal", "Plan", "Roof", "Tree", "square"]

GRID_M = 2.0


class Roof(IntEnum):
    """The form of a roof."""

    FLAT = 0
    GABLED = 1
    HIPPED = 2
    SHED = 3


@dataclass(frozen=True)
class Building:
    """A box with a roof.

    Attributes
    ----------
    rect : Rect
        Its plan, centred on the frame's origin; a ridge runs along u.
    base_m, eaves_m, ridge_m : float
        Heights of the floor, of the walls' top, and of the roof's highest line.
    roof : Roof
    cover : str
        How the roof is painted: a name of `roofs.COVERS`.
    roof_colour, wall_colour, window_colour : (3,) ints
    storey_m, bay_m : float
    style : int
        See `mini.world.Buildings`.
    parent : int
        The building on whose roof it stands, or -1.
    """

    rect: Rect
    base_m: float
    eaves_m: float
    ridge_m: float
    roof: Roof
    cover: str
    roof_colour: tuple[int, int, int]
    wall_colour: tuple[int, int, int]
    window_colour: tuple[int, int, int] = (70, 84, 98)
    storey_m: float = 3.0
    bay_m: float = 3.2
    style: int = 0
    parent: int = -1


@dataclass(frozen=True)
class Tree:
    """A canopy on a trunk.

    Attributes
    ----------
    x, y : float
    radius_m, height_m : float
        Of the canopy; of its top above the ground.
    kind : str
        ``"broad"``, ``"cone"``, ``"bush"`` or ``"bale"``.
    """

    x: float
    y: float
    radius_m: float
    height_m: float
    kind: str = "broad"


@dataclass(frozen=True)
class Decal:
    """Something painted on the ground.

    Attributes
    ----------
    kind : str
        A name of `painters.PAINTERS`.
    shape : Shape
    key : int
        Tells it from others of its kind: colours, phases and patterns come from it.
    side : int
        0: painted everywhere; else only where `Plan.sides` has this number.
    season : int
        0: always; 1: in the survey only; 2: in the older mosaic only.
    """

    kind: str
    shape: Shape
    key: int = 0
    side: int = 0
    season: int = 0


@dataclass
class Plan:
    """The layout of a region.

    Attributes
    ----------
    seed : int
    heights : (n + 1, n + 1) float64
        Of the land at the corners of a grid of `GRID_M`, first row in the south.
    decals : list of Decal
        In the order of painting.
    buildings, trees : lists
    divide : tuple of points
        A line from west to east that parts side 1 (north) from side 2.
    """

    seed: int
    heights: Floats
    decals: list[Decal] = field(default_factory=list)
    buildings: list[Building] = field(default_factory=list)
    trees: list[Tree] = field(default_factory=list)
    divide: tuple[tuple[float, float], ...] = ()

    def paint(
        self, kind: str, shape: Shape, key: int = 0, *, side: int = 0, season: int = 0
    ) -> None:
        """Add a decal on top of those that are there."""
        self.decals.append(Decal(kind, shape, key, side, season))

    def height(self, x: float, y: float) -> float:
        """Return the land's height at the nearest corner of the grid."""
        last = self.heights.shape[0] - 1
        row, column = (min(max(round(at / GRID_M), 0), last) for at in (y, x))
        return float(self.heights[row, column])

    def floor(self, rect: Rect) -> float:
        """Return the lowest height of the land around a rectangle."""
        reach = [(rect.u0 + share * (rect.u1 - rect.u0)) for share in (0, 0.25, 0.5, 0.75, 1)]
        across = [(rect.v0 + share * (rect.v1 - rect.v0)) for share in (0, 0.25, 0.5, 0.75, 1)]
        points = [rect.frame.to_world(u, v) for u in reach for v in across]
        return min(self.height(*point) for point in points)


def square(frame: Frame, half_u: float, half_v: float) -> Rect:
    """Return a rectangle about a frame's origin."""
    return Rect(frame, -half_u, half_u, -half_v, half_v)

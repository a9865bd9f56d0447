"""The layout of a region: what is painted on the ground, buildings of a few kinds, and trees."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from airzoo_bench.datasets.mini.model import SIDE_M
from airzoo_bench.datasets.mini.noise import Dice, octaves
from airzoo_bench.datasets.mini.shapes import Frame, Line, Point, Rect, Shape
from airzoo_bench.geometry.arrays import Bools, Floats

Colour = tuple[int, int, int]

GRID_M = 2.0
"""Spacing of the grid on whose corners the land's heights are given."""
LAND_X: Floats = np.arange(round(SIDE_M / GRID_M) + 1).astype(np.float64)[None, :] * GRID_M
LAND_Y: Floats = LAND_X.T


def colours(text: str) -> tuple[Colour, ...]:
    """Return the colours that hexadecimal triples stand for."""
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
    style: int = 0  # see `model.Buildings`
    parent: int = -1  # the building on whose roof it stands, or -1


class Tree(NamedTuple):
    """A canopy on a trunk, with its radius and the height of its top above the ground."""

    x: float
    y: float
    radius_m: float
    height_m: float
    kind: str = "broad"  # or "cone", "bush", "bale"


class Decal(NamedTuple):
    """Something painted on the ground."""

    kind: str  # a method of `painting.DecalBrush`, or a material
    shape: Shape
    key: int = 0  # tells it from others of its kind: colours, phases and patterns come from it
    side: int = 0  # 0: painted everywhere; 1 and 2: only on one side of `Plan.divide`
    season: int = 0  # 0: always; 1: in the survey only; 2: in the older mosaic only


@dataclass
class Plan:
    """The layout of a region."""

    seed: int
    dice: Dice
    # (n + 1, n + 1): of the land at the corners of its grid, first row in the south
    heights: Floats
    divide: Line = ()  # a line from west to east that parts side 1 (north) from side 2
    decals: list[Decal] = field(default_factory=list)  # in the order of painting
    buildings: list[Building] = field(default_factory=list)
    trees: list[Tree] = field(default_factory=list)

    def paint(
        self,
        kind: str,
        shape: Shape,
        key: int = 0,
        *,
        draw: int = 0,
        side: int = 0,
        season: int = 0,
    ) -> None:
        """Add a decal on top of the existing ones; `draw` is the largest key that is drawn."""
        key = self.dice.integer(0, draw) if draw else key
        self.decals.append(Decal(kind, shape, key, side, season))

    def plant(self, place: Point, radius_m: float, height_m: float, kind: str = "broad") -> None:
        """Add a tree."""
        self.trees.append(Tree(*place, radius_m, height_m, kind))

    def tree_places(self) -> tuple[Floats, Floats]:
        """Return x and y of the trees."""
        x, y = np.array([(tree.x, tree.y) for tree in self.trees]).T
        return x, y

    def keep_trees(self, chosen: Bools) -> None:
        """Fell the other trees."""
        self.trees = [tree for tree, stays in zip(self.trees, chosen, strict=True) if stays]

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
        self._raise(rect, (3.0 * storeys, 0.6), rise, (roof, cover, colour))

    def add_block(self, frame: Frame, half_u: float, half_v: float, storeys: float) -> None:
        """Add a building with a flat roof and its equipment."""
        cover = self.dice.pick(("membrane", "membrane", "gravel", "slabs"))
        top = "flat", cover, self.dice.pick(_FLAT)
        style = self.dice.integer(0, 2)
        self._raise(frame.box(half_u, half_v), (3.0 * storeys, 1.2), 0.0, top, style)
        self._add_roof_boxes(len(self.buildings) - 1)

    def add_barn(self, frame: Frame, half_u: float, half_v: float, wall_m: float) -> None:
        """Add a barn, hall or shed without windows."""
        rect = _lengthwise(frame, half_u, half_v)
        roof = self.dice.pick(("gabled", "gabled", "shed"))
        rise = rect.v1 * (0.35 if roof == "gabled" else 0.3)
        self._raise(rect, (wall_m, 0.0), rise, (roof, "metal", self.dice.pick(METAL)), style=3)

    def _raise(
        self,
        rect: Rect,
        wall_m: tuple[float, float],
        rise: float,
        top: tuple[str, str, Colour],
        style: int = 0,
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


def _lengthwise(frame: Frame, half_u: float, half_v: float) -> Rect:
    """Return a rectangle about a frame's origin that is at least as long as deep."""
    if half_v > half_u:
        return frame.at(0, 0, turned=True).box(half_v, half_u)
    return frame.box(half_u, half_v)

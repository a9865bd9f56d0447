"""Painting the ground and roofs: materials in two seasons, and how each kind of decal looks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Dice, Textures, hash_of
from airzoo_bench.datasets.mini.plan import (
    Building,
    Colour,
    Patch,
    Plan,
    Raster,
    colours,
    line_height,
)
from airzoo_bench.geometry.arrays import Bools, Floats

SURVEY, OLDER = 1, 2
"""Seasons: that of the survey, and that of the older mosaic."""

_STREAM = 41
# How far mottling moves red, green and blue, in eighths: dry and wet ground differ in hue.
_TINT = np.array([9, 8, 6], np.int32)

# Red, green, blue and the amplitude of fine, middle and coarse mottling (display values), in the
# survey and, where that differs, in the older mosaic. Each name is also a kind of decal.
_MATERIALS = """
asphalt 132 130 136 9 10 12 120 116 114 7 12 14
lane 146 142 142 9 12 12 136 130 124 7 12 12
tar 92 92 98 8 6 4
patch 116 114 120 8 6 4
kerb 190 186 178 8 4 4
pavement 176 166 156 10 10 8 170 160 148 8 10 8
paving 184 170 152 10 10 12
concrete 186 182 174 8 14 12
gravel 176 160 140 22 12 12
track 166 140 108 18 16 10
soil 150 114 82 18 16 14 156 128 96 14 14 14
sand 206 186 146 12 8 6
lawn 106 134 58 18 20 20 138 130 78 16 22 22
meadow 118 138 66 24 26 26 150 138 88 22 26 26
rough 96 114 56 30 26 18 132 120 78 26 26 18
litter 74 82 44 26 20 12 116 98 66 26 20 12
reed 112 128 60 34 20 12 164 144 96 30 20 12
water 56 82 78 3 5 14 76 88 72 3 6 14
shallow 98 110 88 10 10 10 126 118 92 10 10 10
court 86 128 96 6 6 4 104 126 104 6 6 4
running 172 84 66 6 6 6 158 92 76 6 6 6
marking 228 228 222 10 18 6
yellow 220 182 70 10 16 6
bed 84 108 46 34 24 8 122 104 66 30 24 8
wood 150 124 96 10 10 4
rubbish 160 150 140 60 40 10
pool 96 178 196 6 6 4 120 150 150 6 6 4
"""

# Of each crop, in the survey and in the older mosaic: the rows as above, the colour between them,
# the distance of the rows in metres, and the share of it that is gap.
_CROPS = """
98 132 58 14 18 18 108 126 66 1.0 0.25 176 152 106 14 16 16 150 126 88 1.0 0.3
120 150 58 14 20 18 134 142 72 1.5 0.3 146 116 84 14 16 16 124 96 70 1.5 0.35
198 180 82 22 16 16 142 146 70 2.0 0.2 118 126 66 18 16 16 138 126 82 2.0 0.25
156 120 86 14 14 16 126 94 68 1.25 0.4 140 108 78 14 14 16 116 88 64 1.25 0.4
192 170 116 16 14 14 164 140 94 1.75 0.35 168 146 104 16 14 14 148 124 88 1.75 0.35
74 116 46 22 14 12 150 120 88 2.5 0.45 104 112 60 22 14 12 146 118 86 2.5 0.5
60 98 48 20 12 12 118 112 72 3.25 0.35 82 94 54 20 12 12 136 116 80 3.25 0.4
124 146 70 26 26 24 116 138 66 3.0 0.3 152 140 90 26 26 24 140 128 80 3.0 0.3
188 196 198 14 14 14 132 122 92 6.0 0.18 186 188 184 12 14 12 140 122 92 6.0 0.22
"""

_CARS = colours("e2e2e0 e8e6e2 3c3e42 222428 969aa0 b2b4b6 962222 2c4880 70604e")
_FLOWERS = colours("be4650 d6be3c aa5aa0 dcd6d0")
_OLD_ROOFS = colours("ac6048 787678 4e76a6 b2aea8")
# Half the size of roof windows and chimneys with their colours, and of hatches and pipes.
_ON_TILES = tuple(zip((0.5, 0.4, 0.8, 0.4), colours("3a4654 c4bcb2 4a5868 704236"), strict=True))
_ON_FLAT = ((0.5, 0.5), (0.3, 2.5), (2.5, 0.3), (0.8, 0.5), (0.35, 0.35))
_FLAT_TONES = colours("d6d6d4 46484c 969696 b2785a")


class Material(NamedTuple):
    """A colour, and the amplitude of fine, middle and coarse mottling in display values."""

    colour: Colour
    fine: int
    middle: int
    coarse: int

    @classmethod
    def of_numbers(cls, numbers: Sequence[float]) -> Material:
        """Make a material of a row of a table."""
        red, green, blue, *mottling = map(int, numbers)
        return cls((red, green, blue), *mottling)


def _materials(season: int) -> dict[str, Material]:
    part = slice(-6, None) if season == OLDER else slice(6)
    rows = (line.split() for line in _MATERIALS.split("\n") if line)
    return {name: Material.of_numbers([*map(int, words)][part]) for name, *words in rows}


def _crops(season: int) -> list[tuple[Material, Material, float, float]]:
    """Return rows, gaps, distance and share of gaps of the crops."""
    crops = []
    for line in filter(None, _CROPS.split("\n")):
        numbers = [float(word) for word in line.split()][11 * (season == OLDER) :][:11]
        gap = Material.of_numbers(numbers[6:9] + numbers[3:6])
        crops.append((Material.of_numbers(numbers[:6]), gap, numbers[9], numbers[10]))
    return crops


class Canvas:
    """A square raster over a plan in a season, whose heights (n, n) are `land`.

    Attributes
    ----------
    rgb : (n, n, 3) uint8
        The plan's decals in order, except those of another season.
    water : (n, n) bool
        Whether the last that was painted is water.
    """

    def __init__(
        self, plan: Plan, raster: Raster, textures: Textures, land: NDArray[Any], season: int
    ) -> None:
        self.plan, self.raster, self.textures, self.land = plan, raster, textures, land
        self.season, self.materials, self.crops = season, _materials(season), _crops(season)
        self.rgb = np.zeros((raster.size, raster.size, 3), np.uint8)
        self.water = np.zeros((raster.size, raster.size), np.bool_)
        self._paint_decals()

    @cached_property
    def _north(self) -> Bools:
        whole = slice(0, self.raster.size)
        x, y = self.raster.centres(whole, whole)
        return y > line_height(x, self.plan.divide)

    def _paint_decals(self) -> None:
        for kind, shape, key, side, season in self.plan.decals:
            if season not in (0, self.season):
                continue
            patch = shape.patch(self.raster)
            if side:
                north = self._north[patch.window]
                patch = patch._replace(mask=patch.mask & (north == (side == 1)))
            if patch.mask.any():
                brush = DecalBrush(self, patch, key)
                if kind in self.materials:
                    brush.paint(kind)
                else:
                    getattr(brush, f"_paint_{kind}")()

    def paint_roof(self, index: int, owner: NDArray[np.int32], colour: Colour) -> None:
        """Paint the roof of one building where it is on top, given the owner of each pixel."""
        building = self.plan.buildings[index]
        patch = building.rect.inset(-0.3).patch(self.raster)
        patch = patch._replace(mask=owner[patch.window] == index)
        if patch.mask.any():
            brush = RoofBrush(self, patch, index, building, colour)
            getattr(brush, f"_cover_with_{building.cover}")()


class Brush:
    """A painter of one patch of a canvas; its key tells it from others of its kind."""

    def __init__(self, canvas: Canvas, patch: Patch, key: int) -> None:
        self.canvas, self.area, self.key = canvas, patch, key
        self.window, self.mask, self.u, self.v = patch
        self.fine, self.middle, self.coarse = (part[self.window] for part in canvas.textures)
        # Noise for the outline of spots, and for ragged outlines.
        self.spots = self.coarse + self.middle

    def paint(
        self,
        material: Material | str,
        where: Bools | None = None,
        shade: NDArray[np.int32] | int = 0,
    ) -> None:
        """Paint a material, which may be named, in the patch, or only `where` (h, w) in it."""
        mask = self.mask if where is None else self.mask & where
        self.canvas.water[self.window][mask] = material in ("water", "pool")
        if isinstance(material, str):
            material = self.canvas.materials[material]
        light = self.fine[mask].astype(np.int32) * material.fine
        light += self.middle[mask].astype(np.int32) * material.middle
        light += self.coarse[mask].astype(np.int32) * material.coarse
        light >>= 6
        light += shade if isinstance(shade, int) else shade[mask]
        values = ((light[:, None] * _TINT) >> 3) + np.array(material.colour, np.int32)
        self.canvas.rgb[self.window][mask] = np.clip(values, 0, 255).astype(np.uint8)

    def cells(
        self, key: int, u: Floats, v: Floats, size_u: float, size_v: float
    ) -> NDArray[np.int32]:
        """Return a random number of 0 to 255 for each cell of a pattern."""
        column = np.floor(u / size_u).astype(np.int64)
        row = np.floor(v / size_v).astype(np.int64)
        # A whole hash a pixel is dear; a multiplicative one on few distinct cells will do.
        code = (column * 73_856_093) ^ (row * 19_349_663)
        start = int(hash_of(self.canvas.plan.seed, key)[0]) & 0x7FFFFFFF
        code = (code ^ np.int64(start)) * 2_654_435_761
        return ((code ^ (code >> 23)) >> 15 & 255).astype(np.int32)

    def tones(self, size_u: float, size_v: float) -> NDArray[np.int32]:
        """Return `cells` along the patch's own axes."""
        return self.cells(self.key, self.u, self.v, size_u, size_v)


def repeats(along: Floats, period: float, part: float, phase: float = 0.0) -> Bools:
    """Return where a coordinate is in the first part of each period, all in metres."""
    moved = along + phase
    return np.asarray(moved - np.floor(moved / period) * period < part)


class DecalBrush(Brush):
    """Paints decals, each by the method of its kind."""

    def _paint_dashes(self) -> None:
        self.paint("marking", repeats(self.u, 9.0, 4.0, self.key % 9))

    def _paint_crossing(self) -> None:
        self.paint("marking", repeats(self.v, 1.25, 0.65))

    def _paint_parking(self) -> None:
        self.paint("lane")
        low, high = float(self.v[self.mask].min()), float(self.v[self.mask].max())
        row = (high - low + 0.25) / max(round((high - low) / 16.0), 1)
        place = self.v - low
        place = place - np.floor(place / row) * row
        stalls = (place < 5.0) | (place > row - 5.0)
        self.paint("marking", repeats(self.u, 2.75, 0.25) & stalls)
        self.paint("marking", np.abs(place - row) < 0.2)

    def _paint_slabs(self) -> None:
        size = (0.75, 1.0, 1.5, 2.0)[self.key % 4]
        kind = ("paving", "pavement", "concrete")[self.key // 4 % 3]
        self.paint(kind, shade=(self.tones(size, size) >> 3) - 16)
        self.paint("kerb", repeats(self.u, size * 6, 0.2) | repeats(self.v, size * 6, 0.2))

    def _paint_plates(self) -> None:
        self.paint("concrete", shade=(self.tones(5.0, 4.0) >> 3) - 24)
        self.paint("patch", repeats(self.u, 5.0, 0.25) | repeats(self.v, 4.0, 0.25))

    def _paint_beds(self) -> None:
        tone = self.tones(1.5, 40.0)
        for index, name in enumerate(("bed", "soil", "lawn", "rough")):
            self.paint(name, (tone >> 6) == index)
        self.paint("gravel", repeats(self.u, 3.0, 0.3))

    def _paint_flowers(self) -> None:
        self.paint("bed")
        if self.canvas.season == SURVEY:
            bloom = self.tones(0.5, 0.5) > 150
            self.paint(Material(_FLOWERS[self.key % 4], 20, 10, 4), bloom)

    def _paint_field(self) -> None:
        key, crops = self.key, self.canvas.crops
        plant, gap, row_m, gap_share = crops[key % len(crops)]
        tone = self.cells(key, np.zeros_like(self.v), self.v, 1.0, row_m * 5)
        wobble = self.v + self.coarse * (1 / 256)
        shade = (tone >> 4) - 8 + key // 16 % 24 - 12
        self.paint(plant, shade=shade)
        self.paint(gap, repeats(wobble, row_m, row_m * gap_share), shade)
        if key // 512 % 3:
            self.paint(gap, repeats(wobble, 14.0, 0.5) | repeats(wobble, 14.0, 0.5, 2.0), -14)
        if row_m < 5:  # not plastic tunnels
            blots = self.spots + (self.fine >> 1)
            bare = ("rough", "soil", "meadow")[key // 64 % 3]
            self.paint(bare, blots > 96 - key // 2048 % 50)

    def _paint_terraces(self) -> None:
        canvas = self.canvas
        land = canvas.land[self.window].astype(np.float64) + self.coarse * (1 / 512)
        step = np.floor(land / 1.5).astype(np.int64)
        crops = int(hash_of(canvas.plan.seed, self.key, 5)[0]) % 3
        for phase, kind in enumerate(((0, 1, 0, 3), (0, 4, 1, 1), (1, 7, 0, 4))[crops]):
            part = self.area._replace(mask=self.mask & (step % 4 == phase))
            DecalBrush(canvas, part, (self.key + phase) * len(canvas.crops) + kind)._paint_field()
        self.paint("rough", land / 1.5 - step < 0.16)
        self.paint("track", land / 1.5 - step < 0.05)

    def _paint_pitch(self) -> None:
        stripes = repeats(self.u, 10.0, 5.0)
        self.paint("lawn", shade=np.where(stripes, 10, -6).astype(np.int32))
        u, v = np.abs(self.u), np.abs(self.v)
        ring = np.sqrt(u * u + v * v)
        half_u, half_v = float(u[self.mask].max()), float(v[self.mask].max())
        lines = (u < 0.2) | (np.abs(ring - 7.0) < 0.2) | (u > half_u - 0.4) | (v > half_v - 0.4)
        box = (u > half_u - 12.0) & (v < 14.0)
        self.paint("marking", lines | (box & ((u < half_u - 11.6) | (v > 13.6))))
        self.paint("soil", (u > half_u - 6) & (v < 4) & (self.middle > 0))

    def _paint_running_track(self) -> None:
        self.paint("running")
        inside = float(self.u[self.mask].max()) - self.u
        self.paint("marking", repeats(inside, 1.25, 0.2) & (inside < 7.6))
        self.paint("lawn", inside > 8.0)

    def _paint_court_marked(self) -> None:
        outer, inner = ("running", "court") if self.key % 2 else ("court", "running")
        u, v = np.abs(self.u), np.abs(self.v)
        self.paint(outer)
        self.paint(inner, (u < 12.0) & (v < 5.75))
        border = (np.abs(u - 12.0) < 0.2) & (v < 5.75) | (np.abs(v - 5.75) < 0.2) & (u < 12.0)
        lines = border | (np.abs(v - 4.4) < 0.15) & (u < 12) | (np.abs(u - 6.4) < 0.15) & (v < 4.4)
        self.paint("marking", lines | (u < 0.2) & (v < 6.5))

    def _paint_car(self) -> None:
        u = self.u
        self.paint(Material(_CARS[self.key % len(_CARS)], 4, 4, 0))
        glass = (u > 0.3) & (u < 1.1) | (u < -1.2) & (u > -1.8)
        self.paint(Material((40, 46, 54), 4, 0, 0), glass & (np.abs(self.v) < 0.7))

    def _paint_old_roof(self) -> None:
        """Paint a building that has gone since: only the older mosaic shows it."""
        colour = _OLD_ROOFS[self.key % 4]
        half = np.where(self.v > 0, 16, -22).astype(np.int32)
        self.paint(Material(colour, 8, 12, 8), shade=half)
        self.paint(Material(colour, 8, 4, 0), repeats(self.u, 1.0, 0.25), -14)

    def _paint_worn(self) -> None:
        kind = ("soil", "gravel", "rough", "sand")[self.key % 4]
        self.paint(kind, self.spots + (self.fine >> 1) > 40)

    def _paint_ruts(self) -> None:
        self.paint("track")
        self.paint("rough", (self.u < 0.45) & (self.middle > -60))

    def _paint_shore(self) -> None:
        self.paint("reed")
        self.paint("shallow", self.coarse > 10)


class RoofBrush(Brush):
    """Paints one roof, by the method of its cover; its key is the building's place in the list."""

    def __init__(
        self, canvas: Canvas, patch: Patch, key: int, building: Building, colour: Colour
    ) -> None:
        super().__init__(canvas, patch, key)
        self.building, self.rect, self.colour = building, building.rect, colour
        self.dice = Dice(canvas.plan.seed, _STREAM, key)
        along = np.minimum(self.u - self.rect.u0, self.rect.u1 - self.u)
        # Distance from the outline, in metres.
        self.rim = np.minimum(along, np.minimum(self.v - self.rect.v0, self.rect.v1 - self.v))

    def within(self, u0: float, u1: float, v0: float, v1: float) -> Bools:
        """Return where a rectangle is, given its sides."""
        return (self.u > u0) & (self.u < u1) & (self.v > v0) & (self.v < v1)

    def near(self, u: float, v: float, half_u: float, half_v: float) -> Bools:
        """Return where a rectangle about a point is."""
        return (np.abs(self.u - u) < half_u) & (np.abs(self.v - v) < half_v)

    def coat(
        self,
        mottling: tuple[int, int, int],
        where: Bools | None = None,
        shade: NDArray[np.int32] | int = 0,
        colour: Colour | None = None,
    ) -> None:
        """Paint in the roof's colour or another."""
        self.paint(Material(colour or self.colour, *mottling), where, shade)

    def _cover_with_tiles(self) -> None:
        rect, mottling = self.rect, (10, 14, 10)
        edge, ends = np.abs(self.v), rect.u1 - np.abs(self.u)
        hips = self.building.roof == "hipped"
        on_hip = hips & (ends < rect.v1 - edge)
        down = np.where(on_hip, rect.u1 - ends, edge)
        across = np.where(on_hip, self.v, self.u)
        shade = (self.cells(self.key, across, down, 0.5, 0.75) >> 4) - 8
        shade += (self.cells(self.key + 9, across, down, 2.5, 50.0) >> 4) - 8
        shade -= np.where(repeats(down, 0.75, 0.25), 14, 0).astype(np.int32)
        self.coat(mottling, shade=shade)
        ridge = (edge < 0.3) & ~on_hip | hips & (np.abs(ends - (rect.v1 - edge)) < 0.3)
        self.coat(mottling, ridge, 26)
        self.coat(mottling, self.rim < 0.3, -26)
        if self.key % 3 == 0:  # moss
            self.coat((14, 14, 4), self.spots > 58, colour=(104, 106, 76))
        self._add_windows()

    def _add_windows(self) -> None:
        """Add windows, dormers, chimneys and panels."""
        dice, rect = self.dice, self.rect
        for _ in range(dice.integer(0, 2 + int(rect.long / 4))):
            u, v = dice.real(rect.u0 + 1, rect.u1 - 1), dice.real(rect.v0 * 0.75, rect.v1 * 0.75)
            half, tone = dice.pick(_ON_TILES)
            frame = self.near(u, v, half + 0.25, half * 1.2 + 0.25)
            self.coat((6, 0, 0), frame, colour=(188, 184, 178))
            self.coat((6, 0, 0), self.near(u, v, half, half * 1.2), colour=tone)
        if dice.chance(14):
            u0, low = dice.real(rect.u0 + 0.8, rect.u1 * 0.2), dice.real(0.8, 1.4)
            self._add_panels(u0, rect.u1 - 1.0, -rect.v1 + low, -0.8)

    def _add_panels(self, u0: float, u1: float, v0: float, v1: float) -> None:
        inside = self.within(u0, u1, v0, v1)
        self.coat((8, 8, 4), inside, colour=(38, 52, 92))
        lines = repeats(self.u - u0, 1.25, 0.25) | repeats(self.v - v0, 2.0, 0.25)
        self.coat((6, 0, 0), inside & lines, colour=(136, 146, 164))

    def _cover_with_metal(self) -> None:
        mottling = (6, 8, 14)
        seams = np.where(repeats(self.u, 1.0, 0.25), 16, 0).astype(np.int32)
        self.coat(mottling, shade=(self.tones(1.0, 6.5) >> 4) - 8 - seams)
        if self.key % 2:
            lights = repeats(self.u, 7.0, 1.0, self.key % 7) & (self.rim > 1.5)
            self.coat((8, 10, 6), lights, colour=(206, 212, 206))
        self.coat((14, 18, 8), self.spots > 74, colour=(150, 104, 76))
        self.coat(mottling, (np.abs(self.v) < 0.35) & (self.building.roof == "gabled"), 30)
        self.coat(mottling, self.rim < 0.3, -24)

    def _cover_with_membrane(self) -> None:
        self.coat((9, 18, 16), shade=(self.tones(3.5, 9.0) >> 4) - 8)
        self.coat((6, 8, 4), repeats(self.u, 3.5, 0.25), -18)
        self._add_flat_details()

    def _cover_with_gravel(self) -> None:
        self.coat((22, 14, 16))
        self._add_flat_details()

    def _cover_with_slabs(self) -> None:
        self.coat((8, 10, 12), shade=(self.tones(1.5, 1.5) >> 3) - 16)
        self.coat((6, 4, 2), repeats(self.u, 6.0, 0.25) | repeats(self.v, 6.0, 0.25), -26)
        self._add_flat_details()

    def _cover_with_machine(self) -> None:
        self.coat((6, 4, 0))
        self.coat((6, 0, 0), self.u * self.u + self.v * self.v < 0.3, colour=(52, 54, 58))

    def _add_flat_details(self) -> None:
        """Add puddles, a garden or panels, hatches and pipes, and the rim of a flat roof."""
        dice, rect = self.dice, self.rect
        self.coat((8, 10, 4), self.spots > 66, colour=(112, 108, 104))
        if self.building.parent < 0 and dice.chance(22):
            u0 = rect.u0 + rect.long * dice.real(0.05, 0.5)
            u1 = u0 + rect.long * dice.real(0.25, 0.45)
            box = (u0, u1, rect.v0 + 1.0, rect.v0 + rect.deep * 0.6)
            if dice.chance(55):
                self._add_panels(*box)
            else:
                self.paint("bed", self.within(*box) & repeats(self.v, 1.5, 1.0))
        for _ in range(int(rect.long * rect.deep / 40)):
            u, v = dice.real(rect.u0, rect.u1), dice.real(rect.v0, rect.v1)
            half = dice.pick(_ON_FLAT)
            self.coat((6, 4, 0), self.near(u, v, *half), colour=dice.pick(_FLAT_TONES))
        high = int(hash_of(self.canvas.plan.seed, self.key)[0]) % 3
        self.coat((6, 6, 4), self.rim < 0.45, 34 if high else -40)
        self.coat((6, 6, 4), (self.rim >= 0.45) & (self.rim < 0.75), -30)

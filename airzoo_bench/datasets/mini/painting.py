"""Painting the ground and roofs in two seasons: how each kind of decal and cover looks."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Dice, Textures, hash_number
from airzoo_bench.datasets.mini.plan import Building, Colour, Patch, Plan, Raster, Window, colours
from airzoo_bench.geometry.arrays import Bools, Floats

SURVEY, OLDER = 1, 2
"""Seasons: that of the survey, and that of the older mosaic."""

_STREAM = 41
_GROUND = tomllib.loads(Path(__file__).with_name("ground.toml").read_text("utf-8"))
# How far mottling moves red, green and blue, in eighths: dry and wet ground differ in hue.
_TINT = (9, 8, 6)
_ROWS = 64  # of a canvas that are coloured at once

_CARS = colours("e2e2e0 e8e6e2 3c3e42 222428 969aa0 b2b4b6 962222 2c4880 70604e")
_FLOWERS = colours("be4650 d6be3c aa5aa0 dcd6d0")
_OLD_ROOFS = colours("ac6048 787678 4e76a6 b2aea8")
# Half the size of roof windows and chimneys with their colours, and of hatches and pipes.
_ON_TILES = tuple(zip((0.5, 0.4, 0.8, 0.4), colours("3a4654 c4bcb2 4a5868 704236"), strict=True))
_ON_FLAT = ((0.5, 0.5), (0.3, 2.5), (2.5, 0.3), (0.8, 0.5), (0.35, 0.35))
_FLAT_TONES = colours("d6d6d4 46484c 969696 b2785a")


class Material(NamedTuple):
    """A colour, and the amplitude of fine, middle and coarse mottling in display values."""

    red: int
    green: int
    blue: int
    fine: int
    middle: int
    coarse: int


class Canvas:
    """A square raster that remembers the last paint of each pixel: decals of a season, then roofs.

    `land` is the height of the land, (n, n).
    """

    def __init__(
        self, plan: Plan, raster: Raster, textures: Textures, land: NDArray[Any], season: int
    ) -> None:
        self.plan, self.raster, self.textures, self.land = plan, raster, textures, land
        self.season, part = season, slice(-6, None) if season == OLDER else slice(6)
        looks = {name: look[part] for name, look in _GROUND["materials"].items()}
        self.materials = {name: Material(*look) for name, look in looks.items()}
        self.crops = [crop[season - 1] for crop in _GROUND["fields"]["crops"]]
        self._numbers: dict[Material, int] = {}
        # The number of the material, and the shade, of each pixel.
        self._look = np.zeros((2, raster.size, raster.size), np.int16)
        whole = slice(0, raster.size)
        north = plan.is_north(*raster.centres(whole, whole)) if plan.divide else None
        for kind, form, key, side, only in plan.decals:
            if only in (0, season):
                patch = form.patch(raster)
                if side and north is not None:
                    there = north[patch.window] == (side == 1)
                    patch = patch._replace(mask=patch.mask & there)
                if patch.mask.any():
                    DecalBrush(self, patch, key).paint_kind(kind)

    def paint(
        self, window: Window, mask: Bools, material: Material, shade: NDArray[np.int32] | int
    ) -> None:
        """Paint a material where a mask of a window says, in shades (h, w) or one."""
        number = self._numbers.setdefault(material, len(self._numbers))
        np.copyto(self._look[0][window], number, where=mask)
        np.copyto(self._look[1][window], shade, where=mask, casting="same_kind")

    def paint_roof(self, index: int, owner: NDArray[np.int32], colour: Colour) -> None:
        """Paint the roof of one building where it is on top, given the owner of each pixel."""
        building = self.plan.buildings[index]
        patch = building.rect.inset(-0.3).patch(self.raster)
        patch = patch._replace(mask=owner[patch.window] == index)
        if patch.mask.any():
            brush = RoofBrush(self, patch, index, building, colour)
            getattr(brush, f"_cover_with_{building.cover}")()

    def colours(self) -> tuple[NDArray[np.uint8], Bools]:
        """Return the albedo (n, n, 3) of all paint so far, and where it is water."""
        table = np.array([*self._numbers], np.int16).T
        rgb = np.empty((*self._look.shape[1:], 3), np.uint8)
        for rows in (slice(row, row + _ROWS) for row in range(0, len(rgb), _ROWS)):
            number, shade = self._look[:, rows]
            light = np.zeros(number.shape, np.int32)
            for noise, share in zip(self.textures, table[3:], strict=True):
                light += np.multiply(noise[rows], share.take(number), dtype=np.int32)
            light >>= 6
            light += shade
            for channel, tint in enumerate(_TINT):
                values = (light * tint >> 3) + table[channel].take(number)
                rgb[rows, :, channel] = values.clip(0, 255)
        wet = [self._numbers.get(self.materials[name], -1) for name in ("water", "pool")]
        return rgb, np.isin(self._look[0], wet)


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
        if isinstance(material, str):
            material = self.canvas.materials[material]
        self.canvas.paint(self.window, mask, material, shade)

    def cells(
        self, key: int, u: Floats, v: Floats, size_u: float, size_v: float
    ) -> NDArray[np.int32]:
        """Return a random number of 0 to 255 for each cell of a pattern."""
        column = np.floor(u / size_u).astype(np.int64)
        row = np.floor(v / size_v).astype(np.int64)
        # A whole hash a pixel is dear; a multiplicative one on few distinct cells will do.
        code = (column * 73_856_093) ^ (row * 19_349_663)
        start = hash_number(self.canvas.plan.seed, key) & 0x7FFFFFFF
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

    def paint_kind(self, kind: str) -> None:
        """Paint a kind of decal, which may be a material."""
        if kind in self.canvas.materials:
            self.paint(kind)
        else:
            getattr(self, f"_paint_{kind}")()

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
            self.paint(Material(*_FLOWERS[self.key % 4], 20, 10, 4), bloom)

    def _paint_field(self) -> None:
        key, crops = self.key, self.canvas.crops
        *look, red, green, blue, row_m, gap_share = crops[key % len(crops)]
        plant, gap = Material(*look), Material(red, green, blue, *look[3:])
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
        crops = hash_number(canvas.plan.seed, self.key, 5) % 3
        for phase, kind in enumerate(((0, 1, 0, 3), (0, 4, 1, 1), (1, 7, 0, 4))[crops]):
            part = self.area._replace(mask=self.mask & (step % 4 == phase))
            field = (self.key + phase) * len(canvas.crops) + kind
            DecalBrush(canvas, part, field).paint_kind("field")
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
        self.paint(Material(*_CARS[self.key % len(_CARS)], 4, 4, 0))
        glass = (u > 0.3) & (u < 1.1) | (u < -1.2) & (u > -1.8)
        self.paint(Material(40, 46, 54, 4, 0, 0), glass & (np.abs(self.v) < 0.7))

    def _paint_old_roof(self) -> None:
        """Paint a building that has gone since: only the older mosaic shows it."""
        colour = _OLD_ROOFS[self.key % 4]
        half = np.where(self.v > 0, 16, -22).astype(np.int32)
        self.paint(Material(*colour, 8, 12, 8), shade=half)
        self.paint(Material(*colour, 8, 4, 0), repeats(self.u, 1.0, 0.25), -14)

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
        self.paint(Material(*(colour or self.colour), *mottling), where, shade)

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
        high = hash_number(self.canvas.plan.seed, self.key) % 3
        self.coat((6, 6, 4), self.rim < 0.45, 34 if high else -40)
        self.coat((6, 6, 4), (self.rim >= 0.45) & (self.rim < 0.75), -30)

"""Painting the ground and roofs in a season: how each kind of decal looks.

A kind is a list of layers, each a material (or its name), where it is and how much lighter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini import layout
from airzoo_bench.datasets.mini.layout import ALWAYS, LOOKS, OLDER, SURVEY, Box, Decal, Plan
from airzoo_bench.datasets.mini.noise import hash_of
from airzoo_bench.geometry.arrays import Bools, Floats

Noise = NDArray[np.int16]
# Red, green, blue, and the amplitude of fine, middle and coarse mottling in display values.
Material = tuple[int, ...]
_Shade = NDArray[np.int64] | int
_Layer = tuple[Sequence[int] | str, Bools | bool, _Shade]

_TINT = (9, 8, 6)  # eighths that mottling moves red, green and blue by: wet ground has another hue
_WORN = ("soil", "gravel", "rough", "sand")
_ROWS = 64  # of a canvas that are coloured at once
_PALETTES = {name: layout.colours(text) for name, text in LOOKS["palettes"].items()}


class Canvas:
    """A square raster that remembers the last paint of each pixel: decals of a season, then roofs.

    `land` is the height of the land, (n, n); `noise` is fine, middle and coarse, -128 to 127.
    """

    def __init__(
        self, plan: Plan, raster: layout.Raster, noise: Sequence[Noise], land: Floats, season: int
    ) -> None:
        self.raster, self.noise, self.land, self.season = raster, noise, land, season
        self.seed, part = plan.seed, slice(-6, None) if season == OLDER else slice(6)
        self.materials = {name: tuple(look[part]) for name, look in LOOKS["materials"].items()}
        self._numbers: dict[Material, int] = {}
        # The number of the material, and the shade, of each pixel.
        self._look = np.zeros((2, raster.size, raster.size), np.int16)
        north = plan.is_north(*raster.centres()) if plan.divide else None
        for decal in plan.decals:
            self.paint(decal, north if decal.side else None, decal.side == 1)

    def paint(self, decal: Decal, owner: NDArray[Any] | None, number: int) -> None:
        """Paint a decal, only on pixels of one owner if there are owners."""
        if decal.season not in (ALWAYS, self.season):
            return
        spot, kind = _Spot(self, decal), decal.kind
        if owner is not None:
            spot.mask &= owner[spot.window] == number
        if not spot.mask.any():
            return
        for material, where, shade in KINDS[kind](spot) if kind in KINDS else [(kind, True, 0)]:
            look = self.materials[material] if isinstance(material, str) else tuple(material)
            index, where = self._numbers.setdefault(look, len(self._numbers)), spot.mask & where
            np.copyto(self._look[0][spot.window], index, where=where)
            np.copyto(self._look[1][spot.window], shade, where=where, casting="unsafe")

    def colours(self) -> tuple[NDArray[np.uint8], Bools]:
        """Return the albedo (n, n, 3) of all paint so far, and where it is water."""
        table = np.array([*self._numbers], np.int16).T
        rgb = np.empty((*self._look.shape[1:], 3), np.uint8)
        for rows in (slice(row, row + _ROWS) for row in range(0, len(rgb), _ROWS)):
            number, shade = self._look[:, rows]
            light = np.zeros(number.shape, np.int32)
            for noise, share in zip(self.noise, table[3:], strict=True):
                light += np.multiply(noise[rows], share.take(number), dtype=np.int32)
            light >>= 6
            light += shade
            for channel, tint in enumerate(_TINT):
                values = (light * tint >> 3) + table[channel].take(number)
                rgb[rows, :, channel] = values.clip(0, 255)
        wet = [self._numbers.get(self.materials[name], -1) for name in ("water", "pool")]
        return rgb, np.isin(self._look[0], wet)


class _Spot:
    """The part of a canvas that a decal covers, with noise and coordinates in its own axes."""

    def __init__(self, canvas: Canvas, decal: Decal) -> None:
        self.canvas, self.decal, self.key = canvas, decal, decal.key
        self.box = cast("Box", decal.form)  # of a roof
        self.window, self.mask, self.u, self.v = decal.form.patch(canvas.raster)
        self.fine, self.middle, self.coarse = (part[self.window] for part in canvas.noise)
        # Noise for the outline of spots, and for ragged outlines.
        self.spots = self.coarse + self.middle

    @property
    def rim(self) -> Floats:
        """Distance from the outline of a box."""
        _, u0, u1, v0, v1, _ = self.box
        along = np.minimum(self.u - u0, u1 - self.u)
        return np.minimum(along, np.minimum(self.v - v0, v1 - self.v))

    @property
    def half(self) -> tuple[float, float]:
        return float(np.abs(self.u[self.mask]).max()), float(np.abs(self.v * self.mask).max())

    def coat(self, fine: int, middle: int, coarse: int, palette: str = "") -> Material:
        """Return a colour of a palette, or the roof's own, with mottling."""
        table = _PALETTES[palette] if palette else [self.decal.colour]
        return (*table[self.key % len(table)], fine, middle, coarse)

    def cells(self, u: Floats | float, v: Floats | float, salt: int = 0) -> NDArray[np.int64]:
        """Return a random number of 0 to 255 for each cell, 1 x 1, of a pattern."""
        column, row = (np.floor(part).astype(np.int64) for part in (u, v))
        # A whole hash a pixel is dear; a multiplicative one on few distinct cells will do.
        code = (column * 73_856_093) ^ (row * 19_349_663)
        start = hash_of(self.canvas.seed, self.key + salt) & 0x7FFFFFFF
        code = (code ^ np.int64(start)) * 2_654_435_761
        return (code ^ (code >> 23)) >> 15 & 255

    def tones(self, size_u: float, size_v: float) -> NDArray[np.int64]:
        return self.cells(self.u / size_u, self.v / size_v)

    def lines(self, size_u: float, size_v: float, width: float) -> Bools:
        return np.asarray((self.u % size_u < width) | (self.v % size_v < width))


def _slabs(p: _Spot) -> list[_Layer]:
    size = (0.75, 1.0, 1.5, 2.0)[p.key % 4]
    kind = ("paving", "pavement", "concrete")[p.key // 4 % 3]
    joints = p.lines(size * 6, size * 6, 0.2)
    return [(kind, True, (p.tones(size, size) >> 3) - 16), ("kerb", joints, 0)]


def _parking(p: _Spot) -> list[_Layer]:
    low, high = float(p.v[p.mask].min()), float(p.v[p.mask].max())
    row = (high - low + 0.25) / max(round((high - low) / 16.0), 1)
    place = (p.v - low) % row
    stalls = (p.u % 2.75 < 0.25) & ((place < 5.0) | (place > row - 5.0))
    return [("lane", True, 0), ("marking", stalls | (np.abs(place - row) < 0.2), 0)]


def _field(p: _Spot, key: int | None = None, where: Bools | bool = True) -> list[_Layer]:
    key, crops = p.key if key is None else key, LOOKS["fields"]["crops"]
    *look, red, green, blue, row_m, gap_share = crops[key % len(crops)][p.canvas.season - 1]
    gap, wobble = (red, green, blue, *look[3:]), p.v + p.coarse * (1 / 256)
    shade = (p.cells(np.zeros_like(p.v), p.v / row_m / 5) >> 4) - 20 + key // 16 % 24
    rows = where & (wobble % row_m < row_m * gap_share)
    layers: list[_Layer] = [(look, where, shade), (gap, rows, shade)]
    if key // 512 % 3:  # wheels
        layers.append((gap, where & ((wobble % 14.0 < 0.5) | ((wobble + 2.0) % 14.0 < 0.5)), -14))
    if row_m < 5:  # not plastic tunnels
        bare = ("rough", "soil", "meadow")[key // 64 % 3]
        blots = p.spots + (p.fine >> 1) > 96 - key // 2048 % 50
        layers.append((bare, where & blots, 0))
    return layers


def _terraces(p: _Spot) -> list[_Layer]:
    land = p.canvas.land[p.window] / 1.5 + p.coarse * (1 / 768)
    step, layers = np.floor(land).astype(np.int64), []
    for phase, crop in enumerate(((0, 1, 0, 3), (0, 4, 1, 1), (1, 7, 0, 4))[p.key % 3]):
        key = (p.key + phase) * len(LOOKS["fields"]["crops"]) + crop
        layers += _field(p, key, step % 4 == phase)
    return [*layers, ("rough", land - step < 0.16, 0), ("track", land - step < 0.05, 0)]


def _pitch(p: _Spot) -> list[_Layer]:
    (half_u, half_v), u, v = p.half, np.abs(p.u), np.abs(p.v)
    ring = np.abs(np.sqrt(u * u + v * v) - 7.0) < 0.2
    area = (u > half_u - 12.0) & (v < 14.0) & ((u < half_u - 11.6) | (v > 13.6))
    lines = (u < 0.2) | ring | area | (u > half_u - 0.4) | (v > half_v - 0.4)
    worn = (u > half_u - 6) & (v < 4) & (p.middle > 0)
    stripes = np.where(p.u % 10.0 < 5.0, 10, -6)
    return [("lawn", True, stripes), ("marking", lines, 0), ("soil", worn, 0)]


def _court_marked(p: _Spot) -> list[_Layer]:
    colour = ("running", "court") if p.key % 2 else ("court", "running")
    u, v = np.abs(p.u), np.abs(p.v)
    inside = (u < 12.0) & (v < 5.75)
    lines = inside & ((u > 11.8) | (v > 5.5) | (np.abs(v - 4.4) < 0.15) | (u < 0.2))
    lines |= (np.abs(u - 6.4) < 0.15) & (v < 4.4)
    return [(colour[0], True, 0), (colour[1], inside, 0), ("marking", lines, 0)]


def _running_track(p: _Spot) -> list[_Layer]:
    inside = p.half[0] - p.u
    lines = (inside % 1.25 < 0.2) & (inside < 7.6)
    return [("running", True, 0), ("marking", lines, 0), ("lawn", inside > 8.0, 0)]


def _car(p: _Spot) -> list[_Layer]:
    glass = ((p.u > 0.3) & (p.u < 1.1) | (p.u < -1.2) & (p.u > -1.8)) & (np.abs(p.v) < 0.7)
    return [(p.coat(4, 4, 0, "cars"), True, 0), ("windscreen", glass, 0)]


def _old_roof(p: _Spot) -> list[_Layer]:
    if p.canvas.season != OLDER:
        return []
    slopes = p.coat(8, 12, 8, "old_roofs"), True, np.where(p.v > 0, 16, -22)
    return [slopes, (p.coat(8, 4, 0, "old_roofs"), p.u % 1.0 < 0.25, -14)]


def _beds(p: _Spot) -> list[_Layer]:
    kind = p.tones(1.5, 40.0) >> 6
    beds = [(name, kind == row, 0) for row, name in enumerate(("bed", "soil", "lawn", "rough"))]
    return [*beds, ("gravel", p.u % 3.0 < 0.3, 0)]


def _flowers(p: _Spot) -> list[_Layer]:
    bloom = (p.tones(0.5, 0.5) > 150) & (p.canvas.season == SURVEY)
    return [("bed", True, 0), (p.coat(20, 10, 4, "flowers"), bloom, 0)]


def _tiles(p: _Spot, *, hipped: bool = False) -> list[_Layer]:
    edge, ends = p.box.v1 - np.abs(p.v), p.box.u1 - np.abs(p.u)
    on_hip, coat = hipped & (ends < edge), p.coat(10, 14, 10)
    down, across = np.where(on_hip, ends, edge), np.where(on_hip, p.v, p.u)
    shade = (p.cells(across / 0.5, down / 0.75) >> 4) + (p.cells(across / 2.5, 0 * down, 9) >> 4)
    shade = shade - 16 - 14 * (down % 0.75 < 0.25)
    ridge = (np.abs(p.v) < 0.3) & ~on_hip | hipped & (np.abs(ends - edge) < 0.3)
    layers: list[_Layer] = [(coat, True, shade), (coat, ridge, 26), (coat, p.rim < 0.3, -26)]
    return [*layers, ("moss", (p.spots > 58) & (p.key % 3 == 0), 0)]


def _metal(p: _Spot) -> list[_Layer]:
    shade = (p.tones(1.0, 6.5) >> 4) - 8 - np.where(p.u % 1.0 < 0.25, 16, 0)
    lights = ((p.u + p.key) % 7.0 < 1.0) & (p.rim > 1.5) & (p.key % 2 == 1)
    layers: list[_Layer] = [(p.coat(6, 8, 14), True, shade), ("roof_light", lights, 0)]
    layers += [("rust", p.spots > 74, 0), (p.coat(6, 8, 14), np.abs(p.v) < 0.35, 30)]
    return [*layers, (p.coat(6, 8, 14), p.rim < 0.3, -24)]


def _flat(p: _Spot, *layers: _Layer) -> list[_Layer]:
    """Add puddles and the rim of a flat roof."""
    rim, bright = p.rim, 34 if p.key % 3 else -40
    edge: list[_Layer] = [(p.coat(6, 6, 4), rim < 0.75, -30), (p.coat(6, 6, 4), rim < 0.45, bright)]
    return [*layers, ("puddle", p.spots > 66, 0), *edge]


def _membrane(p: _Spot) -> list[_Layer]:
    sheets = p.coat(9, 18, 16), True, (p.tones(3.5, 9.0) >> 4) - 8
    return _flat(p, sheets, (p.coat(6, 8, 4), p.u % 3.5 < 0.25, -18))


def _deck(p: _Spot) -> list[_Layer]:
    slabs = p.coat(8, 10, 12), True, (p.tones(1.5, 1.5) >> 3) - 16
    return _flat(p, slabs, (p.coat(6, 4, 2), p.lines(6.0, 6.0, 0.25), -26))


# Kinds with a function of their name; then short ones, covers of roofs and what lies on them.
_NAMED = (
    *(_parking, _slabs, _beds, _flowers, _field, _terraces, _pitch, _running_track),
    *(_court_marked, _car, _old_roof, _tiles, _metal, _membrane, _deck),
)
KINDS: dict[str, Callable[[_Spot], list[_Layer]]] = {
    **{function.__name__.strip("_"): function for function in _NAMED},
    "dashes": lambda p: [("marking", (p.u + p.key % 9) % 9.0 < 4.0, 0)],
    "crossing": lambda p: [("marking", p.v % 1.25 < 0.65, 0)],
    "ruts": lambda p: [("track", True, 0), ("rough", (p.u < 0.45) & (p.middle > -60), 0)],
    "worn": lambda p: [(_WORN[p.key % 4], p.spots + (p.fine >> 1) > 40, 0)],
    "plates": lambda p: [
        ("concrete", True, (p.tones(5.0, 4.0) >> 3) - 24),
        ("patch", p.lines(5.0, 4.0, 0.25), 0),
    ],
    "shore": lambda p: [("reed", True, 0), ("shallow", p.coarse > 10, 0)],
    "hips": partial(_tiles, hipped=True),
    "pebbles": lambda p: _flat(p, (p.coat(22, 14, 16), True, 0)),
    "machine": lambda p: [(p.coat(6, 4, 0), True, 0), ("vent", p.u * p.u + p.v * p.v < 0.3, 0)],
    "panels": lambda p: [("panel", True, 0), ("panel_frame", p.lines(1.25, 2.0, 0.25), 0)],
    "skylight": lambda p: [("sill", True, 0), (p.coat(6, 0, 0, "panes"), p.rim > 0.25, 0)],
    "hatch": lambda p: [(p.coat(6, 4, 0, "hatches"), True, 0)],
    "garden": lambda p: [("bed", p.v % 1.5 < 1.0, 0)],
}

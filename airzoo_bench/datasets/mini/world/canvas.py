"""A raster to paint on, and the colours of the ground in two seasons."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Textures, hash_of
from airzoo_bench.datasets.mini.world.plan import Colour, Plan, colours
from airzoo_bench.datasets.mini.world.shapes import Patch, Raster, Shape, line_height
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["CAR_COLOURS", "OLDER", "SURVEY", "Canvas", "Material", "Palette", "repeats"]

_WET = ("water", "pool")
# How far mottling moves red, green and blue, in eighths: dry and wet ground differ in hue.
_TINT = np.array([9, 8, 6], np.int32)


@dataclass(frozen=True)
class Material:
    """A colour, and the amplitude of fine, middle and coarse mottling in display values."""

    colour: Colour
    fine: int = 10
    middle: int = 8
    coarse: int = 6


@dataclass(frozen=True)
class Crop:
    """What grows on a field: rows of a width, their colour, and the colour between them."""

    row: Material
    gap: Colour
    row_m: float
    gap_share: float


@dataclass(frozen=True)
class Palette:
    """The look of a season, 1 the survey's or 2 the older mosaic's.

    The name of each material is also a kind of decal.
    """

    materials: dict[str, Material]
    crops: tuple[Crop, ...]
    season: int


CAR_COLOURS = colours("e2e2e0 e8e6e2 3c3e42 222428 969aa0 b2b4b6 962222 2c4880 70604e")

_SURVEY = {
    "asphalt": Material((132, 130, 136), 9, 10, 12),
    "lane": Material((146, 142, 142), 9, 12, 12),
    "tar": Material((92, 92, 98), 8, 6, 4),
    "patch": Material((116, 114, 120), 8, 6, 4),
    "kerb": Material((190, 186, 178), 8, 4, 4),
    "pavement": Material((176, 166, 156), 10, 10, 8),
    "paving": Material((184, 170, 152), 10, 10, 12),
    "concrete": Material((186, 182, 174), 8, 14, 12),
    "gravel": Material((176, 160, 140), 22, 12, 12),
    "track": Material((166, 140, 108), 18, 16, 10),
    "soil": Material((150, 114, 82), 18, 16, 14),
    "sand": Material((206, 186, 146), 12, 8, 6),
    "lawn": Material((106, 134, 58), 18, 20, 20),
    "meadow": Material((118, 138, 66), 24, 26, 26),
    "rough": Material((96, 114, 56), 30, 26, 18),
    "litter": Material((74, 82, 44), 26, 20, 12),
    "reed": Material((112, 128, 60), 34, 20, 12),
    "water": Material((56, 82, 78), 3, 5, 14),
    "shallow": Material((98, 110, 88), 10, 10, 10),
    "court": Material((86, 128, 96), 6, 6, 4),
    "running": Material((172, 84, 66), 6, 6, 6),
    "marking": Material((228, 228, 222), 10, 18, 6),
    "yellow": Material((220, 182, 70), 10, 16, 6),
    "bed": Material((84, 108, 46), 34, 24, 8),
    "wood": Material((150, 124, 96), 10, 10, 4),
    "rubbish": Material((160, 150, 140), 60, 40, 10),
    "pool": Material((96, 178, 196), 6, 6, 4),
}

_OLDER = _SURVEY | {
    "asphalt": Material((120, 116, 114), 7, 12, 14),
    "lane": Material((136, 130, 124), 7, 12, 12),
    "pavement": Material((170, 160, 148), 8, 10, 8),
    "soil": Material((156, 128, 96), 14, 14, 14),
    "lawn": Material((138, 130, 78), 16, 22, 22),
    "meadow": Material((150, 138, 88), 22, 26, 26),
    "rough": Material((132, 120, 78), 26, 26, 18),
    "litter": Material((116, 98, 66), 26, 20, 12),
    "reed": Material((164, 144, 96), 30, 20, 12),
    "water": Material((76, 88, 72), 3, 6, 14),
    "shallow": Material((126, 118, 92), 10, 10, 10),
    "bed": Material((122, 104, 66), 30, 24, 8),
    "court": Material((104, 126, 104), 6, 6, 4),
    "running": Material((158, 92, 76), 6, 6, 6),
    "pool": Material((120, 150, 150), 6, 6, 4),
}

_SURVEY_CROPS = (
    Crop(Material((98, 132, 58), 14, 18, 18), (108, 126, 66), 1.0, 0.25),
    Crop(Material((120, 150, 58), 14, 20, 18), (134, 142, 72), 1.5, 0.3),
    Crop(Material((198, 180, 82), 22, 16, 16), (142, 146, 70), 2.0, 0.2),
    Crop(Material((156, 120, 86), 14, 14, 16), (126, 94, 68), 1.25, 0.4),
    Crop(Material((192, 170, 116), 16, 14, 14), (164, 140, 94), 1.75, 0.35),
    Crop(Material((74, 116, 46), 22, 14, 12), (150, 120, 88), 2.5, 0.45),
    Crop(Material((60, 98, 48), 20, 12, 12), (118, 112, 72), 3.25, 0.35),
    Crop(Material((124, 146, 70), 26, 26, 24), (116, 138, 66), 3.0, 0.3),
    Crop(Material((188, 196, 198), 14, 14, 14), (132, 122, 92), 6.0, 0.18),
)

_OLDER_CROPS = (
    Crop(Material((176, 152, 106), 14, 16, 16), (150, 126, 88), 1.0, 0.3),
    Crop(Material((146, 116, 84), 14, 16, 16), (124, 96, 70), 1.5, 0.35),
    Crop(Material((118, 126, 66), 18, 16, 16), (138, 126, 82), 2.0, 0.25),
    Crop(Material((140, 108, 78), 14, 14, 16), (116, 88, 64), 1.25, 0.4),
    Crop(Material((168, 146, 104), 16, 14, 14), (148, 124, 88), 1.75, 0.35),
    Crop(Material((104, 112, 60), 22, 14, 12), (146, 118, 86), 2.5, 0.5),
    Crop(Material((82, 94, 54), 20, 12, 12), (136, 116, 80), 3.25, 0.4),
    Crop(Material((152, 140, 90), 26, 26, 24), (140, 128, 80), 3.0, 0.3),
    Crop(Material((186, 188, 184), 12, 14, 12), (140, 122, 92), 6.0, 0.22),
)

SURVEY = Palette(_SURVEY, _SURVEY_CROPS, 1)
OLDER = Palette(_OLDER, _OLDER_CROPS, 2)


@dataclass(eq=False)
class Canvas:
    """A square raster over a plan, and what is painted on it so far."""

    plan: Plan
    raster: Raster
    textures: Textures
    land: NDArray[np.float32]  # (n, n): heights, for terraces
    palette: Palette
    rgb: NDArray[np.uint8] = field(init=False)  # (n, n, 3): black at first; changed in place
    water: Bools = field(init=False)  # (n, n): where water was painted last; changed in place

    def __post_init__(self) -> None:
        shape = (self.raster.size, self.raster.size)
        self.rgb = np.zeros((*shape, 3), np.uint8)
        self.water = np.zeros(shape, np.bool_)

    def cut(self, shape: Shape, side: int = 0) -> Patch:
        """Return the pixels of a shape, on one side of the plan's divide where one is named."""
        patch = shape.patch(self.raster)
        if side == 0:
            return patch
        return replace(patch, mask=patch.mask & (self._north[patch.window] == (side == 1)))

    @cached_property
    def _north(self) -> Bools:
        whole = slice(0, self.raster.size)
        x, y = self.raster.centres(whole, whole)
        return y > line_height(x, self.plan.divide)

    def put(
        self,
        patch: Patch,
        material: Material | str,
        where: Bools | None = None,
        shade: NDArray[np.int32] | int = 0,
    ) -> None:
        """Paint a material, which may be named, in a patch, or only `where` (h, w) in it."""
        mask = patch.mask if where is None else patch.mask & where
        self.water[patch.window][mask] = material in _WET
        if isinstance(material, str):
            material = self.palette.materials[material]
        light = self.textures.fine[patch.window][mask].astype(np.int32) * material.fine
        light += self.textures.middle[patch.window][mask].astype(np.int32) * material.middle
        light += self.textures.coarse[patch.window][mask].astype(np.int32) * material.coarse
        light >>= 6
        light += shade if isinstance(shade, int) else shade[mask]
        values = ((light[:, None] * _TINT) >> 3) + np.array(material.colour, np.int32)
        self.rgb[patch.window][mask] = np.clip(values, 0, 255).astype(np.uint8)

    def cells(
        self, key: int, u: Floats, v: Floats, size_u: float, size_v: float
    ) -> NDArray[np.int32]:
        """Return a random number of 0 to 255 for each cell of a pattern."""
        column = np.floor(u / size_u).astype(np.int64)
        row = np.floor(v / size_v).astype(np.int64)
        # A whole hash a pixel is dear; a multiplicative one on few distinct cells will do.
        code = (column * 73_856_093) ^ (row * 19_349_663)
        code = (code ^ np.int64(int(hash_of(self.plan.seed, key)[0]) & 0x7FFFFFFF)) * 2_654_435_761
        return ((code ^ (code >> 23)) >> 15 & 255).astype(np.int32)

    def spots(self, patch: Patch) -> NDArray[np.int16]:
        """Return noise of middle and coarse scale, for the outline of spots."""
        return self.textures.coarse[patch.window] + self.textures.middle[patch.window]


def repeats(along: Floats, period: float, part: float, phase: float = 0.0) -> Bools:
    """Return where a coordinate is in the first part of each period, all in metres."""
    moved = along + phase
    return np.asarray(moved - np.floor(moved / period) * period < part)

"""A raster to paint on: materials with mottling, inside shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.landscape.noise import Textures
from airzoo_bench.mini.landscape.palette import Material, Palette
from airzoo_bench.mini.landscape.shapes import Patch, Raster, Shape

__all__ = ["Canvas", "blank_canvas", "line_height"]

# How far mottling moves red, green and blue, in eighths: dry and wet ground differ in hue.
_WET = ("water", "pool")
_TINT = np.array([9, 8, 6], np.int32)


@dataclass(frozen=True, eq=False)
class Canvas:
    """What is painted so far, and what painters need.

    Attributes
    ----------
    raster : Raster
    rgb : (n, n, 3) uint8
        Changed in place.
    textures : Textures
    palette : Palette
    water : (n, n) bool
        Where water was painted last. Changed in place.
    sides : (n, n) uint8
        1 and 2 on the two sides of the dividing line.
    land : (n, n) float32
        Heights, for terraces.
    seed : int
    """

    raster: Raster
    rgb: NDArray[np.uint8]
    textures: Textures
    palette: Palette
    water: Bools
    sides: NDArray[np.uint8]
    land: NDArray[np.float32]
    seed: int

    def cut(self, shape: Shape, side: int = 0) -> Patch:
        """Return the pixels of a shape, on one side of the divide where one is named."""
        patch = shape.patch(self.raster)
        if side == 0:
            return patch
        return replace(patch, mask=patch.mask & (self.sides[patch.window] == side))

    def put(
        self,
        patch: Patch,
        material: Material | str,
        where: Bools | None = None,
        shade: NDArray[np.int32] | int = 0,
    ) -> None:
        """Paint a material.

        Parameters
        ----------
        patch : Patch
        material : Material, or its name in the palette
        where : (h, w) bool, optional
            Only there within the patch.
        shade : (h, w) int32 or int
            Display values to add.
        """
        mask = patch.mask if where is None else patch.mask & where
        self.water[patch.window][mask] = material in _WET
        if isinstance(material, str):
            material = self.palette.materials[material]
        light = self._mottling(patch, material, mask)
        light += shade if isinstance(shade, int) else shade[mask]
        values = (light[:, None] * _TINT) >> 3
        values += np.array(material.colour, np.int32)
        self.rgb[patch.window][mask] = np.clip(values, 0, 255).astype(np.uint8)

    def _mottling(self, patch: Patch, material: Material, mask: Bools) -> NDArray[np.int32]:
        window = patch.window
        light = self.textures.fine[window][mask].astype(np.int32) * material.fine
        light += self.textures.middle[window][mask].astype(np.int32) * material.middle
        light += self.textures.coarse[window][mask].astype(np.int32) * material.coarse
        light >>= 6
        return light


def blank_canvas(
    raster: Raster,
    textures: Textures,
    palette: Palette,
    divide: tuple[tuple[float, float], ...],
    land: NDArray[np.float32],
    seed: int,
) -> Canvas:
    """Return a canvas in black."""
    rgb = np.zeros((raster.size, raster.size, 3), np.uint8)
    water = np.zeros((raster.size, raster.size), np.bool_)
    return Canvas(raster, rgb, textures, palette, water, _sides(raster, divide), land, seed)


def _sides(raster: Raster, divide: tuple[tuple[float, float], ...]) -> NDArray[np.uint8]:
    whole = slice(0, raster.size)
    x, y = raster.centres(whole, whole)
    line = line_height(x[0], divide) if divide else np.full(raster.size, -np.inf)
    return np.where(y > line[None, :], 1, 2).astype(np.uint8)


def line_height(x: Floats, points: tuple[tuple[float, float], ...]) -> Floats:
    """Return y of a line from west to east at some x; beyond its ends it goes on straight.

    Not ``np.interp``, which a compiler may fuse into other roundings on other machines.
    """
    knots_x, knots_y = np.array(points).T
    slopes = (knots_y[1:] - knots_y[:-1]) / (knots_x[1:] - knots_x[:-1])
    part = np.clip(np.searchsorted(knots_x, x, side="right") - 1, 0, len(slopes) - 1)
    return np.asarray(knots_y[part] + (x - knots_x[part]) * slopes[part])

"""How roofs look from above."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape.canvas import Canvas
from airzoo_bench.mini.landscape.painters import cells, repeats
from airzoo_bench.mini.landscape.palette import Material
from airzoo_bench.mini.landscape.plan import Building, Roof
from airzoo_bench.mini.landscape.randomness import Dice, hash_of
from airzoo_bench.mini.landscape.shapes import Patch

__all__ = ["COVERS", "paint_roof"]

Colour = tuple[int, int, int]
_STREAM = 41


def paint_roof(
    canvas: Canvas, building: Building, index: int, owner: NDArray[np.int32], colour: Colour
) -> None:
    """Paint the roof of one building where it is on top.

    Parameters
    ----------
    canvas : Canvas
    building : Building
    index : int
        Its place in the list.
    owner : (n, n) int32
        The building on top of each pixel, -1 for none.
    colour : (3,) ints
    """
    patch = building.rect.inset(-0.3).patch(canvas.raster)
    mask = owner[patch.window] == index
    if not mask.any():
        return
    patch = Patch(patch.rows, patch.columns, mask, patch.u, patch.v)
    COVERS[building.cover](canvas, patch, building, colour, index)


def _edge(patch: Patch, building: Building) -> Floats:
    """Distance from the outline, in metres."""
    rect = building.rect
    along = np.minimum(patch.u - rect.u0, rect.u1 - patch.u)
    return np.minimum(along, np.minimum(patch.v - rect.v0, rect.v1 - patch.v))


def _tiles(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    rect = building.rect
    edge = np.abs(patch.v)
    hips = building.roof is Roof.HIPPED
    ends = rect.u1 - np.abs(patch.u)
    on_hip = hips & (ends < rect.v1 - edge)
    down = np.where(on_hip, rect.u1 - ends, edge)
    across = np.where(on_hip, patch.v, patch.u)
    shade = (cells(canvas.seed, index, across, down, 0.5, 0.75) >> 4) - 8
    shade = shade + (cells(canvas.seed, index + 9, across, down, 2.5, 50.0) >> 4) - 8
    shade = shade - np.where(repeats(down, 0.75, 0.25), 14, 0)
    material = Material(colour, 10, 14, 10)
    canvas.put(patch, material, shade=shade.astype(np.int32))
    ridge = (edge < 0.3) & ~on_hip | hips & (np.abs(ends - (rect.v1 - edge)) < 0.3)
    canvas.put(patch, material, ridge, 26)
    canvas.put(patch, material, _edge(patch, building) < 0.3, -26)
    _moss(canvas, patch, index)
    _roof_windows(canvas, patch, building, index)


def _moss(canvas: Canvas, patch: Patch, index: int) -> None:
    spread = canvas.textures.middle[patch.window] + canvas.textures.coarse[patch.window]
    if index % 3 == 0:
        canvas.put(patch, Material((104, 106, 76), 14, 14, 4), spread > 58)


def _roof_windows(canvas: Canvas, patch: Patch, building: Building, index: int) -> None:
    """Windows, dormers and chimneys."""
    dice, rect = Dice(canvas.seed, _STREAM, index), building.rect
    for _ in range(dice.integer(0, 2 + int((rect.u1 - rect.u0) / 4))):
        u, v = dice.real(rect.u0 + 1, rect.u1 - 1), dice.real(rect.v0 * 0.75, rect.v1 * 0.75)
        half, tone = dice.pick(
            (
                (0.5, (58, 70, 84)),
                (0.4, (196, 188, 178)),
                (0.8, (74, 88, 104)),
                (0.4, (112, 66, 54)),
            )
        )
        spot = (np.abs(patch.u - u) < half) & (np.abs(patch.v - v) < half * 1.2)
        rim = (np.abs(patch.u - u) < half + 0.25) & (np.abs(patch.v - v) < half * 1.2 + 0.25)
        canvas.put(patch, Material((188, 184, 178), 6, 0, 0), rim)
        canvas.put(patch, Material(tone, 6, 0, 0), spot)
    if dice.chance(14):
        u0, low = dice.real(rect.u0 + 0.8, rect.u1 * 0.2), dice.real(0.8, 1.4)
        _panels(canvas, patch, (u0, rect.u1 - 1.0, -rect.v1 + low, -0.8))


def _panels(canvas: Canvas, patch: Patch, box: tuple[float, float, float, float]) -> None:
    inside = (patch.u > box[0]) & (patch.u < box[1]) & (patch.v > box[2]) & (patch.v < box[3])
    canvas.put(patch, Material((38, 52, 92), 8, 8, 4), inside)
    lines = repeats(patch.u - box[0], 1.25, 0.25) | repeats(patch.v - box[2], 2.0, 0.25)
    canvas.put(patch, Material((136, 146, 164), 6, 0, 0), inside & lines)


def _metal(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    sheet = (cells(canvas.seed, index, patch.u, patch.v, 1.0, 6.5) >> 4) - 8
    seams = np.where(repeats(patch.u, 1.0, 0.25), 16, 0)
    material = Material(colour, 6, 8, 14)
    canvas.put(patch, material, shade=(sheet - seams).astype(np.int32))
    if index % 2:
        lights = repeats(patch.u, 7.0, 1.0, index % 7) & (_edge(patch, building) > 1.5)
        canvas.put(patch, Material((206, 212, 206), 8, 10, 6), lights)
    rust = canvas.textures.coarse[patch.window] + canvas.textures.middle[patch.window]
    canvas.put(patch, Material((150, 104, 76), 14, 18, 8), rust > 74)
    canvas.put(patch, material, (np.abs(patch.v) < 0.35) & (building.roof is Roof.GABLED), 30)
    canvas.put(patch, material, _edge(patch, building) < 0.3, -24)


def _membrane(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    sheets = (cells(canvas.seed, index, patch.u, patch.v, 3.5, 9.0) >> 4) - 8
    canvas.put(patch, Material(colour, 9, 18, 16), shade=sheets)
    canvas.put(patch, Material(colour, 6, 8, 4), repeats(patch.u, 3.5, 0.25), -18)
    _flat_details(canvas, patch, building, colour, index)


def _flat_details(
    canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int
) -> None:
    """Puddles, the rim, hatches, pipes, gardens and panels of a flat roof."""
    dice, rect = Dice(canvas.seed, _STREAM, index), building.rect
    puddle = canvas.textures.coarse[patch.window] + canvas.textures.middle[patch.window]
    canvas.put(patch, Material((112, 108, 104), 8, 10, 4), puddle > 66)
    long, deep = rect.u1 - rect.u0, rect.v1 - rect.v0
    if building.parent < 0 and dice.chance(22):
        u0 = rect.u0 + long * dice.real(0.05, 0.5)
        box = (u0, u0 + long * dice.real(0.25, 0.45), rect.v0 + 1.0, rect.v0 + deep * 0.6)
        if dice.chance(55):
            _panels(canvas, patch, box)
        else:
            inside = (patch.u > box[0]) & (patch.u < box[1])
            garden = inside & (patch.v > box[2]) & (patch.v < box[3])
            canvas.put(patch, "bed", garden & repeats(patch.v, 1.5, 1.0))
    for _ in range(int(long * deep / 40)):
        u, v = dice.real(rect.u0, rect.u1), dice.real(rect.v0, rect.v1)
        half_u, half_v = dice.pick(((0.5, 0.5), (0.3, 2.5), (2.5, 0.3), (0.8, 0.5), (0.35, 0.35)))
        tone = dice.pick(((214, 214, 212), (70, 72, 76), (150, 150, 150), (178, 120, 90)))
        spot = (np.abs(patch.u - u) < half_u) & (np.abs(patch.v - v) < half_v)
        canvas.put(patch, Material(tone, 6, 4, 0), spot)
    rim = _edge(patch, building)
    bright = 34 if int(hash_of(canvas.seed, index)) % 3 else -40
    canvas.put(patch, Material(colour, 6, 6, 4), rim < 0.45, bright)
    canvas.put(patch, Material(colour, 6, 6, 4), (rim >= 0.45) & (rim < 0.75), -30)


def _gravel(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    canvas.put(patch, Material(colour, 22, 14, 16))
    _flat_details(canvas, patch, building, colour, index)


def _slabs(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    tone = (cells(canvas.seed, index, patch.u, patch.v, 1.5, 1.5) >> 3) - 16
    canvas.put(patch, Material(colour, 8, 10, 12), shade=tone)
    joints = repeats(patch.u, 6.0, 0.25) | repeats(patch.v, 6.0, 0.25)
    canvas.put(patch, Material(colour, 6, 4, 2), joints, -26)
    _flat_details(canvas, patch, building, colour, index)


def _machine(canvas: Canvas, patch: Patch, building: Building, colour: Colour, index: int) -> None:
    canvas.put(patch, Material(colour, 6, 4, 0))
    ring = patch.u * patch.u + patch.v * patch.v
    canvas.put(patch, Material((52, 54, 58), 6, 0, 0), ring < 0.3)


COVERS: dict[str, Callable[[Canvas, Patch, Building, Colour, int], None]] = {
    "gravel": _gravel,
    "machine": _machine,
    "membrane": _membrane,
    "metal": _metal,
    "slabs": _slabs,
    "tiles": _tiles,
}

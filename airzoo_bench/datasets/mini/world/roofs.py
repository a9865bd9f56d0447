"""How roofs look from above."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Dice, hash_of
from airzoo_bench.datasets.mini.world.canvas import Canvas, Material, repeats
from airzoo_bench.datasets.mini.world.plan import Building, Colour, colours
from airzoo_bench.datasets.mini.world.shapes import Patch, Rect
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["paint_roof"]

_STREAM = 41


@dataclass(frozen=True, eq=False)
class _Top:
    """A roof to be painted: where it is on top, and the building's place in the list."""

    canvas: Canvas
    patch: Patch
    building: Building
    colour: Colour
    index: int

    @property
    def rect(self) -> Rect:
        return self.building.rect

    @property
    def rim(self) -> Floats:
        """Distance from the outline, in metres."""
        u, v, rect = self.patch.u, self.patch.v, self.rect
        along = np.minimum(u - rect.u0, rect.u1 - u)
        return np.minimum(along, np.minimum(v - rect.v0, rect.v1 - v))

    def near(self, u: float, v: float, half_u: float, half_v: float) -> Bools:
        """Return where a rectangle about a point is."""
        return (np.abs(self.patch.u - u) < half_u) & (np.abs(self.patch.v - v) < half_v)

    def put(
        self,
        mottling: tuple[int, int, int],
        where: Bools | None = None,
        shade: NDArray[np.int32] | int = 0,
        colour: Colour | None = None,
    ) -> None:
        """Paint in the roof's colour or another."""
        self.canvas.put(self.patch, Material(colour or self.colour, *mottling), where, shade)


def paint_roof(
    canvas: Canvas, building: Building, index: int, owner: NDArray[np.int32], colour: Colour
) -> None:
    """Paint the roof of one building where it is on top."""
    patch = building.rect.inset(-0.3).patch(canvas.raster)
    patch = replace(patch, mask=owner[patch.window] == index)
    if patch.mask.any():
        _COVERS[building.cover](_Top(canvas, patch, building, colour, index))


def _tiles(top: _Top) -> None:
    patch, rect = top.patch, top.rect
    edge, ends = np.abs(patch.v), rect.u1 - np.abs(patch.u)
    hips = top.building.roof == "hipped"
    on_hip = hips & (ends < rect.v1 - edge)
    down = np.where(on_hip, rect.u1 - ends, edge)
    across = np.where(on_hip, patch.v, patch.u)
    cells = top.canvas.cells
    shade = (cells(top.index, across, down, 0.5, 0.75) >> 4) - 8
    shade += (cells(top.index + 9, across, down, 2.5, 50.0) >> 4) - 8
    shade -= np.where(repeats(down, 0.75, 0.25), 14, 0).astype(np.int32)
    mottling = 10, 14, 10
    top.put(mottling, shade=shade)
    ridge = (edge < 0.3) & ~on_hip | hips & (np.abs(ends - (rect.v1 - edge)) < 0.3)
    top.put(mottling, ridge, 26)
    top.put(mottling, top.rim < 0.3, -26)
    if top.index % 3 == 0:  # moss
        top.put((14, 14, 4), top.canvas.spots(patch) > 58, colour=(104, 106, 76))
    _add_windows(top)


def _add_windows(top: _Top) -> None:
    """Windows, dormers and chimneys."""
    dice, rect = Dice(top.canvas.plan.seed, _STREAM, top.index), top.rect
    tones = colours("3a4654 c4bcb2 4a5868 704236")
    kinds = tuple(zip((0.5, 0.4, 0.8, 0.4), tones, strict=True))
    for _ in range(dice.integer(0, 2 + int(rect.long / 4))):
        u, v = dice.real(rect.u0 + 1, rect.u1 - 1), dice.real(rect.v0 * 0.75, rect.v1 * 0.75)
        half, tone = dice.pick(kinds)
        frame = top.near(u, v, half + 0.25, half * 1.2 + 0.25)
        top.put((6, 0, 0), frame, colour=(188, 184, 178))
        top.put((6, 0, 0), top.near(u, v, half, half * 1.2), colour=tone)
    if dice.chance(14):
        u0, low = dice.real(rect.u0 + 0.8, rect.u1 * 0.2), dice.real(0.8, 1.4)
        _add_panels(top, (u0, rect.u1 - 1.0, -rect.v1 + low, -0.8))


def _add_panels(top: _Top, box: tuple[float, float, float, float]) -> None:
    inside = _within(top.patch, box)
    top.put((8, 8, 4), inside, colour=(38, 52, 92))
    lines = repeats(top.patch.u - box[0], 1.25, 0.25) | repeats(top.patch.v - box[2], 2.0, 0.25)
    top.put((6, 0, 0), inside & lines, colour=(136, 146, 164))


def _within(patch: Patch, box: tuple[float, float, float, float]) -> Bools:
    u0, u1, v0, v1 = box
    return (patch.u > u0) & (patch.u < u1) & (patch.v > v0) & (patch.v < v1)


def _metal(top: _Top) -> None:
    patch, mottling = top.patch, (6, 8, 14)
    sheets = (top.canvas.cells(top.index, patch.u, patch.v, 1.0, 6.5) >> 4) - 8
    seams = np.where(repeats(patch.u, 1.0, 0.25), 16, 0).astype(np.int32)
    top.put(mottling, shade=sheets - seams)
    if top.index % 2:
        lights = repeats(patch.u, 7.0, 1.0, top.index % 7) & (top.rim > 1.5)
        top.put((8, 10, 6), lights, colour=(206, 212, 206))
    top.put((14, 18, 8), top.canvas.spots(patch) > 74, colour=(150, 104, 76))
    top.put(mottling, (np.abs(patch.v) < 0.35) & (top.building.roof == "gabled"), 30)
    top.put(mottling, top.rim < 0.3, -24)


def _membrane(top: _Top) -> None:
    sheets = (top.canvas.cells(top.index, top.patch.u, top.patch.v, 3.5, 9.0) >> 4) - 8
    top.put((9, 18, 16), shade=sheets)
    top.put((6, 8, 4), repeats(top.patch.u, 3.5, 0.25), -18)
    _add_flat_details(top)


def _gravel(top: _Top) -> None:
    top.put((22, 14, 16))
    _add_flat_details(top)


def _slabs(top: _Top) -> None:
    tone = (top.canvas.cells(top.index, top.patch.u, top.patch.v, 1.5, 1.5) >> 3) - 16
    top.put((8, 10, 12), shade=tone)
    joints = repeats(top.patch.u, 6.0, 0.25) | repeats(top.patch.v, 6.0, 0.25)
    top.put((6, 4, 2), joints, -26)
    _add_flat_details(top)


def _machine(top: _Top) -> None:
    top.put((6, 4, 0))
    ring = top.patch.u * top.patch.u + top.patch.v * top.patch.v
    top.put((6, 0, 0), ring < 0.3, colour=(52, 54, 58))


def _add_flat_details(top: _Top) -> None:
    """Puddles, a garden or panels, hatches and pipes, and the rim of a flat roof."""
    seed, rect, patch = top.canvas.plan.seed, top.rect, top.patch
    dice = Dice(seed, _STREAM, top.index)
    top.put((8, 10, 4), top.canvas.spots(patch) > 66, colour=(112, 108, 104))
    if top.building.parent < 0 and dice.chance(22):
        u0 = rect.u0 + rect.long * dice.real(0.05, 0.5)
        u1 = u0 + rect.long * dice.real(0.25, 0.45)
        box = (u0, u1, rect.v0 + 1.0, rect.v0 + rect.deep * 0.6)
        if dice.chance(55):
            _add_panels(top, box)
        else:
            top.canvas.put(patch, "bed", _within(patch, box) & repeats(patch.v, 1.5, 1.0))
    for _ in range(int(rect.long * rect.deep / 40)):
        u, v = dice.real(rect.u0, rect.u1), dice.real(rect.v0, rect.v1)
        half = dice.pick(((0.5, 0.5), (0.3, 2.5), (2.5, 0.3), (0.8, 0.5), (0.35, 0.35)))
        tone = dice.pick(((214, 214, 212), (70, 72, 76), (150, 150, 150), (178, 120, 90)))
        top.put((6, 4, 0), top.near(u, v, *half), colour=tone)
    rim = top.rim
    top.put((6, 6, 4), rim < 0.45, 34 if int(hash_of(seed, top.index)[0]) % 3 else -40)
    top.put((6, 6, 4), (rim >= 0.45) & (rim < 0.75), -30)


_COVERS: dict[str, Callable[[_Top], None]] = {
    "gravel": _gravel,
    "machine": _machine,
    "membrane": _membrane,
    "metal": _metal,
    "slabs": _slabs,
    "tiles": _tiles,
}

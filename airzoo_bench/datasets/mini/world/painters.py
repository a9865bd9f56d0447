"""How each kind of decal is painted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import hash_of
from airzoo_bench.datasets.mini.world.canvas import CAR_COLOURS, Canvas, Material, repeats
from airzoo_bench.datasets.mini.world.shapes import Patch

__all__ = ["paint_decals"]


def paint_decals(canvas: Canvas) -> None:
    """Paint the decals of the canvas's plan in order, but for those of another season."""
    for decal in canvas.plan.decals:
        if decal.season not in (0, canvas.palette.season):
            continue
        patch = canvas.cut(decal.shape, decal.side)
        if not patch.mask.any():
            continue
        if decal.kind in _PAINTERS:
            _PAINTERS[decal.kind](canvas, patch, decal.key)
        else:
            canvas.put(patch, decal.kind)


def _dashes(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "marking", repeats(patch.u, 9.0, 4.0, key % 9))


def _crossing(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "marking", repeats(patch.v, 1.25, 0.65))


def _parking(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "lane")
    low, high = float(patch.v[patch.mask].min()), float(patch.v[patch.mask].max())
    row = (high - low + 0.25) / max(round((high - low) / 16.0), 1)
    place = patch.v - low
    place = place - np.floor(place / row) * row
    stalls = (place < 5.0) | (place > row - 5.0)
    canvas.put(patch, "marking", repeats(patch.u, 2.75, 0.25) & stalls)
    canvas.put(patch, "marking", np.abs(place - row) < 0.2)


def _slabs(canvas: Canvas, patch: Patch, key: int) -> None:
    size = (0.75, 1.0, 1.5, 2.0)[key % 4]
    tone = canvas.cells(key, patch.u, patch.v, size, size)
    canvas.put(patch, ("paving", "pavement", "concrete")[key // 4 % 3], shade=(tone >> 3) - 16)
    canvas.put(patch, "kerb", repeats(patch.u, size * 6, 0.2) | repeats(patch.v, size * 6, 0.2))


def _plates(canvas: Canvas, patch: Patch, key: int) -> None:
    tone = canvas.cells(key, patch.u, patch.v, 5.0, 4.0)
    canvas.put(patch, "concrete", shade=(tone >> 3) - 24)
    canvas.put(patch, "patch", repeats(patch.u, 5.0, 0.25) | repeats(patch.v, 4.0, 0.25))


def _beds(canvas: Canvas, patch: Patch, key: int) -> None:
    tone = canvas.cells(key, patch.u, patch.v, 1.5, 40.0)
    for index, name in enumerate(("bed", "soil", "lawn", "rough")):
        canvas.put(patch, name, (tone >> 6) == index)
    canvas.put(patch, "gravel", repeats(patch.u, 3.0, 0.3))


def _flowers(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "bed")
    if canvas.palette.season == 1:
        colour = ((190, 70, 80), (214, 190, 60), (170, 90, 160), (220, 214, 208))[key % 4]
        bloom = canvas.cells(key, patch.u, patch.v, 0.5, 0.5) > 150
        canvas.put(patch, Material(colour, 20, 10, 4), bloom)


def _field(canvas: Canvas, patch: Patch, key: int) -> None:
    crop = canvas.palette.crops[key % len(canvas.palette.crops)]
    tone = canvas.cells(key, np.zeros_like(patch.v), patch.v, 1.0, crop.row_m * 5)
    wobble = patch.v + canvas.textures.coarse[patch.window] * (1 / 256)
    shade = (tone >> 4) - 8 + key // 16 % 24 - 12
    canvas.put(patch, crop.row, shade=shade)
    gap = replace(crop.row, colour=crop.gap)
    canvas.put(patch, gap, repeats(wobble, crop.row_m, crop.row_m * crop.gap_share), shade)
    if key // 512 % 3:
        lines = repeats(wobble, 14.0, 0.5) | repeats(wobble, 14.0, 0.5, 2.0)
        canvas.put(patch, gap, lines, -14)
    if crop.row_m < 5:  # not plastic tunnels
        bare = _blots(canvas, patch) > 96 - key // 2048 % 50
        canvas.put(patch, ("rough", "soil", "meadow")[key // 64 % 3], bare)


def _blots(canvas: Canvas, patch: Patch) -> NDArray[np.int16]:
    """Noise of all scales, for ragged outlines."""
    return canvas.spots(patch) + (canvas.textures.fine[patch.window] >> 1)


def _terraces(canvas: Canvas, patch: Patch, key: int) -> None:
    land = canvas.land[patch.window].astype(np.float64)
    land = land + canvas.textures.coarse[patch.window] * (1 / 512)
    step = np.floor(land / 1.5).astype(np.int64)
    crops = int(hash_of(canvas.plan.seed, key, 5)[0]) % 3
    kinds = ((0, 1, 0, 3), (0, 4, 1, 1), (1, 7, 0, 4))[crops]
    for phase, kind in enumerate(kinds):
        part = replace(patch, mask=patch.mask & (step % 4 == phase))
        _field(canvas, part, (key + phase) * len(canvas.palette.crops) + kind)
    canvas.put(patch, "rough", land / 1.5 - step < 0.16)
    canvas.put(patch, "track", land / 1.5 - step < 0.05)


def _pitch(canvas: Canvas, patch: Patch, key: int) -> None:
    stripes = repeats(patch.u, 10.0, 5.0)
    canvas.put(patch, "lawn", shade=np.where(stripes, 10, -6).astype(np.int32))
    u, v = np.abs(patch.u), np.abs(patch.v)
    ring = np.sqrt(u * u + v * v)
    half_u, half_v = float(u[patch.mask].max()), float(v[patch.mask].max())
    lines = (u < 0.2) | (np.abs(ring - 7.0) < 0.2) | (u > half_u - 0.4) | (v > half_v - 0.4)
    box = (u > half_u - 12.0) & (v < 14.0)
    canvas.put(patch, "marking", lines | (box & ((u < half_u - 11.6) | (v > 13.6))))
    worn = (u > half_u - 6) & (v < 4) & (canvas.textures.middle[patch.window] > 0)
    canvas.put(patch, "soil", worn)


def _running(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "running")
    inside = float(patch.u[patch.mask].max()) - patch.u
    canvas.put(patch, "marking", repeats(inside, 1.25, 0.2) & (inside < 7.6))
    canvas.put(patch, "lawn", inside > 8.0)


def _court(canvas: Canvas, patch: Patch, key: int) -> None:
    outer, inner = ("running", "court") if key % 2 else ("court", "running")
    u, v = np.abs(patch.u), np.abs(patch.v)
    canvas.put(patch, outer)
    canvas.put(patch, inner, (u < 12.0) & (v < 5.75))
    border = (np.abs(u - 12.0) < 0.2) & (v < 5.75) | (np.abs(v - 5.75) < 0.2) & (u < 12.0)
    lines = border | (np.abs(v - 4.4) < 0.15) & (u < 12) | (np.abs(u - 6.4) < 0.15) & (v < 4.4)
    canvas.put(patch, "marking", lines | (u < 0.2) & (v < 6.5))


def _car(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, Material(CAR_COLOURS[key % len(CAR_COLOURS)], 4, 4, 0))
    glass = (patch.u > 0.3) & (patch.u < 1.1) | (patch.u < -1.2) & (patch.u > -1.8)
    canvas.put(patch, Material((40, 46, 54), 4, 0, 0), glass & (np.abs(patch.v) < 0.7))


def _old_roof(canvas: Canvas, patch: Patch, key: int) -> None:
    """Paint a building that has gone since: only the older mosaic shows it."""
    colour = ((172, 96, 72), (120, 118, 120), (78, 118, 166), (178, 174, 168))[key % 4]
    half = np.where(patch.v > 0, 16, -22).astype(np.int32)
    canvas.put(patch, Material(colour, 8, 12, 8), shade=half)
    canvas.put(patch, Material(colour, 8, 4, 0), repeats(patch.u, 1.0, 0.25), -14)


def _worn(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, ("soil", "gravel", "rough", "sand")[key % 4], _blots(canvas, patch) > 40)


def _ruts(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "track")
    grown = canvas.textures.middle[patch.window] > -60
    canvas.put(patch, "rough", (patch.u < 0.45) & grown)


def _shore(canvas: Canvas, patch: Patch, key: int) -> None:
    canvas.put(patch, "reed")
    canvas.put(patch, "shallow", canvas.textures.coarse[patch.window] > 10)


_PAINTERS: dict[str, Callable[[Canvas, Patch, int], None]] = {
    "beds": _beds,
    "car": _car,
    "crossing": _crossing,
    "dashes": _dashes,
    "field": _field,
    "flowers": _flowers,
    "court_marked": _court,
    "old_roof": _old_roof,
    "parking": _parking,
    "pitch": _pitch,
    "plates": _plates,
    "running_track": _running,
    "ruts": _ruts,
    "shore": _shore,
    "slabs": _slabs,
    "terraces": _terraces,
    "worn": _worn,
}

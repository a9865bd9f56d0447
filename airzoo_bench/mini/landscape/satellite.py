"""The older mosaic: the same ground in another season, in another light, a little off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.landscape.canvas import Canvas
from airzoo_bench.mini.landscape.from_above import NOTHING
from airzoo_bench.mini.landscape.houses import METAL, TILES
from airzoo_bench.mini.landscape.noise import Textures
from airzoo_bench.mini.landscape.plan import Plan
from airzoo_bench.mini.landscape.randomness import hash_of
from airzoo_bench.mini.landscape.sunlight import lit, sunlit
from airzoo_bench.mini.landscape.surface import (
    Surface,
    light_on,
    owners,
    paint_canopies,
    paint_roofs,
)
from airzoo_bench.mini.light import OLDER_SUN
from airzoo_bench.mini.world import Mesh

__all__ = ["paint_older"]

_STREAM = 61
_ABSENT, _REPAINTED = 4, 9  # percent of the buildings, cumulative
# Where the mosaic shows what is elsewhere: metres east and north, 0.6 m in all.
_OFFSET_M = (0.48, -0.36)
_PIXEL_M = 0.3


@dataclass(frozen=True, eq=False)
class _Changes:
    absent: Bools
    colours: dict[int, tuple[int, int, int]]


def paint_older(
    canvas: Canvas, plan: Plan, mesh: Mesh, surface: Surface, colours: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Paint, light, shift and blur the older mosaic.

    Parameters
    ----------
    canvas : Canvas
        The ground of the older season; it is painted over.
    plan : Plan
    mesh : Mesh
    surface : Surface
    colours : (T, 3) uint8
        Of the canopies in the survey.

    Returns
    -------
    (m, m, 3) uint8
        At 0.3 m.
    """
    changes = _changes(plan)
    surface = _without(surface, mesh, changes.absent)
    paint_roofs(canvas, plan, mesh, surface, changes.colours)
    bare, winter = _winter_trees(plan, colours)
    hidden = _holes(mesh, surface, bare, canvas.textures)
    paint_canopies(canvas.rgb, mesh, surface, winter, canvas.textures, hidden)
    canopy_m = np.where(hidden, np.float32(NOTHING), surface.canopy_m)
    top = np.maximum(np.maximum(surface.roof_m, canopy_m), canvas.land)
    visible = sunlit(top, OLDER_SUN, canvas.raster.pixel_m)
    cosine = light_on(mesh, surface, plan.heights, hidden, OLDER_SUN)
    picture = _faded(lit(canvas.rgb, cosine, visible, OLDER_SUN))
    side_m = canvas.raster.size * canvas.raster.pixel_m
    return resampled(picture, canvas.raster.pixel_m, round(side_m / _PIXEL_M))


def _changes(plan: Plan) -> _Changes:
    draw = (hash_of(plan.seed, _STREAM, np.arange(len(plan.buildings))) >> np.uint64(20)).tolist()
    parents = [b.parent if b.parent >= 0 else i for i, b in enumerate(plan.buildings)]
    small = [(b.rect.u1 - b.rect.u0) * (b.rect.v1 - b.rect.v0) < 500 for b in plan.buildings]
    absent = np.array(
        [draw[parent] % 100 < _ABSENT and small[parent] for parent in parents], np.bool_
    )
    colours = {}
    for index, building in enumerate(plan.buildings):
        if _ABSENT <= draw[index] % 100 < _REPAINTED:
            table = METAL if building.cover == "metal" else TILES
            colours[index] = table[draw[index] // 128 % len(table)]
    return _Changes(absent, colours)


def _without(surface: Surface, mesh: Mesh, absent: Bools) -> Surface:
    owner = owners(mesh, surface.roof)
    gone = (owner >= 0) & absent[owner]
    return replace(
        surface,
        roof_m=np.where(gone, np.float32(NOTHING), surface.roof_m),
        roof=np.where(gone, np.int32(-1), surface.roof),
    )


def _winter_trees(plan: Plan, colours: NDArray[np.uint8]) -> tuple[Bools, NDArray[np.uint8]]:
    """Return which trees have lost leaves, and the colours of all."""
    draw = hash_of(plan.seed, _STREAM, 1, np.arange(len(plan.trees)))
    broad = np.array([tree.kind in ("broad", "bush") for tree in plan.trees], np.bool_)
    bare = broad & (draw % np.uint64(100) < 45)
    winter = colours.astype(np.int64) * 3 // 4 + 14
    brown = colours.astype(np.int64) // 3 + np.array([84, 68, 46])
    return bare, np.where(bare[:, None], brown, winter).astype(np.uint8)


def _holes(mesh: Mesh, surface: Surface, bare: Bools, textures: Textures) -> Bools:
    owner = owners(mesh, surface.canopy)
    thin = (owner >= 0) & bare[owner]
    noise = textures.fine + (textures.middle >> 1)
    return thin & (noise > -8)


def _faded(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Less contrast and colour, and a bluish haze."""
    table = np.arange(256)
    curve = np.stack([(table * 205 >> 8) + lift for lift in (22, 24, 32)]).astype(np.int16)
    bands = [curve[channel][picture[..., channel]] for channel in range(3)]
    grey = (bands[0] * 2 + bands[1] * 3 + bands[2]) // 6
    mixed = [(band * 13 + grey * 3) >> 4 for band in bands]
    return np.stack(mixed, -1).astype(np.uint8)


def resampled(picture: NDArray[np.uint8], pixel_m: float, size: int) -> NDArray[np.uint8]:
    """Resample bilinearly to the mosaic's pixels at its offset, and blur by 1-2-1."""
    rows = _bilinear(picture, pixel_m, size, -_OFFSET_M[1])
    columns = _bilinear(rows.transpose(1, 0, 2), pixel_m, size, _OFFSET_M[0])
    return np.ascontiguousarray(columns.transpose(1, 0, 2))


def _bilinear(
    picture: NDArray[np.uint8], pixel_m: float, size: int, offset_m: float
) -> NDArray[np.uint8]:
    """Resample and blur the rows."""
    at: Floats = ((np.arange(size).astype(np.float64) + 0.5) * _PIXEL_M + offset_m) / pixel_m - 0.5
    at = np.clip(at, 0.0, len(picture) - 1.0)
    low = np.minimum(np.floor(at).astype(np.int64), len(picture) - 2)
    weight = np.floor((at - low) * 64 + 0.5).astype(np.uint16)[:, None, None]
    wide = picture.astype(np.uint16)
    sharp = wide[low] * (64 - weight) + wide[low + 1] * weight >> 6
    blurred = sharp * 2
    blurred[1:] += sharp[:-1]
    blurred[0] += sharp[0]
    blurred[:-1] += sharp[1:]
    blurred[-1] += sharp[-1]
    return np.asarray(((blurred + 2) >> 2).astype(np.uint8))

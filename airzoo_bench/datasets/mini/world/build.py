"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`noise`); arithmetic is in integers, or in the float
operations that IEEE 754 rounds alike everywhere (+ - * / and the square root, elementwise). There
are no sums of floats, no matrix products, no sines.

The older mosaic shows the same ground in another season and light, with some buildings changed, a
little off.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.noise import hash_of
from airzoo_bench.datasets.mini.world.canvas import OLDER, SURVEY
from airzoo_bench.datasets.mini.world.city_plan import city_plan
from airzoo_bench.datasets.mini.world.meshes import building_mesh, tree_mesh
from airzoo_bench.datasets.mini.world.model import (
    OLDER_SUN,
    REGIONS,
    SIDE_M,
    SURVEY_SUN,
    Buildings,
    Light,
    Mesh,
    World,
)
from airzoo_bench.datasets.mini.world.painters import paint_decals
from airzoo_bench.datasets.mini.world.plan import METAL, TILES, Colour, Plan
from airzoo_bench.datasets.mini.world.rural_plan import rural_plan
from airzoo_bench.datasets.mini.world.shapes import Raster
from airzoo_bench.datasets.mini.world.surface import Layer, Surface, surface_heights, tree_colours
from airzoo_bench.datasets.mini.world.terrain import apron_mesh, land_mesh
from airzoo_bench.geometry.arrays import Bools

__all__ = ["build_world", "digest"]

# Heights in integers of this many to the metre.
_UNITS = 1024
_BIAS, _SOFT = 200, 512
_FAR_STEPS = 512

_STREAM = 61
_ABSENT, _REPAINTED = 4, 9  # percent of the buildings, cumulative
# Where the mosaic shows what is elsewhere: metres east and north, 0.6 m in all.
_OFFSET_M = (0.48, -0.36)
_PIXEL_M = 0.3


def _in_light(surface: Surface, albedo: NDArray[np.uint8], light: Light) -> NDArray[np.uint8]:
    """Return a map (n, n, 3) of albedo in light and shadow."""
    visible = sunlit(surface.heights, light, surface.raster.pixel_m)
    return lit(albedo, surface.cosine(light), visible, light)


def sunlit(heights: NDArray[np.floating], light: Light, pixel_m: float) -> NDArray[np.uint8]:
    """Return how much of the sun reaches each pixel of heights (n, n) in metres, 0 to 255."""
    east, north, up = light.direction
    size = len(heights)
    drop = round(_UNITS * pixel_m * up / -north)
    shift = np.floor(np.arange(size) * (east / north) + 0.5).astype(np.int64)
    offsets = (shift - shift.min()).tolist()
    low = np.floor(np.asarray(heights, np.float64) * _UNITS).astype(np.int32)
    shadow = np.full((size, size + max(offsets)), -(1 << 29), np.int32)
    for row, offset in enumerate(offsets):
        shadow[row, offset : offset + size] = low[row]
    steps = 1
    while steps <= _FAR_STEPS:
        np.maximum(shadow[:-steps], shadow[steps:] - drop * steps, out=shadow[:-steps])
        steps *= 2
    back = np.stack([shadow[row, offset : offset + size] for row, offset in enumerate(offsets)])
    dark = np.clip((back - low - _BIAS) * 255 // _SOFT, 0, 255)
    return np.asarray((255 - dark).astype(np.uint8))


def lit(
    albedo: NDArray[np.uint8],
    cosine: NDArray[np.float32],
    visible: NDArray[np.uint8],
    light: Light,
) -> NDArray[np.uint8]:
    """Light a map as `model.Light` says; `cosine` to the sun and `visible` from `sunlit`."""
    sun = cosine * (visible.astype(np.float32) * np.float32(1 / 255))
    result = np.empty_like(albedo)
    for channel in range(3):
        factor = sun * np.float32(light.sun[channel])
        factor += np.float32(light.sky[channel])
        factor *= albedo[..., channel]
        factor += np.float32(0.5)
        result[..., channel] = np.minimum(factor, np.float32(255)).astype(np.uint8)
    return result


def _older_mosaic(surface: Surface, albedo: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Paint, light, shift and blur the older mosaic (m, m, 3), at 0.3 m."""
    canvas = surface.canvas(OLDER)
    paint_decals(canvas)
    absent, repainted = _changes(surface.plan)
    bare, winter = _winter_trees(surface.plan, albedo)
    noise = surface.textures.fine + (surface.textures.middle >> 1)
    older = replace(
        surface,
        roofs=surface.roofs.without(_of(surface.roofs, absent)),
        canopies=surface.canopies.without(_of(surface.canopies, bare) & (noise > -8)),
    )
    older.paint_roofs(canvas, repainted)
    older.paint_canopies(canvas, winter)
    side_m = surface.raster.size * surface.raster.pixel_m
    picture = _faded(_in_light(older, canvas.rgb, OLDER_SUN))
    return resampled(picture, surface.raster.pixel_m, round(side_m / _PIXEL_M))


def _of(layer: Layer, chosen: Bools) -> Bools:
    """Where a layer shows chosen owners."""
    return (layer.owner >= 0) & chosen[layer.owner]


def _changes(plan: Plan) -> tuple[Bools, dict[int, Colour]]:
    """Return which buildings were not there yet, and which roofs had another colour."""
    draw = (hash_of(plan.seed, _STREAM, np.arange(len(plan.buildings))) >> np.uint64(20)).tolist()
    parents = [b.parent if b.parent >= 0 else i for i, b in enumerate(plan.buildings)]
    small = [building.rect.long * building.rect.deep < 500 for building in plan.buildings]
    absent = [draw[parent] % 100 < _ABSENT and small[parent] for parent in parents]
    repainted = {}
    for index, building in enumerate(plan.buildings):
        if _ABSENT <= draw[index] % 100 < _REPAINTED:
            table = METAL if building.cover == "metal" else TILES
            repainted[index] = table[draw[index] // 128 % len(table)]
    return np.array(absent, np.bool_), repainted


def _winter_trees(plan: Plan, albedo: NDArray[np.uint8]) -> tuple[Bools, NDArray[np.uint8]]:
    """Return which trees have lost leaves, and the colours of all."""
    draw = hash_of(plan.seed, _STREAM, 1, np.arange(len(plan.trees)))
    broad = np.array([tree.kind in ("broad", "bush") for tree in plan.trees], np.bool_)
    bare = broad & (draw % np.uint64(100) < 45)
    winter = albedo.astype(np.int64) * 3 // 4 + 14
    brown = albedo.astype(np.int64) // 3 + np.array([84, 68, 46])
    return bare, np.where(bare[:, None], brown, winter).astype(np.uint8)


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
    for offset_m in (-_OFFSET_M[1], _OFFSET_M[0]):  # rows, then columns
        picture = _bilinear(picture, pixel_m, size, offset_m).transpose(1, 0, 2)
    return np.ascontiguousarray(picture)


def _bilinear(
    picture: NDArray[np.uint8], pixel_m: float, size: int, offset_m: float
) -> NDArray[np.uint8]:
    """Resample and blur the rows."""
    at = ((np.arange(size).astype(np.float64) + 0.5) * _PIXEL_M + offset_m) / pixel_m - 0.5
    at = np.clip(at, 0.0, len(picture) - 1.0)
    low = np.minimum(np.floor(at).astype(np.int64), len(picture) - 2)
    weight = np.floor((at - low) * 64 + 0.5).astype(np.uint16)[:, None, None]
    wide = picture.astype(np.uint16)
    sharp = wide[low] * (64 - weight) + wide[low + 1] * weight >> 6
    around = np.pad(sharp, ((1, 1), (0, 0), (0, 0)), mode="edge")
    blurred = around[:-2] + around[2:] + sharp * 2
    return np.asarray(((blurred + 2) >> 2).astype(np.uint8))


_PLANS = {"city": city_plan, "rural": rural_plan}
_MAP_M, _DSM_M = 0.25, 0.5


def build_world(region: str, seed: int) -> World:
    """Make one region of `model.REGIONS`; another seed makes another place of the same kind."""
    if region not in _PLANS:
        expected = f"one of {', '.join(sorted(REGIONS))}"
        raise UsageError("unknown region", where=region, expected=expected)
    if seed < 0:
        raise UsageError("the seed is negative", where=f"seed {seed}", expected="0 or more")
    plan = _PLANS[region](seed)
    land = plan.heights
    parts = [land_mesh(land), building_mesh(plan.buildings), tree_mesh(plan), apron_mesh(land)]
    mesh = Mesh.joined(parts)
    surface = Surface.of(plan, mesh, Raster(round(SIDE_M / _MAP_M), _MAP_M))
    canopies = tree_colours(plan)
    canvas = surface.canvas(SURVEY)
    paint_decals(canvas)
    ground, water = canvas.rgb.copy(), canvas.water.copy()
    surface.paint_roofs(canvas, {})
    surface.paint_canopies(canvas, canopies)
    return World(
        region=REGIONS[region],
        seed=seed,
        mesh=mesh,
        buildings=_walls(plan),
        tree_colours=canopies,
        ground_albedo=ground,
        top_albedo=canvas.rgb,
        water=water,
        dsm=surface_heights(mesh, land, Raster(round(SIDE_M / _DSM_M), _DSM_M)),
        dom=_in_light(surface, canvas.rgb, SURVEY_SUN),
        satellite=_older_mosaic(surface, canopies),
    )


def _walls(plan: Plan) -> Buildings:
    def column(name: str, dtype: type) -> NDArray[Any]:
        return np.array([getattr(building, name) for building in plan.buildings], dtype)

    return Buildings(
        wall_colour=column("wall_colour", np.uint8),
        window_colour=column("window_colour", np.uint8),
        base_m=column("base_m", np.float64),
        storey_m=column("storey_m", np.float64),
        bay_m=column("bay_m", np.float64),
        style=column("style", np.uint8),
    )


def digest(world: World) -> dict[str, str]:
    """Return the SHA-256 of each array's little-endian bytes, by the array's name."""
    arrays = {f"mesh.{name}": array for name, array in vars(world.mesh).items()}
    arrays |= {f"buildings.{name}": array for name, array in vars(world.buildings).items()}
    arrays |= {name: array for name, array in vars(world).items() if isinstance(array, np.ndarray)}
    return {name: _sha256(array) for name, array in sorted(arrays.items())}


def _sha256(array: NDArray[np.generic]) -> str:
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return hashlib.sha256(little.data.cast("B")).hexdigest()

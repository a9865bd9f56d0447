"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`noise`); arithmetic is in integers, or in the float
operations that IEEE 754 rounds alike everywhere (+ - * / and the square root, elementwise). There
are no sums of floats, no matrix products, no sines.

The older mosaic shows the same ground in another season and light, with some buildings changed, a
little off.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.city import city_plan
from airzoo_bench.datasets.mini.meshes import plan_mesh
from airzoo_bench.datasets.mini.model import (
    OLDER_SUN,
    REGIONS,
    SIDE_M,
    SURVEY_SUN,
    Buildings,
    Light,
    Material,
    Mesh,
    World,
)
from airzoo_bench.datasets.mini.noise import hash_of, textures
from airzoo_bench.datasets.mini.painting import OLDER, SURVEY, Canvas
from airzoo_bench.datasets.mini.plan import METAL, TILES, Colour, Plan, colours
from airzoo_bench.datasets.mini.rasters import (
    Layer,
    canopies_on_top,
    land_at,
    lit,
    share_below_top,
    sun_cosine,
    sunlit,
    surface_heights,
)
from airzoo_bench.datasets.mini.rural import rural_plan
from airzoo_bench.datasets.mini.shapes import Raster
from airzoo_bench.geometry.arrays import Bools

_Rgb = NDArray[np.uint8]

_PLANS = {"city": city_plan, "rural": rural_plan}
_MAP_M, _DSM_M, _MOSAIC_M = 0.25, 0.5, 0.3

_BROAD = colours("4e6c2c 5c7a32 405e2a 68803a 547038 747e36")
_TREES = {"cone": colours("32502e 3a5834"), "bale": colours("ceb476 d6be82")}
_TREE_STREAM, _CHANGES_STREAM = 51, 61
_ABSENT, _REPAINTED = 4, 9  # percent of the buildings, cumulative
# Where the mosaic shows what is elsewhere: metres east and north, 0.6 m in all.
_OFFSET_M = (0.48, -0.36)


class _Maps:
    """A meshed plan as seen from above, painted and lit in either season."""

    def __init__(self, plan: Plan, mesh: Mesh) -> None:
        self.plan, self.mesh = plan, mesh
        self.raster = Raster(round(SIDE_M / _MAP_M), _MAP_M)
        self.textures = textures(plan.seed, self.raster.size)
        self.land = land_at(plan.heights, self.raster).astype(np.float32)
        self.roofs, self.canopies = (
            Layer.from_mesh(mesh, self.raster, material)
            for material in (Material.ROOF, Material.CANOPY)
        )

    def canvas(self, season: int) -> Canvas:
        """Return the land of a season."""
        canvas = Canvas(self.plan, self.raster, self.textures, self.land, season)
        canvas.paint_decals()
        return canvas

    def cover(
        self,
        canvas: Canvas,
        roofs: Layer,
        repainted: dict[int, Colour],
        canopies: Layer,
        albedo: _Rgb,
    ) -> None:
        """Paint roofs, some in another colour, and canopies of albedo (trees, 3)."""
        for index, building in enumerate(self.plan.buildings):
            canvas.paint_roof(index, roofs.owner, repainted.get(index, building.roof_colour))
        there = canopies_on_top(roofs, canopies) >= 0
        owner = canopies.owner[there]
        leaves = self.textures.fine[there].astype(np.int32) * 40
        leaves += self.textures.middle[there].astype(np.int32) * 14
        below = share_below_top(self.mesh, owner, canopies.height[there])
        light = (leaves >> 6) - (below * 34).astype(np.int32)
        values = albedo[owner].astype(np.int32) + ((light[:, None] * np.array([8, 8, 6])) >> 3)
        canvas.rgb[there] = np.clip(values, 0, 255).astype(np.uint8)

    def in_light(self, albedo: _Rgb, roofs: Layer, canopies: Layer, light: Light) -> _Rgb:
        """Return a map (n, n, 3) of albedo in light and shadow."""
        heights = np.maximum(np.maximum(roofs.height, canopies.height), self.land)
        on_top = roofs.triangle, canopies_on_top(roofs, canopies)
        cosine = sun_cosine(self.mesh, self.plan.heights, light, self.raster, *on_top)
        return lit(albedo, cosine, sunlit(heights, light, self.raster.pixel_m), light)

    def older_mosaic(self, albedo: _Rgb) -> _Rgb:
        """Paint, light, shift and blur the older mosaic (m, m, 3), at 0.3 m."""
        canvas = self.canvas(OLDER)
        absent, repainted = _changed_buildings(self.plan)
        bare, winter = _winter_trees(self.plan, albedo)
        twigs = self.textures.fine + (self.textures.middle >> 1) > -8
        roofs, canopies = self.roofs.without(absent), self.canopies.without(bare, twigs)
        self.cover(canvas, roofs, repainted, canopies, winter)
        picture = _fade(self.in_light(canvas.rgb, roofs, canopies, OLDER_SUN))
        return _resampled(picture, self.raster.pixel_m, round(SIDE_M / _MOSAIC_M))


def build_world(region: str, seed: int) -> World:
    """Make one region of `model.REGIONS`; another seed makes another place of the same kind."""
    if region not in _PLANS:
        expected = f"one of {', '.join(sorted(REGIONS))}"
        raise UsageError("unknown region", where=region, expected=expected)
    if seed < 0:
        raise UsageError("the seed is negative", where=f"seed {seed}", expected="0 or more")
    plan = _PLANS[region](seed)
    mesh = plan_mesh(plan)
    maps = _Maps(plan, mesh)
    leaves = _tree_colours(plan)
    canvas = maps.canvas(SURVEY)
    ground, water = canvas.rgb.copy(), canvas.water.copy()
    maps.cover(canvas, maps.roofs, {}, maps.canopies, leaves)
    return World(
        region=REGIONS[region],
        seed=seed,
        mesh=mesh,
        buildings=_walls(plan),
        tree_colours=leaves,
        ground_albedo=ground,
        top_albedo=canvas.rgb,
        water=water,
        dsm=surface_heights(mesh, plan.heights, Raster(round(SIDE_M / _DSM_M), _DSM_M)),
        dom=maps.in_light(canvas.rgb, maps.roofs, maps.canopies, SURVEY_SUN),
        satellite=maps.older_mosaic(leaves),
    )


def _walls(plan: Plan) -> Buildings:
    columns: dict[str, Any] = {"base_m": np.float64, "storey_m": np.float64, "bay_m": np.float64}
    columns |= {"wall_colour": np.uint8, "window_colour": np.uint8, "style": np.uint8}
    return Buildings(
        **{
            name: np.array([getattr(building, name) for building in plan.buildings], kind)
            for name, kind in columns.items()
        }
    )


def _tree_colours(plan: Plan) -> _Rgb:
    """Return the albedo of each tree's canopy, (T, 3)."""
    albedo = np.zeros((len(plan.trees), 3), np.int64)
    bits = hash_of(plan.seed, _TREE_STREAM, np.arange(len(plan.trees))).tolist()
    for index, (tree, draw) in enumerate(zip(plan.trees, bits, strict=True)):
        table = _TREES.get(tree.kind, _BROAD)
        albedo[index] = np.array(table[draw % len(table)]) + ((draw >> 32) % 25 - 12)
    return np.clip(albedo, 0, 255).astype(np.uint8)


def _changed_buildings(plan: Plan) -> tuple[Bools, dict[int, Colour]]:
    """Return which buildings were not there yet, and which roofs had another colour."""
    numbers = np.arange(len(plan.buildings))
    draw = (hash_of(plan.seed, _CHANGES_STREAM, numbers) >> np.uint64(20)).tolist()
    absent, repainted = np.zeros(len(numbers), np.bool_), {}
    for index, building in enumerate(plan.buildings):
        parent = building.parent if building.parent >= 0 else index
        rect = plan.buildings[parent].rect
        absent[index] = draw[parent] % 100 < _ABSENT and rect.long * rect.deep < 500
        if _ABSENT <= draw[index] % 100 < _REPAINTED:
            table = METAL if building.cover == "metal" else TILES
            repainted[index] = table[draw[index] // 128 % len(table)]
    return absent, repainted


def _winter_trees(plan: Plan, albedo: _Rgb) -> tuple[Bools, _Rgb]:
    """Return which trees have lost leaves, and the colours of all."""
    draw = hash_of(plan.seed, _CHANGES_STREAM, 1, np.arange(len(plan.trees)))
    broad = np.array([tree.kind in ("broad", "bush") for tree in plan.trees], np.bool_)
    bare = broad & (draw % np.uint64(100) < 45)
    winter = albedo.astype(np.int64) * 3 // 4 + 14
    brown = albedo.astype(np.int64) // 3 + np.array([84, 68, 46])
    return bare, np.where(bare[:, None], brown, winter).astype(np.uint8)


def _fade(picture: _Rgb) -> _Rgb:
    """Take contrast and colour away, and add a bluish haze."""
    table = np.arange(256)
    curve = np.stack([(table * 205 >> 8) + lift for lift in (22, 24, 32)]).astype(np.int16)
    bands = [curve[channel][picture[..., channel]] for channel in range(3)]
    grey = (bands[0] * 2 + bands[1] * 3 + bands[2]) // 6
    return np.stack([(band * 13 + grey * 3) >> 4 for band in bands], -1).astype(np.uint8)


def _resampled(picture: _Rgb, pixel_m: float, size: int) -> _Rgb:
    """Resample bilinearly to the mosaic's pixels at its offset, and blur by 1-2-1."""
    for offset_m in (-_OFFSET_M[1], _OFFSET_M[0]):  # rows, then columns
        at = ((np.arange(size).astype(np.float64) + 0.5) * _MOSAIC_M + offset_m) / pixel_m - 0.5
        at = np.clip(at, 0.0, len(picture) - 1.0)
        low = np.minimum(np.floor(at).astype(np.int64), len(picture) - 2)
        weight = np.floor((at - low) * 64 + 0.5).astype(np.uint16)[:, None, None]
        wide = picture.astype(np.uint16)
        sharp = wide[low] * (64 - weight) + wide[low + 1] * weight >> 6
        around = np.pad(sharp, ((1, 1), (0, 0), (0, 0)), mode="edge")
        blurred = (around[:-2] + around[2:] + sharp * 2 + 2) >> 2
        picture = blurred.astype(np.uint8).transpose(1, 0, 2)
    return np.ascontiguousarray(picture)


def digest(world: World) -> dict[str, str]:
    """Return the SHA-256 of each array's little-endian bytes, by the array's name."""
    digests = {}
    for name, array in sorted(world.arrays.items()):
        little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        digests[name] = hashlib.sha256(little.data.cast("B")).hexdigest()
    return digests

"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`landscape.randomness`); arithmetic is in integers, or
in the float operations that IEEE 754 rounds alike everywhere (+ - * / and the square root,
elementwise). There are no sums of floats, no matrix products, no sines.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.mini.landscape.building_mesh import building_mesh, joined
from airzoo_bench.mini.landscape.canvas import blank_canvas
from airzoo_bench.mini.landscape.city_plan import city_plan
from airzoo_bench.mini.landscape.land_mesh import apron_mesh, land_at, land_mesh
from airzoo_bench.mini.landscape.noise import Textures, textures
from airzoo_bench.mini.landscape.painters import paint_decals
from airzoo_bench.mini.landscape.palette import OLDER, SURVEY, Palette
from airzoo_bench.mini.landscape.plan import Plan
from airzoo_bench.mini.landscape.rural_plan import rural_plan
from airzoo_bench.mini.landscape.satellite import paint_older
from airzoo_bench.mini.landscape.shapes import Raster
from airzoo_bench.mini.landscape.sunlight import lit, sunlit
from airzoo_bench.mini.landscape.surface import (
    Surface,
    light_on,
    make_surface,
    paint_canopies,
    paint_roofs,
    surface_heights,
    tree_colours,
)
from airzoo_bench.mini.landscape.tree_mesh import tree_mesh
from airzoo_bench.mini.light import SURVEY_SUN
from airzoo_bench.mini.world import REGIONS, Buildings, Mesh, World

__all__ = ["DEFAULT_SEED", "build_world", "digest", "expected_digest"]

# The seed of the benchmark AirZoo-Mini, whose digests are in checksums.json.
DEFAULT_SEED = 0
_CHECKSUMS = Path(__file__).with_name("checksums.json")

_PLANS = {"city": city_plan, "rural": rural_plan}
_MAP_M, _DSM_M = 0.25, 0.5


@dataclass(frozen=True, eq=False)
class _Scene:
    """What both maps of a region are made from."""

    plan: Plan
    mesh: Mesh
    surface: Surface
    raster: Raster
    textures: Textures
    land: NDArray[np.float32]


def build_world(region: str, seed: int) -> World:
    """Make one region.

    Parameters
    ----------
    region : str
        A name of `world.REGIONS`.
    seed : int
        Another seed makes another place of the same kind; at least 0.

    Returns
    -------
    World

    Raises
    ------
    UsageError
        There is no such region, or the seed is negative.
    """
    if region not in _PLANS:
        raise UsageError(
            "unknown region", where=region, expected=f"one of {', '.join(sorted(REGIONS))}"
        )
    if seed < 0:
        raise UsageError("the seed is negative", where=f"seed {seed}", expected="0 or more")
    scene = _scene(region, seed)
    colours = tree_colours(scene.plan)
    ground, water = _ground(scene, SURVEY)
    top = _top(scene, ground, colours)
    side = REGIONS[region].side_m
    return World(
        region=REGIONS[region],
        seed=seed,
        mesh=scene.mesh,
        buildings=_walls(scene.plan),
        tree_colours=colours,
        ground_albedo=ground,
        top_albedo=top,
        water=water,
        dsm=surface_heights(scene.mesh, scene.plan.heights, Raster(round(side / _DSM_M), _DSM_M)),
        dom=_orthophoto(scene, top),
        satellite=_satellite(scene, colours),
    )


def _scene(region: str, seed: int) -> _Scene:
    side = REGIONS[region].side_m
    plan = _PLANS[region](seed, side)
    raster = Raster(round(side / _MAP_M), _MAP_M)
    under = np.array([plan.height(tree.x, tree.y) for tree in plan.trees])
    mesh = joined(
        [
            land_mesh(plan.heights),
            building_mesh(plan.buildings),
            tree_mesh(plan.trees, under, seed),
            apron_mesh(plan.heights),
        ]
    )
    land = land_at(plan.heights, raster.size, raster.pixel_m).astype(np.float32)
    surface = make_surface(mesh, raster)
    return _Scene(plan, mesh, surface, raster, textures(seed, raster.size), land)


def _ground(scene: _Scene, palette: Palette) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Paint the ground of a season; water is where it was painted last."""
    plan = scene.plan
    canvas = blank_canvas(scene.raster, scene.textures, palette, plan.divide, scene.land, plan.seed)
    paint_decals(canvas, plan.decals)
    return canvas.rgb, canvas.water


def _top(scene: _Scene, ground: NDArray[np.uint8], colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    plan = scene.plan
    canvas = blank_canvas(scene.raster, scene.textures, SURVEY, (), scene.land, plan.seed)
    canvas.rgb[:] = ground
    paint_roofs(canvas, plan, scene.mesh, scene.surface, {})
    paint_canopies(canvas.rgb, scene.mesh, scene.surface, colours, scene.textures)
    return canvas.rgb


def _orthophoto(scene: _Scene, top: NDArray[np.uint8]) -> NDArray[np.uint8]:
    surface = scene.surface
    heights = np.maximum(np.maximum(surface.roof_m, surface.canopy_m), scene.land)
    visible = sunlit(heights, SURVEY_SUN, scene.raster.pixel_m)
    cosine = light_on(scene.mesh, surface, scene.plan.heights, None, SURVEY_SUN)
    return lit(top, cosine, visible, SURVEY_SUN)


def _satellite(scene: _Scene, colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    plan = scene.plan
    canvas = blank_canvas(scene.raster, scene.textures, OLDER, plan.divide, scene.land, plan.seed)
    paint_decals(canvas, plan.decals)
    return paint_older(canvas, plan, scene.mesh, scene.surface, colours)


def _walls(plan: Plan) -> Buildings:
    buildings = plan.buildings

    def column(name: str, dtype: type) -> NDArray[Any]:
        return np.array([getattr(building, name) for building in buildings], dtype)

    return Buildings(
        wall_colour=column("wall_colour", np.uint8),
        window_colour=column("window_colour", np.uint8),
        base_m=column("base_m", np.float64),
        storey_m=column("storey_m", np.float64),
        bay_m=column("bay_m", np.float64),
        style=column("style", np.uint8),
    )


def digest(world: World) -> dict[str, str]:
    """Return the SHA-256 of each array's little-endian bytes, by the array's name.

    Parameters
    ----------
    world : World
    """
    arrays = {f"mesh.{name}": array for name, array in vars(world.mesh).items()}
    arrays |= {f"buildings.{name}": array for name, array in vars(world.buildings).items()}
    arrays |= {k: v for k, v in vars(world).items() if isinstance(v, np.ndarray)}
    return {name: _sha256(array) for name, array in sorted(arrays.items())}


def expected_digest(region: str) -> dict[str, str]:
    """Return the digest that a region of `DEFAULT_SEED` has on every machine.

    Parameters
    ----------
    region : str
    """
    expected: dict[str, str] = json.loads(_CHECKSUMS.read_text("utf-8"))[region]
    return expected


def _sha256(array: NDArray[np.generic]) -> str:
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return hashlib.sha256(little.data.cast("B")).hexdigest()

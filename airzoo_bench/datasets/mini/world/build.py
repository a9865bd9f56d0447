"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`noise`); arithmetic is in integers, or in the float
operations that IEEE 754 rounds alike everywhere (+ - * / and the square root, elementwise). There
are no sums of floats, no matrix products, no sines.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.world.canvas import SURVEY
from airzoo_bench.datasets.mini.world.city_plan import city_plan
from airzoo_bench.datasets.mini.world.maps import in_light, older_mosaic
from airzoo_bench.datasets.mini.world.meshes import building_mesh, tree_mesh
from airzoo_bench.datasets.mini.world.model import (
    REGIONS,
    SIDE_M,
    SURVEY_SUN,
    Buildings,
    Mesh,
    World,
)
from airzoo_bench.datasets.mini.world.painters import paint_decals
from airzoo_bench.datasets.mini.world.plan import Plan
from airzoo_bench.datasets.mini.world.rural_plan import rural_plan
from airzoo_bench.datasets.mini.world.shapes import Raster
from airzoo_bench.datasets.mini.world.surface import Surface, surface_heights, tree_colours
from airzoo_bench.datasets.mini.world.terrain import apron_mesh, land_mesh

__all__ = ["build_world", "digest"]

_PLANS = {"city": city_plan, "rural": rural_plan}
_MAP_M, _DSM_M = 0.25, 0.5


def build_world(region: str, seed: int) -> World:
    """Make one region of `model.REGIONS`; another seed makes another place of the same kind.

    Raises
    ------
    UsageError
        There is no such region, or the seed is negative.
    """
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
        dom=in_light(surface, canvas.rgb, SURVEY_SUN),
        satellite=older_mosaic(surface, canopies),
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

"""The meshed plan as rasters: what is on top of each pixel, and its albedo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.landscape.canvas import Canvas
from airzoo_bench.mini.landscape.from_above import NOTHING, seen_from_above, sun_cosine
from airzoo_bench.mini.landscape.land_mesh import land_at, land_light
from airzoo_bench.mini.landscape.noise import Textures
from airzoo_bench.mini.landscape.plan import Plan
from airzoo_bench.mini.landscape.randomness import hash_of
from airzoo_bench.mini.landscape.roofs import paint_roof
from airzoo_bench.mini.landscape.shapes import Raster
from airzoo_bench.mini.light import Light
from airzoo_bench.mini.world import Material, Mesh

__all__ = [
    "Surface",
    "make_surface",
    "paint_canopies",
    "paint_roofs",
    "surface_heights",
    "tree_colours",
]

_STREAM = 51
_BROAD = ((78, 108, 44), (92, 122, 50), (64, 94, 42), (104, 128, 58), (84, 112, 56), (116, 126, 54))
_FIXED = {"cone": ((50, 80, 46), (58, 88, 52)), "bale": ((206, 180, 118), (214, 190, 130))}


@dataclass(frozen=True, eq=False)
class Surface:
    """What a map sees, each (n, n).

    Attributes
    ----------
    roof_m, canopy_m : float32
        Heights; `NOTHING` where there is none.
    roof, canopy : int32
        Triangles; -1 where there is none.
    """

    roof_m: NDArray[np.float32]
    roof: NDArray[np.int32]
    canopy_m: NDArray[np.float32]
    canopy: NDArray[np.int32]


def make_surface(mesh: Mesh, raster: Raster) -> Surface:
    """Look at buildings and at trees from above."""
    roofs = seen_from_above(mesh, raster, mesh.material == Material.ROOF)
    trees = seen_from_above(mesh, raster, mesh.material == Material.CANOPY)
    return Surface(
        roofs.height.astype(np.float32),
        roofs.triangle,
        trees.height.astype(np.float32),
        trees.triangle,
    )


def surface_heights(mesh: Mesh, heights: Floats, raster: Raster) -> NDArray[np.float32]:
    """Return the height of the highest surface at the pixel centres, in float64 until the end."""
    solid = (mesh.material == Material.ROOF) | (mesh.material == Material.CANOPY)
    top = seen_from_above(mesh, raster, solid).height
    land = land_at(heights, raster.size, raster.pixel_m)
    return np.asarray(np.maximum(top, land).astype(np.float32))


def owners(mesh: Mesh, triangle: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the building or tree of each pixel, -1 for none."""
    return np.where(triangle >= 0, mesh.owner[triangle], np.int32(-1)).astype(np.int32)


def light_on(
    mesh: Mesh, surface: Surface, heights: Floats, hidden: Bools | None, light: Light
) -> NDArray[np.float32]:
    """Return the cosine to the sun of what is on top.

    Parameters
    ----------
    mesh, surface
    heights : (k + 1, k + 1) float64
        Of the land.
    hidden : (n, n) bool, optional
        Where canopies are not there.
    light : Light
    """
    cosine = land_light(heights, light.direction, surface.roof.shape[0])
    of_triangle = sun_cosine(mesh, light.direction)
    for triangle in (surface.roof, _visible(surface, hidden)):
        there = triangle >= 0
        cosine[there] = of_triangle[triangle[there]]
    return cosine


def _visible(surface: Surface, hidden: Bools | None) -> NDArray[np.int32]:
    canopy = np.where(surface.canopy_m > surface.roof_m, surface.canopy, np.int32(-1))
    return canopy if hidden is None else np.where(hidden, np.int32(-1), canopy)


def tree_colours(plan: Plan) -> NDArray[np.uint8]:
    """Return the albedo of each tree's canopy, (T, 3)."""
    colours = np.zeros((len(plan.trees), 3), np.int64)
    bits = hash_of(plan.seed, _STREAM, np.arange(len(plan.trees)))
    for index, tree in enumerate(plan.trees):
        table = _FIXED.get(tree.kind, _BROAD)
        draw = int(bits[index])
        tone = (draw >> 32) % 25 - 12
        colours[index] = [part + tone for part in table[draw % len(table)]]
    return np.clip(colours, 0, 255).astype(np.uint8)


def paint_roofs(
    canvas: Canvas,
    plan: Plan,
    mesh: Mesh,
    surface: Surface,
    colours: dict[int, tuple[int, int, int]],
) -> None:
    """Paint all roofs; `colours` are those of buildings that are not painted as planned."""
    owner = owners(mesh, surface.roof)
    for index, building in enumerate(plan.buildings):
        paint_roof(canvas, building, index, owner, colours.get(index, building.roof_colour))


def paint_canopies(
    rgb: NDArray[np.uint8],
    mesh: Mesh,
    surface: Surface,
    colours: NDArray[np.uint8],
    textures: Textures,
    hidden: Bools | None = None,
) -> None:
    """Paint canopies with their leaves, darker towards the rim, in place."""
    canopy = _visible(surface, hidden)
    there = canopy >= 0
    owner = mesh.owner[canopy[there]]
    leaves = (
        textures.fine[there].astype(np.int32) * 40 + textures.middle[there].astype(np.int32) * 14
    )
    depth = _below_top(mesh, surface.canopy_m[there], owner)
    light = (leaves >> 6) - (depth * 34).astype(np.int32)
    values = colours[owner].astype(np.int32) + ((light[:, None] * np.array([8, 8, 6])) >> 3)
    rgb[there] = np.clip(values, 0, 255).astype(np.uint8)


def _below_top(
    mesh: Mesh, height: NDArray[np.float32], owner: NDArray[np.int32]
) -> NDArray[np.float32]:
    """How far below its canopy's top a pixel is, as a share of the canopy's height."""
    is_canopy = mesh.material == Material.CANOPY
    count = int(mesh.owner[is_canopy].max(initial=-1)) + 1
    top = np.full(count, NOTHING)
    bottom = np.full(count, -NOTHING)
    for corner in range(3):
        z = mesh.vertices[mesh.triangles[is_canopy, corner], 2]
        np.maximum.at(top, mesh.owner[is_canopy], z)
        np.minimum.at(bottom, mesh.owner[is_canopy], z)
    depth = (top[owner] - height) / np.maximum(top - bottom, 0.1)[owner]
    return np.asarray(depth.astype(np.float32))

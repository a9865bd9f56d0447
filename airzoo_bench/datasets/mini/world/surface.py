"""The world as rasters: which triangle is on top of each pixel, how high, and in what colour."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Textures, hash_of, textures
from airzoo_bench.datasets.mini.world.canvas import Canvas, Palette
from airzoo_bench.datasets.mini.world.model import Light, Material, Mesh
from airzoo_bench.datasets.mini.world.plan import Colour, Plan, colours
from airzoo_bench.datasets.mini.world.roofs import paint_roof
from airzoo_bench.datasets.mini.world.shapes import Raster
from airzoo_bench.datasets.mini.world.terrain import land_at, land_cosine
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["Layer", "Surface", "surface_heights", "tree_colours"]

_STREAM = 51
_NOTHING = -1_000.0
_BLOCK = 1 << 20
_TREES = {
    "cone": colours("32502e 3a5834"),
    "bale": colours("ceb476 d6be82"),
    "broad": colours("4e6c2c 5c7a32 405e2a 68803a 547038 747e36"),
}


@dataclass(frozen=True, eq=False)
class Layer:
    """The topmost surface of one material at each pixel; arrays are (n, n)."""

    height: NDArray[np.float32]  # `_NOTHING` where there is none
    triangle: NDArray[np.int32]  # -1 where there is none
    owner: NDArray[np.int32]

    @classmethod
    def of(cls, mesh: Mesh, raster: Raster, material: Material) -> Layer:
        """Look at the triangles of a material from above."""
        height, triangle = _seen_from_above(mesh, raster, mesh.material == material)
        owner = np.where(triangle >= 0, mesh.owner[triangle], np.int32(-1))
        return cls(height.astype(np.float32), triangle, owner)

    def without(self, hidden: Bools) -> Layer:
        """Return the layer with nothing at some pixels."""
        gone = np.int32(-1)
        return Layer(
            np.where(hidden, np.float32(_NOTHING), self.height),
            np.where(hidden, gone, self.triangle),
            np.where(hidden, gone, self.owner),
        )


@dataclass(frozen=True, eq=False)
class Surface:
    """A meshed plan as a map sees it."""

    plan: Plan
    mesh: Mesh
    raster: Raster  # of n pixels a side
    textures: Textures
    land: NDArray[np.float32]  # (n, n): its heights
    roofs: Layer
    canopies: Layer

    @classmethod
    def of(cls, plan: Plan, mesh: Mesh, raster: Raster) -> Surface:
        """Look at a world from above."""
        layers = (Layer.of(mesh, raster, kind) for kind in (Material.ROOF, Material.CANOPY))
        land = land_at(plan.heights, raster).astype(np.float32)
        return cls(plan, mesh, raster, textures(plan.seed, raster.size), land, *layers)

    @property
    def heights(self) -> NDArray[np.float32]:
        """Heights (n, n) of what is on top."""
        return np.maximum(np.maximum(self.roofs.height, self.canopies.height), self.land)

    @property
    def on_top(self) -> NDArray[np.int32]:
        """Triangles of canopies where no roof is above them, -1 elsewhere, (n, n)."""
        above = self.canopies.height > self.roofs.height
        return np.where(above, self.canopies.triangle, np.int32(-1))

    def canvas(self, palette: Palette) -> Canvas:
        """Return a black canvas of a season."""
        return Canvas(self.plan, self.raster, self.textures, self.land, palette)

    def cosine(self, light: Light) -> NDArray[np.float32]:
        """Return the cosine to the sun of what is on top, at least 0, (n, n)."""
        cosine = land_cosine(self.plan.heights, light.direction, self.raster.size)
        x, y, z = _normals(self.mesh.vertices[self.mesh.triangles]).T
        length = np.sqrt(x * x + y * y + z * z)
        along = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
        of_triangle = np.maximum(along / np.maximum(length, 1e-12), 0.0).astype(np.float32)
        for triangle in (self.roofs.triangle, self.on_top):
            there = triangle >= 0
            cosine[there] = of_triangle[triangle[there]]
        return cosine

    def paint_roofs(self, canvas: Canvas, repainted: dict[int, Colour]) -> None:
        """Paint all roofs; `repainted` are colours of buildings that differ from the plan's."""
        for index, building in enumerate(self.plan.buildings):
            colour = repainted.get(index, building.roof_colour)
            paint_roof(canvas, building, index, self.roofs.owner, colour)

    def paint_canopies(self, canvas: Canvas, albedo: NDArray[np.uint8]) -> None:
        """Paint canopies of albedo (trees, 3) with their leaves, darker towards the rim."""
        triangle = self.on_top
        there = triangle >= 0
        owner = self.mesh.owner[triangle[there]]
        leaves = self.textures.fine[there].astype(np.int32) * 40
        leaves += self.textures.middle[there].astype(np.int32) * 14
        light = (leaves >> 6) - (self._below_top(there, owner) * 34).astype(np.int32)
        values = albedo[owner].astype(np.int32) + ((light[:, None] * np.array([8, 8, 6])) >> 3)
        canvas.rgb[there] = np.clip(values, 0, 255).astype(np.uint8)

    def _below_top(self, there: Bools, owner: NDArray[np.int32]) -> NDArray[np.float32]:
        """How far below its canopy's top a pixel is, as a share of the canopy's height."""
        chosen = self.mesh.material == Material.CANOPY
        top = np.full(len(self.plan.trees), _NOTHING)
        bottom = -top
        for corner in range(3):
            z = self.mesh.vertices[self.mesh.triangles[chosen, corner], 2]
            np.maximum.at(top, self.mesh.owner[chosen], z)
            np.minimum.at(bottom, self.mesh.owner[chosen], z)
        below = top[owner] - self.canopies.height[there]
        return np.asarray((below / np.maximum(top - bottom, 0.1)[owner]).astype(np.float32))


def surface_heights(mesh: Mesh, land: Floats, raster: Raster) -> NDArray[np.float32]:
    """Return the height of the highest surface at the pixel centres, in float64 until the end."""
    solid = (mesh.material == Material.ROOF) | (mesh.material == Material.CANOPY)
    top, _ = _seen_from_above(mesh, raster, solid)
    return np.asarray(np.maximum(top, land_at(land, raster)).astype(np.float32))


def tree_colours(plan: Plan) -> NDArray[np.uint8]:
    """Return the albedo of each tree's canopy, (T, 3)."""
    albedo = np.zeros((len(plan.trees), 3), np.int64)
    bits = hash_of(plan.seed, _STREAM, np.arange(len(plan.trees))).tolist()
    for index, (tree, draw) in enumerate(zip(plan.trees, bits, strict=True)):
        table = _TREES.get(tree.kind, _TREES["broad"])
        tone = (draw >> 32) % 25 - 12
        albedo[index] = [part + tone for part in table[draw % len(table)]]
    return np.clip(albedo, 0, 255).astype(np.uint8)


def _seen_from_above(mesh: Mesh, raster: Raster, chosen: Bools) -> tuple[Floats, NDArray[np.int32]]:
    """Return height and number of the highest of the chosen triangles at each pixel centre."""
    numbers = np.flatnonzero(chosen)
    corners = mesh.vertices[mesh.triangles[numbers]]
    normal = _normals(corners)
    up = normal[:, 2] > 1e-9
    numbers, corners, normal = numbers[up], corners[up], normal[up]
    slope = -normal[:, :2] / normal[:, 2:]
    height = np.full(raster.size * raster.size, _NOTHING)
    triangle = np.full(raster.size * raster.size, -1, np.int32)
    for which, pixel, x, y in _candidates(corners, raster):
        inside = _inside(corners[which], x, y)
        which, pixel, x, y = which[inside], pixel[inside], x[inside], y[inside]
        first = corners[which, 0]
        z = first[:, 2] + slope[which, 0] * (x - first[:, 0]) + slope[which, 1] * (y - first[:, 1])
        np.maximum.at(height, pixel, z)
        best = z == height[pixel]
        triangle[pixel[best]] = numbers[which[best]]
    shape = (raster.size, raster.size)
    return height.reshape(shape), triangle.reshape(shape)


def _normals(corners: Floats) -> Floats:
    # Not np.cross, whose order of operations is not promised.
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    return np.stack([x, y, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], 1)


def _candidates(
    corners: Floats, raster: Raster
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]]:
    """Yield pairs of triangle and pixel whose boxes meet, in blocks of bounded size."""
    size, pixel = raster.size, raster.pixel_m
    low, high = corners[..., :2].min(axis=1) / pixel, corners[..., :2].max(axis=1) / pixel
    first = np.maximum(np.ceil(low - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(high - 0.5), size - 1).astype(np.int64)
    wide, tall = np.maximum(last - first + 1, 0).T
    counts = wide * tall
    ends = np.cumsum(counts)
    start = 0
    while start < len(counts):
        done = int(ends[start - 1]) if start else 0
        stop = max(int(np.searchsorted(ends, done + _BLOCK, side="right")), start + 1)
        which = np.repeat(np.arange(start, stop), counts[start:stop])
        place = np.arange(len(which)) - (ends[which] - counts[which] - done)
        north, east = np.divmod(place, np.maximum(wide[which], 1))
        column, row = first[which, 0] + east, first[which, 1] + north
        x, y = (column + 0.5) * pixel, (row + 0.5) * pixel
        yield which, (size - 1 - row) * size + column, x, y
        start = stop


def _inside(corners: Floats, x: Floats, y: Floats) -> Bools:
    inside = np.ones(x.shape, np.bool_)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        x0, y0 = corners[:, i, 0], corners[:, i, 1]
        x1, y1 = corners[:, j, 0], corners[:, j, 1]
        inside &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= -1e-9
    return inside

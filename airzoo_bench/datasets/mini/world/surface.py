"""The world as rasters: which triangle is on top of each pixel, how high, and in what light."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.world.model import Light, Material, Mesh
from airzoo_bench.datasets.mini.world.plan import GRID_M
from airzoo_bench.datasets.mini.world.shapes import Raster
from airzoo_bench.geometry.arrays import Bools, Floats

_Indices = NDArray[np.int64]

_NOTHING = -1_000.0
_BLOCK = 1 << 20
# Heights of shadows are in integers of this many to the metre.
_UNITS = 1024
_BIAS, _SOFT = 200, 512
_FAR_STEPS = 512


class Layer(NamedTuple):
    """The topmost surface of one material at each pixel; arrays are (n, n)."""

    height: NDArray[np.float32]  # `_NOTHING` where there is none
    triangle: NDArray[np.int32]  # -1 where there is none
    owner: NDArray[np.int32]

    @classmethod
    def from_mesh(cls, mesh: Mesh, raster: Raster, material: Material) -> Layer:
        """Look at the triangles of a material from above."""
        height, triangle = _look_down(mesh, raster, mesh.material == material)
        owner = np.where(triangle >= 0, mesh.owner[triangle], np.int32(-1))
        return cls(height.astype(np.float32), triangle, owner)

    def without(self, owners: Bools, where: Bools | bool = True) -> Layer:
        """Return the layer without some owners, given as a mask of all, at pixels `where`."""
        hidden = (self.owner >= 0) & owners[self.owner] & where
        blank = np.float32(_NOTHING), np.int32(-1), np.int32(-1)
        return Layer(*(np.where(hidden, b, part) for b, part in zip(blank, self, strict=True)))


def canopies_on_top(roofs: Layer, canopies: Layer) -> NDArray[np.int32]:
    """Return triangles of canopies where no roof is above them, -1 elsewhere, (n, n)."""
    return np.where(canopies.height > roofs.height, canopies.triangle, np.int32(-1))


def share_below_top(
    mesh: Mesh, canopies: Layer, there: Bools, owner: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return how far below its canopy's top a pixel is, as a share of the canopy's height."""
    chosen = mesh.material == Material.CANOPY
    top = np.full(int(mesh.owner[chosen].max(initial=-1)) + 1, _NOTHING)
    bottom = -top
    for corner in range(3):
        z = mesh.vertices[mesh.triangles[chosen, corner], 2]
        np.maximum.at(top, mesh.owner[chosen], z)
        np.minimum.at(bottom, mesh.owner[chosen], z)
    below = top[owner] - canopies.height[there]
    return np.asarray((below / np.maximum(top - bottom, 0.1)[owner]).astype(np.float32))


def surface_heights(mesh: Mesh, land: Floats, raster: Raster) -> NDArray[np.float32]:
    """Return the height of the highest surface at the pixel centres, in float64 until the end."""
    solid = (mesh.material == Material.ROOF) | (mesh.material == Material.CANOPY)
    top, _ = _look_down(mesh, raster, solid)
    return np.asarray(np.maximum(top, land_at(land, raster)).astype(np.float32))


def _look_down(mesh: Mesh, raster: Raster, chosen: Bools) -> tuple[Floats, NDArray[np.int32]]:
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
) -> Iterator[tuple[_Indices, _Indices, Floats, Floats]]:
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


def land_at(heights: Floats, raster: Raster) -> Floats:
    """Return the height of the land's triangles at the pixel centres, first row in the north."""
    per_cell = round(GRID_M / raster.pixel_m)
    step = (np.arange(per_cell) + 0.5) / per_cell
    east, north = step[None, None, None, :], step[None, :, None, None]
    z00, z10 = heights[:-1, :-1][:, None, :, None], heights[:-1, 1:][:, None, :, None]
    z01, z11 = heights[1:, :-1][:, None, :, None], heights[1:, 1:][:, None, :, None]
    lower = z00 + east * (z10 - z00) + north * (z11 - z10)
    upper = z00 + north * (z01 - z00) + east * (z11 - z01)
    cells = np.where(east >= north, lower, upper)
    return np.ascontiguousarray(cells.reshape(raster.size, raster.size)[::-1])


def sun_cosine(
    mesh: Mesh, land: Floats, light: Light, raster: Raster, *on_top: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return the cosine to the sun, at least 0, of the land and of triangles (n, n) on it."""
    cosine = _land_cosine(land, light.direction, raster.size)
    x, y, z = _normals(mesh.vertices[mesh.triangles]).T
    length = np.sqrt(x * x + y * y + z * z)
    along = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
    of_triangle = np.maximum(along / np.maximum(length, 1e-12), 0.0).astype(np.float32)
    for triangle in on_top:
        there = triangle >= 0
        cosine[there] = of_triangle[triangle[there]]
    return cosine


def _land_cosine(
    heights: Floats, sun: tuple[float, float, float], size: int
) -> NDArray[np.float32]:
    south, north = heights[:-1], heights[1:]
    lower = _slope_cosine(south[:, 1:] - south[:, :-1], north[:, 1:] - south[:, 1:], sun)
    upper = _slope_cosine(north[:, 1:] - north[:, :-1], north[:, :-1] - south[:, :-1], sun)
    step = np.arange(size // len(south))
    below = (step[None, :] >= step[:, None])[None, :, None, :]
    cosine = np.where(below, lower[:, None, :, None], upper[:, None, :, None])
    return np.ascontiguousarray(cosine.reshape(size, size)[::-1])


def _slope_cosine(
    rise_x: Floats, rise_y: Floats, sun: tuple[float, float, float]
) -> NDArray[np.float32]:
    slope_x, slope_y = rise_x / GRID_M, rise_y / GRID_M
    along = sun[2] - slope_x * sun[0] - slope_y * sun[1]
    length = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return np.asarray(np.maximum(along / length, 0.0).astype(np.float32))


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

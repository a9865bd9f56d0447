"""A mesh as rasters: which triangle is on top of each pixel, how high, and in what light.

Arithmetic is in the order that gives the same bits on every machine, see `build`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.model import Light, Material, Mesh
from airzoo_bench.datasets.mini.plan import GRID_M
from airzoo_bench.datasets.mini.shapes import Raster
from airzoo_bench.geometry.arrays import Bools, Floats

_Indices = NDArray[np.int64]
_Singles = NDArray[np.float32]

_NOTHING = -1_000.0
_BLOCK = 256  # triangles worked on at once
# Heights of shadows are in integers of this many to the metre.
_UNITS = 1024
_BIAS, _SOFT = 200, 512
_FAR_STEPS = 512


class Layer(NamedTuple):
    """The topmost surface of one material at each pixel; arrays are (n, n)."""

    height: _Singles  # `_NOTHING` where there is none
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


def share_below_top(mesh: Mesh, owner: NDArray[np.int32], height: _Singles) -> _Singles:
    """Return how far points are below the top of their canopy, as a share of its height."""
    chosen = mesh.material == Material.CANOPY
    owners = mesh.owner[chosen]
    top = np.full(int(owners.max(initial=-1)) + 1, _NOTHING)
    bottom = -top
    for corner in range(3):
        z = mesh.vertices[mesh.triangles[chosen, corner], 2]
        np.maximum.at(top, owners, z)
        np.minimum.at(bottom, owners, z)
    share = (top[owner] - height) / np.maximum(top - bottom, 0.1)[owner]
    return np.asarray(share.astype(np.float32))


def surface_heights(mesh: Mesh, land: Floats, raster: Raster) -> _Singles:
    """Return the height of the highest surface at the pixel centres, in float64 until the end."""
    top, _ = _look_down(mesh, raster, np.isin(mesh.material, (Material.ROOF, Material.CANOPY)))
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
    for start in range(0, len(numbers), _BLOCK):
        part = corners[start : start + _BLOCK]
        which, column, row = _pixels_in_boxes(part, raster)
        x, y = (np.asarray((at + 0.5) * raster.pixel_m, np.float64) for at in (column, row))
        inside = _inside(part[which], x, y)
        which, x, y = which[inside], x[inside], y[inside]
        pixel = ((raster.size - 1 - row) * raster.size + column)[inside]
        rise, first = slope[start + which], part[which, 0]
        z = first[:, 2] + rise[:, 0] * (x - first[:, 0]) + rise[:, 1] * (y - first[:, 1])
        np.maximum.at(height, pixel, z)
        best = z == height[pixel]
        triangle[pixel[best]] = numbers[start + which[best]]
    shape = (raster.size, raster.size)
    return height.reshape(shape), triangle.reshape(shape)


def _normals(corners: Floats) -> Floats:
    # Not np.cross, whose order of operations is not promised.
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    return np.stack([x, y, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], 1)


def _pixels_in_boxes(corners: Floats, raster: Raster) -> tuple[_Indices, _Indices, _Indices]:
    """Return pairs of triangle and pixel (column, and row from the south) whose boxes meet."""
    places = corners[..., :2] / raster.pixel_m
    first = np.maximum(np.ceil(places.min(axis=1) - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(places.max(axis=1) - 0.5), raster.size - 1).astype(np.int64)
    wide, tall = np.maximum(last - first + 1, 0).T
    counts = wide * tall
    which = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(which)) - (np.cumsum(counts) - counts)[which]
    north, east = np.divmod(place, np.maximum(wide, 1)[which])
    return which, first[which, 0] + east, first[which, 1] + north


def _inside(corners: Floats, x: Floats, y: Floats) -> Bools:
    inside = np.ones(x.shape, np.bool_)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        x0, y0 = corners[:, i, 0], corners[:, i, 1]
        x1, y1 = corners[:, j, 0], corners[:, j, 1]
        inside &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= -1e-9
    return inside


def _rises(heights: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return how land rises to the east and north in the lower, then upper triangle of cells."""
    east, north = heights[:, 1:] - heights[:, :-1], heights[1:] - heights[:-1]
    return east[:-1], north[:, 1:], east[1:], north[:, :-1]


def _spread(lower: NDArray[Any], upper: NDArray[Any], size: int) -> NDArray[Any]:
    """Lay values of both triangles of cells (n, k or 1, n, k or 1) out as a map (size, size)."""
    step = np.arange(size // lower.shape[0])
    below = (step[None, :] >= step[:, None])[None, :, None, :]
    return np.ascontiguousarray(np.where(below, lower, upper).reshape(size, size)[::-1])


def land_at(heights: Floats, raster: Raster) -> Floats:
    """Return the height of the land's triangles at the pixel centres, first row in the north."""
    per_cell = round(GRID_M / raster.pixel_m)
    step = (np.arange(per_cell) + 0.5) / per_cell
    east, north = step[None, None, None, :], step[None, :, None, None]
    base = heights[:-1, :-1][:, None, :, None]
    lower_x, lower_y, upper_x, upper_y = (rise[:, None, :, None] for rise in _rises(heights))
    lower, upper = base + east * lower_x + north * lower_y, base + north * upper_y + east * upper_x
    return _spread(lower, upper, raster.size)


def sun_cosine(
    mesh: Mesh, land: Floats, light: Light, raster: Raster, *on_top: NDArray[np.int32]
) -> _Singles:
    """Return the cosine to the sun, at least 0, of the land and of triangles (n, n) on it."""
    lower_x, lower_y, upper_x, upper_y = _rises(land)
    lower, upper = (
        _slope_cosine(x, y, light.direction)[:, None, :, None]
        for x, y in ((lower_x, lower_y), (upper_x, upper_y))
    )
    cosine = _spread(lower, upper, raster.size)
    x, y, z = _normals(mesh.vertices[mesh.triangles]).T
    length = np.sqrt(x * x + y * y + z * z)
    along = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
    of_triangle = np.maximum(along / np.maximum(length, 1e-12), 0.0).astype(np.float32)
    for triangle in on_top:
        there = triangle >= 0
        cosine[there] = of_triangle[triangle[there]]
    return cosine


def _slope_cosine(rise_x: Floats, rise_y: Floats, sun: tuple[float, float, float]) -> _Singles:
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
    albedo: NDArray[np.uint8], cosine: _Singles, visible: NDArray[np.uint8], light: Light
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

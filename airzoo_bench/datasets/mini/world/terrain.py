"""The land: heights at the corners of a grid, as triangles, and on rasters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import octaves
from airzoo_bench.datasets.mini.world.model import SIDE_M, Material, Mesh
from airzoo_bench.datasets.mini.world.shapes import Raster
from airzoo_bench.geometry.arrays import Floats

__all__ = [
    "GRID_M",
    "LAND_X",
    "LAND_Y",
    "apron_mesh",
    "blended",
    "land_at",
    "land_cosine",
    "land_mesh",
    "rolling",
    "smooth_share",
]

_Indices = NDArray[np.int64]

GRID_M = 2.0
"""Spacing of the grid on whose corners the land's heights are given."""

LAND_X: Floats = np.arange(round(SIDE_M / GRID_M) + 1).astype(np.float64)[None, :] * GRID_M
LAND_Y: Floats = LAND_X.T

# Distances of the apron's corners beyond the border, in steps of the grid, to 800 m.
_BEYOND = np.array([0, 2, 5, 10, 18, 30, 45, 65, 90, 120, 160, 205, 255, 325, 400])


def rolling(seed: int, stream: int, cells: dict[int, int], relief_m: float) -> Floats:
    """Return smooth hills about zero on the land's grid, most within half of `relief_m`."""
    return octaves(seed, stream, LAND_X.size, cells).astype(np.float64) * (relief_m / 4096)


def smooth_share(away: Floats, near: float, far: float) -> Floats:
    """Return 0 up to a distance `near`, 1 from `far` on, and smoothly between."""
    share = np.clip((away - near) / (far - near), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def blended(
    heights: Floats, away: Floats, level: Floats | float, near: float, far: float
) -> Floats:
    """Return heights that are `level` up to a distance `near`, and as they were from `far` on."""
    share = smooth_share(away, near, far)
    return heights * share + level * (1.0 - share)


def land_mesh(heights: Floats) -> Mesh:
    """Mesh the land inside the region; each cell is cut from south-west to north-east."""
    index = np.arange(heights.shape[0])
    return _grid(index, index, heights, Material.GROUND)


def apron_mesh(heights: Floats) -> Mesh:
    """Mesh the land beyond the region: that inside, mirrored at the border, in coarse triangles."""
    inside = np.arange(heights.shape[0])
    west, east = -_BEYOND[::-1], heights.shape[0] - 1 + _BEYOND
    strips = [(inside, west), (inside, east), (west, inside), (east, inside)]
    corners = [(a, b) for a in (west, east) for b in (west, east)]
    return Mesh.joined([_grid(x, y, heights, Material.APRON) for x, y in strips + corners])


def _grid(columns: _Indices, rows: _Indices, heights: Floats, material: Material) -> Mesh:
    mirrored = (_mirrored(index, heights.shape[0] - 1) for index in (rows, columns))
    z = heights[np.ix_(*mirrored)]
    x, y = np.meshgrid(columns * GRID_M, rows * GRID_M)
    wide = len(columns)
    first = (np.arange(len(rows) - 1)[:, None] * wide + np.arange(wide - 1)[None, :]).ravel()
    lower = np.stack([first, first + 1, first + wide + 1], 1)
    upper = np.stack([first, first + wide + 1, first + wide], 1)
    triangles = np.concatenate([lower, upper]).astype(np.int32)
    return Mesh(
        np.stack([x.ravel(), y.ravel(), z.ravel()], 1),
        triangles,
        np.full(len(triangles), material, np.uint8),
        np.full(len(triangles), -1, np.int32),
    )


def _mirrored(index: _Indices, last: int) -> _Indices:
    index = np.abs(index) % (2 * last)
    return np.minimum(index, 2 * last - index)


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


def land_cosine(heights: Floats, sun: tuple[float, float, float], size: int) -> NDArray[np.float32]:
    """Return the cosine between the land's triangles and the sun, at least 0; (size, size)."""
    south, north = heights[:-1], heights[1:]
    lower = _cosine(south[:, 1:] - south[:, :-1], north[:, 1:] - south[:, 1:], sun)
    upper = _cosine(north[:, 1:] - north[:, :-1], north[:, :-1] - south[:, :-1], sun)
    step = np.arange(size // len(south))
    below = (step[None, :] >= step[:, None])[None, :, None, :]
    cosine = np.where(below, lower[:, None, :, None], upper[:, None, :, None])
    return np.ascontiguousarray(cosine.reshape(size, size)[::-1])


def _cosine(rise_x: Floats, rise_y: Floats, sun: tuple[float, float, float]) -> NDArray[np.float32]:
    slope_x, slope_y = rise_x / GRID_M, rise_y / GRID_M
    along = sun[2] - slope_x * sun[0] - slope_y * sun[1]
    length = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return np.asarray(np.maximum(along / length, 0.0).astype(np.float32))

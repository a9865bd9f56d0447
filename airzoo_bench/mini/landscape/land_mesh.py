"""The land as triangles: a fine grid inside the region, a coarse apron beyond."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape.building_mesh import joined
from airzoo_bench.mini.landscape.plan import GRID_M
from airzoo_bench.mini.world import Material, Mesh

__all__ = ["apron_mesh", "land_at", "land_light", "land_mesh"]

# Distances beyond the border, in steps of the grid, to 800 m.
_BEYOND = np.array([0, 2, 5, 10, 18, 30, 45, 65, 90, 120, 160, 205, 255, 325, 400])


def land_mesh(heights: Floats) -> Mesh:
    """Mesh the land inside the region; each cell is cut from south-west to north-east."""
    last = heights.shape[0] - 1
    index = np.arange(last + 1)
    return _grid(index, index, heights, Material.GROUND)


def apron_mesh(heights: Floats) -> Mesh:
    """Mesh the land beyond the region: that inside, mirrored at the border, in coarse triangles.

    Along the border it has the corners of the land's own grid, so that no gap opens.
    """
    last = heights.shape[0] - 1
    inside = np.arange(last + 1)
    west, east = -_BEYOND[::-1], last + _BEYOND
    strips = [(inside, west), (inside, east), (west, inside), (east, inside)]
    corners = [(a, b) for a in (west, east) for b in (west, east)]
    return joined([_grid(x, y, heights, Material.APRON) for x, y in strips + corners])


def _grid(
    columns: NDArray[np.int64], rows: NDArray[np.int64], heights: Floats, material: Material
) -> Mesh:
    last = heights.shape[0] - 1
    z = heights[_mirrored(rows, last)[:, None], _mirrored(columns, last)[None, :]]
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


def _mirrored(index: NDArray[np.int64], last: int) -> NDArray[np.int64]:
    index = np.abs(index) % (2 * last)
    return np.minimum(index, 2 * last - index)


def land_at(heights: Floats, size: int, pixel_m: float) -> Floats:
    """Return the height of the land's triangles at the pixel centres of a raster.

    Parameters
    ----------
    heights : (n + 1, n + 1) float64
    size : int
    pixel_m : float
        A whole number of pixels makes a cell of the grid.

    Returns
    -------
    (size, size) float64
        First row in the north.
    """
    per_cell = round(GRID_M / pixel_m)
    step = (np.arange(per_cell) + 0.5) / per_cell
    east, north = step[None, None, None, :], step[None, :, None, None]
    z00, z10 = heights[:-1, :-1][:, None, :, None], heights[:-1, 1:][:, None, :, None]
    z01, z11 = heights[1:, :-1][:, None, :, None], heights[1:, 1:][:, None, :, None]
    lower = z00 + east * (z10 - z00) + north * (z11 - z10)
    upper = z00 + north * (z01 - z00) + east * (z11 - z01)
    return np.ascontiguousarray(np.where(east >= north, lower, upper).reshape(size, size)[::-1])


def land_light(heights: Floats, sun: tuple[float, float, float], size: int) -> NDArray[np.float32]:
    """Return the cosine between the land's triangles and the sun, at least 0; (size, size)."""
    south, north = heights[:-1], heights[1:]
    lower = _cosine(south[:, 1:] - south[:, :-1], north[:, 1:] - south[:, 1:], sun)
    upper = _cosine(north[:, 1:] - north[:, :-1], north[:, :-1] - south[:, :-1], sun)
    per_cell = size // (heights.shape[0] - 1)
    step = np.arange(per_cell)
    below = (step[None, :] >= step[:, None])[None, :, None, :]
    light = np.where(below, lower[:, None, :, None], upper[:, None, :, None])
    return np.ascontiguousarray(light.reshape(size, size)[::-1])


def _cosine(rise_x: Floats, rise_y: Floats, sun: tuple[float, float, float]) -> NDArray[np.float32]:
    slope_x, slope_y = rise_x / GRID_M, rise_y / GRID_M
    along = sun[2] - slope_x * sun[0] - slope_y * sun[1]
    length = np.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return np.asarray(np.maximum(along / length, 0.0).astype(np.float32))

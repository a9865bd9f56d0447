"""Heights of the land at the corners of a grid."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.landscape.noise import octaves
from airzoo_bench.mini.landscape.plan import GRID_M
from airzoo_bench.mini.landscape.shapes import Frame, Point, distance_to_line

__all__ = ["blended", "corners", "inside", "levelled", "near_line", "rolling", "smooth_share"]


def corners(side_m: float) -> tuple[Floats, Floats]:
    """Return x (1, n + 1) and y (n + 1, 1) of the grid's corners."""
    along: Floats = np.arange(round(side_m / GRID_M) + 1).astype(np.float64) * GRID_M
    return along[None, :], along[:, None]


def rolling(
    seed: int, stream: int, side_m: float, cells: dict[int, int], relief_m: float
) -> Floats:
    """Return smooth hills about zero, (n + 1, n + 1), most within half of `relief_m`."""
    count = round(side_m / GRID_M) + 1
    return octaves(seed, stream, count, cells).astype(np.float64) * (relief_m / 4096)


def smooth_share(distance: Floats, near: float, far: float) -> Floats:
    """Return 0 up to `near`, 1 from `far` on, and smoothly between."""
    share = np.clip((distance - near) / (far - near), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def blended(
    heights: Floats, distance: Floats, level: Floats | float, near: float, far: float
) -> Floats:
    """Return heights that are `level` up to a distance, the land beyond another."""
    share = smooth_share(distance, near, far)
    return heights * share + level * (1.0 - share)


def levelled(heights: Floats, frame: Frame, half_u: float, half_v: float, slope_m: float) -> Floats:
    """Return heights with a level yard about a frame's origin, as high as the land there."""
    x, y = corners((heights.shape[0] - 1) * GRID_M)
    u, v = frame.to_local(x, y)
    off = np.maximum(np.abs(u) - half_u, np.abs(v) - half_v)
    row, column = round(frame.y / GRID_M), round(frame.x / GRID_M)
    return blended(heights, off, float(heights[row, column]), 0.0, slope_m)


def near_line(side_m: float, points: tuple[Point, ...]) -> Floats:
    """Return the distance of the grid's corners from a line."""
    return distance_to_line(*corners(side_m), points)


def inside(frame: Frame, side_m: float, half_u: float, half_v: float) -> Bools:
    """Return which of the grid's corners lie in a rectangle about a frame's origin."""
    u, v = frame.to_local(*corners(side_m))
    return (np.abs(u) <= half_u) & (np.abs(v) <= half_v)

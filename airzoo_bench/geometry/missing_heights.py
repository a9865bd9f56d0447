"""Heights where a surface model has none, and rays that come down there."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import pixel_to_world
from airzoo_bench.geometry.rays import RayHits, RayStatus

__all__ = ["HeightAt", "meet_missing", "nearest_heights"]

HeightAt = Callable[[Floats], Floats]
"""Takes places (..., 2) to heights (...)."""
# Rounding of a hit on the surface; one further below it has gone through a hole.
_SUNK_M = 1e-3
_ROWS_PX = 1 << 16
_TIE_M = 1e-6


def nearest_heights(field: HeightField, most_px: int) -> HeightAt:
    """Return what finds the height of the valid pixel that is nearest to a place.

    It looks at every k-th pixel of every k-th row, beginning with k // 2, where k is the least
    whole number that leaves at most `most_px`. Of those that are equally near, to a micrometre, the
    first in row-major order counts.

    Parameters
    ----------
    field : HeightField
        Places are in its CRS.
    most_px : int
        At least 1.

    Returns
    -------
    HeightAt
        NaN for places that are NaN, and everywhere where no such pixel has a height.
    """
    from scipy.spatial import cKDTree

    @cache
    def pixels() -> tuple[Any, Floats, Floats]:
        # Made when the first ray asks: of a model without holes none does.
        xy, heights = _thinned(field, most_px)
        origin = xy.min(axis=0, initial=np.inf)
        return cKDTree(xy - origin), origin, heights

    def height(places: Floats) -> Floats:
        tree, origin, heights = pixels()
        known = np.isfinite(places).all(axis=-1)
        found = np.full(places.shape[:-1], np.nan)
        if heights.size and known.any():
            near, _ = tree.query(places[known] - origin)
            tied = tree.query_ball_point(places[known] - origin, near + _TIE_M)
            found[known] = heights[[min(rows) for rows in tied]]
        return found

    return height


def _thinned(field: HeightField, most_px: int) -> tuple[Floats, Floats]:
    """Places (P, 2) and heights (P,) of evenly spread pixels that have one."""
    rows, columns = field.heights.shape
    step = 1
    while -(-rows // step) * -(-columns // step) > most_px:
        step += 1
    column = np.arange(min(step // 2, columns - 1), columns, step)
    row = np.arange(min(step // 2, rows - 1), rows, step)
    at_once = max(_ROWS_PX // len(column), 1)
    places, heights = [], []
    for start in range(0, len(row), at_once):
        across, down = np.meshgrid(column, row[start : start + at_once])
        found = field.heights_at(across.ravel(), down.ravel())
        there = ~np.isnan(found)
        pixels = np.stack((across.ravel()[there], down.ravel()[there]), axis=-1) + 0.5
        places.append(pixel_to_world(field.transform, pixels))
        heights.append(found[there])
    return np.concatenate(places), np.concatenate(heights)


def meet_missing(
    origins: Floats,
    unit: Floats,
    hits: RayHits,
    field: HeightField,
    height_at: HeightAt,
    max_range_m: float,
) -> Floats:
    """Find where rays come down that have missed the surface model where it has no height.

    Such a ray is met with a level plane: first at `height_at` of the camera's place, then at that
    of the point so found.

    Parameters
    ----------
    origins, unit : (N, 3) array, (N, M, 3) array
        Camera centres, and directions of length 1.
    hits : RayHits
        What `intersect_heightfield` found for these rays.
    field : HeightField
        The surface that it met them with.
    height_at : HeightAt
        Such as that of `nearest_heights`.
    max_range_m : float
        Farthest a point may be from the centre.

    Returns
    -------
    (N, M, 3) array
        The points of `hits`, and those found here; NaN for all other rays: those that do not go
        down, begin below the ground, or come to their range above a surface that is there.
    """
    points = hits.points.copy()
    camera, ray = np.nonzero(_through_holes(hits, field))
    origin, direction = origins[camera], unit[camera, ray]
    first = _on_plane(origin, direction, height_at(origin[:, :2]))
    second = _on_plane(origin, direction, height_at(first[:, :2]))
    length = np.linalg.norm(second - origin, axis=-1)
    cut = hits.status[camera, ray] == RayStatus.BEYOND_RANGE
    # Above a surface that is there, the range is what ended the ray.
    lost = ~(length <= max_range_m) | (cut & ~np.isnan(field.sample(second[:, :2])))
    sunk = hits.valid[camera, ray]
    lost |= sunk & ~(length < np.linalg.norm(points[camera, ray] - origin, axis=-1))
    kept = ~lost
    points[camera[kept], ray[kept]] = second[kept]
    return points


def _through_holes(hits: RayHits, field: HeightField) -> Bools:
    """Rays (N, M) that may have come down without a height: missed, cut, or met underground."""
    missed = np.isin(hits.status, (RayStatus.OFF_RASTER, RayStatus.BEYOND_RANGE))
    under: Bools = hits.points[..., 2] < field.sample(hits.points[..., :2]) - _SUNK_M
    return missed | under


def _on_plane(origin: Floats, direction: Floats, height: Floats) -> Floats:
    """Points (P, 3) where rays that go down meet level planes; NaN from below."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = (height - origin[:, 2]) / direction[:, 2]
        points = origin + length[:, None] * direction
    return np.where((length > 0.0)[:, None], points, np.nan)

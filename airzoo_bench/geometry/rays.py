"""Rays met with the ground: a horizontal plane, the surface of a DSM, or where it has no height.

World coordinates are metres with z up. Distances are measured along the ray from the camera centre.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.frames import describe_crs, horizontal_crs
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.march import first_crossings
from airzoo_bench.geometry.rasters import pixel_to_world

__all__ = [
    "HeightAt",
    "RayHits",
    "RayStatus",
    "intersect_heightfield",
    "intersect_plane",
    "meet_missing",
    "nearest_heights",
]

HeightAt = Callable[[Floats], Floats]
"""Takes places (..., 2) to heights (...)."""

_BLOCK = 1 << 16
# Rounding of a hit on the surface; one further below it has gone through a hole.
_SUNK_M = 1e-3
_ROWS_PX = 1 << 16
_TIE_M = 1e-6


class RayStatus(IntEnum):
    """What became of a ray; the names are those of reports."""

    HIT = 0
    NOT_DOWNWARD = 1
    BEHIND = 2
    BEYOND_RANGE = 3
    OFF_RASTER = 4
    NO_RAY = 5
    """The ray or its origin is not finite: its pixel lies beyond the range of the lens model."""


class RayHits(NamedTuple):
    """Where rays meet the ground.

    Attributes
    ----------
    points : (N, M, 3) array
        NaN where the ray does not hit.
    valid : (N, M) bool array
        True where the ray hits.
    status : (N, M) uint8 array
        RayStatus of each ray.
    """

    points: Floats
    valid: Bools
    status: NDArray[np.uint8]


def intersect_plane(
    origins: Floats, directions: Floats, z0: ArrayLike, max_range_m: float
) -> RayHits:
    """Meet rays with the horizontal plane z = z0.

    Parameters
    ----------
    origins : (N, 3) array
        Camera centres.
    directions : (N, M, 3) array
        Of any length.
    z0 : (N,) array or scalar
        Height of the plane.
    max_range_m : float
        Farthest a point may be from the centre; the distance itself is still a hit.

    Returns
    -------
    RayHits
        NOT_DOWNWARD: the ray is level or goes up. BEHIND: it goes down from a centre on the plane
        or below. BEYOND_RANGE: it is longer than `max_range_m`.

    Raises
    ------
    RasterError
        `z0` is not finite.
    """
    plane = np.asarray(z0, dtype=np.float64).reshape(-1, 1)
    if not np.isfinite(plane).all():
        raise RasterError("the height of the plane is not finite", expected="a number of metres")
    unit, status = _prepared(origins, directions)
    above = origins[:, 2:] - plane
    going = status == RayStatus.HIT
    with np.errstate(over="ignore"):
        length = above / np.where(going, -unit[..., 2], np.nan)
    status[going & (above <= 0.0)] = RayStatus.BEHIND
    status[np.equal(status, RayStatus.HIT) & ~(length <= max_range_m)] = RayStatus.BEYOND_RANGE
    hits = _hits(origins, unit, length, status)
    # The plane's own height, not what rounding leaves of it.
    hits.points[..., 2] = np.where(hits.valid, plane, np.nan)
    return hits


def intersect_heightfield(
    origins: Floats, directions: Floats, field: HeightField, max_range_m: float
) -> RayHits:
    """Meet rays with the surface of a DSM: the first crossing from above.

    The ray is followed from cell to cell of the grid of pixel centres, between the highest and the
    lowest height, and met with the surface of each cell in closed form (see `march`); so that no
    wall is stepped over, and the point is exact to rounding.

    Where the DSM has no height the march goes on. When the ray has sunk into the ground across such
    a gap, the crossing is the first place beyond it where the surface is above the ray; the point
    is the ray's there, hence below the surface.

    Parameters
    ----------
    origins, directions : (N, 3) array, (N, M, 3) array
        See `intersect_plane`, in the field's CRS.
    field : HeightField
        In a projected CRS in metres.
    max_range_m : float
        See `intersect_plane`.

    Returns
    -------
    RayHits
        NOT_DOWNWARD: the ray is level or goes up. BEHIND: the centre is on the surface or below, or
        below all of it. BEYOND_RANGE: `max_range_m` is reached above the surface. OFF_RASTER: the
        ray leaves the raster above the surface, enters it below, never meets it, or sinks below the
        lowest height where the DSM has none.

    Raises
    ------
    RasterError
        The field's CRS is not projected in metres.
    """
    _require_metres(field)
    unit, status = _prepared(origins, directions)
    length = np.full(status.shape, np.nan)
    low, _ = field.height_range
    on_raster = field.sample(origins[:, :2])
    below = (origins[:, 2] <= low) | (origins[:, 2] <= on_raster)
    status[(status == RayStatus.HIT) & below[:, None]] = RayStatus.BEHIND
    for camera, ray in _blocks(status == RayStatus.HIT):
        found, cut = first_crossings(origins[camera], unit[camera, ray], field, max_range_m)
        length[camera, ray] = found
        missed = np.where(cut, RayStatus.BEYOND_RANGE, RayStatus.OFF_RASTER)
        status[camera, ray] = np.where(np.isnan(found), missed, RayStatus.HIT)
    return _hits(origins, unit, length, status)


def _prepared(origins: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint8]]:
    """Return unit directions, and a status: NO_RAY, NOT_DOWNWARD, or HIT for those to go on."""
    x, y, z = np.moveaxis(directions, -1, 0)
    norm = np.sqrt(x * x + y * y + z * z)
    usable = np.isfinite(norm) & (norm > 0.0) & np.isfinite(origins).all(axis=-1, keepdims=True)
    unit = directions / np.where(usable, norm, np.nan)[..., None]
    downward = np.where(unit[..., 2] < 0.0, RayStatus.HIT, RayStatus.NOT_DOWNWARD)
    return unit, np.where(usable, downward, RayStatus.NO_RAY).astype(np.uint8)


def _hits(origins: Floats, unit: Floats, length: Floats, status: NDArray[np.uint8]) -> RayHits:
    valid = status == RayStatus.HIT
    points = origins[:, None] + np.where(valid, length, np.nan)[..., None] * unit
    return RayHits(points, valid, status)


def _blocks(todo: Bools) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Cut the rays to do into blocks of indices, to bound memory."""
    camera, ray = np.nonzero(todo)
    for start in range(0, len(camera), _BLOCK):
        yield camera[start : start + _BLOCK], ray[start : start + _BLOCK]


def _require_metres(field: HeightField) -> None:
    crs = horizontal_crs(field.crs)
    if any(axis.unit_conversion_factor != 1.0 for axis in crs.axis_info) or crs.is_geographic:
        raise RasterError(
            f"the height field is in {describe_crs(crs)}, not in metres",
            expected="a projected CRS in metres",
            fix="reproject the DSM and the poses, e.g. to the local UTM zone",
        )


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

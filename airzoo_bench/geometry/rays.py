"""Rays met with the ground: a horizontal plane, or the surface of a DSM.

World coordinates are metres with z up. Distances are measured along the ray from the camera centre.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.march import first_crossings

__all__ = [
    "RayHits",
    "RayStatus",
    "intersect_heightfield",
    "intersect_plane",
]


_BLOCK = 1 << 16


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

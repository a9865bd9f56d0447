"""Frames: projected coordinates, WGS84 longitude and latitude, ECEF, and local east-north-up.

Horizontal coordinates are always x, y or lon, lat, whatever the axis order of the CRS. Heights of
geodetic coordinates are above the WGS84 ellipsoid.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS, Geod, Transformer

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import horizontal_crs, same_plane

__all__ = [
    "change_of_plane",
    "ecef_to_geodetic",
    "enu_axes",
    "from_lonlat",
    "geodesic_distance_m",
    "geodetic_to_ecef",
    "to_lonlat",
    "unwrapped",
]

_WGS84 = CRS.from_epsg(4326)


def to_lonlat(crs: Any, xy: ArrayLike) -> Floats:
    """Take coordinates of a CRS to WGS84.

    Parameters
    ----------
    crs : Any
        See `crs.horizontal_crs`.
    xy : (..., 2) array
        x (easting or longitude), y (northing or latitude).

    Returns
    -------
    (..., 2) array
        Longitude, latitude in degrees; NaN where `xy` is NaN or beyond the projection.

    Raises
    ------
    UserError
        See `crs.horizontal_crs`.
    """
    return _transformed(_transformer(horizontal_crs(crs), _WGS84), xy)


def from_lonlat(crs: Any, lonlat: ArrayLike) -> Floats:
    """Take WGS84 longitude and latitude (..., 2) to a CRS; the inverse of `to_lonlat`.

    Parameters
    ----------
    crs : Any
        See `crs.horizontal_crs`.
    lonlat : (..., 2) array
        Degrees.

    Returns
    -------
    (..., 2) array
        x before y; NaN beyond the domain of the CRS.
    """
    return _transformed(_transformer(_WGS84, horizontal_crs(crs)), lonlat)


def unwrapped(lonlat: ArrayLike, about_lon: float) -> Floats:
    """Move longitudes by whole turns to within 180 degrees of one: none jumps at +-180.

    Parameters
    ----------
    lonlat : (..., 2) array
        Degrees; what needs no turn stays as it is to the last bit.
    about_lon : float
        A longitude in the midst of them.

    Returns
    -------
    (..., 2) array
        Such as 180.1 for -179.9 about 179.
    """
    given = np.asarray(lonlat, dtype=np.float64)
    turns = np.round((about_lon - given[..., 0]) / 360)
    return given + 360 * np.stack([turns, np.zeros_like(turns)], axis=-1)


def geodetic_to_ecef(lonlatheight: ArrayLike) -> Floats:
    """Take lon, lat (degrees), height (m) on WGS84, (..., 3), to ECEF metres (EPSG:4978).

    Parameters
    ----------
    lonlatheight : (..., 3) array
        Longitude, latitude, ellipsoidal height.

    Returns
    -------
    (..., 3) array
        Metres.
    """
    return _transformed(_transformer(CRS.from_epsg(4979), CRS.from_epsg(4978)), lonlatheight)


def ecef_to_geodetic(xyz: ArrayLike) -> Floats:
    """Take ECEF metres (..., 3) to lon, lat (degrees), height (m) on WGS84 (EPSG:4979).

    Parameters
    ----------
    xyz : (..., 3) array
        Metres.

    Returns
    -------
    (..., 3) array
        Longitude, latitude, ellipsoidal height.
    """
    return _transformed(_transformer(CRS.from_epsg(4978), CRS.from_epsg(4979)), xyz)


def geodesic_distance_m(lonlat_a: ArrayLike, lonlat_b: ArrayLike, *, jobs: int = 1) -> Floats:
    """Length of the geodesic on the WGS84 ellipsoid, by PROJ (Karney 2013).

    Parameters
    ----------
    lonlat_a, lonlat_b : (..., 2) array
        Longitude, latitude in degrees; they broadcast.
    jobs : int
        Threads.

    Returns
    -------
    (...) array
        Metres; NaN where one is NaN.
    """
    a, b = np.broadcast_arrays(
        np.asarray(lonlat_a, dtype=np.float64), np.asarray(lonlat_b, dtype=np.float64)
    )
    columns = [np.ascontiguousarray(end[..., axis]).ravel() for end in (a, b) for axis in (0, 1)]
    parts = zip(*(np.array_split(column, jobs) for column in columns), strict=True)
    with ThreadPoolExecutor(jobs) as pool:
        found = pool.map(_geodesics, parts)
        return np.concatenate(list(found)).reshape(a.shape[:-1])


def _geodesics(columns: tuple[Any, ...]) -> Floats:
    _, _, metres = _geod().inv(*columns)
    return np.asarray(metres, dtype=np.float64)


def enu_axes(lonlat: ArrayLike) -> Floats:
    """Axes of the east-north-up frames tangent at places of WGS84.

    Parameters
    ----------
    lonlat : (N, 2) array
        Longitude, latitude in degrees.

    Returns
    -------
    (N, 3, 3) array
        Rotations from ENU to ECEF: the columns are east, north and up.
    """
    lon, lat = np.radians(np.asarray(lonlat, dtype=np.float64)).T
    east = (-np.sin(lon), np.cos(lon), np.zeros_like(lon))
    north = (-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat))
    up = (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat))
    return np.array((east, north, up)).T


@lru_cache(maxsize=64)
def _transformer(source: CRS, target: CRS) -> Transformer:
    return Transformer.from_crs(source, target, always_xy=True)


@lru_cache(maxsize=1)
def _geod() -> Geod:
    return Geod(ellps="WGS84")


def _transformed(transformer: Transformer, points: ArrayLike) -> Floats:
    given = np.asarray(points, dtype=np.float64)
    columns: list[Any] = [given[..., axis].ravel() for axis in range(given.shape[-1])]
    moved = np.stack(transformer.transform(*columns), axis=-1).reshape(given.shape)
    # PROJ answers with infinity where it cannot, and looks at one coordinate at a time.
    usable = np.isfinite(given).all(axis=-1) & np.isfinite(moved).all(axis=-1)
    return np.where(usable[..., None], moved, np.nan)


def change_of_plane(source: Any, target: Any) -> Callable[[Floats], Floats]:
    """Return what takes coordinates (..., 2) of one CRS to another, x before y.

    Coordinates are left as they are where the two are one CRS (see `crs.same_plane`);
    otherwise they go through WGS84, and are NaN beyond the domain of either.

    Parameters
    ----------
    source, target : Any
        See `crs.horizontal_crs`.

    Returns
    -------
    callable
        Takes and returns (..., 2) arrays.
    """
    if same_plane(source, target):
        return lambda xy: xy
    return lambda xy: from_lonlat(target, to_lonlat(source, xy))

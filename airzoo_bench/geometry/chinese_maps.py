"""GCJ-02 and BD-09, the shifted coordinates of Chinese maps.

Maps published in China stand in GCJ-02, WGS84 moved by some 300 to 700 m that change from place to
place; Baidu moves them again (BD-09). The formulas were never published officially; these are the
ones in general use, as in eviltransform (github.com/googollee/eviltransform), coordtransform
(github.com/wandergis/coordtransform) and Wikipedia, "Restrictions on geographic data in China".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["wgs84_to_bd09", "wgs84_to_gcj02"]

# Krasovsky's ellipsoid of 1940: semi-major axis (m) and squared eccentricity.
_AXIS_M, _ECCENTRICITY2 = 6_378_245.0, 0.00669342162296594323
_ABOUT = (105.0, 35.0)
# Where the formulas move anything.
_WEST, _EAST, _SOUTH, _NORTH = 72.004, 137.8347, 0.8293, 55.8271
_BAIDU_DEG = (0.0065, 0.006)
_BAIDU_TURNS = np.pi * 3000.0 / 180.0


def wgs84_to_gcj02(lonlat: ArrayLike) -> Floats:
    """Shift WGS84 longitude and latitude (..., 2) as maps published in China are.

    Parameters
    ----------
    lonlat : (..., 2) array
        Degrees.

    Returns
    -------
    (..., 2) array
        Degrees; unchanged outside of the rectangle that the formulas are made for.
    """
    given = np.asarray(lonlat, dtype=np.float64)
    lon, lat = given[..., 0], given[..., 1]
    east_m, north_m = _shift_m(lon - _ABOUT[0], lat - _ABOUT[1])
    root = np.sqrt(1.0 - _ECCENTRICITY2 * np.sin(np.radians(lat)) ** 2)
    meridian_m = _AXIS_M * (1.0 - _ECCENTRICITY2) / root**3
    parallel_m = _AXIS_M / root * np.cos(np.radians(lat))
    shift = np.degrees(np.stack((east_m / parallel_m, north_m / meridian_m), axis=-1))
    return np.where(_is_shifted(given), given + shift, given)


def wgs84_to_bd09(lonlat: ArrayLike) -> Floats:
    """Shift WGS84 longitude and latitude (..., 2) as Baidu's maps are; see `wgs84_to_gcj02`.

    Parameters
    ----------
    lonlat : (..., 2) array
        Degrees.

    Returns
    -------
    (..., 2) array
        Degrees; unchanged where GCJ-02 is.
    """
    given = np.asarray(lonlat, dtype=np.float64)
    shifted = wgs84_to_gcj02(given)
    x, y = shifted[..., 0], shifted[..., 1]
    radius = np.hypot(x, y) + 2e-5 * np.sin(y * _BAIDU_TURNS)
    angle = np.arctan2(y, x) + 3e-6 * np.cos(x * _BAIDU_TURNS)
    moved = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1) + _BAIDU_DEG
    return np.where(_is_shifted(given), moved, given)


def _is_shifted(lonlat: Floats) -> Bools:
    """Return which places the formulas are made for, (..., 1)."""
    lon, lat = lonlat[..., :1], lonlat[..., 1:]
    return (lon >= _WEST) & (lon <= _EAST) & (lat >= _SOUTH) & (lat <= _NORTH)


def _shift_m(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Metres east and north, by degrees from the place that the series are about."""
    root = np.sqrt(np.abs(x))
    both = 20.0 * (_sine(6.0 * x) + _sine(2.0 * x))
    east = 300.0 + x + 2.0 * y + 0.1 * x * x + 0.1 * x * y + 0.1 * root
    east += (both + 20.0 * _sine(x) + 40.0 * _sine(x / 3)) * 2 / 3
    east += (150.0 * _sine(x / 12) + 300.0 * _sine(x / 30)) * 2 / 3
    north = -100.0 + 2.0 * x + 3.0 * y + 0.2 * y * y + 0.1 * x * y + 0.2 * root
    north += (both + 20.0 * _sine(y) + 40.0 * _sine(y / 3)) * 2 / 3
    north += (160.0 * _sine(y / 12) + 320.0 * _sine(y / 30)) * 2 / 3
    return east, north


def _sine(half_turns: Floats) -> Floats:
    return np.asarray(np.sin(np.pi * half_turns), dtype=np.float64)

"""From coordinates of any CRS to pixels of a map, also where the map crosses the 180th meridian."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import horizontal_crs
from airzoo_bench.geometry.frames import change_of_plane
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world, world_to_pixel

__all__ = ["LONLAT_CRS", "to_map_pixels"]

LONLAT_CRS = "EPSG:4326"
"""Longitude and latitude in degrees, x before y."""

_LONGITUDES, _LATITUDES = (0.0, 1.0, 2.0), (0.0, 40.0)
_ALIKE, _DIGITS = 1e-9, 9


def to_map_pixels(source: Any, raster: RasterInfo) -> Callable[[Floats], Floats]:
    """Return what takes coordinates (..., 2) of a CRS to pixels of a raster.

    Where the raster's CRS goes round the earth (degrees, upright cylinders such as Mercator's),
    places lie on it by the turn that is nearest to its middle: PROJ gives longitudes from -180 to
    180, and a map may go from 179.9 to 180.1.

    Parameters
    ----------
    source : Any
        See `crs.horizontal_crs`.
    raster : RasterInfo
        In any CRS.

    Returns
    -------
    callable
        Takes and returns (..., 2) arrays; NaN beyond the domain of either CRS.
    """
    change, turn = change_of_plane(source, raster.crs), _turn(raster.crs)
    middle = pixel_to_world(raster.transform, (raster.width / 2.0, raster.height / 2.0))[0]

    def pixels(xy: Floats) -> Floats:
        world = change(xy)
        if turn:
            away = turn * np.round((middle - world[..., 0]) / turn)
            world = world + np.stack([away, np.zeros_like(away)], axis=-1)
        return world_to_pixel(raster.transform, world)

    return pixels


def _turn(crs: Any) -> float:
    """Return by how much x grows once round the earth; 0 where a CRS does not go round it."""
    plane = horizontal_crs(crs)
    degrees = plane.geodetic_crs or plane
    change = change_of_plane(degrees, plane)
    x = change(np.array([[(lon, lat) for lon in _LONGITUDES] for lat in _LATITUDES]))[..., 0]
    low, high = np.abs(np.diff(x, axis=1)).min(axis=1)  # one of the steps may be across its edge
    around = round(2.0 * np.pi / degrees.axis_info[0].unit_conversion_factor, _DIGITS)
    return around * float(low) if abs(low - high) <= _ALIKE * low else 0.0

"""From coordinates of any CRS to pixels of a map, also where the map crosses the 180th meridian."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import horizontal_crs
from airzoo_bench.geometry.frames import change_of_plane, from_lonlat
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world, world_to_pixel

__all__ = ["LONLAT_CRS", "to_map_pixels"]

LONLAT_CRS = "EPSG:4326"
"""Longitude and latitude in degrees, x before y."""

_ROUND_THE_EARTH = ("Mercator", "Popular Visualisation Pseudo Mercator")


def to_map_pixels(source: Any, raster: RasterInfo) -> Callable[[Floats], Floats]:
    """Return what takes coordinates (..., 2) of a CRS to pixels of a raster.

    Where the raster's CRS goes round the earth (degrees, Mercator), places lie on it by the turn
    that is nearest to its middle: PROJ gives longitudes from -180 to 180, and a map may go from
    179.9 to 180.1.

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
    operation = None if plane.is_geographic else plane.coordinate_operation
    if operation is not None and not operation.method_name.startswith(_ROUND_THE_EARTH):
        return 0.0
    x = from_lonlat(plane, [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])[:, 0]
    return 360.0 * float(np.abs(np.diff(x)).min())  # one of the steps may be across its edge

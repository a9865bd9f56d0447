"""From the map plane of one CRS to that of another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import from_lonlat, same_plane, to_lonlat

__all__ = ["change_of_plane"]


def change_of_plane(source: Any, target: Any) -> Callable[[Floats], Floats]:
    """Return what takes coordinates (..., 2) of one CRS to another, x before y.

    Coordinates are left as they are where the two are one CRS (see `frames.same_plane`);
    otherwise they go through WGS84, and are NaN beyond the domain of either.

    Parameters
    ----------
    source, target : Any
        See `frames.horizontal_crs`.

    Returns
    -------
    callable
        Takes and returns (..., 2) arrays.
    """
    if same_plane(source, target):
        return lambda xy: xy
    return lambda xy: from_lonlat(target, to_lonlat(source, xy))

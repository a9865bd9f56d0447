"""Heights above the ellipsoid and above sea level: geoids, and changing from one to another.

PROJ needs a grid for each geoid. pyproj's wheels carry none and nothing is fetched here: without
the grid there is no figure, never a zero.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from airzoo_bench.core.errors import UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs

__all__ = [
    "ChangedHeights",
    "changed_heights",
    "heights_crs",
    "how_to_install",
    "stated_heights_crs",
]

_WGS84 = CRS.from_epsg(4326)
_MARGIN_DEG = 0.01
_EXPECTED = (
    "a CRS with heights, such as EPSG:5773 (EGM96), EPSG:3855 (EGM2008), EPSG:4979 (WGS84's "
    "ellipsoid) or a PROJ string with +geoidgrids"
)


@dataclass(frozen=True, eq=False)
class ChangedHeights:
    """Heights in another vertical CRS.

    Attributes
    ----------
    heights_m : (N,) array
    operation : str
        What PROJ did, by its own name.
    accuracy_m : float or None
        As PROJ states it; None where it states none.
    """

    heights_m: Floats
    operation: str
    accuracy_m: float | None


def heights_crs(given: Any) -> CRS:
    """Return a CRS of WGS84 longitude, latitude and the heights of a CRS.

    Parameters
    ----------
    given : Any
        What pyproj takes: a vertical CRS, one of an ellipsoid in three dimensions, or a compound
        one, whose horizontal part is left aside.

    Returns
    -------
    CRS
        Of three axes.

    Raises
    ------
    UserError
        PROJ does not know it, or it has no heights.
    """
    try:
        known = CRS.from_user_input(given)
    except CRSError as error:
        raise UserError(f"unknown vertical CRS {str(given)[:80]!r}", expected=_EXPECTED) from error
    found = stated_heights_crs(known)
    if found is None:
        raise UserError(f"{describe_crs(known)} has no heights", expected=_EXPECTED)
    return found


def stated_heights_crs(crs: CRS) -> CRS | None:
    """Return what `heights_crs` does, of a CRS that may say nothing of heights.

    Parameters
    ----------
    crs : CRS
        Of any kind.

    Returns
    -------
    CRS or None
        None where it says nothing of them.
    """
    if crs.is_compound:
        return CompoundCRS(crs.sub_crs_list[1].name, [_WGS84, crs.sub_crs_list[1]])
    if crs.is_vertical:
        return CompoundCRS(crs.name, [_WGS84, crs])
    if len(crs.axis_info) == 3 and (crs.is_geographic or crs.is_projected):
        # It counts from the ellipsoid of its datum.
        return crs.geodetic_crs.to_3d() if crs.geodetic_crs is not None else None
    return None


def changed_heights(
    heights_m: ArrayLike, lonlat: ArrayLike, source: Any, target: Any
) -> ChangedHeights:
    """Take heights to another vertical CRS, with PROJ's best operation for the place or not at all.

    Parameters
    ----------
    heights_m : (N,) array
        Metres, whatever the units of the CRS; NaN stays NaN.
    lonlat : (N, 2) array
        WGS84, degrees.
    source, target : Any
        See `heights_crs`.

    Returns
    -------
    ChangedHeights
        Heights in the target's datum, in metres.

    Raises
    ------
    UserError
        One is no CRS of heights, a grid is not installed (it is named) or does not cover a place,
        or PROJ knows no way from one to the other.
    """
    heights, places = np.asarray(heights_m, np.float64), np.asarray(lonlat, np.float64)
    there = np.isfinite(heights) & np.isfinite(places).all(axis=-1)
    first, last = heights_crs(source), heights_crs(target)
    what = f"heights cannot be taken from {_named(source)} to {_named(target)}"
    if not there.any():
        return ChangedHeights(heights.copy(), "none", None)
    (west, south), (east, north) = places[there].min(axis=0), places[there].max(axis=0)
    around = _area(west, south, east, north)
    transformer, lacking = _operation(first, last, around)
    if transformer is None:
        raise UserError(
            f"{what}: " + (f"PROJ's grid {lacking} is not installed" if lacking else "no way"),
            expected="an exact conversion",
            fix=how_to_install(lacking) if lacking else "convert them with another program",
        )
    moved = heights.copy()
    lon, lat = places[there].T
    moved[there] = transformer.transform(lon, lat, heights[there] / _unit_m(first))[2]
    moved[there] *= _unit_m(last)
    if not np.isfinite(moved[there]).all():
        raise UserError(
            f"{what}: the grids of PROJ do not cover every place",
            expected=f"places that {transformer.description} covers",
        )
    accuracy = transformer.accuracy
    return ChangedHeights(
        moved, transformer.description, accuracy if accuracy and accuracy > 0.0 else None
    )


def how_to_install(grid: str) -> str:
    """Say how a grid of PROJ is installed.

    Parameters
    ----------
    grid : str
        Its file's name.

    Returns
    -------
    str
        A command, and where the grid comes from.
    """
    return f"pyproj sync --file {grid} (or PROJ's own projsync), which fetches it from cdn.proj.org"


def _named(crs: Any) -> str:
    return describe_crs(CRS.from_user_input(crs))


def _unit_m(crs: CRS) -> float:
    return float(crs.axis_info[2].unit_conversion_factor)


def _area(west: float, south: float, east: float, north: float) -> AreaOfInterest:
    return AreaOfInterest(
        west - _MARGIN_DEG, south - _MARGIN_DEG, east + _MARGIN_DEG, north + _MARGIN_DEG
    )


@lru_cache(maxsize=64)
def _operation(source: CRS, target: CRS, around: Any) -> tuple[Transformer | None, str]:
    """Return PROJ's best operation, or None and the first grid that it lacks."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Best transformation is not available", UserWarning)
        try:
            group = TransformerGroup(
                source, target, always_xy=True, allow_ballpark=False, area_of_interest=around
            )
        except ProjError as error:
            raise UserError(f"PROJ refuses the change of heights: {error}") from error
    if group.transformers and group.best_available:
        return group.transformers[0], ""
    parts = (
        part
        for operation in group.unavailable_operations
        for part in (operation, *operation.operations)
    )
    lacking = (grid.short_name for part in parts for grid in part.grids if not grid.available)
    return None, next(lacking, "")

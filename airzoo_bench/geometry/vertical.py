"""Units and zero of heights: vertical units, geoids and ellipsoids.

PROJ needs a grid for each geoid. pyproj's wheels carry none and nothing is fetched here: without
the grid there is no figure, never a zero.
"""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.crs import CompoundCRS
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs

_WGS84 = CRS.from_epsg(4326)
_MARGIN_DEG = 0.01
_SAME_UNIT = 1e-6  # the two feet differ by 2e-6: they are different units
# How files spell units besides PROJ's own names.
_SPELLINGS = {
    "m": ("meter", "meters", "metres"),
    "cm": ("centimeter", "centimeters", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetres"),
    "km": ("kilometer", "kilometers", "kilometres"),
    "ft": ("feet", "international foot", "international feet"),
    "us-ft": ("us survey feet", "survey foot", "survey feet", "ftus", "ft_us", "us_ft", "us ft"),
}


def vertical_m(crs: CRS) -> float | None:
    """Return the metres of the vertical unit that a CRS states; None where it has no heights."""
    for axis in crs.axis_info:
        if axis.direction == "down":
            raise RasterError(
                f"{crs.name} counts depths, not heights", expected="heights, upward positive"
            )
        if axis.direction == "up":
            return float(axis.unit_conversion_factor)
    return None


def height_unit_m(dataset: Any) -> float:
    """Return the metres of a raster's unit of height: its band's, its CRS's, or 1.

    Raise RasterError where the unit is no length, or band and CRS state different ones.
    """
    wkt = dataset.crs.to_wkt() if dataset.crs else ""
    return _height_unit_m(dataset.units[0] or "", wkt, dataset.name)


@lru_cache(maxsize=64)
def _height_unit_m(band: str, wkt: str, where: str) -> float:
    by_crs = vertical_m(CRS.from_wkt(wkt)) if wkt else None
    by_band = _lengths().get(band.strip().lower()) if band.strip() else None
    if band.strip() and by_band is None:
        raise RasterError(
            f"heights are in {band[:40]!r}, which is no known unit of length",
            where=where,
            expected="m, ft, US survey foot, or another unit that PROJ knows",
            fix="name the unit of the heights: gdal_edit.py -units m",
        )
    if by_crs and by_band and abs(by_band / by_crs - 1.0) > _SAME_UNIT:
        raise RasterError(
            f"two units of height: the band's is {band} ({by_band:g} m), the CRS's {by_crs:g} m",
            where=where,
            fix="make the two agree: gdal_edit.py -units, or -a_srs",
        )
    return by_band or by_crs or 1.0


@lru_cache(maxsize=1)
def _lengths() -> dict[str, float]:
    """Return the metres of each unit of length, by its names in lower case."""
    known: dict[str, float] = {}
    for name, unit in get_units_map(category="linear").items():
        known[name.lower()] = unit.conv_factor
        if unit.proj_short_name:
            known[unit.proj_short_name.lower()] = unit.conv_factor
    for name, others in _SPELLINGS.items():
        known |= dict.fromkeys(others, known[name])
    return known


def heights_crs(given: Any) -> CRS:
    """Return the CRS of WGS84 longitude, latitude and the heights of a CRS; raise UserError."""
    expected = (
        "a CRS with heights, such as EPSG:5773 (EGM96), EPSG:3855 (EGM2008), EPSG:4979 (WGS84's "
        "ellipsoid) or a PROJ string with +geoidgrids"
    )
    try:
        known = CRS.from_user_input(given)
    except CRSError as error:
        raise UserError(f"unknown vertical CRS {str(given)[:80]!r}", expected=expected) from error
    found = stated_heights_crs(known)
    if found is None:
        raise UserError(f"{describe_crs(known)} has no heights", expected=expected)
    return found


def stated_heights_crs(crs: CRS) -> CRS | None:
    """Return the same as `heights_crs`, or None for a CRS without heights."""
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
) -> tuple[Floats, str]:
    """Take heights (N,) at WGS84 places (N, 2) to another vertical CRS, exactly or not at all.

    Return metres, whatever the units of the CRS (NaN stays NaN), and PROJ's name of the operation.
    Raise UserError where PROJ knows no way, or names a grid that is not installed or does not cover
    a place.
    """
    heights, places = np.asarray(heights_m, np.float64), np.asarray(lonlat, np.float64)
    there = np.isfinite(heights) & np.isfinite(places).all(axis=-1)
    first, last = heights_crs(source), heights_crs(target)
    names = [describe_crs(CRS.from_user_input(crs)) for crs in (source, target)]
    what = f"heights cannot be taken from {names[0]} to {names[1]}"
    if not there.any():
        return heights.copy(), "none"
    low, high = places[there].min(axis=0) - _MARGIN_DEG, places[there].max(axis=0) + _MARGIN_DEG
    transformer, lacking = _operation(first, last, AreaOfInterest(*low, *high))
    if transformer is None:
        raise UserError(
            f"{what}: " + (f"PROJ's grid {lacking} is not installed" if lacking else "no way"),
            expected="an exact conversion",
            fix=f"pyproj sync --file {lacking} (or PROJ's own projsync), which fetches it from "
            "cdn.proj.org"
            if lacking
            else "convert them with another program",
        )
    from_m, to_m = (float(crs.axis_info[2].unit_conversion_factor) for crs in (first, last))
    moved = heights.copy()
    lon, lat = places[there].T
    moved[there] = transformer.transform(lon, lat, heights[there] / from_m)[2] * to_m
    if not np.isfinite(moved[there]).all():
        raise UserError(
            f"{what}: the grids of PROJ do not cover every place",
            expected=f"places that {transformer.description} covers",
        )
    return moved, transformer.description


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

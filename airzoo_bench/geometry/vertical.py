"""Units of heights, as CRS and rasters state them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from pyproj import CRS
from pyproj.database import get_units_map

from airzoo_bench.core.errors import RasterError

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

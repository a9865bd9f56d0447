"""What heights are measured in, and how true the metres and the north of a projection are."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS, Proj
from pyproj.database import get_units_map

from airzoo_bench.core.errors import CameraError, RasterError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.frames import from_lonlat

__all__ = [
    "check_true_metres",
    "grid_convergence_deg",
    "height_unit_m",
    "scale_error",
    "vertical_m",
]

# Scene coordinates are metres where the CRS's scale differs from 1 by less than this.
_MOST_SCALE_ERROR = 0.005

# How files spell units besides PROJ's own names.
_SPELLINGS = {
    "m": ("meter", "meters", "metres"),
    "cm": ("centimeter", "centimeters", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetres"),
    "km": ("kilometer", "kilometers", "kilometres"),
    "ft": ("feet", "international foot", "international feet"),
    "us-ft": ("us survey feet", "survey foot", "survey feet", "ftus", "ft_us", "us_ft", "us ft"),
}
# Half the length of meridian whose direction is measured, some 11 m: the curvature of the meridian
# on the grid and the last digits of millions of metres then both stay below 1e-8 degrees.
_STEP_DEG = 1e-4
_SAME_UNIT = 1e-6  # the two feet differ by 2e-6: they are different units


def scale_error(crs: Any, lonlat: ArrayLike) -> Floats:
    """How far a metre of a projected CRS is from a metre on the ground, at worst over directions.

    The largest |k - 1| of Tissot's indicatrix (Snyder, Map Projections: A Working Manual, 1987,
    section 4), as PROJ computes it.

    Parameters
    ----------
    crs : Any
        A projected CRS, see `crs.horizontal_crs`.
    lonlat : (..., 2) array
        Longitude, latitude in degrees.

    Returns
    -------
    (...) array
        A share, 0 where lengths are true; infinite beyond the projection.

    Raises
    ------
    UserError
        See `crs.horizontal_crs`.
    """
    place = np.asarray(lonlat, dtype=np.float64)
    proj = Proj(horizontal_crs(crs))
    factors = proj.get_factors(place[..., 0], place[..., 1])
    axes = np.stack((factors.tissot_semimajor, factors.tissot_semiminor), axis=-1)
    error = np.abs(axes - 1.0).max(axis=-1)
    return np.where(np.isfinite(error), error, np.inf)


def check_true_metres(crs: CRS, lonlat: ArrayLike, where: object) -> None:
    """Refuse a projected CRS whose coordinates are no metres at some places.

    Parameters
    ----------
    crs : CRS
        Projected.
    lonlat : (..., 2) array
        Degrees, WGS84.
    where : object
        The file that states the CRS, for the message.

    Raises
    ------
    CameraError
        Its scale there differs from 1 by 0.5 % or more.
    """
    worst = float(np.max(scale_error(crs, lonlat), initial=0.0))
    if not worst < _MOST_SCALE_ERROR:
        lon, lat = np.asarray(lonlat, dtype=np.float64).reshape(-1, 2)[0]
        found = "beyond it" if np.isinf(worst) else f"where its scale is off by {worst:.1%}"
        raise CameraError(
            f"coordinates of {describe_crs(crs)} are no metres here: the scene is at longitude "
            f"{lon:.4f}, latitude {lat:.4f}, {found}",
            where=where,
            expected=f"a projected CRS whose scale at the scene is within {_MOST_SCALE_ERROR:.1%} "
            "of 1, such as the UTM zone",
            fix="transform poses, DSM and cloud to such a CRS",
        )


def grid_convergence_deg(crs: Any, lonlat: ArrayLike) -> Floats:
    """Angle from true north to the grid's north, clockwise positive.

    An azimuth on the grid is the true azimuth less the convergence.

    Parameters
    ----------
    crs : Any
        A projected CRS, see `crs.horizontal_crs`.
    lonlat : (..., 2) array
        WGS84 longitude, latitude in degrees.

    Returns
    -------
    (...) array
        Degrees in (-180, 180]; NaN where `lonlat` is NaN or beyond the projection.

    Raises
    ------
    CameraError
        The CRS is not projected.
    UserError
        See `crs.horizontal_crs`.
    """
    plane = horizontal_crs(crs)
    if not plane.is_projected:
        raise CameraError(
            f"{plane.name} has no grid to turn camera poses to",
            expected="a projected CRS in metres",
        )
    place = np.asarray(lonlat, dtype=np.float64)
    south, north = place.copy(), place.copy()
    south[..., 1] = np.maximum(place[..., 1] - _STEP_DEG, -90.0)
    north[..., 1] = np.minimum(place[..., 1] + _STEP_DEG, 90.0)
    x, y = np.moveaxis(from_lonlat(plane, north) - from_lonlat(plane, south), -1, 0)
    return np.asarray(-np.degrees(np.arctan2(x, y)), dtype=np.float64)


def vertical_m(crs: CRS) -> float | None:
    """Metres of the vertical unit that a CRS states; None where it has no heights.

    Parameters
    ----------
    crs : CRS
        Compound, projected or geographic.

    Returns
    -------
    float or None
        Such as 0.3048 for feet.

    Raises
    ------
    RasterError
        Its third axis goes down (depths).
    """
    for axis in crs.axis_info:
        if axis.direction == "down":
            raise RasterError(
                f"{crs.name} counts depths, not heights", expected="heights, upward positive"
            )
        if axis.direction == "up":
            return float(axis.unit_conversion_factor)
    return None


def height_unit_m(dataset: Any) -> float:
    """Metres of the unit of a raster's heights, by its band's unit or its CRS's vertical axis.

    Parameters
    ----------
    dataset : rasterio.DatasetReader
        Open.

    Returns
    -------
    float
        1 where the file says nothing.

    Raises
    ------
    RasterError
        The unit is no length, or band and CRS state different ones.
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
    """Metres of each unit of length, by its names in lower case."""
    known: dict[str, float] = {}
    for name, unit in get_units_map(category="linear").items():
        known[name.lower()] = unit.conv_factor
        if unit.proj_short_name:
            known[unit.proj_short_name.lower()] = unit.conv_factor
    for name, others in _SPELLINGS.items():
        known |= dict.fromkeys(others, known[name])
    return known

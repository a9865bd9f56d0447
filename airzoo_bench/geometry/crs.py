"""Coordinate reference systems (CRS): map planes, WGS84, ECEF, ENU, true metres, height units.

A CRS is anything pyproj takes: an EPSG code, ``"EPSG:4547"``, WKT, a CRS of pyproj or rasterio.
Horizontal coordinates are always x, y or lon, lat, whatever the axis order of the CRS, and NaN
beyond its domain. Heights of geodetic coordinates are above the WGS84 ellipsoid.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS, Geod, Proj, Transformer
from pyproj.database import get_units_map
from pyproj.exceptions import CRSError

from airzoo_bench.core.errors import CameraError, RasterError, UserError
from airzoo_bench.geometry.arrays import Floats

LOCAL_CRS = "local"
"""Names a frame in metres, z up, that has no place on the earth."""
LONLAT_CRS = "EPSG:4326"
"""Longitude and latitude in degrees, x before y."""

_WGS84 = CRS.from_epsg(4326)
_EQUATOR_M = 6378137.0
# Scene coordinates are metres where the CRS's scale differs from 1 by less than this.
_MOST_SCALE_ERROR = 0.005
# Half the length of meridian whose direction is measured, some 11 m: the curvature of the meridian
# on the grid and the last digits of millions of metres then both stay below 1e-8 degrees.
_STEP_DEG = 1e-4


def horizontal_crs(crs: Any) -> CRS:
    """Return the horizontal part of a CRS; refuse one that is neither projected nor geographic."""
    if isinstance(crs, str) and crs == LOCAL_CRS:  # a CRS compares itself through PROJ, slowly
        raise UserError(
            "the frame is local: it has no place on the earth",
            expected="a projected CRS in metres",
            fix="georeference the scene, or leave out what needs a map",
        )
    try:
        known = CRS.from_user_input(crs)
    except CRSError as error:
        raise UserError(f"unknown CRS {crs!r}", expected="such as EPSG:4547 or WKT") from error
    flat = known.to_2d()
    if not (flat.is_projected or flat.is_geographic):
        raise UserError(f"CRS {known.name!r} has no map plane", expected="projected or geographic")
    return flat


def describe_crs(crs: CRS) -> str:
    """Name a CRS for messages, such as "EPSG:32615 (WGS 84 / UTM zone 15N)"."""
    code = crs.to_epsg()
    if code is None:
        return crs.name if crs.name != "unknown" else crs.to_string()[:80]
    return f"EPSG:{code} ({crs.name})"


def same_plane(first: Any, second: Any) -> bool:
    """Tell whether two CRS have one map plane.

    Two spellings of one CRS agree, whatever the order of their axes and their vertical parts.
    """
    a, b = horizontal_crs(first), horizontal_crs(second)
    code = a.to_epsg()
    if a.equals(b, ignore_axis_order=True) or (code is not None and code == b.to_epsg()):
        return True
    # WKT 1 has no place for EPSG:4547's northing-easting axes: PROJ then finds whole and part
    # different, though the parts agree.
    if a.geodetic_crs is None or b.geodetic_crs is None:
        return False
    axes = (
        sorted((axis.direction, axis.unit_conversion_factor) for axis in crs.axis_info)
        for crs in (a, b)
    )
    return (
        a.geodetic_crs.equals(b.geodetic_crs, ignore_axis_order=True)
        and a.coordinate_operation == b.coordinate_operation
        and next(axes) == next(axes)
    )


def check_same_crs(a: Any, b: Any, what: str) -> None:
    """Refuse two CRS with different map planes, named such as "DOM and DSM"."""
    if same_plane(a, b):
        return
    first, second = horizontal_crs(a), horizontal_crs(b)
    raise RasterError(
        f"{what} differ in CRS: {describe_crs(first)} and {describe_crs(second)}",
        expected="one CRS",
        fix="reproject one of them, e.g. with gdalwarp",
    )


def to_lonlat(crs: Any, xy: ArrayLike) -> Floats:
    """Take coordinates (..., 2) of a CRS to WGS84 longitude and latitude in degrees."""
    return _transform_points(_transformer(horizontal_crs(crs), _WGS84), xy)


def from_lonlat(crs: Any, lonlat: ArrayLike) -> Floats:
    """Take WGS84 longitude and latitude (..., 2) to a CRS; the inverse of `to_lonlat`."""
    return _transform_points(_transformer(_WGS84, horizontal_crs(crs)), lonlat)


def change_of_plane(source: Any, target: Any) -> Callable[[Floats], Floats]:
    """Return a function that takes coordinates (..., 2) of one CRS to another.

    It leaves them as they are where the two have one plane, and goes through WGS84 otherwise.
    """
    if same_plane(source, target):
        return lambda xy: xy
    return lambda xy: from_lonlat(target, to_lonlat(source, xy))


def unwrap(lonlat: ArrayLike, about_lon: float) -> Floats:
    """Move longitudes by whole turns to within 180 degrees of one: none jumps at +-180."""
    given = np.asarray(lonlat, dtype=np.float64)
    turns = np.round((about_lon - given[..., 0]) / 360)
    return given + 360 * np.stack([turns, np.zeros_like(turns)], axis=-1)


def geodetic_to_ecef(lonlatheight: ArrayLike) -> Floats:
    """Take lon, lat (degrees), height (m) on WGS84, (..., 3), to ECEF metres (EPSG:4978)."""
    return _transform_points(_transformer(CRS.from_epsg(4979), CRS.from_epsg(4978)), lonlatheight)


def ecef_to_geodetic(xyz: ArrayLike) -> Floats:
    """Take ECEF metres (..., 3) to lon, lat (degrees), height (m) on WGS84 (EPSG:4979)."""
    return _transform_points(_transformer(CRS.from_epsg(4978), CRS.from_epsg(4979)), xyz)


def enu_axes(lonlat: ArrayLike) -> Floats:
    """Return rotations (N, 3, 3) from local ENU frames to ECEF: columns are east, north and up."""
    lon, lat = np.radians(np.asarray(lonlat, dtype=np.float64)).T
    east = (-np.sin(lon), np.cos(lon), np.zeros_like(lon))
    north = (-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat))
    up = (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat))
    return np.array((east, north, up)).T


def geodesic_distance_m(lonlat_a: ArrayLike, lonlat_b: ArrayLike, *, jobs: int = 1) -> Floats:
    """Return lengths of geodesics on the WGS84 ellipsoid, by PROJ (Karney 2013), in threads."""
    a, b = np.broadcast_arrays(
        np.asarray(lonlat_a, dtype=np.float64), np.asarray(lonlat_b, dtype=np.float64)
    )
    columns = [np.ascontiguousarray(end[..., axis]).ravel() for end in (a, b) for axis in (0, 1)]
    parts = zip(*(np.array_split(column, jobs) for column in columns), strict=True)
    geod = Geod(ellps="WGS84")
    with ThreadPoolExecutor(jobs) as pool:
        found = list(pool.map(lambda part: geod.inv(*part)[2], parts))
    return np.asarray(np.concatenate(found), np.float64).reshape(a.shape[:-1])


def great_circle_m(lonlat_a: Floats, lonlat_b: Floats) -> Floats:
    """Return lengths of great circles on a sphere with the earth's radius at the equator."""
    ends = (np.moveaxis(np.radians(end), -1, 0) for end in (lonlat_a, lonlat_b))
    (lon_a, lat_a), (lon_b, lat_b) = ends
    across = np.cos(lat_a) * np.cos(lat_b) * np.sin((lon_a - lon_b) / 2) ** 2
    haversine = np.sin((lat_a - lat_b) / 2) ** 2 + across
    return np.asarray(2 * _EQUATOR_M * np.arcsin(np.sqrt(np.minimum(haversine, 1.0))))


def scale_error(crs: Any, lonlat: ArrayLike) -> Floats:
    """Return the largest |k - 1| of Tissot's indicatrix over directions, as PROJ computes it.

    Source: Snyder, Map Projections: A Working Manual, 1987, section 4. Infinite beyond the CRS.
    """
    place = np.asarray(lonlat, dtype=np.float64)
    factors = Proj(horizontal_crs(crs)).get_factors(place[..., 0], place[..., 1])
    axes = np.stack((factors.tissot_semimajor, factors.tissot_semiminor), axis=-1)
    error = np.abs(axes - 1.0).max(axis=-1)
    return np.where(np.isfinite(error), error, np.inf)


def check_true_metres(crs: CRS, lonlat: ArrayLike, where: object) -> None:
    """Refuse a projected CRS with a scale that differs from 1 by 0.5 % or more at some place."""
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
    """Return the angle from true north to the north of a projected CRS, clockwise positive.

    An azimuth on the grid is the true azimuth less the convergence.
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


@lru_cache(maxsize=64)
def _transformer(source: CRS, target: CRS) -> Transformer:
    return Transformer.from_crs(source, target, always_xy=True)


def _transform_points(transformer: Transformer, points: ArrayLike) -> Floats:
    given = np.asarray(points, dtype=np.float64)
    columns: list[Any] = [given[..., axis].ravel() for axis in range(given.shape[-1])]
    moved = np.stack(transformer.transform(*columns), axis=-1).reshape(given.shape)
    # PROJ answers with infinity where it cannot, and looks at one coordinate at a time.
    usable = np.isfinite(given).all(axis=-1) & np.isfinite(moved).all(axis=-1)
    return np.where(usable[..., None], moved, np.nan)


# --- units of heights ---

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

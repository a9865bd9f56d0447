"""Coordinate reference systems (CRS): their map plane, whether two have the same, their names."""

from __future__ import annotations

from typing import Any

from pyproj import CRS
from pyproj.exceptions import CRSError

from airzoo_bench.core.errors import RasterError, UserError

__all__ = ["LOCAL_CRS", "check_same_crs", "describe_crs", "horizontal_crs", "same_plane"]

LOCAL_CRS = "local"
"""Names a frame in metres, z up, that has no place on the earth."""


def horizontal_crs(crs: Any) -> CRS:
    """Return the horizontal part of a CRS, given as anything pyproj takes.

    Parameters
    ----------
    crs : Any
        An EPSG code, ``"EPSG:4547"``, WKT, a PROJ string, a CRS of pyproj or rasterio.

    Returns
    -------
    CRS
        Of two axes.

    Raises
    ------
    UserError
        A CRS that PROJ does not know, or that is neither projected nor geographic.
    """
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


def check_same_crs(a: Any, b: Any, what: str) -> None:
    """Refuse two CRS whose map planes differ, see `same_plane`.

    Parameters
    ----------
    a, b : Any
        See `horizontal_crs`.
    what : str
        What the two belong to, such as ``"DOM and DSM"``.

    Raises
    ------
    RasterError
        They differ; both are named.
    UserError
        See `horizontal_crs`.
    """
    if same_plane(a, b):
        return
    first, second = horizontal_crs(a), horizontal_crs(b)
    raise RasterError(
        f"{what} differ in CRS: {describe_crs(first)} and {describe_crs(second)}",
        expected="one CRS",
        fix="reproject one of them, e.g. with gdalwarp",
    )


def same_plane(first: Any, second: Any) -> bool:
    """Whether two CRS have one map plane.

    They do when PROJ finds them equivalent, or gives them one EPSG code, or finds their
    datum, projection and units equivalent: two spellings of one CRS agree, whatever the order of
    their axes. A vertical part is left aside.

    Parameters
    ----------
    first, second : Any
        See `horizontal_crs`.

    Returns
    -------
    bool
        False where their coordinates differ.

    Raises
    ------
    UserError
        See `horizontal_crs`.
    """
    a, b = horizontal_crs(first), horizontal_crs(second)
    code = a.to_epsg()
    if a.equals(b, ignore_axis_order=True) or (code is not None and code == b.to_epsg()):
        return True
    # WKT 1 has no place for EPSG:4547's northing-easting axes: PROJ then finds whole and part
    # different, though the parts agree.
    if a.geodetic_crs is None or b.geodetic_crs is None:
        return False
    return (
        a.geodetic_crs.equals(b.geodetic_crs, ignore_axis_order=True)
        and a.coordinate_operation == b.coordinate_operation
        and _axes(a) == _axes(b)
    )


def _axes(crs: CRS) -> list[tuple[str, float]]:
    return sorted((axis.direction, axis.unit_conversion_factor) for axis in crs.axis_info)


def describe_crs(crs: CRS) -> str:
    """Name a CRS for messages: its EPSG code where it has one, and its name.

    Parameters
    ----------
    crs : CRS
        Of pyproj or rasterio.

    Returns
    -------
    str
        Such as "EPSG:32615 (WGS 84 / UTM zone 15N)".
    """
    code = crs.to_epsg()
    if code is None:
        return crs.name if crs.name != "unknown" else crs.to_string()[:80]
    return f"EPSG:{code} ({crs.name})"

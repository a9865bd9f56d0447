"""Which known mistake explains that positions or heights are off, said as the cause in warnings."""

from __future__ import annotations

import math

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.chinese_maps import wgs84_to_bd09, wgs84_to_gcj02
from airzoo_bench.geometry.datums import DatumChange
from airzoo_bench.geometry.frames import geodesic_distance_m
from airzoo_bench.geometry.vertical import geoid_at, how_to_install

__all__ = ["LEFT_M", "UNDULATION_M", "datum_cause", "height_cause", "position_cause"]

LEFT_M = 30.0
"""What a mistake may leave: two receivers, and where in the scene the photos are."""
_LEFT = 0.1
UNDULATION_M = 5.0
"""Between an offset and the undulation: receivers are that wrong in height, geoids far less."""

_SWAPPED = "with longitude and latitude swapped"
_CHINESE = {"GCJ-02, the shifted coordinates of Chinese maps": wgs84_to_gcj02}
_CHINESE |= {"BD-09, the shifted coordinates of Baidu's maps": wgs84_to_bd09}


def position_cause(gps: Floats, poses: Floats) -> str:
    """Name the mistake that explains how far positions are from poses; empty where none does.

    A mistake explains it where correcting it leaves (median) no more than 30 m and a tenth.

    Parameters
    ----------
    gps, poses : (N, 2) array
        Longitude, latitude as the photos (or a table of priors) state them, and of the poses; NaN
        where one has none.
    """
    most = min(LEFT_M, _LEFT * _apart_m(gps, poses))
    for cause, places in _corrected(gps, poses).items():
        left = _apart_m(*places)
        if left < most:
            return f"{cause} ({left:.0f} m would be left)"
    return ""


def _apart_m(first: Floats, second: Floats) -> float:
    """Median distance; infinite where none is known."""
    metres = geodesic_distance_m(first, second)
    known = metres[np.isfinite(metres)]
    return float(np.median(known)) if known.size else math.inf


def _corrected(gps: Floats, poses: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Return positions and poses with each mistake corrected, by what is to be said of it."""
    fit = "positions would fit"
    found = {
        f"{_SWAPPED} the {fit}": (gps[:, ::-1], poses),
        f"taken as radians the {fit}": (np.degrees(gps), poses),
        f"with longitudes of the other sign the {fit}": (gps * (-1.0, 1.0), poses),
        f"with latitudes of the other sign the {fit}": (gps * (1.0, -1.0), poses),
    }
    found = {cause: (_on_earth(first), second) for cause, (first, second) in found.items()}
    for name, shift in _CHINESE.items():
        like = f"as far and in the direction that {name}, lie from WGS84 here"
        maps = "poses, and the map and surface model that they come from, look like"
        found[f"{like}: {maps} {_short(name)}, GPS like WGS84"] = shift(gps), poses
        found[f"{like}: GPS or priors look like {_short(name)}, poses like WGS84"] = (
            gps,
            shift(poses),
        )
    return found


def _short(name: str) -> str:
    return name.partition(",")[0]


def _on_earth(lonlat: Floats) -> Floats:
    fine = (np.abs(lonlat) <= (360.0, 90.0)).all(axis=1, keepdims=True)
    return np.where(fine, lonlat, np.nan)


def height_cause(off_m: float, lonlat: Floats, first: str, second: str) -> str:
    """Say whether an offset in height is the geoid's undulation.

    Parameters
    ----------
    off_m : float
        Height of the first less that of the second.
    lonlat : (2,) array
        Of the scene.
    first, second : str
        What the heights are of, such as "poses".
    """
    geoid = geoid_at(lonlat)
    if geoid.undulation_m is None:
        return (
            "whether that is the geoid's undulation here cannot be said without its grid: "
            + how_to_install(geoid.grid)
        )
    above = f"{geoid.undulation_m:+.1f} m by {geoid.model}"
    for (high, low), left in (
        ((first, second), off_m - geoid.undulation_m),
        ((second, first), off_m + geoid.undulation_m),
    ):
        if abs(left) <= UNDULATION_M and abs(left) < abs(off_m) / 2:
            return (
                f"that is the geoid's undulation here ({above}) to {abs(left):.1f} m: {high} look "
                f"like heights above the ellipsoid, {low} like heights above sea level"
            )
    return f"that is not the geoid's undulation here ({above})"


def datum_cause(change: DatumChange) -> str:
    """Say how well PROJ gets from a datum to WGS84, and what would do better."""
    found = (
        f"PROJ knows no way from {change.datum} to WGS84 and takes one for the other, which may be "
        "off by hundreds of metres"
        if change.accuracy_m is None
        else f"PROJ gets from {change.datum} to WGS84 to {change.accuracy_m:g} m only"
    )
    return f"{found}; better with {how_to_install(change.grid)}" if change.grid else found

"""Whether a flight can be flown in a world: inside its region, above its ground and buildings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.frames import from_lonlat, to_lonlat
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.mini.world import CRS, Region

if TYPE_CHECKING:
    from airzoo_bench.mini.trajectory import Trajectory

__all__ = ["allowed_box", "check_inside", "surface"]

_ABOVE_SURFACE_M = 2.0
_BOX_DECIMALS = 6


def surface(region: Region, dsm: NDArray[np.float32]) -> HeightField:
    """Return a region's surface model with its place in `CRS`."""
    pixel = region.side_m / dsm.shape[1]
    return HeightField(dsm, Affine(pixel, 0.0, region.west, 0.0, -pixel, region.north), CRS)


def allowed_box(region: Region) -> tuple[float, float, float, float]:
    """West, south, east and north in WGS84 of a box, all of which lies in the region.

    The region is a square of the grid, which is turned against true north: the box is cut to what
    lies within whatever the latitude, to digits that people read.
    """
    ends = np.array((0.0, region.side_m))
    corners = np.stack(np.meshgrid(region.west + ends, region.south + ends), axis=-1)
    lon, lat = np.moveaxis(to_lonlat(CRS, corners), -1, 0)
    unit = 10.0**_BOX_DECIMALS
    west, south = (np.ceil(v * unit) / unit for v in (lon[:, 0].max(), lat[0].max()))
    east, north = (np.floor(v * unit) / unit for v in (lon[:, 1].min(), lat[1].min()))
    return float(west), float(south), float(east), float(north)


def check_inside(
    trajectory: Trajectory, region: Region, dsm: NDArray[np.float32], where: object = None
) -> None:
    """Refuse a flight that leaves the region, or goes below its surface.

    Parameters
    ----------
    trajectory : Trajectory
    region : Region
    dsm : (H, W) float32 array
        Heights of what is seen from above; its first row is in the north.
    where : object, optional
        The file the flight is from, for messages.

    Raises
    ------
    CameraError
        Positions outside the region, or lower than 2 m above the ground, roof or tree there;
        the first three are named. Every camera looking up, which a wrong sign of pitch makes.
    """
    xy = from_lonlat(CRS, trajectory.lonlat)
    _check_region(trajectory, region, xy, where)
    _check_heights(trajectory, surface(region, dsm).sample(xy), where)
    if (trajectory.pitch_deg > 0.0).all():
        raise CameraError(
            "every frame looks above the horizon",
            where=where,
            expected="pitch 0 at the horizon, -90 straight down",
            mend="change the sign of pitch",
        )


def _check_region(trajectory: Trajectory, region: Region, xy: Floats, where: object) -> None:
    outside = ~_inside(region, xy)
    if not outside.any():
        return
    swapped = _inside(region, from_lonlat(CRS, trajectory.lonlat[:, ::-1]))
    west, south, east, north = allowed_box(region)
    places = [f"{lon:.6f}, {lat:.6f}" for lon, lat in trajectory.lonlat]
    raise CameraError(
        f"outside the region {region.name}: {_named(trajectory.names, outside, places)}",
        where=where,
        expected=f"longitude {west:.6f} to {east:.6f}, latitude {south:.6f} to {north:.6f}",
        mend="longitude and latitude look swapped: exchange them"
        if swapped[outside].all()
        else "move the flight into the region",
    )


def _check_heights(trajectory: Trajectory, ground: Floats, where: object) -> None:
    # Where the surface has no height, nothing can be said against the flight.
    low = trajectory.altitude_m < ground + _ABOVE_SURFACE_M
    if not low.any():
        return
    heights = [
        f"at {altitude:.1f} m, surface {height:.1f} m"
        for altitude, height in zip(trajectory.altitude_m, ground, strict=True)
    ]
    raise CameraError(
        f"below the ground or inside a building or tree: {_named(trajectory.names, low, heights)}",
        where=where,
        expected=f"at least {_ABOVE_SURFACE_M:g} m above the surface",
        mend="fly higher; altitude is above the WGS84 ellipsoid, as the surface's heights are",
    )


def _inside(region: Region, xy: Floats) -> Bools:
    steps = xy - (region.west, region.south)
    return np.asarray(((steps >= 0.0) & (steps <= region.side_m)).all(axis=-1), dtype=np.bool_)


def _named(names: Sequence[str], bad: Bools, details: Sequence[str]) -> str:
    rows = np.flatnonzero(bad).tolist()
    return first_of([f"{names[row]} ({details[row]})" for row in rows], len(names))

"""Heights of poses and priors in the vertical CRS of the surface model."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.datasets.photo_options import HeightOptions
from airzoo_bench.datasets.sources import vertical_unit_m
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.vertical import changed_heights, heights_crs, stated_heights_crs

__all__ = [
    "check_accuracy",
    "heights_of_surface",
    "named_heights_crs",
    "surface_altitudes",
    "surface_centres",
    "surface_heights_crs",
]

_SAME_M = 1e-6  # one datum in two units


def surface_heights_crs(dsm: Path | None, named: str | None) -> CRS | None:
    """Return the vertical CRS of a surface model: the one named, else its own compound CRS's."""
    if named is None:
        return None if dsm is None else stated_heights_crs(open_info(dsm).crs)
    return named_heights_crs(named, f"--dsm-vertical {named}")


def named_heights_crs(named: str, option: str) -> CRS:
    """Return the vertical CRS that an option names, see `geometry.vertical.heights_crs`."""
    try:
        return heights_crs(named)
    except UserError as error:
        raise error.inside(option) from error


def heights_of_surface(
    heights_m: Floats, lonlat: Floats, source: CRS, surface: CRS | None, option: str
) -> tuple[Floats, str]:
    """Take heights to the vertical CRS of the surface model."""
    if surface is None:
        raise UsageError(
            "the vertical CRS of the surface model is not known",
            where=option,
            expected="what heights are to be converted to",
            fix="give --dsm-vertical, such as EPSG:5773 (EGM96), or leave this option out",
        )
    if source.equals(surface):
        return heights_m, ""
    try:
        changed, operation = changed_heights(heights_m, lonlat, source, surface)
    except UserError as error:
        raise error.inside(option) from error
    by = changed - heights_m
    by = by[np.isfinite(by)]
    if not (np.abs(by) > _SAME_M).any():
        return heights_m, ""
    return changed, f"{float(np.median(by)):+.2f} m (median; PROJ: {operation})"


def check_accuracy(options: HeightOptions) -> None:
    """Refuse a stated accuracy of the truth that is none."""
    accuracy = options.truth_accuracy
    if accuracy is not None and not 0.0 < accuracy < math.inf:
        raise UsageError(
            f"--truth-accuracy {accuracy:g} is no accuracy", expected="metres, greater than 0"
        )


def surface_centres(
    centres: Floats,
    named: str,
    crs: str,
    options: HeightOptions,
    dsm: Path | None,
    place: str,
) -> tuple[Floats, tuple[str, ...]]:
    """Return camera centres in metres, with heights as the surface model has them."""
    own = options.vertical_crs
    where = f"--vertical-crs {own}" if own else f"{place}, heights of {named}"
    stated = named_heights_crs(own, where) if own else stated_heights_crs(CRS(named))
    in_metres: Floats = centres * (1.0, 1.0, vertical_unit_m(own or named))
    surface = surface_heights_crs(dsm, options.dsm_vertical_crs)
    if stated is None or (own is None and surface is None):
        return in_metres, ()
    lonlat = to_lonlat(crs, in_metres[:, :2])
    heights, by = heights_of_surface(in_metres[:, 2], lonlat, stated, surface, where)
    return np.column_stack((in_metres[:, :2], heights)), _converted("heights of the poses", by)


def surface_altitudes(
    metadata: dict[str, PhotoPrior],
    named: str | None,
    option: str,
    options: HeightOptions,
    dsm: Path | None,
    what: str = "altitudes of the photos",
) -> tuple[dict[str, PhotoPrior], tuple[str, ...]]:
    """Return priors with altitudes as the surface model has heights, and what was done."""
    if named is None:
        return metadata, ()
    rows = [(prior.lon, prior.lat, prior.altitude_m) for prior in metadata.values()]
    values = np.array(rows, dtype=np.float64).reshape(-1, 3)
    surface = surface_heights_crs(dsm, options.dsm_vertical_crs)
    place = f"{option} {named}"
    source = named_heights_crs(named, place)
    heights, by = heights_of_surface(values[:, 2], values[:, :2], source, surface, place)
    found = {
        name: prior if prior.altitude_m is None else replace(prior, altitude_m=float(height))
        for (name, prior), height in zip(metadata.items(), heights, strict=True)
    }
    return found, _converted(what, by)


def _converted(what: str, by: str) -> tuple[str, ...]:
    return (f"{what} are converted to the surface model's, by {by}",) if by else ()

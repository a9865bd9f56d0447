"""Heights of poses and priors in the vertical CRS of the surface model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.datasets.metadata import PhotoPrior
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.vertical import (
    changed_heights,
    heights_crs,
    stated_heights_crs,
    vertical_m,
)

__all__ = ["surface_altitudes", "surface_centres"]

_SAME_M = 1e-6  # one datum in two units


def surface_centres(
    centres: Floats,
    named: str,
    crs: str,
    vertical: str | None,
    dsm: Path | None,
    dsm_vertical: str | None,
    place: str,
) -> tuple[Floats, tuple[str, ...]]:
    """Return camera centres in metres, with heights as the surface model has them, and a note.

    Centres are in the CRS `named`, of which `crs` is the horizontal part, and heights in its
    vertical CRS or in `vertical`; `place` is what states the CRS, for messages.
    """
    where = f"--vertical-crs {vertical}" if vertical else f"{place}, heights of {named}"
    stated = _named(vertical, where) if vertical else stated_heights_crs(CRS(named))
    unit = vertical_m(CRS.from_user_input(vertical or named)) or 1.0
    in_metres: Floats = centres * (1.0, 1.0, unit)
    surface = _of_surface(dsm, dsm_vertical)
    if stated is None or (vertical is None and surface is None):
        return in_metres, ()
    lonlat, what = to_lonlat(crs, in_metres[:, :2]), "heights of the poses"
    heights, note = _changed(in_metres[:, 2], lonlat, stated, surface, where, what)
    return np.column_stack((in_metres[:, :2], heights)), note


def surface_altitudes(
    metadata: dict[str, PhotoPrior],
    named: str | None,
    option: str,
    dsm: Path | None,
    dsm_vertical: str | None,
    what: str = "altitudes of the photos",
) -> tuple[dict[str, PhotoPrior], tuple[str, ...]]:
    """Return priors with altitudes as the surface model has heights, and a note."""
    if named is None:
        return metadata, ()
    rows = [(prior.lon, prior.lat, prior.altitude_m) for prior in metadata.values()]
    values = np.array(rows, dtype=np.float64).reshape(-1, 3)
    place, surface = f"{option} {named}", _of_surface(dsm, dsm_vertical)
    source = _named(named, place)
    heights, note = _changed(values[:, 2], values[:, :2], source, surface, place, what)
    found = {
        name: prior if prior.altitude_m is None else replace(prior, altitude_m=float(height))
        for (name, prior), height in zip(metadata.items(), heights, strict=True)
    }
    return found, note


def _of_surface(dsm: Path | None, named: str | None) -> CRS | None:
    """Return the vertical CRS of a surface model: the one named, else its own compound CRS's."""
    if named is None:
        return None if dsm is None else stated_heights_crs(open_info(dsm).crs)
    return _named(named, f"--dsm-vertical {named}")


def _named(named: str, option: str) -> CRS:
    try:
        return heights_crs(named)
    except UserError as error:
        raise error.inside(option) from error


def _changed(
    heights_m: Floats, lonlat: Floats, source: CRS, surface: CRS | None, option: str, what: str
) -> tuple[Floats, tuple[str, ...]]:
    """Take heights to the vertical CRS of the surface model."""
    if surface is None:
        raise UsageError(
            "the vertical CRS of the surface model is not known",
            where=option,
            expected="what heights are to be converted to",
            fix="give --dsm-vertical, such as EPSG:5773 (EGM96), or leave this option out",
        )
    if source.equals(surface):
        return heights_m, ()
    try:
        changed, operation = changed_heights(heights_m, lonlat, source, surface)
    except UserError as error:
        raise error.inside(option) from error
    by = changed - heights_m
    by = by[np.isfinite(by)]
    if not (np.abs(by) > _SAME_M).any():
        return heights_m, ()
    note = f"{what} are converted to the surface model's, by {float(np.median(by)):+.2f} m (median)"
    return changed, (f"{note}, by PROJ's {operation}",)

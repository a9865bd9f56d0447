"""Heights of poses and priors in the vertical CRS of the surface model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.vertical import changed_heights, heights_crs, stated_heights_crs

__all__ = ["heights_of_surface", "named_heights_crs", "surface_heights_crs"]

_SAME_M = 1e-6  # one datum in two units


def surface_heights_crs(dsm: Path, named: str | None) -> CRS | None:
    """Return the vertical CRS of a surface model: the one named, else its own compound CRS's.

    Raises
    ------
    UserError
        PROJ does not know the one that is named, or it has no heights.
    """
    if named is None:
        return stated_heights_crs(open_info(dsm).crs)
    return named_heights_crs(named, f"--dsm-vertical-crs {named}")


def named_heights_crs(named: str, option: str) -> CRS:
    """Return the vertical CRS that an option names, see `geometry.vertical.heights_crs`.

    Raises
    ------
    UserError
        There is none; the message says which option.
    """
    try:
        return heights_crs(named)
    except UserError as error:
        raise error.inside(option) from error


def heights_of_surface(
    heights_m: Floats, lonlat: Floats, source: CRS, surface: CRS | None, option: str
) -> tuple[Floats, str]:
    """Take heights to the vertical CRS of the surface model.

    Parameters
    ----------
    heights_m : (N,) array
    lonlat : (N, 2) array
    source : CRS
        The heights', see `geometry.vertical.heights_crs`.
    surface : CRS or None
        See `surface_heights_crs`.
    option : str
        Where the source is stated, for messages.

    Returns
    -------
    heights_m : (N,) array
    note : str
        What was done; empty where both are one.

    Raises
    ------
    UserError
        The surface model's is not known, or PROJ cannot do it exactly.
    """
    if surface is None:
        raise UsageError(
            "the vertical CRS of the surface model is not known",
            where=option,
            expected="what heights are to be converted to",
            fix="give --dsm-vertical-crs, such as EPSG:5773 (EGM96), or leave this option out",
        )
    if source.equals(surface):
        return heights_m, ""
    try:
        changed = changed_heights(heights_m, lonlat, source, surface)
    except UserError as error:
        raise error.inside(option) from error
    by = changed.heights_m - heights_m
    by = by[np.isfinite(by)]
    if not (np.abs(by) > _SAME_M).any():
        return heights_m, ""
    accuracy = f", good to {changed.accuracy_m:g} m" if changed.accuracy_m is not None else ""
    return changed.heights_m, (
        f"{float(np.median(by)):+.2f} m (median; PROJ: {changed.operation}{accuracy})"
    )

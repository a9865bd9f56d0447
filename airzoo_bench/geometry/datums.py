"""How well PROJ can take a CRS to WGS84 at a place, with the grids that are installed."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyproj import CRS
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

from airzoo_bench.geometry.crs import horizontal_crs

__all__ = ["DatumChange", "datum_change", "same_datum"]

_MARGIN_DEG = 0.01
# Datums of which PROJ knows no operation and that lie within a metre of WGS84: CGCS2000 is ITRF97
# at the epoch 2000.0, from which China has moved by 0.03 m a year.
_AS_WGS84_M = {"China 2000": 1.0}


@dataclass(frozen=True)
class DatumChange:
    """What PROJ does to get from a CRS to WGS84.

    Attributes
    ----------
    datum : str
        Of the CRS.
    accuracy_m : float or None
        None where PROJ knows no operation and takes coordinates of one datum for those of the
        other ("ballpark"): the error may be hundreds of metres.
    grid : str
        A file that a better operation needs and that is not installed; empty where none does.
    """

    datum: str
    accuracy_m: float | None
    grid: str

    def worse_than(self, metres: float) -> bool:
        """Whether errors larger than so many metres are to be expected.

        Parameters
        ----------
        metres : float
            The largest error that would do.

        Returns
        -------
        bool
            True where nothing is known.
        """
        return self.accuracy_m is None or self.accuracy_m > metres


def datum_change(crs: Any, lonlat: ArrayLike) -> DatumChange:
    """Look up what PROJ does to get from a CRS to WGS84 about a place.

    Parameters
    ----------
    crs : Any
        See `crs.horizontal_crs`.
    lonlat : (2,) array
        Degrees.

    Returns
    -------
    DatumChange
        Of the best operation that is installed.

    Raises
    ------
    UserError
        See `crs.horizontal_crs`.
    """
    plane, (lon, lat) = horizontal_crs(crs), map(float, np.asarray(lonlat, dtype=np.float64))
    around = AreaOfInterest(
        lon - _MARGIN_DEG, lat - _MARGIN_DEG, lon + _MARGIN_DEG, lat + _MARGIN_DEG
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Best transformation is not available", UserWarning)
        area: Any = around
        group = TransformerGroup(plane, 4326, always_xy=True, area_of_interest=area)
    stated = group.transformers[0].accuracy if group.transformers else -1.0
    known = None if stated is None or stated < 0.0 else float(stated)
    datum = _geodetic(plane).datum
    name = "unknown" if datum is None else datum.name
    lacking = [
        grid.short_name
        for operation in group.unavailable_operations
        if known is None or 0.0 <= operation.accuracy < known
        for part in (operation, *operation.operations)
        for grid in part.grids
        if not grid.available
    ]
    return DatumChange(
        name, _AS_WGS84_M.get(name) if known is None else known, "".join(lacking[:1])
    )


def same_datum(first: Any, second: Any) -> bool:
    """Whether PROJ gets from one CRS to the other without a change of datum.

    Parameters
    ----------
    first, second : Any
        See `crs.horizontal_crs`.

    Returns
    -------
    bool
        Whether their geodetic CRS are one, whatever the order of axes.
    """
    a, b = _geodetic(horizontal_crs(first)), _geodetic(horizontal_crs(second))
    return bool(a.equals(b, ignore_axis_order=True))


def _geodetic(plane: CRS) -> CRS:
    return plane.geodetic_crs or plane

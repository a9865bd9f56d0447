"""Flights over the city, by hand and drawn at random."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from pyproj import Transformer

from airzoo_bench.datasets.mini.flights import (
    Trajectory,
)
from airzoo_bench.datasets.mini.world.model import CRS, REGIONS

CITY = REGIONS["city"]


TO_LONLAT = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)


def over_city(east: list[float], north: list[float], altitude: list[float]) -> Trajectory:
    """Return a flight through places of the city, looking obliquely down."""
    lonlat = np.array(
        [
            TO_LONLAT.transform(CITY.west + e, CITY.south + n)
            for e, n in zip(east, north, strict=True)
        ]
    )
    count = len(east)
    level = np.zeros(count)
    return Trajectory(
        tuple(f"f{k}" for k in range(count)),
        np.arange(count, dtype=float),
        lonlat,
        np.array(altitude, dtype=float),
        level,
        level - 45.0,
        level,
    )


def angles(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def flights(draw: st.DrawFn) -> Trajectory:
    count = draw(st.integers(1, 5))

    def column(low: float, high: float) -> np.ndarray:
        return np.array([draw(angles(low, high)) for _ in range(count)])

    return Trajectory(
        tuple(f"a{k}" for k in range(count)),
        np.cumsum(column(0.01, 10.0)),
        np.stack((column(112.0, 115.0), column(27.0, 29.0)), axis=-1),
        column(-100.0, 500.0),
        column(-30.0, 30.0),
        column(-89.0, 20.0),
        column(-180.0, 179.9),
    )

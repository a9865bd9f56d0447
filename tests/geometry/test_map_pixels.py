"""Pixels of a map that crosses the 180th meridian, in any CRS that goes round the earth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer
from rasterio import Affine

from airzoo_bench.geometry.map_pixels import to_map_pixels
from airzoo_bench.geometry.rasters import RasterInfo

# Degrees of datums that PROJ reaches from WGS84 by grids or in their own country only, and maps on
# upright cylinders.
ROUND = (4326, 4284, 4301, 4087, 32662, 6933, 3395, 3832)


@pytest.mark.parametrize("crs", ROUND)
@pytest.mark.parametrize("middle_lon", [180.0, -180.0])
def test_places_on_both_sides_are_on_the_map(crs: int, middle_lon: float) -> None:
    own = CRS(crs).geodetic_crs
    to_map = Transformer.from_crs(own, crs, always_xy=True)
    one, two = (to_map.transform(lon, 65.0)[0] for lon in (100.0, 101.0))
    y, degree = to_map.transform(100.0, 65.0)[1], two - one
    step = 1e-4 * degree
    left = one + (middle_lon - 100.0) * degree - 500 * step
    raster = RasterInfo(
        Path("map.tif"), 1000, 10, Affine(step, 0, left, 0, -step, y), CRS(crs), None, 1, "uint8"
    )
    lon = np.array([-179.99, -179.96, 179.96, 179.99])
    pixels = to_map_pixels(own, raster)(np.stack((lon, np.full(4, 65.0)), axis=-1))
    np.testing.assert_allclose(pixels[:, 0], [600, 900, 100, 400], atol=1e-3)
    np.testing.assert_allclose(pixels[:, 1], 0, atol=1e-3)


@pytest.mark.parametrize("crs", [32660, 4547, 3031, 8857])
def test_others_stay_where_proj_has_them(crs: int) -> None:
    raster = RasterInfo(
        Path("map.tif"), 10, 10, Affine(1, 0, 1e9, 0, -1, 0), CRS(crs), None, 1, "uint8"
    )
    xy = np.array([[500_000.0, 4_000_000.0]])
    found = to_map_pixels(crs, raster)(xy)
    np.testing.assert_allclose(found, [[500_000 - 1e9, -4_000_000]])

"""GCJ-02 and BD-09 against coordinates that others published."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.geometry.chinese_maps import wgs84_to_bd09, wgs84_to_gcj02

# WGS84 and shifted (longitude, latitude), as the tests of eviltransform state them.
GCJ02 = {
    "Shanghai": ((121.5272106, 31.1774276), (121.531541859215, 31.17530398364597)),
    "Shenzhen": ((113.912316, 22.543847), (113.9171764808363, 22.540796131694766)),
    "Beijing": ((116.377817, 39.911954), (116.38404722455657, 39.91334545536069)),
}
# As coordtransform has it, by way of GCJ-02.
BEIJING = (116.404, 39.915)
BEIJING_GCJ02 = (116.41024449916938, 39.91640428150164)
BEIJING_BD09 = (116.41662724378733, 39.922699552216216)


@pytest.mark.parametrize("city", GCJ02)
def test_gcj02_is_as_published(city: str) -> None:
    given, shifted = GCJ02[city]
    np.testing.assert_allclose(wgs84_to_gcj02(given), shifted, rtol=0, atol=1e-9)


def test_bd09_is_as_published() -> None:
    np.testing.assert_allclose(wgs84_to_gcj02(BEIJING), BEIJING_GCJ02, rtol=0, atol=1e-9)
    np.testing.assert_allclose(wgs84_to_bd09(BEIJING), BEIJING_BD09, rtol=0, atol=1e-9)


def test_nothing_moves_elsewhere() -> None:
    places = np.array([(13.4, 52.5), (-74.0, 40.7), (150.0, -33.0), (np.nan, 30.0)])
    np.testing.assert_array_equal(wgs84_to_gcj02(places), places)
    np.testing.assert_array_equal(wgs84_to_bd09(places), places)


def test_places_may_come_in_any_shape() -> None:
    places = np.array([given for given, _ in GCJ02.values()])
    stacked = wgs84_to_gcj02(places.reshape(3, 1, 2))
    np.testing.assert_array_equal(stacked.reshape(3, 2), wgs84_to_gcj02(places))

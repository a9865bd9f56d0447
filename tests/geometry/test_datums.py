"""What PROJ says of its own accuracy between datums, without any grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.geometry.datums import datum_change, same_datum
from airzoo_bench.geometry.frames import geodesic_distance_m, to_lonlat
from tests.geoids import proj_with


@pytest.mark.parametrize(
    ("crs", "place", "datum", "accuracy_m"),
    [
        ("EPSG:32650", (117.0, 40.0), "World Geodetic System 1984 ensemble", 0.0),
        ("EPSG:4490", (114.0, 30.0), "China 2000", 1.0),
        ("EPSG:4547", (114.0, 30.0), "China 2000", 1.0),
        ("EPSG:25833", (15.0, 52.0), "European Terrestrial Reference System 1989 ensemble", 1.0),
        ("EPSG:2437", (120.0, 40.0), "Beijing 1954", None),
    ],
)
def test_the_accuracy_is_told(
    tmp_path: Path,
    crs: str,
    place: tuple[float, float],
    datum: str,
    accuracy_m: float | None,
) -> None:
    with proj_with(tmp_path):
        change = datum_change(crs, place)
    assert (change.datum, change.accuracy_m) == (datum, accuracy_m)


@pytest.mark.parametrize(
    ("crs", "place"), [("EPSG:26715", (-93.0, 45.0)), ("EPSG:27700", (-1, 52))]
)
def test_a_grid_that_would_do_better_is_named(
    tmp_path: Path, crs: str, place: tuple[float, float]
) -> None:
    with proj_with(tmp_path):
        change = datum_change(crs, place)
    assert change.worse_than(1.0)
    assert change.grid.endswith(".tif")


def test_none_is_worse_than_all() -> None:
    change = datum_change("EPSG:2437", (120.0, 40.0))
    assert change.worse_than(1e6)
    assert not datum_change("EPSG:4547", (114.0, 30.0)).worse_than(1.0)


def test_cgcs2000_coordinates_are_taken_for_those_of_wgs84() -> None:
    # Gauss-Krueger about 114 degrees and UTM on the same ellipsoid but for 0.1 mm.
    xy = np.array([500_000.0, 3_320_000.0])
    on_wgs84 = "+proj=tmerc +lat_0=0 +lon_0=114 +k=1 +x_0=500000 +y_0=0 +ellps=WGS84 +type=crs"
    apart = geodesic_distance_m(to_lonlat("EPSG:4547", xy), to_lonlat(on_wgs84, xy))
    assert apart < 0.001


def test_projections_of_one_datum_need_no_change() -> None:
    assert same_datum("EPSG:32633", "EPSG:4326")
    assert same_datum("EPSG:4547", "EPSG:4490")
    assert not same_datum("EPSG:4547", "EPSG:32650")

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS, Geod, Proj, Transformer

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.crs import (
    check_true_metres,
    ecef_to_geodetic,
    enu_axes,
    geodesic_distance_m,
    geodetic_to_ecef,
    grid_convergence_deg,
    scale_error,
)
from airzoo_bench.geometry.heightfield import (
    HeightField,
    blocked_heights,
    median_height,
    survey_heights,
)
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.solving import lift
from tests.geometry.support import write_tif

# WGS84 by definition: semi-major axis, flattening.
A = 6378137.0
B = A * (1.0 - 1.0 / 298.257223563)
DULUTH, VIENNA = (-92.0, 46.8), (16.4, 48.2)


def test_ecef_by_the_textbook() -> None:
    lon, lat, height = np.radians(112.93), np.radians(28.2), 77.0
    squared = 1.0 - (B / A) ** 2
    normal = A / np.sqrt(1.0 - squared * np.sin(lat) ** 2)
    flat, up = (normal + height) * np.cos(lat), ((B / A) ** 2 * normal + height) * np.sin(lat)
    expected = (flat * np.cos(lon), flat * np.sin(lon), up)
    np.testing.assert_allclose(geodetic_to_ecef((112.93, 28.2, 77.0)), expected, rtol=0, atol=1e-8)


def test_geodesic_distances() -> None:
    # A degree of longitude on the equator is a pi / 180; a quarter meridian is 10,001,965.729 m.
    measured = geodesic_distance_m([(0, 0), (0, 0)], [(1, 0), (0, 90)])
    np.testing.assert_allclose(measured, (np.pi * A / 180.0, 10001965.7293), rtol=0, atol=1e-4)
    assert geodesic_distance_m(np.zeros((4, 1, 2)), np.ones((3, 2))).shape == (4, 3)


def test_enu_points_the_way_the_globe_does() -> None:
    place = np.array((112.93, 28.2, 50.0))
    (axes,) = enu_axes(place[None, :2])
    steps = ecef_to_geodetic(geodetic_to_ecef(place) + 10.0 * axes.T) - place
    assert (steps[[0, 1], [0, 1]] > 0).all()
    assert (np.abs(steps[[0, 1], [1, 0]]) < 1e-9).all()
    np.testing.assert_allclose(steps[2], (0.0, 0.0, 10.0), rtol=0, atol=1e-8)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("crs", "place"),
    [(32615, DULUTH), (32633, VIENNA), (31256, VIENNA), (32610, DULUTH), (3035, VIENNA)],
)
def test_scale_is_that_of_geodesics(crs: int, place: tuple[float, float]) -> None:
    # The oracle: the length on the ellipsoid of steps of 10 m on the map, in all directions. Datum
    # shifts stretch by 1e-4 themselves.
    to_map = Transformer.from_crs(4326, crs, always_xy=True)
    angle = np.radians(np.arange(0, 360, 5))
    x, y = to_map.transform(*place)
    ends = to_map.transform(x + 10 * np.cos(angle), y + 10 * np.sin(angle), direction="INVERSE")
    start = np.broadcast_to(place, (len(angle), 2)).T
    metres = np.array(Geod(ellps="GRS80").inv(*start, *ends)[2])
    assert scale_error(crs, place) == pytest.approx(np.abs(10 / metres - 1).max(), abs=2e-4)


TRUE_METRES = [(32615, DULUTH), (4547, (113.0, 28.2)), (2056, (7.4, 46.9)), (3857, (10, 0.5))]
OTHERS = [(3857, DULUTH), (3857, (10.0, 6.0)), (32615, VIENNA), (3395, VIENNA)]


@pytest.mark.parametrize(("crs", "place"), TRUE_METRES + OTHERS)
def test_a_scale_other_than_one_is_refused(crs: int, place: tuple[float, float]) -> None:
    refused = pytest.raises(CameraError, match=r"poses\.json: coordinates of EPSG:\d+ ")
    with nullcontext() if (crs, place) in TRUE_METRES else refused:
        check_true_metres(CRS(crs), [place], "poses.json")


@pytest.mark.parametrize(
    ("crs", "lon", "lat"),
    [
        (4547, 112.3, 28.2),  # west of the central meridian, 114 E
        (4547, 115.2, 28.2),
        (32615, -91.99, 46.84),
        (32756, 151.2, -33.9),
        (2154, 7.2, 43.7),  # conic
        (3031, 60.0, -75.0),  # polar
    ],
)
def test_convergence_against_proj(crs: int, lon: float, lat: float) -> None:
    found = grid_convergence_deg(crs, (lon, lat))
    expected = Proj(crs).get_factors(lon, lat).meridian_convergence
    assert found == pytest.approx(expected, abs=1e-7)


# --- units of heights ---

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937


@pytest.mark.parametrize(
    ("crs", "unit", "metres"),
    [
        ("EPSG:32615", None, 1.0),
        ("EPSG:32615", "Metre", 1.0),
        ("EPSG:32615", " Feet ", FOOT),
        ("EPSG:32615", "us-ft", SURVEY_FOOT),
        ("EPSG:32615+6360", None, SURVEY_FOOT),
        ("EPSG:32615+6360", "US survey foot", SURVEY_FOOT),
    ],
)
def test_every_reader_of_heights_makes_metres(
    crs: str, unit: str | None, metres: float, tmp_path: Path
) -> None:
    path = write_tif(tmp_path / "dsm.tif", np.full((6, 8), 100.0, np.float32), crs=crs)
    if unit is not None:
        with rasterio.open(path, "r+") as dataset:
            dataset.units = (unit,)
    wanted = pytest.approx(100.0 * metres, rel=1e-12)
    assert median_height(path) == wanted
    field = HeightField.read(path)
    assert field.heights[2, 3] == wanted
    with blocked_heights(path) as lazy:
        assert lazy.heights_at(np.array([3]), np.array([2]))[0] == wanted
        assert lazy.height_range == (wanted, wanted)
    found = survey_heights(path, 0.0, 1000.0)
    assert (found.low, found.high, found.valid) == (wanted, wanted, found.pixels)
    assert lift([[3.5, 2.5]], open_info(path), path, jobs=1).points[0, 2] == wanted

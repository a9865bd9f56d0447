"""Metres are metres: the scale of projections, and the units of heights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import CRS, Geod, Transformer

from airzoo_bench.core.errors import CameraError, RasterError
from airzoo_bench.geometry.blocks import blocked_heights, median_height, survey_heights
from airzoo_bench.geometry.heightfield import HeightField, metres_of
from airzoo_bench.geometry.missing_heights import nearest_heights
from airzoo_bench.geometry.rasters import open_info, opened
from airzoo_bench.geometry.units import check_true_metres, scale_error, vertical_m
from airzoo_bench.matching.lifting import lift
from tests.geometry.support import write_tif

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937
DULUTH, VIENNA = (-92.0, 46.8), (16.4, 48.2)


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


@pytest.mark.parametrize(
    ("crs", "place", "true"),
    [
        (32615, DULUTH, True),
        (4547, (113.0, 28.2), True),
        (2056, (7.4, 46.9), True),
        (3857, DULUTH, False),
        (3857, (16.0, 47.8), False),
        (3857, (10.0, 0.5), True),
        (3857, (10.0, 6.0), False),
        (32615, VIENNA, False),
        (3395, VIENNA, False),
    ],
)
def test_a_scale_of_one_or_refused(crs: int, place: tuple[float, float], true: bool) -> None:
    if true:
        check_true_metres(CRS(crs), [place], "poses.json")
        return
    with pytest.raises(
        CameraError, match=r"poses\.json: coordinates of EPSG:\d+ .* no metres here"
    ):
        check_true_metres(CRS(crs), [place], "poses.json")


def tif(path: Path, crs: str, unit: str | None, value: float = 100.0, **profile: Any) -> Path:
    import rasterio

    write_tif(path, np.full((6, 8), value, np.float32), crs=crs, **profile)
    if unit is not None:
        with rasterio.open(path, "r+") as dataset:
            dataset.units = (unit,)
    return path


@pytest.mark.parametrize(
    ("crs", "unit", "metres"),
    [
        ("EPSG:32615", None, 1.0),
        ("EPSG:32615", "m", 1.0),
        ("EPSG:32615", "Metre", 1.0),
        ("EPSG:32615", "ft", FOOT),
        ("EPSG:32615", " Feet ", FOOT),
        ("EPSG:32615", "US survey foot", SURVEY_FOOT),
        ("EPSG:32615", "us-ft", SURVEY_FOOT),
        ("EPSG:32615", "cm", 0.01),
        ("EPSG:32615+5703", None, 1.0),
        ("EPSG:32615+6360", None, SURVEY_FOOT),
        ("EPSG:32615+6360", "US survey foot", SURVEY_FOOT),
    ],
)
def test_every_reader_of_heights_makes_metres(
    crs: str, unit: str | None, metres: float, tmp_path: Path
) -> None:
    path = tif(tmp_path / "dsm.tif", crs, unit)
    wanted = pytest.approx(100.0 * metres, rel=1e-12)
    assert median_height(path) == wanted
    field = HeightField.read(path)
    assert field.heights[2, 3] == wanted
    info = open_info(path)
    with blocked_heights(path) as lazy:
        assert lazy.heights_at(np.array([3]), np.array([2]))[0] == wanted
        assert lazy.height_range == (wanted, wanted)
        xy = np.array(info.transform @ (3.5, 2.5))
        assert nearest_heights(lazy, 100)(xy[None])[0] == wanted
    found = survey_heights(path, 0.0, 1000.0)
    assert (found.low, found.high, found.valid_share) == (wanted, wanted, 1.0)
    assert lift([[3.5, 2.5]], info, path, jobs=1).points[0, 2] == wanted


def test_scale_and_offset_are_in_the_unit_of_the_file(tmp_path: Path) -> None:
    import rasterio

    path = tif(tmp_path / "dsm.tif", "EPSG:32615", "ft")
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.5,), (10.0,)
    with opened(path) as dataset:
        assert metres_of(dataset) == (0.5 * FOOT, 10.0 * FOOT)
    assert median_height(path) == pytest.approx(60.0 * FOOT)
    assert HeightField.read(path).heights[0, 0] == pytest.approx(60.0 * FOOT)


@pytest.mark.parametrize(
    ("crs", "unit", "said"),
    [
        ("EPSG:32615", "degree", "'degree', which is no known unit of length"),
        ("EPSG:32615+5703", "ft", "two units of height: the band's is ft"),
        ("EPSG:32615+6360", "m", "two units of height"),
        ("EPSG:32615+6360", "ft", "two units of height"),
    ],
)
def test_units_that_contradict_are_refused(crs: str, unit: str, said: str, tmp_path: Path) -> None:
    path = tif(tmp_path / "dsm.tif", crs, unit)
    with pytest.raises(RasterError, match=said) as caught:
        HeightField.read(path)
    assert "dsm.tif" in str(caught.value)
    with pytest.raises(RasterError, match=said):
        median_height(path)


def test_depths_are_no_heights() -> None:
    assert vertical_m(CRS("EPSG:32615")) is None
    assert vertical_m(CRS("EPSG:4979")) == 1.0
    with pytest.raises(RasterError, match="counts depths"):
        vertical_m(CRS("EPSG:32615+5715"))


def test_a_survey_counts(tmp_path: Path) -> None:
    heights = np.arange(48, dtype=np.float32).reshape(6, 8)
    heights[0, :3] = (-9999, np.nan, 4.0)
    heights[5, 5:] = 4.0
    path = write_tif(tmp_path / "dsm.tif", heights, nodata=-9999)
    found = survey_heights(path, 5.0, 40.0)
    assert (found.pixels, found.valid, found.low, found.high) == (48, 46, 3.0, 44.0)
    assert (found.at_low, found.beyond) == (1, 1 + 2 + 3 + 4)
    heights[:] = np.nan
    nothing = survey_heights(write_tif(tmp_path / "none.tif", heights), 5.0, 40.0)
    assert (nothing.valid, nothing.at_low, nothing.beyond) == (0, 0, 0)
    assert np.isnan([nothing.low, nothing.high]).all()


@pytest.mark.parametrize("most_px", [10_000, 500, 7])
def test_the_nearest_height_by_brute_force(most_px: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    heights = rng.normal(size=(40, 50)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.7] = np.nan
    path = write_tif(tmp_path / "dsm.tif", heights)
    step = next(k for k in range(1, 60) if -(-40 // k) * -(-50 // k) <= most_px)
    rows, columns = np.meshgrid(
        np.arange(min(step // 2, 39), 40, step),
        np.arange(min(step // 2, 49), 50, step),
        indexing="ij",
    )
    known = ~np.isnan(heights[rows, columns])
    rows, columns = rows[known], columns[known]
    pixels = rng.uniform(-30, 80, (200, 2))
    # Corners of four pixels, equally near to all: the first in row-major order counts.
    pixels[:50] = rng.integers(1, 39, (50, 2))
    away = (pixels[:, :1] - columns - 0.5) ** 2 + (pixels[:, 1:] - rows - 0.5) ** 2
    first = np.argmin(away, axis=1)
    wanted = heights[rows[first], columns[first]] if len(rows) else np.full(200, np.nan)
    info = open_info(path)
    xy = np.stack([np.array(info.transform @ tuple(p)) for p in pixels])
    for made in (HeightField.read(path), None):
        with blocked_heights(path) as lazy:
            found = nearest_heights(made or lazy, most_px)(xy)
        np.testing.assert_array_equal(found, wanted)
    field = HeightField.read(path)
    assert np.isnan(nearest_heights(field, most_px)(np.array([[np.nan, 0.0]]))).all()
    field.heights[:] = np.nan
    assert np.isnan(nearest_heights(field, most_px)(xy)).all()

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from rasterio import Affine
from rasterio.enums import ColorInterp

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    gsd_m,
    open_info,
    pixel_to_world,
    read_rgb,
    to_map_pixels,
)

from .support import write_tif

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4)


def test_grid_agrees_with_rasterio(tmp_path: Path) -> None:
    transform = Affine(0.3, 0.1, 576000, 0.2, -0.4, 5188000)
    path = write_tif(tmp_path / "a.tif", GREY, transform=transform)
    with rasterio.open(path) as dataset:
        for row, column in ((0, 0), (2, 3)):
            centre = pixel_to_world(transform, (column + 0.5, row + 0.5))
            np.testing.assert_allclose(centre, dataset.xy(row, column), rtol=0, atol=1e-9)
            assert dataset.index(*centre) == (row, column)


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ({"transform": Affine.identity()}, "no georeference"),
        ({"crs": None}, "no CRS"),
        ({"transform": Affine(0.5, 1.0, 9.0, 0.5, 1.0, 9.0)}, "no georeference"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_files_without_georeference(tmp_path: Path, profile: dict, message: str) -> None:
    path = write_tif(tmp_path / "a.tif", GREY, **profile)
    with pytest.raises(RasterError, match=message) as caught:
        open_info(path)
    assert str(path) in str(caught.value)


def test_gsd_is_true_ground(tmp_path: Path) -> None:
    # UTM at its central meridian (x = 500 km): 0.5 m of the grid are 0.5 / 0.9996 m.
    path = write_tif(tmp_path / "u.tif", GREY, transform=Affine(0.5, 0, 499999, 0, -0.5, 5188000))
    np.testing.assert_allclose(gsd_m(open_info(path)), (0.5 / 0.9996,) * 2, rtol=1e-7)
    # A second of arc at 60 N: N cos(lat) = a cos / sqrt(1 - e^2 sin^2) east,
    # a (1 - e^2) / (1 - e^2 sin^2)^1.5 north; e^2 = 0.00669438, sin^2 = 0.75.
    second = 1 / 3600
    corner = Affine(second, 0, 10 - 2 * second, 0, -second, 60 + 1.5 * second)
    path = write_tif(tmp_path / "g.tif", GREY, crs="EPSG:4326", transform=corner)
    root = np.sqrt(1 - 0.00669437999014 * 0.75)
    arc = np.radians(second) * 6378137.0
    expected = (arc * 0.5 / root, arc * (1 - 0.00669437999014) / root**3)
    np.testing.assert_allclose(gsd_m(open_info(path)), expected, rtol=1e-7)
    # Web Mercator stretches by 1 / cos(lat) of the sphere: about 2 at 60 N (y = 8399737.89).
    corner = Affine(1, 0, 0, 0, -1, 8399737.889818357 + 1.5)
    path = write_tif(tmp_path / "m.tif", GREY, crs="EPSG:3857", transform=corner)
    expected = (0.5 / root, 0.5 * (1 - 0.00669437999014) / root**3)
    np.testing.assert_allclose(gsd_m(open_info(path)), expected, rtol=1e-6)


def test_rgb_of_grey_alpha_and_named_bands(tmp_path: Path) -> None:
    bands = np.stack((GREY, GREY + 50, GREY + 100, np.full_like(GREY, 255)))
    rgb = np.moveaxis(bands[:3], 0, -1)
    assert np.array_equal(read_rgb(write_tif(tmp_path / "4.tif", bands)), rgb)
    assert np.array_equal(read_rgb(write_tif(tmp_path / "3.tif", bands[:3])), rgb)
    grey = np.repeat(GREY[..., None], 3, axis=-1)
    assert np.array_equal(read_rgb(write_tif(tmp_path / "1.tif", GREY)), grey)
    assert np.array_equal(read_rgb(write_tif(tmp_path / "2.tif", bands[[0, 3]])), grey)
    path = write_tif(tmp_path / "bgr.tif", bands[[2, 1, 0]])
    with rasterio.open(path, "r+") as dataset:
        dataset.colorinterp = (ColorInterp.blue, ColorInterp.green, ColorInterp.red)
    assert np.array_equal(read_rgb(path), rgb)


@pytest.mark.parametrize("middle", [180.0, -180.0])
def test_places_on_both_sides_of_the_180th_meridian(middle: float) -> None:
    transform = Affine(1e-4, 0, middle - 0.05, 0, -1e-4, 65.0)
    raster = RasterInfo(Path("map.tif"), 1000, 10, transform, CRS(4326), None, 1, "uint8")
    lon = np.array([-179.99, -179.96, 179.96, 179.99])
    pixels = to_map_pixels(4326, raster)(np.stack((lon, np.full(4, 65.0)), axis=-1))
    np.testing.assert_allclose(pixels[:, 0], [600, 900, 100, 400], atol=1e-3)
    np.testing.assert_allclose(pixels[:, 1], 0, atol=1e-3)


def test_settings_of_a_machine_move_no_pixel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GDAL would put a GeoTIFF of points half a pixel aside, under the same checksum."""
    path = write_tif(tmp_path / "points.tif", np.zeros((4, 5), np.float32))
    with rasterio.open(path, "r+") as dataset:
        dataset.update_tags(AREA_OR_POINT="Point")
        dataset.transform = Affine(2, 0, 1000, 0, -2, 5000)
    usual = open_info(path).transform
    monkeypatch.setenv("GTIFF_POINT_GEO_IGNORE", "TRUE")
    with rasterio.open(path) as dataset:
        assert dataset.transform != usual
    assert open_info(path).transform == usual

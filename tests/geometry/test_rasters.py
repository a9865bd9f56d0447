from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from rasterio import Affine
from rasterio.enums import ColorInterp

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    gsd_m,
    open_info,
    pixel_to_world,
    read_rgb,
    to_map_pixels,
    world_to_pixel,
    world_to_pixel_steps,
)

from .support import write_tif

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4)


def test_grid_worked_by_hand() -> None:
    # 0.5 m pixels, upper left corner (1000, 2000): the first centre is (1000.25, 1999.75).
    transform = Affine(0.5, 0, 1000, 0, -0.5, 2000)
    assert pixel_to_world(transform, (0.5, 0.5)).tolist() == [1000.25, 1999.75]
    assert pixel_to_world(transform, (2, 4)).tolist() == [1001, 1998]
    assert world_to_pixel(transform, (1001, 1998)).tolist() == [2, 4]
    assert world_to_pixel((0.5, 0, 1000, 0, -0.5, 2000), (1000, 2000)).tolist() == [0, 0]
    assert world_to_pixel_steps(transform, np.array((1.0, 1.0))).tolist() == [2, -2]


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
        ({"transform": Affine.identity()}, "no geotransform"),
        ({"crs": None}, "no CRS"),
        ({"transform": Affine(0.5, 1.0, 9.0, 0.5, 1.0, 9.0)}, "cannot be inverted"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_files_without_georeference(tmp_path: Path, profile: dict, message: str) -> None:
    path = write_tif(tmp_path / "a.tif", GREY, **profile)
    with pytest.raises(RasterError, match=message) as caught:
        open_info(path)
    assert str(path) in str(caught.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(RasterError, match="no such file"):
        open_info(tmp_path / "missing.tif")
    text = tmp_path / "text.tif"
    text.write_text("no raster")
    with pytest.raises(RasterError, match="cannot be read as a raster"):
        open_info(text)
    noise = np.random.default_rng(0).integers(0, 255, (300, 300), dtype=np.uint8)
    whole = write_tif(tmp_path / "whole.tif", noise, compress="deflate").read_bytes()
    cut = tmp_path / "cut.tif"
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RasterError, match="cannot be read as a raster"):
        read_rgb(cut)


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


def test_gsd_of_oblong_and_rotated_pixels(tmp_path: Path) -> None:
    turned = Affine(0.3, 0.4, 500000, 0.4, -0.3, 5188000)
    path = write_tif(tmp_path / "r.tif", GREY, transform=turned)
    np.testing.assert_allclose(gsd_m(open_info(path)), (0.5 / 0.9996,) * 2, rtol=1e-6)
    oblong = Affine(0.3, 0, 500000, 0, -0.6, 5188000)
    path = write_tif(tmp_path / "o.tif", GREY, transform=oblong)
    np.testing.assert_allclose(gsd_m(open_info(path)), (0.3 / 0.9996, 0.6 / 0.9996), rtol=1e-6)


def test_same_crs_in_other_words() -> None:
    utm = CRS.from_epsg(32615)
    esri = utm.to_wkt("WKT1_ESRI")
    for other in (32615, esri, utm.to_wkt(), "+proj=utm +zone=15 +datum=WGS84", "EPSG:32615+5773"):
        check_same_crs(utm, other, "DOM and DSM")
    # Without a datum's name only the code is left to go by.
    check_same_crs(25832, "+proj=utm +zone=32 +ellps=GRS80 +units=m +type=crs", "DOM and DSM")
    changsha = CRS.from_epsg(4547)
    for version in ("WKT1_GDAL", "WKT1_ESRI", "WKT2_2019"):
        check_same_crs(changsha, changsha.to_wkt(version), "DOM and DSM")
    with pytest.raises(RasterError, match=r"DOM and DSM differ in CRS: EPSG:32615.*EPSG:32616"):
        check_same_crs(utm, 32616, "DOM and DSM")
    # Neighbouring zones, other datum, other unit, other false easting; metres and degrees.
    proj = "+proj=tmerc +lon_0=114 +x_0={} +ellps=GRS80 +units={}"
    for a, b in (
        (4547, 4548),
        (4547, 4526),
        (4326, 4490),
        (32649, 4547),
        (proj.format(500000, "m"), proj.format(500000, "us-ft")),
        (proj.format(500000, "m"), proj.format(500001, "m")),
        (32615, 4326),
    ):
        with pytest.raises(RasterError, match="tiles and poses differ"):
            check_same_crs(a, b, "tiles and poses")


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


def test_rgb_of_other_types(tmp_path: Path) -> None:
    for dtype in ("uint16", "float32"):
        with pytest.raises(RasterError, match=f"colours are {dtype}"):
            read_rgb(write_tif(tmp_path / "a.tif", GREY.astype(dtype)))
    five = np.stack((GREY,) * 5)
    with pytest.raises(RasterError, match="no colours: 5 bands"):
        read_rgb(write_tif(tmp_path / "5.tif", five, photometric="MINISBLACK"))
    path = write_tif(tmp_path / "p.tif", GREY, photometric="PALETTE")
    with rasterio.open(path, "r+") as dataset:
        dataset.write_colormap(1, {0: (255, 0, 0, 255), 1: (0, 0, 255, 255)})
    with pytest.raises(RasterError, match="palette"):
        read_rgb(path)


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

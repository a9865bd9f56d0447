from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from pyproj import CRS
from rasterio import Affine
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning

from airzoo_bench.datasets.folder import copy_map
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    gsd_m,
    open_info,
    pixel_to_world,
    raster_sha256,
    read_rgb,
    to_map_pixels,
)
from tests.support import write_raster

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
    rgb, grey = np.moveaxis(bands[:3], 0, -1), np.repeat(GREY[..., None], 3, axis=-1)
    for content, colours in ((bands, rgb), (bands[:3], rgb), (GREY, grey), (bands[[0, 3]], grey)):
        assert np.array_equal(read_rgb(write_tif(tmp_path / "a.tif", content)), colours)
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


# --- the checksum of a raster ---

BAND = "<PAMDataset><PAMRasterBand band='1'>{}</PAMRasterBand></PAMDataset>"
SIDE_FILES = {
    "offset": BAND.format("<Offset>7</Offset>"),
    "scale": BAND.format("<Scale>0.3048</Scale>"),
    "unit": BAND.format("<UnitType>ft</UnitType>"),
    "nodata": BAND.format("<NoDataValue>100</NoDataValue>"),
    "grid": "<PAMDataset><GeoTransform>500010, 1, 0, 5200000, 0, -1</GeoTransform></PAMDataset>",
    "crs": "<PAMDataset><SRS>EPSG:32632</SRS></PAMDataset>",
}
STATISTICS = BAND.format("<Metadata><MDI key='STATISTICS_MEAN'>100.5</MDI></Metadata>")


@pytest.fixture
def surface(tmp_path: Path) -> Path:
    heights = np.float32(100) + np.random.default_rng(0).random((1, 40, 50), np.float32)
    return write_raster(tmp_path / "dsm.tif", heights)


@pytest.mark.parametrize("what", SIDE_FILES)
def test_side_files_that_change_heights_or_places_change_it(surface: Path, what: str) -> None:
    plain = raster_sha256(surface)
    assert plain == sha256(surface.read_bytes()).hexdigest()
    Path(f"{surface}.aux.xml").write_text(SIDE_FILES[what])
    changed = raster_sha256(surface)
    assert changed != plain
    Path(f"{surface}.aux.xml").write_text(SIDE_FILES[what].replace("7", "8").replace("10,", "11,"))
    assert (raster_sha256(surface) == changed) == (what not in ("offset", "grid"))


def test_statistics_and_overviews_beside_it_change_nothing(surface: Path) -> None:
    plain = raster_sha256(surface)
    Path(f"{surface}.aux.xml").write_text(STATISTICS)
    with rasterio.Env(TIFF_USE_OVR="YES"), rasterio.open(surface, "r+") as dataset:
        dataset.build_overviews([2, 4])
    assert Path(f"{surface}.ovr").is_file()
    assert raster_sha256(surface) == plain


def test_a_world_file_where_the_file_has_no_grid(tmp_path: Path) -> None:
    path, found = tmp_path / "dsm.tif", []
    profile = {"driver": "GTiff", "width": 5, "height": 4, "count": 1, "dtype": "float32"}
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(path, "w", **profile) as dataset:
        dataset.write(np.zeros((1, 4, 5), np.float32))
    for east in (500_000, 500_001):
        path.with_suffix(".tfw").write_text(f"1\n0\n0\n-1\n{east}.5\n5199999.5\n")
        found.append(raster_sha256(path))
    assert found[0] != found[1]


PLACED = """<VRTDataset rasterXSize="8" rasterYSize="4"><VRTRasterBand dataType="Float32" band="1">
{}</VRTRasterBand></VRTDataset>"""
SOURCE = """<SimpleSource><SourceFilename relativeToVRT="{relative}">{name}</SourceFilename>
<SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="4" ySize="4"/>
<DstRect xOff="{at}" yOff="0" xSize="4" ySize="4"/></SimpleSource>"""


def virtual(path: Path, *placed: tuple[str, int], relative: int = 1) -> Path:
    sources = (SOURCE.format(name=name, at=at, relative=relative) for name, at in placed)
    path.write_text(PLACED.format("".join(sources)))
    return path


def test_the_checksum_of_a_virtual_raster_is_the_same_in_any_folder(tmp_path: Path) -> None:
    for name, height in (("a.tif", 1.0), ("b.tif", 2.0)):
        write_raster(tmp_path / name, np.full((1, 4, 4), height, np.float32), crs="EPSG:32633")
    placed = ("a.tif", 0), ("b.tif", 4)
    one = raster_sha256(virtual(tmp_path / "one.vrt", *placed))
    by_path = [(str(tmp_path / name), at) for name, at in placed]
    assert raster_sha256(virtual(tmp_path / "by_path.vrt", *by_path, relative=0)) == one
    copy_map(tmp_path / "one.vrt", tmp_path / "data" / "dsm.vrt")
    assert raster_sha256(tmp_path / "data" / "dsm.vrt") == one
    (tmp_path / "b.tif").write_bytes((tmp_path / "a.tif").read_bytes())
    assert raster_sha256(tmp_path / "one.vrt") != one

"""The checksum of a raster: of all that its numbers rest on, and of nothing else."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from rasterio.errors import NotGeoreferencedWarning

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.matching.truth import check_dsm, dsm_checksum
from tests.support import write_raster

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
    with pytest.raises(BenchmarkError, match="surface model"):
        check_dsm(surface, dsm_checksum(surface), plain)
    Path(f"{surface}.aux.xml").write_text(SIDE_FILES[what].replace("7", "8").replace("10,", "11,"))
    assert (raster_sha256(surface) == changed) == (what not in ("offset", "grid"))


def test_statistics_and_overviews_beside_it_change_nothing(surface: Path) -> None:
    plain = raster_sha256(surface)
    Path(f"{surface}.aux.xml").write_text(STATISTICS)
    with rasterio.Env(TIFF_USE_OVR="YES"), rasterio.open(surface, "r+") as dataset:
        dataset.build_overviews([2, 4])
    assert Path(f"{surface}.ovr").is_file()
    assert raster_sha256(surface) == plain


def test_a_mask_beside_it_is_part_of_it(surface: Path) -> None:
    plain, found = raster_sha256(surface), []
    for rows in (3, 4):
        mask = np.ones((40, 50), np.bool_)
        mask[:rows] = False
        with rasterio.Env(GDAL_TIFF_INTERNAL_MASK="NO"), rasterio.open(surface, "r+") as dataset:
            dataset.write_mask(mask)
        found.append(raster_sha256(surface))
    assert Path(f"{surface}.msk").is_file()
    assert len({plain, *found}) == 3


def test_a_world_file_where_the_file_has_no_grid(tmp_path: Path) -> None:
    path, found = tmp_path / "dsm.tif", []
    profile = {"driver": "GTiff", "width": 5, "height": 4, "count": 1, "dtype": "float32"}
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(path, "w", **profile) as dataset:
        dataset.write(np.zeros((1, 4, 5), np.float32))
    for east in (500_000, 500_001):
        path.with_suffix(".tfw").write_text(f"1\n0\n0\n-1\n{east}.5\n5199999.5\n")
        found.append(raster_sha256(path))
    assert found[0] != found[1]


def test_a_header_beside_the_numbers_is_part_of_it(tmp_path: Path, surface: Path) -> None:
    rasterio.shutil.copy(surface, tmp_path / "dsm.bil", driver="EHdr")
    header = tmp_path / "dsm.hdr"
    plain = raster_sha256(tmp_path / "dsm.bil")
    header.write_text(header.read_text() + "NODATA 100\n")
    assert raster_sha256(tmp_path / "dsm.bil") != plain


def test_the_scale_of_a_virtual_raster(tmp_path: Path, surface: Path) -> None:
    virtual = tmp_path / "dsm.vrt"
    rasterio.shutil.copy(surface, virtual, driver="VRT")
    plain = raster_sha256(virtual)
    text = virtual.read_text()
    assert "<SimpleSource>" in text
    virtual.write_text(text.replace("<SimpleSource>", "<Offset>7</Offset><SimpleSource>"))
    assert raster_sha256(virtual) != plain


def test_it_is_the_same_wherever_the_files_stand(tmp_path: Path, surface: Path) -> None:
    Path(f"{surface}.aux.xml").write_text(SIDE_FILES["offset"])
    other = tmp_path / "other" / "surface.tif"
    other.parent.mkdir()
    other.write_bytes(surface.read_bytes())
    Path(f"{other}.aux.xml").write_text(SIDE_FILES["offset"])
    assert raster_sha256(other) == raster_sha256(surface)

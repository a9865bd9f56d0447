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
from airzoo_bench.datasets.folder import copy_map
from airzoo_bench.geometry.rasters import raster_sha256
from airzoo_bench.matching.truth import check_dsm
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
        check_dsm(surface, plain)
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


@pytest.fixture
def halves(tmp_path: Path) -> Path:
    for name, height in (("a.tif", 1.0), ("b.tif", 2.0)):
        write_raster(tmp_path / name, np.full((1, 4, 4), height, np.float32), crs="EPSG:32633")
    return tmp_path


def test_the_checksum_of_a_virtual_raster_is_the_same_wherever_it_stands(
    halves: Path, tmp_path: Path
) -> None:
    placed = ("a.tif", 0), ("b.tif", 4)
    one = raster_sha256(virtual(halves / "one.vrt", *placed))
    by_path = [(str(halves / name), at) for name, at in placed]
    assert raster_sha256(virtual(halves / "by_path.vrt", *by_path, relative=0)) == one
    copy_map(halves / "one.vrt", tmp_path / "data" / "dsm.vrt")
    assert raster_sha256(tmp_path / "data" / "dsm.vrt") == one
    (halves / "b.tif").write_bytes((halves / "a.tif").read_bytes())
    assert raster_sha256(halves / "one.vrt") != one

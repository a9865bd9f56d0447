"""The checksum of virtual rasters: of what they are made, and how."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.enums import Resampling

from airzoo_bench.core.errors import RasterError
from airzoo_bench.datasets.folder import copy_map
from airzoo_bench.geometry import raster_files
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import opened
from tests.support import write_raster

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


def test_the_checksum_of_a_virtual_raster_says_where_its_files_are_placed(halves: Path) -> None:
    one = virtual(halves / "one.vrt", ("a.tif", 0), ("b.tif", 4))
    places = {
        "swapped": virtual(halves / "swapped.vrt", ("b.tif", 0), ("a.tif", 4)),
        "moved": virtual(halves / "moved.vrt", ("a.tif", 0), ("b.tif", 3)),
        "above": virtual(halves / "above.vrt", ("b.tif", 4), ("a.tif", 0)),
        "twice": virtual(halves / "twice.vrt", ("a.tif", 0), ("b.tif", 4), ("b.tif", 4)),
    }
    found = {name: raster_sha256(path) for name, path in places.items()}
    assert len({raster_sha256(one), *found.values()}) == 5
    with opened(one) as left, opened(places["swapped"]) as right:
        assert (left.read(1) != right.read(1)).all()


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


@pytest.mark.parametrize("name", ["SourceFilename", "relativeToVRT", "SrcRect"])
def test_names_are_read_in_either_case_as_gdal_does(halves: Path, name: str) -> None:
    path = virtual(halves / "one.vrt", ("a.tif", 0))
    path.write_text(path.read_text().replace(name, name.lower()))
    before = raster_sha256(path)
    with opened(path) as dataset:
        assert dataset.read(1)[0, 0] == 1.0
    (halves / "a.tif").write_bytes((halves / "b.tif").read_bytes())
    assert raster_sha256(path) != before


@pytest.mark.parametrize("outer", ["n.tif", "n.vrt"])
@pytest.mark.parametrize("inner", ["in.tif", "in.vrt", "in"])
def test_virtual_rasters_are_known_by_their_content(halves: Path, outer: str, inner: str) -> None:
    virtual(halves / inner, ("a.tif", 0))
    path = virtual(halves / outer, (inner, 0))
    before = raster_sha256(path)
    assert {one.name for one in raster_files.raster_files(path)} == {outer, inner, "a.tif"}
    copy_map(path, halves / "data" / outer)
    assert raster_sha256(halves / "data" / outer) == before
    (halves / "a.tif").write_bytes((halves / "b.tif").read_bytes())
    assert raster_sha256(path) != before


def test_a_file_whose_folder_depends_on_where_a_run_is_started(
    halves: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GDAL reads that of the folder of the run, which is not the one beside the raster."""
    path = virtual(halves / "one.vrt", ("a.tif", 0), relative=0)
    other = tmp_path / "elsewhere"
    other.mkdir()
    (other / "a.tif").write_bytes((halves / "b.tif").read_bytes())
    monkeypatch.chdir(other)
    with opened(path) as dataset:
        assert dataset.read(1)[0, 0] == 2.0
    with pytest.raises(RasterError, match=r"whose folder it does not say: a\.tif"):
        raster_sha256(path)


@pytest.mark.parametrize("shrunk", [False, True])
def test_overviews_of_its_files_count_where_gdal_reads_numbers_from_them(
    tmp_path: Path, shrunk: bool
) -> None:
    heights = np.random.default_rng(0).random((1, 64, 64), np.float32)
    source = write_raster(tmp_path / "a.tif", heights, crs="EPSG:32633")
    text = PLACED.format(SOURCE.format(name="a.tif", at=0, relative=1))
    text = text.replace('<SrcRect xOff="0" yOff="0" xSize="4" ySize="4"/>', "{}")
    side = 16 if shrunk else 4
    text = text.format(f'<SrcRect xOff="0" yOff="0" xSize="{side}" ySize="{side}"/>')
    path, whole = tmp_path / "inner.vrt", virtual(tmp_path / "outer.vrt", ("inner.vrt", 0))
    path.write_text(text)
    before = [raster_sha256(one) for one in (path, whole)]
    with opened(whole) as dataset:
        plain = dataset.read(1)
    with rasterio.Env(TIFF_USE_OVR=True), rasterio.open(source, "r+") as dataset:
        dataset.build_overviews([2, 4], Resampling.average)
    assert source.with_name("a.tif.ovr").is_file()
    with opened(whole) as dataset:
        assert (dataset.read(1) != plain).any() == shrunk
    after = [raster_sha256(one) for one in (path, whole)]
    assert [one != other for one, other in zip(before, after, strict=True)] == [shrunk, shrunk]


def test_a_virtual_raster_without_its_files_has_no_checksum(halves: Path) -> None:
    path = virtual(halves / "one.vrt", ("a.tif", 0), ("c.tif", 4))
    with pytest.raises(RasterError, match=r"is made of a file that is not there: c\.tif"):
        raster_sha256(path)


def test_a_virtual_raster_that_is_made_of_itself(halves: Path) -> None:
    one = virtual(halves / "one.vrt", ("two.vrt", 0))
    virtual(halves / "two.vrt", ("a.tif", 0), ("one.vrt", 4))
    with pytest.raises(RasterError, match="made of itself"):
        raster_sha256(one)


def test_virtual_rasters_of_virtual_rasters_are_looked_at_once(
    halves: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each four times in the next: a million openings of eleven small files."""
    names = ["a.tif", *(f"{level}.vrt" for level in range(10))]
    for below, name in pairwise(names):
        virtual(halves / name, *[(below, at) for at in range(4)])
    looked: list[str] = []
    work = raster_files.content_of

    def watching(path: Path, checksum: Callable[[Path], str]) -> str:
        looked.append(path.name)
        return work(path, checksum)

    monkeypatch.setattr(raster_files, "content_of", watching)
    raster_sha256(halves / names[-1])
    assert sorted(looked) == sorted(names[1:])

"""The files of UAV-VisLoc: maps of several tiles or without a georeference, and what is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning

from airzoo_bench import load_benchmark
from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.published.options import UavVisLocOptions
from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC
from airzoo_bench.geometry.rasters import open_info
from tests.datasets.published.uav_visloc_tree import (
    FLIGHTS,
    PIXEL_DEG,
    make_tree,
    map_files,
    read,
    rewrite,
    write_map,
)
from tests.support import run_main


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_tree(tmp_path / "无人机 UAV VisLoc")


def test_four_tiles_make_one_map(root: Path) -> None:
    folder = root / "09"
    with rasterio.open(folder / "satellite09_02-01.tif", "r+") as tile:
        tile.write(np.full((1, 1), 200, np.uint8), 2, window=((5, 6), (7, 8)))
    scene = read(root, "09")
    assert scene.dom == folder / "satellite09.vrt"
    assert scene.notes == ("flight 09: satellite09.vrt was written over the 4 tiles of its map",)
    assert scene.dom.stat().st_size < 8000
    info = open_info(scene.dom)
    assert (info.width, info.height, info.bands) == (5000, 4000, 3)
    np.testing.assert_allclose(info.transform[:6], (PIXEL_DEG, 0, 120.03, 0, -PIXEL_DEG, 30.99))
    moved = root.rename(root.with_name("moved"))
    with rasterio.open(moved / "09" / "satellite09.vrt") as joined:
        assert [c.name for c in joined.colorinterp] == ["red", "green", "blue"]
        assert joined.read(2, window=((1805, 1806), (7, 8))).item() == 200
        assert joined.read(1, window=((1805, 1806), (7, 8))).item() == 0


def test_a_copy_needs_no_source(root: Path, tmp_path: Path) -> None:
    with rasterio.open(root / "09" / "satellite09_02-02.tif", "r+") as tile:
        tile.write(np.full((1, 1), 200, np.uint8), 3, window=((5, 6), (7, 8)))
    out = tmp_path / "data" / "copied"
    arguments = ("--source", root, "--out", out, "--copy", "--scene", "09", "--scene", "01")
    assert run_main("prepare", "uav-visloc", *arguments) == 0
    shutil.rmtree(root)
    with rasterio.open(out / "data" / "09" / "dom.vrt") as joined:
        assert joined.read(3, window=((1805, 1806), (2607, 2608))).item() == 200
        assert joined.read(3, window=((5, 6), (7, 8))).item() == 0
    assert load_benchmark(out).scene("09").tiles()[0].image.shape == (1024, 1024, 3)


FOLDER_FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no table": (lambda root: (root / "01" / "01.csv").unlink(), "lacks 01.csv; it holds"),
    "no photos": (lambda root: shutil.rmtree(root / "01" / "drone"), "lacks drone; it holds"),
    "no map": (lambda root: (root / "01" / "satellite01.tif").unlink(), "lacks satellite01.tif"),
    "a photo less": (
        lambda root: (root / "01" / "drone" / "01_0003.JPG").unlink(),
        r"photos of it are not in the folder drone: 1 of 5 \(01_0003.JPG\)",
    ),
    "packed": (
        lambda root: (root / "01" / "drone").rename(root / "01" / "drone.zip.part"),
        "lacks drone(.|\n)*finish the download and unpack 1 .drone.zip.part",
    ),
    "two maps": (
        lambda root: shutil.copy(root / "01" / "satellite01.tif", root / "01" / "01.tif"),
        "two files could be satellite01.tif: 2 .01.tif, satellite01.tif",
    ),
    "two tables": (
        lambda root: shutil.copy(root / "01" / "01.csv", root / "01" / "01.CSV"),
        "two files could be 01.csv",
    ),
    "two photos": (
        lambda root: shutil.copy(*(root / "01" / "drone" / f"01_0001.{e}" for e in ("JPG", "jpg"))),
        "two photos differ in case only",
    ),
    "two folders": (lambda root: (root / "1").mkdir(), "two folders are of flight 01: 01, 1"),
    "another column": (
        lambda root: rewrite(root / "01" / "01.csv", ",lat,", ",latitude,"),
        "lacks the column lat",
    ),
    "a heading by another name": (
        lambda root: rewrite(root / "01" / "01.csv", ",Phi1", ",Yaw"),
        r"lacks the column Phi1 \(did you mean 'Yaw' or 'Phi2'\?\)",
    ),
    "quoted decimal commas": (
        lambda root: rewrite(root / "01" / "01.csv", ",405.0,", ',"405,0",'),
        "column height: '405,0'(.|\n)*fix: .*decimal point, or separate the values by semicolons",
    ),
    "decimal commas": (
        lambda root: rewrite(root / "01" / "01.csv", "29.7", "29,7"),
        "line 2: has 11 values for 10 columns",
    ),
    "swapped": (
        lambda root: rewrite(root / "01" / "01.csv", ",lat,lon,", ",lon,lat,"),
        "line 2, column lat: '115.9|line 2: column lat: '115.9",
    ),
    "another range": (
        lambda root: rewrite(root / "satellite_ coordinates_range.csv", ",29.77", ",30.77"),
        "pixels off those of",
    ),
    "upside down": (
        lambda root: rewrite(root / "satellite_ coordinates_range.csv", ",29.77", ",25.77"),
        "is not above and left of right bottom",
    ),
    "two ranges": (
        lambda root: rewrite(root / "satellite_ coordinates_range.csv", "lite07", "lite01"),
        "more than one row is of flight 01: lines 2 and 3",
    ),
    "two range tables": (
        lambda root: (root / "satellite_coordinates_range.csv").write_text("x"),
        "two files could be satellite_ coordinates_range.csv",
    ),
    "not a photo": (
        lambda root: (root / "01" / "drone" / "01_0001.JPG").write_bytes(b""),
        "01_0001.JPG",
    ),
    "half a map": (
        lambda root: (root / "01" / "satellite01.tif").write_bytes(b"II*\0"),
        "satellite01.tif: cannot be read as a raster",
    ),
}


@pytest.mark.parametrize("fault", FOLDER_FAULTS)
def test_refused(root: Path, fault: str) -> None:
    spoil, message = FOLDER_FAULTS[fault]
    spoil(root)
    with pytest.raises(UserError, match=message):
        read(root, "01")


TILE_FAULTS = {
    "missing": ("satellite09_02-02.tif", None, "nothing covers columns 2600 to 5000, rows 1800"),
    "off the grid": ("satellite09_01-02.tif", 2600.4, "begins 0.40 pixels off the grid of"),
    "a gap": ("satellite09_01-02.tif", 2610, "nothing covers columns 2600 to 2610, rows 0 to 1800"),
}


@pytest.mark.parametrize("fault", TILE_FAULTS)
def test_tiles_that_do_not_fit(root: Path, fault: str) -> None:
    name, left, message = TILE_FAULTS[fault]
    path = root / "09" / name
    path.unlink()
    if left is not None:
        write_map(path, FLIGHTS["09"], (left, 0, 2400, 1800))
    with pytest.raises(UserError, match=message):
        read(root, "09")
    assert not list(root.glob("09/*.vrt"))


def test_tiles_that_differ(root: Path) -> None:
    path = root / "09" / "satellite09_02-01.tif"
    write_map(path, FLIGHTS["09"], (0, 1800, 2600, 2200), crs="EPSG:4490")
    with pytest.raises(UserError, match=r"satellite09_02-01.tif: its CRS is"):
        read(root, "09")
    write_map(path, FLIGHTS["09"], (0, 1800, 2600, 2200), count=1, photometric=None)
    with pytest.raises(UserError, match=r"satellite09_02-01.tif: its bands is"):
        read(root, "09")


@pytest.mark.parametrize("flight", ["01", "09"])
def test_a_map_without_georeference_is_placed_by_the_range_table(root: Path, flight: str) -> None:
    expected = open_info(read(root, flight).dom or root)
    for name, window in map_files(FLIGHTS[flight]).items():
        with pytest.warns(NotGeoreferencedWarning):
            write_map(root / flight / name, FLIGHTS[flight], window, crs=None, transform=None)
    scene = read(root, flight)
    assert "placed by the range table" in scene.notes[0]
    info = open_info(scene.dom or root)
    assert (info.width, info.height) == (expected.width, expected.height)
    np.testing.assert_allclose(info.transform[:6], expected.transform[:6], atol=1e-9)
    (root / "satellite_ coordinates_range.csv").unlink()
    with pytest.raises(UserError, match="has no georeference"):
        read(root, flight)


@pytest.mark.parametrize("made", ["empty", "several", "file"])
def test_no_flights(root: Path, tmp_path: Path, made: str) -> None:
    source = tmp_path / made
    if made == "file":
        source.write_bytes(b"PK")
    else:
        source.mkdir()
        (source / "UAV_VisLoc.zip").touch()
    if made == "several":
        for name in ("a", "b"):
            shutil.copytree(root, source / name)
    messages = {
        "empty": "holds no flight of UAV-VisLoc, but 1 entry (.|\n)*unpack 1 .UAV_VisLoc.zip",
        "several": "several folders hold flights: 2 .a, b",
        "file": "a file, not a folder(.|\n)*unpack the archive",
    }
    with pytest.raises(UserError, match=messages[made]):
        UAV_VISLOC.scenes(UavVisLocOptions(source))


def test_the_folder_of_a_flight_names_the_one_above(root: Path) -> None:
    with pytest.raises(UserError, match="is the folder of one flight") as refused:
        UAV_VISLOC.scenes(UavVisLocOptions(root / "01"))
    assert refused.value.fix == f"--source {root} --scene 01"


def test_a_broken_flight_leaves_nothing(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (root / "01" / "01.csv").unlink()
    out = tmp_path / "data" / "uav-visloc"
    assert run_main("prepare", "uav-visloc", "--source", root, "--out", out) == 2
    assert capsys.readouterr().err.count("fix:") == 1
    assert not (tmp_path / "data").exists()

"""UAV-VisLoc as it is downloaded: what is read of a flight, and what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning

from airzoo_bench import evaluate
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC, UavVisLocOptions
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import geodesic_distance_m
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.footprints import cast_footprints
from airzoo_bench.retrieval.truth import read_truth
from tests.datasets.published.uav_visloc_tree import (
    FLIGHTS,
    PIXEL_DEG,
    anchors,
    answers,
    make_tree,
    map_files,
    write_map,
)
from tests.support import run_main


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_tree(tmp_path / "无人机 UAV VisLoc")


def read(source: Path, flight: str, **options: Any) -> NativeScene:
    return UAV_VISLOC.read(UavVisLocOptions(source, **options), flight, silent)


def poses(scene: NativeScene) -> Poses:
    assert scene.poses is not None
    return scene.poses


def footprints(scene: NativeScene) -> Floats:
    """Return lon, lat (N, 4, 2) of the photos' corners on the plane."""
    assert scene.cameras is not None
    assert scene.plane_height_m is not None
    return cast_footprints(
        scene.cameras,
        poses(scene),
        str(scene.crs),
        scene.plane_height_m,
        inset=0.0,
        max_range_m=5000.0,
    ).lonlat


def test_flights_are_found(root: Path, tmp_path: Path) -> None:
    for source in (root, tmp_path):
        assert UAV_VISLOC.scenes(UavVisLocOptions(source)) == ["01", "07", "09"]


@pytest.mark.parametrize("flight", FLIGHTS)
def test_footprints_are_those_of_the_ellipsoid(root: Path, flight: str) -> None:
    """Scale of UTM is off by 0.1 % at most, which is 0.3 m at the corner of a footprint."""
    scene = read(root, flight)
    expected = np.stack([anchors(photo) for photo in FLIGHTS[flight].photos])
    assert geodesic_distance_m(footprints(scene), expected).max() < 0.3
    assert scene.names == tuple(FLIGHTS[flight].photo(i) for i in range(len(expected)))


def test_a_footprint_by_hand(root: Path) -> None:
    """At 405 m 52 and 36 degrees see 2 x 197.53 m across and 2 x 131.59 m along.

    Towards 165 degrees the top of the photo is south by east, and its left is east by north: the
    top left corner is 197.53 m towards 75 degrees and 131.59 m towards 165 degrees away, that is
    190.80 + 34.06 = 224.86 m east and 51.12 - 127.11 = -75.99 m north.
    """
    corner = footprints(read(root, "01"))[0, 0]
    lon, lat = FLIGHTS["01"].photos[0][:2]
    east = geodesic_distance_m(np.array([lon, lat]), np.array([corner[0], lat]))
    north = geodesic_distance_m(np.array([lon, lat]), np.array([lon, corner[1]]))
    assert corner[0] > lon
    assert corner[1] < lat
    np.testing.assert_allclose([east, north], [224.86, 75.99], atol=0.1)


@pytest.mark.parametrize(
    ("options", "phi"),
    [
        ({"heading": "east-north-positive"}, 90.0 - 165.0),
        ({"heading": "counter-clockwise"}, -165.0),
        ({"heading_column": "Phi2"}, 168.0),
    ],
)
def test_headings_by_name(root: Path, options: dict[str, Any], phi: float) -> None:
    expected = anchors((*FLIGHTS["01"].photos[0][:3], phi))
    assert geodesic_distance_m(footprints(read(root, "01", **options))[0], expected).max() < 0.3


def test_fields_of_view_and_plane(root: Path) -> None:
    wide = read(root, "01", fov_across=90.0, plane_height=["205", "7=3"])
    assert wide.plane_height_m == 205.0
    assert poses(wide).centres[0, 2] == 405.0
    corners = footprints(wide)[0]
    across = geodesic_distance_m(corners[0], corners[1])
    np.testing.assert_allclose(across, 400.0, atol=0.2)
    assert read(root, "07", plane_height=["205", "7=3"]).plane_height_m == 3.0


def rewrite(path: Path, old: str, new: str, count: int = -1) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, count).encode())


def test_columns_go_by_name(root: Path) -> None:
    before = read(root, "01")
    path = root / "01" / "01.csv"
    lines = [line.split(",") for line in path.read_text().splitlines()]
    mixed = [";".join([*row[::-1], "x"]).replace(".", ",") for row in lines]
    path.write_text("\ufeff" + "\n".join(mixed).replace(",JPG", ".JPG"), encoding="utf-8")
    after = read(root, "01")
    np.testing.assert_array_equal(poses(after).centres, poses(before).centres)
    np.testing.assert_array_equal(poses(after).rotation, poses(before).rotation)


def test_names_in_another_case(root: Path) -> None:
    (root / "01" / "drone" / "01_0002.JPG").rename(root / "01" / "drone" / "01_0002.jpg")
    assert read(root, "01").names[1] == "01_0002.jpg"


def test_no_heading(root: Path) -> None:
    (note,) = read(root, "07").notes
    assert note.startswith("3 of 3 photos have no heading; they got -1.5 degrees (the flight's Phi")
    turned = read(root, "07", missing_heading="88.5")
    expected = anchors((*FLIGHTS["07"].photos[0][:3], 88.5))
    assert geodesic_distance_m(footprints(turned)[0], expected).max() < 0.3
    with pytest.raises(UserError, match="3 of 3 photos have no heading"):
        read(root, "07", missing_heading="leave-out")
    with pytest.raises(UserError, match="'north' is no heading"):
        read(root, "07", missing_heading="north")
    rewrite(root / "01" / "01.csv", ",30.0,", ",,")
    left_out = read(root, "01", missing_heading="leave-out")
    assert left_out.unposed == ("01_0002.JPG",)
    assert left_out.notes == ("1 of 5 photos have no heading and were left out",)


def test_heights_above_the_sea(root: Path) -> None:
    path = root / "01" / "01.csv"
    rewrite(path, ",405.0,", ",2305.0,", 2)
    rewrite(path, ",405.0,", ",2500.0,")
    scene = read(root, "01")
    assert scene.plane_height_m == 2000.0
    assert "heights vary from 2305 to 2500 m" in scene.notes[0]
    assert "--plane-height 01=METRES" in scene.notes[0]
    assert read(root, "01", height_above_ground=400.0).plane_height_m == 2100.0
    assert read(root, "01", plane_height=["1=1900"]).notes == ()
    with pytest.raises(UserError, match="2 of 5 photos were taken at or below the ground"):
        read(root, "01", plane_height=["2305"])
    with pytest.raises(UserError, match="'12=5' is no height"):
        read(root, "01", plane_height=["12=5"])


def test_four_tiles_make_one_map(root: Path) -> None:
    folder = root / "09"
    with rasterio.open(folder / "satellite09_02-01.tif", "r+") as tile:
        tile.write(np.full((1, 1), 200, np.uint8), 2, window=((5, 6), (7, 8)))
    scene = read(root, "09")
    assert scene.dom == folder / "satellite09.vrt"
    assert scene.notes == ("satellite09.vrt was written over the 4 tiles of its map",)
    assert scene.dom.stat().st_size < 8000
    info = open_info(scene.dom)
    assert (info.width, info.height, info.bands) == (5000, 4000, 3)
    np.testing.assert_allclose(info.transform[:6], (PIXEL_DEG, 0, 120.03, 0, -PIXEL_DEG, 30.99))
    moved = root.rename(root.with_name("moved"))
    with rasterio.open(moved / "09" / "satellite09.vrt") as joined:
        assert [c.name for c in joined.colorinterp] == ["red", "green", "blue"]
        assert joined.read(2, window=((1805, 1806), (7, 8))).item() == 200
        assert joined.read(1, window=((1805, 1806), (7, 8))).item() == 0


def test_joined_map_elsewhere(root: Path, tmp_path: Path) -> None:
    scene = read(root, "09", joined_maps=tmp_path / "joined")
    assert scene.dom == tmp_path / "joined" / "satellite09.vrt"
    assert not list(root.glob("09/*.vrt"))
    with rasterio.open(scene.dom) as joined:
        assert joined.read(1, window=((3990, 3991), (4990, 4991))).item() == 0


def exact(folder: Path) -> dict[str, dict[str, list[str]]]:
    """Return the tiles that answer each photo by the construction of the tree.

    Those with the fewest anchors come first: a footprint turned another way loses them first.
    """
    answered: dict[str, dict[str, list[str]]] = {}
    for scene in sorted((folder / "scenes").iterdir()):
        tiles = pd.read_parquet(scene / "retrieval" / "tiles.parquet").set_index("id")
        boxes = tiles[["lon_min", "lat_max", "lon_max", "lat_min"]].T.to_dict("list")
        flight = FLIGHTS[scene.name]
        answered[scene.name] = {
            f"{scene.name}/{Path(flight.photo(i)).stem}": answers(flight, i, boxes)
            for i in range(len(flight.photos))
        }
    return answered


def predictions(path: Path, folder: Path, protocol: str) -> Path:
    ranked = {query: ids for scene in exact(folder).values() for query, ids in scene.items()}
    rows = [ids[:20] + [""] * (20 - len(ids)) for ids in ranked.values()]
    np.savez(path, protocol=protocol, query_ids=list(ranked), ranked_ids=np.array(rows))
    return path


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights, one of them on four tiles, made into a benchmark folder."""
    base = tmp_path_factory.mktemp("visloc")
    make_tree(base / "UAV_VisLoc", {name: FLIGHTS[name] for name in ("01", "09")})
    out = base / "data" / "folder"
    assert run_main("prepare", "uav-visloc", "--source", base, "--out", out) == 0
    return out


def test_positives_are_those_of_the_construction(prepared: Path) -> None:
    for scene, queries in exact(prepared).items():
        truth = read_truth(prepared / "scenes" / scene, scene)
        tiles = truth.tiles["id"].to_numpy()
        found = zip(truth.positives.queries, truth.positives.tiles, strict=True)
        pairs = {(truth.queries["id"][query], tiles[tile]) for query, tile in found}
        assert pairs == {(query, tile) for query, ids in queries.items() for tile in ids}


def test_exact_predictions_score_perfect(prepared: Path, tmp_path: Path) -> None:
    (name,) = (path.stem for path in (prepared / "protocols").iterdir())
    path = predictions(tmp_path / "p.npz", prepared, name)
    scores = evaluate(path, data=prepared).overall
    assert {scores[key] for key in ("recall@1", "recall@5", "ap@5")} == {1.0}


@pytest.mark.parametrize("heading", ["east-north-positive", "counter-clockwise"])
def test_a_wrong_heading_scores_lower(prepared: Path, tmp_path: Path, heading: str) -> None:
    wrong = tmp_path / "wrong"
    source = ("--source", prepared.parents[1], "--heading", heading, "--scene", "01")
    assert run_main("prepare", "uav-visloc", *source, "--out", wrong) == 0
    (name,) = (path.stem for path in (wrong / "protocols").iterdir())
    path = predictions(tmp_path / "p.npz", wrong, name)
    assert evaluate(path, data=wrong).overall["ap@5"] < 0.9


FOLDER_FAULTS = {
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


def test_bounds_are_compared_with_the_range_table(root: Path) -> None:
    table = root / "satellite_ coordinates_range.csv"
    rewrite(table, f"{29.77:.9f}", f"{29.77 + 3 * PIXEL_DEG:.9f}")
    (note,) = read(root, "01").notes
    assert note.startswith("the bounds of satellite01.tif are up to 3.0 pixels off those of the")
    rewrite(table, "satellite01.tif", "satellite02.tif")
    assert read(root, "01").notes[0].startswith("satellite_ coordinates_range.csv has no row")
    table.rename(root / "satellite_coordinates_range.csv")
    rewrite(root / "satellite_coordinates_range.csv", "satellite07.tif", "07.tif")
    assert len(read(root, "07").notes) == 1


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


def test_a_broken_flight_leaves_nothing(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (root / "01" / "01.csv").unlink()
    out = tmp_path / "data" / "uav-visloc"
    assert run_main("prepare", "uav-visloc", "--source", root, "--out", out) == 2
    assert capsys.readouterr().err.count("fix:") == 1
    assert not (tmp_path / "data").exists()

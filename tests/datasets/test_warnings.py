"""`prepare photos` compares what it is given: the figures it prints, and what it warns of."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rasterio import Affine

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.datasets.facts_lines import kinds_and_warnings
from airzoo_bench.datasets.geometry_checks.dataset import folder_facts, open_benchmark
from airzoo_bench.datasets.plausibility import Kind
from airzoo_bench.datasets.scene_facts import _share_inside
from airzoo_bench.geometry.frames import from_lonlat
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.protocol.lookup import shipped_protocols
from tests.datasets import documented
from tests.datasets.tagged import LEVEL, NAMES, tag
from tests.support import (
    MAP_SIZE_M,
    NORTH_WEST,
    Place,
    run_main,
    write_raster,
)


def test_a_sound_scene_says_its_figures_and_no_warning(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main(*place.arguments()) == 0
    said = capsys.readouterr()
    assert "warning" not in said.err
    for line in (
        "photos          4, 100.0 m above the surface (100.0 m above take-off by their metad",
        "poses           2.1 m from the photos' GPS, -2.0 m in height (medians)",
        "priors          4, off by 2.9 m; yaw 0.0, pitch 1.0, rotation 1.0 degrees",
        "map             256 x 256 px, 1 m per pixel; 100% of the photos' corners lie on it",
        "surface         100% of its pixels have a height, 99.5 to 100.0 m, median 100.0 m",
        "crops           18% of the map each on average, at most 18%",
        "chance          a random tile is a right answer in 18.4% of cases",
    ):
        assert f"  {line}" in said.out


def test_empty_tiles_are_counted(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    colours = np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8)
    colours[:, :100, :100] = 0
    write_raster(place.dom, colours, nodata=0)
    assert run_main(*place.arguments()) == 0
    # Of tiles of 64 px every 32 px, those that begin at 0 and 32 both ways end before 100.
    assert "of cases; 4 tiles without valid pixels left out" in capsys.readouterr().out


def test_tiles_below_a_threshold_are_not_called_empty(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    colours = np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8)
    colours[:, :100, :100] = 0
    write_raster(place.dom, colours, nodata=0)
    shipped = shipped_protocols()["photos-retrieval"].read_text()
    half = tmp_path / "half.toml"
    half.write_text(shipped.replace("least_valid_share = 0.0", "least_valid_share = 0.5"))
    assert run_main(*place.arguments(protocol=half)) == 0
    # Those that begin at 0, 32 or 64 both ways, but for the last of these.
    assert "; 8 tiles with less than 50% of valid pixels left out" in capsys.readouterr().out
    predictions = tmp_path / "p.npz"
    assert run_main("template", "park-retrieval", "--out", predictions) == 0
    for command in (("eval", "retrieval"), ("check",)):
        assert run_main(*command, predictions) == 0
        said = capsys.readouterr()
        assert "8 tiles with less than 50% of valid pixels are in no gallery" in said.out + said.err
    filled = dict(np.load(predictions))
    filled["ranked_ids"] = filled["ranked_ids"].astype("U40")
    filled["ranked_ids"][0, 0] = "park/64_00001_00002"
    np.savez(predictions, **filled)
    assert run_main("check", predictions) == 1
    said = capsys.readouterr()
    fix = "leave this tile out: 43.8% of its pixels are valid, and dropped_tiles.csv lists it"
    assert fix in said.out + said.err


def moved(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[NORTH_WEST[0] + x + 40, NORTH_WEST[1] - y, 200.0])


def lowered(place: Place) -> None:
    write_raster(place.dsm, LEVEL - 27.5)


def in_feet(place: Place) -> None:
    # 20 m are 65.6 ft: the cameras, at 200 m, still are above them.
    write_raster(place.dsm, LEVEL / 5 / 0.3048)
    for name in NAMES:
        tag(place, name, relative=180.0)


def retag(names: tuple[str, ...], **changes: Any) -> Callable[[Place], None]:
    return lambda place: [tag(place, name, **changes) for name in names] and None


def hole(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, 2:4, 3] = 0.0
    write_raster(place.dsm, heights)


def zeros(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, :20] = 0.0
    write_raster(place.dsm, heights)


def shifted(place: Place) -> None:
    grid = Affine(1, 0, NORTH_WEST[0] + 30, 0, -1, NORTH_WEST[1])
    write_raster(place.dom, np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8), transform=grid)


def shifted_holes(place: Place) -> None:
    rng = np.random.default_rng(1)
    holes = np.kron(rng.random((32, 32)) < 0.3, np.ones((8, 8), bool))
    ground = np.where(holes, 0, 90).astype(np.uint8)
    write_raster(place.dsm, np.where(holes, -9999, LEVEL).astype(np.float32), nodata=-9999)
    grid = Affine(1, 0, NORTH_WEST[0] + 9, 0, -1, NORTH_WEST[1] + 6)
    write_raster(place.dom, np.stack([ground[:250]] * 3), transform=grid)


def high_cloud(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(10, 240, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 127.5))))
    return {"cloud": cloud}


def small_map(place: Place) -> None:
    dom = np.full((3, 88, 100), 9, np.uint8)
    grid = Affine(1, 0, NORTH_WEST[0] + 10, 0, -1, NORTH_WEST[1] - 20)
    write_raster(place.dom, dom, transform=grid)


def coarse(place: Place) -> None:
    grid = Affine(8, 0, NORTH_WEST[0], 0, -8, NORTH_WEST[1])
    write_raster(place.dom, np.full((3, 32, 32), 9, np.uint8), transform=grid)


def copied(place: Place) -> None:
    for name in NAMES[1:3]:
        (place.images / name).write_bytes((place.images / NAMES[0]).read_bytes())


def two_cameras(place: Place) -> None:
    for name in NAMES:
        tag(place, name, camera="FC300S" if name < "c" else "FC6310")


def two_flights(place: Place) -> None:
    for name in NAMES:
        tag(place, name, camera="FC300S", day="2016:06:23" if name < "c" else "2019:07:01")


def same_pose(place: Place) -> None:
    place.change_image("a.jpg", center=place.read_poses()["images"]["b.jpg"]["center"])


def no_metadata(place: Place) -> None:
    Image.new("L", (64, 48), 7).save(place.images / "a.jpg")


def in_float32(place: Place) -> None:
    for number, (name, image) in enumerate(place.read_poses()["images"].items()):
        x, y, z = (float(np.float32(value + 0.28 + 0.4 * number)) for value in image["center"])
        place.change_image(name, center=[x, y, z])


def in_one_line(place: Place) -> dict[str, object]:
    for name in NAMES:
        x, y = place.centres["a.jpg" if name < "c" else "b.jpg"]
        place.change_image(name, center=[NORTH_WEST[0] + x, NORTH_WEST[1] - y, 200.0])
    return high_cloud(place)


def one_height(place: Place) -> None:
    # One of more than a million pixels: the nearest height is looked for among every second one.
    heights = np.full((1, 1100, 1100), np.nan, np.float32)
    heights[0, 100, 102], heights[0, 102, 106] = 100.0, 99.5
    write_raster(place.dsm, heights)


def tower(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, 54:74, 54:74] = 300.0
    write_raster(place.dsm, heights)


def cloud_beside(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(300, 400, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 100.0))))
    return {"cloud": cloud}


def coloured(colour: int, share: float, nodata: float | None = None) -> Callable[[Place], None]:
    def changed(place: Place) -> None:
        ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
        ground[:, : int(share * MAP_SIZE_M)] = colour
        write_raster(place.dom, ground, nodata=nodata)

    return changed


def flipped(turn: Any) -> Callable[[Place], None]:
    def changed(place: Place) -> None:
        rng = np.random.default_rng(1)
        holes = np.kron(rng.random((32, 32)) < 0.3, np.ones((8, 8), bool))
        ground = np.where(holes, 0, rng.integers(1, 256, (3, *holes.shape))).astype(np.uint8)
        write_raster(place.dsm, np.where(holes, np.nan, LEVEL))
        write_raster(place.dom, ground[turn], nodata=0)

    return changed


def one_far(place: Place) -> None:
    x, y = place.centres["a.jpg"]
    place.change_image("a.jpg", center=[NORTH_WEST[0] + x + 60, NORTH_WEST[1] - y, 200.0])


def cut_surface(side: int) -> Callable[[Place], None]:
    return lambda place: write_raster(place.dsm, LEVEL[:, :side, :side]) and None


def in_beijing_1954(place: Place) -> None:
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    write_raster(place.dom, ground, crs="EPSG:2437")
    write_raster(place.dsm, LEVEL, crs="EPSG:2437")
    place.change_poses(crs="EPSG:2437")
    for name in NAMES:
        tag(place, name, crs="EPSG:2437")


SUSPECT: dict[str, tuple[Callable[[Place], Any], list[str], set[Kind]]] = {
    "poses 40 m away": (
        moved,
        ["poses are 38.5", "all to one side (+38.5 m east, +1.5 m north)"],
        {Kind.GPS_PLAN},
    ),
    "a surface model lowered by 27.5 m": (
        lowered,
        ["cameras are 127.5 m above the surface model", "100.0 m above take-off (+27.5 m): poses"],
        {Kind.HEIGHT},
    ),
    "a surface model in feet": (
        in_feet,
        ["134.4 m above the surface", "in feet, the surface model would fit to 0.0 m"],
        {Kind.HEIGHT},
    ),
    "GPS of another datum": (
        retag(NAMES, up=30.0),
        ["poses are -30.0 m from their own photos' GPS in height"],
        {Kind.GPS_HEIGHT},
    ),
    "yaw turned": (
        retag(NAMES[1:3], yaw=178.0),
        ["the priors' yaw is 180 degrees off in 2 of 4 (park/b, park/c)"],
        {Kind.TURNED},
    ),
    "yaw of another axis": (
        retag(NAMES, yaw=92.0),
        ["yaw is 90 degrees too large in 4 of 4 (first 3: park/a, park/b, park/c)"],
        {Kind.TURNED},
    ),
    "pitch negated": (
        retag(NAMES, pitch=89.0),
        ["pitch has the wrong sign in 4 of 4"],
        {Kind.TURNED},
    ),
    "pitch from nadir": (
        retag(NAMES, pitch=-3.0),
        ["pitch is counted from nadir in 4 of 4"],
        {Kind.TURNED},
    ),
    "no gimbal": (
        retag(NAMES[:1], yaw=None),
        [
            "1 of 4 photos has no prior: 1 (park/a) have no gimbal angles. Matching asks the "
            "other 3, retrieval and reconstruction need none; --priors FILE",
        ],
        {Kind.NO_PRIOR},
    ),
    "no metadata in one": (
        no_metadata,
        ["no prior: 1 (park/a) have no GPS position. Matching"],
        {Kind.NO_PRIOR},
    ),
    "no gimbal at all": (
        retag(NAMES, yaw=None),
        ["4 of 4 photos have no prior: 4 (first 3: park/a, park/b, park/c) have no gimbal angles"],
        {Kind.NO_PRIOR},
    ),
    "copies": (
        copied,
        ["2 of 4 photos are copies of another, the same bytes: a.jpg = b.jpg = c"],
        {Kind.COPIES},
    ),
    "two cameras": (
        two_cameras,
        [
            "scene park has photos of 2 cameras with one camera matrix (FC300S, 64x48 px: 2 "
            "(a.jpg, b.jpg); FC6310, 64x48 px: 2 (c.jpg, sub/d.jpg)): give each image its own K",
        ],
        {Kind.CAMERAS},
    ),
    "two sizes": (
        lambda p: Image.new("L", (64, 40)).save(p.images / "b.jpg"),
        ["matrix (camera not stated, 64x40 px: 1 (b.jpg); camera not stated, 64x48 px: 3 (a.jpg"],
        {Kind.CAMERAS},
    ),
    "two flights": (
        two_flights,
        ["were taken from 2016-06-23 to 2019-07-01: one surface"],
        {Kind.DAYS},
    ),
    "one pose twice": (
        same_pose,
        ["1 of 4 photos (park/b) has the pose of another"],
        {Kind.SAME_POSE},
    ),
    "float32": (in_float32, ["have gone through float32: an error of 0.1"], {Kind.FLOAT32}),
    "two places": (
        in_one_line,
        ["taken from 2 places, and aligning a reconstruction needs 3"],
        {Kind.PLACES},
    ),
    "two heights": (one_height, ["no height near 4 of 4 cameras"], {Kind.NO_HEIGHT}),
    "a tower": (tower, ["1 of 4 cameras is below the surface model"], {Kind.BELOW}),
    "angles of another kind": (
        retag(NAMES, yaw=30.0),
        ["the priors' rotation is 30 degrees off (median)"],
        {Kind.ROTATION},
    ),
    "one height everywhere": (
        lambda p: write_raster(p.dsm, np.full_like(LEVEL, 100.0)) and None,
        ["the surface model is flat: every height is exactly 100 m"],
        {Kind.FLAT},
    ),
    "a cloud elsewhere": (
        cloud_beside,
        ["the true cloud has no point over a height"],
        {Kind.NO_CLOUD},
    ),
    "a map that is masked": (
        coloured(0, 0.97, 0),
        ["only 3.1% of the map shows anything"],
        {Kind.LITTLE_SHOWN},
    ),
    "a black map": (
        coloured(0, 1.0),
        ["100% of the map is exactly one colour (0 0 0)", "gdalwarp -srcnodata '0 0 0'"],
        {Kind.ONE_COLOUR},
    ),
    "a white collar": (
        coloured(255, 0.3),
        ["30% of the map is exactly one colour (255 255 255)"],
        {Kind.ONE_COLOUR},
    ),
    "a map upside down": (
        flipped(np.s_[:, ::-1]),
        ["the map is upside down against the surface model, by their empty pixels"],
        {Kind.FLIPPED},
    ),
    "a map mirrored": (
        flipped(np.s_[:, :, ::-1]),
        ["the map is mirrored against the surface"],
        {Kind.FLIPPED},
    ),
    "pixels not square": (
        lambda p: p.change_poses(K=[[64.0, 0, 32], [0, 72.0, 24], [0, 0, 1]]),
        ["fx is 0.89 times fy in 4 of 4 (first 3: park/a, park/b, park/c)"],
        {Kind.NOT_SQUARE},
    ),
    "one pose far from GPS": (
        one_far,
        ["poses are far from their own photos' GPS in 1 of 4 (park/a by 60 m), others are not"],
        {Kind.GPS_APART},
    ),
    "a surface model of a part": (
        cut_surface(100),
        ["the surface model lies below only 16% of the map", "only 6% of the photos' corners lie"],
        {Kind.LITTLE_SURFACE, Kind.OFF_SURFACE},
    ),
    "one tile": (
        lambda p: {"tile_size": 256},
        ["every tile answers every photo"],
        {Kind.EVERY_TILE},
    ),
    "few tiles": (
        lambda p: {"tile_size": 150},
        ["a random tile answers a photo in 67% of cases"],
        {Kind.CHANCE},
    ),
    "a plane of another datum": (
        lambda p: {"plane_height": 60},
        ["the ground plane is at 60.0 m, and the surface model is 99.5 to 100.0 m high"],
        {Kind.PLANE},
    ),
    "untagged zeros": (
        zeros,
        ["8% of the surface model's heights are exactly 0 m", "a_nodata"],
        {Kind.LOWEST},
    ),
    "a small hole of zeros": (
        hole,
        ["2 of the surface model's heights are exactly 0 m, its lowest, and the next is 99.5 m"],
        {Kind.LOWEST},
    ),
    "map shifted": (
        shifted,
        ["the map lies 30.0", "moved by -30.0 columns and +0.0"],
        {Kind.SHIFT},
    ),
    "map shifted, of another size": (
        shifted_holes,
        ["the map lies 10.8", "by their empty pixels: moved by -9.0 columns and +6.0 rows"],
        {Kind.SHIFT},
    ),
    "cloud of another datum": (
        high_cloud,
        ["the true cloud is +27.5 m from the surface model"],
        {Kind.CLOUD},
    ),
    "a map of one photo": (
        small_map,
        ["only 12% of the photos' corners lie on the map", "1 of 1 all of it", "more than half"],
        {Kind.OFF_MAP, Kind.CROPS},
    ),
    "a datum that PROJ cannot convert": (
        in_beijing_1954,
        ["poses and GPS have different datums, and PROJ knows no way from Beijing 1954 to WGS84"],
        {Kind.DATUM},
    ),
    "a coarse map": (coarse, ["a photo sees 12 pixels of the map"], {Kind.COARSE}),
}


def test_every_kind_has_a_case() -> None:
    assert {kind for _, _, kinds in SUSPECT.values() for kind in kinds} == set(Kind)


@pytest.mark.parametrize("name", ["warnings", "refusals"])
def test_the_docs_list_what_the_code_says(name: str) -> None:
    # Where this fails: python -m tests.datasets.documented
    assert documented.parts(documented.PAGE.read_text(), name)[1] == documented.lists()[name]


@pytest.mark.parametrize("name", documented.benchmarks())
def test_the_page_of_benchmarks_says_what_datasets_say(name: str) -> None:
    # Where this fails: python -m tests.datasets.documented
    page = documented.BENCHMARKS.read_text(encoding="utf-8")
    assert documented.parts(page, name)[1] == documented.benchmarks()[name]


@pytest.mark.parametrize("case", list(SUSPECT))
def test_what_is_suspect_is_named_then_and_later(
    case: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments, kinds = SUSPECT[case]
    changes = change(place)
    assert run_main(*place.arguments(**(changes or {}))) == 0
    said = capsys.readouterr()
    warned = [line[9:] for line in said.err.splitlines() if line.startswith("warning: ")]
    for fragment in fragments:
        assert any(fragment in line for line in warned), (fragment, warned)
    assert run_main("check-geometry", "park", "--format", "json") == 0
    found = json.loads(capsys.readouterr().out)["scenes"][0]
    assert found["warnings"] == warned
    facts = folder_facts(open_benchmark(Path("park")), "park")
    assert facts is not None
    assert kinds <= {kind for kind, _ in kinds_and_warnings(facts)}
    assert run_main("check-geometry", "park") == 0
    assert "warns" in capsys.readouterr().out


def test_corners_lie_on_a_map_across_the_180th_meridian(tmp_path: Path) -> None:
    pixels = np.zeros((3, 20, 20), np.uint8)
    transform = Affine(0.001, 0, 179.99, 0, -0.001, 50.01)
    write_raster(tmp_path / "dom.tif", pixels, crs="EPSG:4326", transform=transform)
    lonlat = np.array([(179.995, 50.0), (-179.995, 50.0), (-179.9, 50.0)])
    corners = from_lonlat("EPSG:32601", lonlat)
    inputs = SceneInputs("s", pd.DataFrame({"id": ["a"]}), "EPSG:32601", None, None, 0.0)

    assert _share_inside(corners[None], inputs, open_info(tmp_path / "dom.tif")) == 2 / 3

"""`prepare photos` compares what it holds: what it says, warns of and refuses."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from hypothesis import given
from PIL import Image
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.facts_lines import kinds_and_warnings
from airzoo_bench.datasets.geometry_checks.dataset import folder_facts, open_benchmark
from airzoo_bench.datasets.plausibility import Kind
from airzoo_bench.datasets.priors import prior_errors, turned_priors
from airzoo_bench.geometry.attitude import angles_to_rotations
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.geometry.poses import Poses
from tests.datasets import documented
from tests.datasets.test_dji import packet
from tests.geometry.support import quick, seeds
from tests.support import (
    MAP_SIZE_M,
    NORTH_WEST,
    PLACE_CRS,
    Place,
    make_place,
    run_main,
    write_raster,
)

LEVEL = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
LEVEL[0, 0, 0] = 99.5  # where no photo looks: a surface of one height is suspect
NAMES = ("a.jpg", "b.jpg", "c.jpg", "sub/d.jpg")


def tag(
    place: Place,
    name: str,
    *,
    yaw: float | None = 0.0,
    pitch: float = -89.0,
    up: float = 2.0,
    relative: float | None = 100.0,
    camera: str | None = None,
    day: str = "",
) -> None:
    """Write GPS, 2 m off the pose, and gimbal angles into a photo."""
    x, y = place.centres[name]
    lon, lat = to_lonlat(PLACE_CRS, (NORTH_WEST[0] + x + 1.5, NORTH_WEST[1] - y - 1.5)).tolist()
    exif = Image.Exif()
    exif.get_ifd(0x8825).update(
        {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 5: b"\0", 6: 200.0 + up}
    )
    if camera is not None:
        exif[0x0110] = camera
    exif.get_ifd(0x8769)[0x9003] = f"{day} 12:00:00"
    values = {"RelativeAltitude": relative}
    if yaw is not None:
        values |= {"GimbalYawDegree": yaw, "GimbalPitchDegree": pitch, "GimbalRollDegree": 0.0}
    texts = (
        f'drone-dji:{key}="{value:+.2f}"' for key, value in values.items() if value is not None
    )
    data = b"http://ns.adobe.com/xap/1.0/\0" + packet(" ".join(texts))
    stream = io.BytesIO()
    Image.new("L", (64, 48)).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    head = b"\xff\xe1" + (len(data) + 2).to_bytes(2)
    (place.images / name).write_bytes(content[:2] + head + data + content[2:])


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    made = make_place(tmp_path / "sources")
    write_raster(made.dsm, LEVEL)
    for name in NAMES:
        tag(made, name)
    return made


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
    assert "of cases; 4 empty tiles left out" in capsys.readouterr().out


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


SUSPECT: dict[str, tuple[Callable[[Place], Any], list[str]]] = {
    "poses 40 m away": (moved, ["poses are 38.5", "all to one side (+38.5 m east, +1.5 m north)"]),
    "a surface model lowered by 27.5 m": (
        lowered,
        ["cameras are 127.5 m above the surface model", "100.0 m above take-off (+27.5 m): poses"],
    ),
    "a surface model in feet": (
        in_feet,
        ["134.4 m above the surface", "in feet, the surface model would fit to 0.0 m"],
    ),
    "GPS of another datum": (
        retag(NAMES, up=30.0),
        ["poses are -30.0 m from their own photos' GPS in height"],
    ),
    "yaw turned": (
        retag(NAMES[1:3], yaw=178.0),
        ["the priors' yaw is 180 degrees off in 2 of 4 (park/b, park/c)"],
    ),
    "yaw of another axis": (
        retag(NAMES, yaw=92.0),
        ["yaw is 90 degrees too large in 4 of 4 (first 3: park/a, park/b, park/c)"],
    ),
    "pitch negated": (retag(NAMES, pitch=89.0), ["pitch has the wrong sign in 4 of 4"]),
    "pitch from nadir": (retag(NAMES, pitch=-3.0), ["pitch is counted from nadir in 4 of 4"]),
    "no gimbal": (
        retag(NAMES[:1], yaw=None),
        [
            "1 of 4 photos has no prior: 1 (park/a) have no gimbal angles. Matching asks the "
            "other 3, retrieval and reconstruction need none; --priors FILE",
        ],
    ),
    "no metadata in one": (no_metadata, ["no prior: 1 (park/a) have no GPS position. Matching"]),
    "no gimbal at all": (
        retag(NAMES, yaw=None),
        ["4 of 4 photos have no prior: 4 (first 3: park/a, park/b, park/c) have no gimbal angles"],
    ),
    "copies": (copied, ["2 of 4 photos are copies of another, the same bytes: a.jpg = b.jpg = c"]),
    "two cameras": (
        two_cameras,
        [
            "scene park has photos of 2 cameras with one camera matrix (FC300S, 64x48 px: 2 "
            "(a.jpg, b.jpg); FC6310, 64x48 px: 2 (c.jpg, sub/d.jpg)): give each image its own K",
        ],
    ),
    "two sizes": (
        lambda p: Image.new("L", (64, 40)).save(p.images / "b.jpg"),
        ["matrix (camera not stated, 64x40 px: 1 (b.jpg); camera not stated, 64x48 px: 3 (a.jpg"],
    ),
    "two flights": (two_flights, ["were taken from 2016-06-23 to 2019-07-01: one surface"]),
    "one pose twice": (same_pose, ["1 of 4 photos (park/b) has the pose of another"]),
    "float32": (in_float32, ["have gone through float32: an error of 0.1"]),
    "two places": (in_one_line, ["taken from 2 places, and aligning a reconstruction needs 3"]),
    "two heights": (one_height, ["no height near 4 of 4 cameras"]),
    "a tower": (tower, ["1 of 4 cameras is below the surface model"]),
    "angles of another kind": (
        retag(NAMES, yaw=30.0),
        ["the priors' rotation is 30 degrees off (median)"],
    ),
    "one height everywhere": (
        lambda p: write_raster(p.dsm, np.full_like(LEVEL, 100.0)) and None,
        ["the surface model is flat: every height is exactly 100 m"],
    ),
    "a cloud elsewhere": (cloud_beside, ["the true cloud has no point over a height"]),
    "a map that is masked": (coloured(0, 0.97, 0), ["only 3.1% of the map shows anything"]),
    "a black map": (
        coloured(0, 1.0),
        ["100% of the map is exactly one colour (0 0 0)", "gdalwarp -srcnodata '0 0 0'"],
    ),
    "a white collar": (coloured(255, 0.3), ["30% of the map is exactly one colour (255 255 255)"]),
    "a map upside down": (
        flipped(np.s_[:, ::-1]),
        ["the map is upside down against the surface model, by their empty pixels"],
    ),
    "a map mirrored": (flipped(np.s_[:, :, ::-1]), ["the map is mirrored against the surface"]),
    "pixels not square": (
        lambda p: p.change_poses(K=[[64.0, 0, 32], [0, 72.0, 24], [0, 0, 1]]),
        ["fx is 0.89 times fy in 4 of 4 (first 3: park/a, park/b, park/c)"],
    ),
    "one pose far from GPS": (
        one_far,
        ["poses are far from their own photos' GPS in 1 of 4 (park/a by 60 m), others are not"],
    ),
    "a surface model of a part": (
        cut_surface(100),
        ["the surface model lies below only 16% of the map", "only 6% of the photos' corners lie"],
    ),
    "one tile": (lambda p: {"tile_size": 256}, ["every tile answers every photo"]),
    "few tiles": (lambda p: {"tile_size": 150}, ["a random tile answers a photo in 67% of cases"]),
    "untagged zeros": (zeros, ["8% of the surface model's heights are exactly 0 m", "a_nodata"]),
    "map shifted": (shifted, ["the map lies 30.0", "moved by -30.0 columns and +0.0"]),
    "map shifted, of another size": (
        shifted_holes,
        ["the map lies 10.8", "by their empty pixels: moved by -9.0 columns and +6.0 rows"],
    ),
    "cloud of another datum": (high_cloud, ["the true cloud is +27.5 m from the surface model"]),
    "a map of one photo": (
        small_map,
        ["only 12% of the photos' corners lie on the map", "1 of 1 all of it", "more than half"],
    ),
    "a coarse map": (coarse, ["a photo sees 12 pixels of the map"]),
}


KINDS: dict[str, tuple[Kind, ...]] = {
    "poses 40 m away": (Kind.GPS_PLAN,),
    "a surface model lowered by 27.5 m": (Kind.HEIGHT,),
    "a surface model in feet": (Kind.HEIGHT,),
    "GPS of another datum": (Kind.GPS_HEIGHT,),
    "yaw turned": (Kind.TURNED,),
    "yaw of another axis": (Kind.TURNED,),
    "pitch negated": (Kind.TURNED,),
    "pitch from nadir": (Kind.TURNED,),
    "no gimbal": (Kind.NO_PRIOR,),
    "no metadata in one": (Kind.NO_PRIOR,),
    "no gimbal at all": (Kind.NO_PRIOR,),
    "copies": (Kind.COPIES,),
    "two cameras": (Kind.CAMERAS,),
    "two sizes": (Kind.CAMERAS,),
    "two flights": (Kind.DAYS,),
    "one pose twice": (Kind.SAME_POSE,),
    "float32": (Kind.FLOAT32,),
    "two places": (Kind.PLACES,),
    "two heights": (Kind.NO_HEIGHT,),
    "a tower": (Kind.BELOW,),
    "angles of another kind": (Kind.ROTATION,),
    "one height everywhere": (Kind.FLAT,),
    "a cloud elsewhere": (Kind.NO_CLOUD,),
    "a map that is masked": (Kind.LITTLE_SHOWN,),
    "a black map": (Kind.ONE_COLOUR,),
    "a white collar": (Kind.ONE_COLOUR,),
    "a map upside down": (Kind.FLIPPED,),
    "a map mirrored": (Kind.FLIPPED,),
    "pixels not square": (Kind.NOT_SQUARE,),
    "one pose far from GPS": (Kind.GPS_APART,),
    "a surface model of a part": (
        Kind.LITTLE_SURFACE,
        Kind.OFF_SURFACE,
    ),
    "one tile": (Kind.EVERY_TILE,),
    "few tiles": (Kind.CHANCE,),
    "untagged zeros": (Kind.LOWEST,),
    "map shifted": (Kind.SHIFT,),
    "map shifted, of another size": (Kind.SHIFT,),
    "cloud of another datum": (Kind.CLOUD,),
    "a map of one photo": (
        Kind.OFF_MAP,
        Kind.CROPS,
    ),
    "a coarse map": (Kind.COARSE,),
}


def test_every_kind_has_a_case() -> None:
    assert {kind for kinds in KINDS.values() for kind in kinds} == set(Kind)


@pytest.mark.parametrize("name", ["warnings", "refusals"])
def test_the_docs_list_what_the_code_says(name: str) -> None:
    # Where this fails: python -m tests.datasets.documented
    assert documented.parts(documented.PAGE.read_text(), name)[1] == documented.lists()[name]


@pytest.mark.parametrize("case", list(SUSPECT))
def test_what_is_suspect_is_named_then_and_later(
    case: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments = SUSPECT[case]
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
    assert set(KINDS[case]) <= {kind for kind, _ in kinds_and_warnings(facts)}
    assert run_main("check-geometry", "park") == 0
    assert "warns" in capsys.readouterr().out


def feet_above(place: Place) -> None:
    write_raster(place.dsm, LEVEL / 0.3048)


def untagged(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, :64] = -9999
    write_raster(place.dsm, heights)


def mostly_zero(place: Place) -> None:
    heights = np.where(np.arange(256)[:, None] < 200, 0, LEVEL).astype(np.float32)
    write_raster(place.dsm, heights)
    far = Affine(1, 0, NORTH_WEST[0] + 9000, 0, -1, NORTH_WEST[1])
    write_raster(place.dom, np.full((3, 256, 256), 9, np.uint8), transform=far)


def in_degrees(step: float, north: float) -> Callable[[Place], None]:
    def change(place: Place) -> None:
        grid = Affine(step, 0, 10.0, 0, -step, north)
        write_raster(
            place.dom, np.full((3, 900, 100), 9, np.uint8), crs="EPSG:4326", transform=grid
        )

    return change


def in_mercator(place: Place) -> None:
    place.change_poses(crs="EPSG:3857")
    write_raster(place.dsm, LEVEL, crs="EPSG:3857")


def sparse(side: int, which: str) -> Callable[[Place], None]:
    def change(place: Place) -> None:
        profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "tiled": True}
        profile |= {"dtype": "uint8", "sparse_ok": True, "bigtiff": "yes", "crs": PLACE_CRS}
        profile |= {"transform": Affine(0.01, 0, NORTH_WEST[0], 0, -0.01, NORTH_WEST[1])}
        with rasterio.open(getattr(place, which), "w", **profile, blockxsize=4096, blockysize=4096):
            pass

    return change


def zone_beside(place: Place) -> None:
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    write_raster(place.dom, ground, crs="EPSG:32634")


REFUSED: dict[str, tuple[Callable[[Place], Any], list[str]]] = {
    "cameras below a DSM in feet": (
        feet_above,
        ["every camera is below the surface: they are at 200.0 m", "is at 328.1 m", "be 100.0 m"],
    ),
    "-9999 untagged": (untagged, ["25.0% of its heights are no", "from -9999 to 100 m", "-9999"]),
    "nothing to ask": (
        mostly_zero,
        ["does not overlap the surface model"],
    ),
    "latitude of -93": (in_degrees(0.18, 69.0), ["reaches from -93.0000 to 69.0000 degrees"]),
    "pixels larger than photos": (in_degrees(0.18, 89.0), ["a pixel is 19,", "photo sees 100.0 m"]),
    "web Mercator": (in_mercator, ["EPSG:3857", "no metres here", "latitude 42.", "UTM zone"]),
    "a map too large": (sparse(400_000, "dom"), ["is 400,000 x 400,000 px", "-projwin"]),
    "a surface too large": (sparse(400_000, "dsm"), ["is 400,000 x 400,000 px", "-tr"]),
    "a map elsewhere": (
        zone_beside,
        [
            "dom.tif: does not overlap the surface model: in the CRS of that, the map spans x 95",
            "the surface model x 500000.0 to 500256.0, y 5199744.0 to 5200000.0",
        ],
    ),
    "too many tiles": (sparse(100_000, "dom"), ["make 9,759,376 tiles", "larger --tile-size"]),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_what_cannot_be_is_refused(
    case: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments = REFUSED[case]
    change(place)
    assert run_main(*place.arguments()) == 2
    said = capsys.readouterr()
    assert said.out == ""
    for fragment in fragments:
        assert fragment in said.err


def edited(key: str, value: str) -> Callable[[Path, Place], None]:
    def change(folder: Path, _: Place) -> None:
        file = folder / "benchmark.toml"
        lines = file.read_text().splitlines(keepends=True)
        assert any(line.startswith(key) for line in lines)
        file.write_text(
            "".join(f"{key} = {value}\n" if line.startswith(key) else line for line in lines)
        )

    return change


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        (edited("plane_height_m", "9.0"), "plane_height_m is 9, and the photos' altitudes are abo"),
        (edited("crs", '"EPSG:32634"'), "its CRS is EPSG:32634, that of the surface model EPSG:32"),
        (lambda _, p: write_raster(p.dsm, LEVEL + 1), "the surface model is not the one that the"),
        (
            lambda _, p: write_raster(p.dom, np.full((3, 200, 200), 9, np.uint8)),
            "is 200 x 200 px, and tiles reach to 256, 256",
        ),
    ],
)
@pytest.mark.parametrize("command", ["check-geometry", "check-split"])
def test_what_was_changed_since_is_refused(
    command: str,
    change: Callable[[Path, Place], Any],
    fragment: str,
    place: Place,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if command == "check-split" and "tiles" in fragment:
        pytest.skip("footprints need no map")
    assert run_main(*place.arguments()) == 0
    change(place.dsm.parent.parent / "data" / "park", place)
    capsys.readouterr()
    names = ("park",) if command == "check-geometry" else ("park", "park")
    assert run_main(command, *names) == 2
    assert fragment in capsys.readouterr().err


def test_poses_and_surface_in_their_stated_feet(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    foot = 1200 / 3937
    assert run_main(*place.arguments()) == 0
    plain = capsys.readouterr().out
    queries = place.dsm.parent.parent / "data/park/scenes/park/queries.csv"
    before = queries.read_text()
    place.change_poses(crs=f"{PLACE_CRS}+6360")
    for name, (x, y) in place.centres.items():
        at = [NORTH_WEST[0] + x, NORTH_WEST[1] - y, 200.0 / foot]
        place.change_image(name, center=at)
    write_raster(place.dsm, (LEVEL / foot).astype(np.float32), crs=f"{PLACE_CRS}+6360")
    assert run_main(*place.arguments(), "--force") == 0
    assert capsys.readouterr().out == plain
    rows = zip(before.splitlines()[1:], queries.read_text().splitlines()[1:], strict=True)
    for one, other in rows:
        np.testing.assert_allclose(
            *(np.array(row.split(",")[2:], float) for row in (one, other)), atol=1e-5
        )


def test_priors_from_a_table(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        tag(place, name, yaw=None)
    assert run_main(*place.arguments()) == 0
    assert "4 of 4 photos have no prior: 4 (first" in capsys.readouterr().err
    table = place.dsm.with_name("priors.csv")
    rows = "".join(f"{name},1.5,-88,0,\n" for name in NAMES)
    table.write_text(f"image,yaw_deg,pitch_deg,roll_deg,altitude_m\n{rows}")
    assert run_main(*place.arguments(priors=table), "--force") == 0
    said = capsys.readouterr()
    assert "priors          4, off by 2.9 m; yaw 1.5, pitch 2.0, rotation 2.5 degrees" in said.out
    assert "warning" not in said.err
    assert run_main("check-geometry", "park") == 0
    assert "passes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "has the columns "),
        ("name,yaw_deg\na.jpg,1\n", "has the columns name, yaw_deg"),
        ("image,heading\na.jpg,1\n", "expected: image, and some of lon, lat"),
        ("image,yaw_deg\na.jpg,1,2\n", "has the columns None, image, yaw_deg"),
        ("image,yaw_deg\na.jpg,1\na.jpg,2\n", "named twice: 1 ('a.jpg')"),
        ("image,yaw_deg\nz.jpg,1\n", "no photos: 1 ('z.jpg')"),
        ("image,yaw_deg\na.jpg,north\n", "column yaw_deg, line 2: 'north'"),
        ("image,yaw_deg\na.jpg,nan\n", "column yaw_deg, line 2: 'nan'"),
        ("image,lat\na.jpg,93\n", "column lat, line 2: '93'"),
    ],
)
def test_bad_tables_of_priors(
    table: str, said: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place.dsm.with_name("priors.csv")
    path.write_text(table)
    assert run_main(*place.arguments(priors=path)) == 2
    message = capsys.readouterr().err
    assert said in message
    assert "priors.csv" in message


@pytest.mark.parametrize(
    ("crs", "vertical", "said"),
    [
        (PLACE_CRS, None, None),
        (f"{PLACE_CRS}+5703", None, None),
        (f"{PLACE_CRS}+6360", None, "heights in units of 0.3048006096 m"),
        ("EPSG:32632", None, "differ in CRS"),
        ("EPSG:2263", None, "differ in CRS"),
    ],
)
def test_units_of_a_cloud(
    crs: str,
    vertical: str | None,
    said: str | None,
    place: Place,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import laspy
    from pyproj import CRS

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.offsets, header.scales = np.array([*NORTH_WEST, 0]), np.full(3, 0.01)
    header.add_crs(CRS(crs))
    made = laspy.LasData(header)
    made.x, made.y = NORTH_WEST[0] + np.arange(9.0), NORTH_WEST[1] - np.arange(9.0)
    made.z = np.full(9, 100.0)
    cloud = place.dsm.with_name("cloud.las")
    made.write(cloud)
    assert run_main(*place.arguments(cloud=cloud)) == (0 if said is None else 2)
    assert (said or "") in capsys.readouterr().err


@quick
@given(seeds)
def test_turned_priors_are_told_from_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw, pitch, roll = rng.uniform((-180, -85, -5), (180, -50, 5), (12, 3)).T
    noise = Rotation.from_rotvec(rng.normal(0, 2, (12, 3)), degrees=True).as_matrix()

    def poses(yaw: Any, pitch: Any, roll: Any) -> Poses:
        rotations = noise @ angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
        return Poses.from_centres(rotations, np.zeros((12, 3)))

    truth = Poses.from_centres(
        angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0), np.zeros((12, 3))
    )
    assert turned_priors(poses(yaw, pitch, roll), truth) == {}
    _, _, pitch_deg, rotation_deg = prior_errors(poses(yaw, pitch, roll), truth)
    assert (rotation_deg < 15).all()
    assert (pitch_deg <= rotation_deg + 1e-9).all()
    half = turned_priors(poses(np.where(np.arange(12) < 5, yaw + 180, yaw), pitch, roll), truth)
    ((what, rows),) = half.items()
    assert what == "yaw is 180 degrees off"
    assert rows.tolist() == [True] * 5 + [False] * 7
    for off, what in ((90, "yaw is 90 degrees too large"), (-90, "yaw is 90 degrees too small")):
        ((found, rows),) = turned_priors(poses(yaw + off, pitch, roll), truth).items()
        assert (found, rows.all()) == (what, True)
    away = np.abs(np.abs(yaw) % 90 - 45) < 20
    negated = turned_priors(poses(-yaw, pitch, roll), truth)
    assert not away.any() or next(iter(negated)) in (
        "yaw has the wrong sign",
        "yaw is 180 degrees off",
    )
    nonsense = turned_priors(poses(yaw + 135, pitch, roll), truth)
    assert list(nonsense)[-1] == "rotation is more than 45 degrees off"
    assert sum(nonsense.values()).tolist() == [1] * 12

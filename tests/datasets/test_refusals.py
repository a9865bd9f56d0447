"""What `prepare photos` and checks of a folder refuse."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio import Affine

from tests.datasets.tagged import LEVEL
from tests.support import MAP_SIZE_M, NORTH_WEST, PLACE_CRS, Place, run_main, write_raster


def feet_above(place: Place) -> None:
    write_raster(place.dsm, LEVEL / 0.3048)


def untagged(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, :64] = -9999
    write_raster(place.dsm, heights)


def untagged_in_feet(place: Place) -> None:
    heights = LEVEL / 0.3048
    heights[0, :64] = -9999
    write_raster(place.dsm, heights)
    with rasterio.open(place.dsm, "r+") as raster:
        raster.units = ("ft",)


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
    "-9999 ft untagged": (
        untagged_in_feet,
        ["they go from -3047.6952 to ", "gdal_edit.py -a_nodata -9999"],
    ),
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


CHANGED: list[tuple[Callable[[Path, Place], Any], str]] = [
    (edited("plane_height_m", "9.0"), "plane_height_m is 9, and the photos' altitudes are abo"),
    (edited("crs", '"EPSG:32634"'), "its CRS is EPSG:32634, that of the surface model EPSG:32"),
    (lambda _, p: write_raster(p.dsm, LEVEL + 1), "the surface model is not the one that the"),
]
# Footprints, which check-split compares, need no map.
CHANGED_MAP = (
    lambda _, p: write_raster(p.dom, np.full((3, 200, 200), 9, np.uint8)),
    "is 200 x 200 px, and tiles reach to 256, 256",
)


@pytest.mark.parametrize(
    ("command", "change", "fragment"),
    [
        *(("check-geometry", *case) for case in (*CHANGED, CHANGED_MAP)),
        *(("check-split", *case) for case in CHANGED),
    ],
)
def test_what_was_changed_since_is_refused(
    command: str,
    change: Callable[[Path, Place], Any],
    fragment: str,
    place: Place,
    capsys: pytest.CaptureFixture[str],
) -> None:
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

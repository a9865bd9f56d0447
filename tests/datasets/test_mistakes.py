"""Offsets between poses, GPS and surface model whose cause has a name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.datasets.mistakes import height_cause, position_cause
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.chinese_maps import wgs84_to_bd09, wgs84_to_gcj02
from airzoo_bench.geometry.frames import from_lonlat
from tests.datasets.tagged import LEVEL, NAMES, tag
from tests.geoids import EGM2008, proj_with, undulation_m, write_geoid
from tests.support import MAP_SIZE_M, Place, run_main, write_raster

CHINA = "EPSG:32650"
HERE = np.array([15.0, 46.95])  # where the made-up place is
XIAN = np.array([[108.94, 34.26], [108.941, 34.262], [108.938, 34.259]])
EUROPE = np.array([[13.4, 52.5], [13.401, 52.502], [13.402, 52.5]])
METRES = 1e-5  # about a metre, in degrees


def in_china(place: Place) -> None:
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    write_raster(place.dom, ground, crs=CHINA)
    write_raster(place.dsm, LEVEL, crs=CHINA)
    place.change_poses(crs=CHINA)


def warned(place: Place, capsys: pytest.CaptureFixture[str]) -> str:
    assert run_main(*place.arguments()) == 0
    return capsys.readouterr().err


def swapped(lonlat: Floats) -> Floats:
    return lonlat[..., ::-1]


@pytest.mark.parametrize(
    ("gps", "poses", "said"),
    [
        (swapped(EUROPE), EUROPE, "with longitude and latitude swapped the positions would fit"),
        (swapped(XIAN), XIAN, "with longitude and latitude swapped"),
        (np.radians(EUROPE), EUROPE, "taken as radians the positions would fit"),
        (EUROPE * (-1, 1), EUROPE, "with longitudes of the other sign"),
        (EUROPE * (1, -1), EUROPE, "with latitudes of the other sign"),
        (wgs84_to_gcj02(XIAN), XIAN, "WGS84 here: GPS or priors look like GCJ-02, poses like WGS"),
        (XIAN, wgs84_to_gcj02(XIAN), "look like GCJ-02, GPS like WGS84"),
        (wgs84_to_bd09(XIAN), XIAN, "GPS or priors look like BD-09"),
        (XIAN, wgs84_to_bd09(XIAN), "come from, look like BD-09, GPS like WGS84"),
        (EUROPE, EUROPE, ""),
        (EUROPE + np.array((0.007, -0.001)), EUROPE, ""),
        (np.full((3, 2), np.nan), EUROPE, ""),
    ],
)
def test_the_mistake_is_named(gps: Floats, poses: Floats, said: str) -> None:
    noisy = gps + np.random.default_rng(3).normal(0, 3 * METRES, gps.shape)
    # Noise in radians is 57 times as large.
    found = position_cause(gps if "radians" in said else noisy, poses)
    assert said in found
    assert bool(found) == bool(said)


def test_positions_that_agree_to_the_last_digit_have_no_mistake() -> None:
    assert position_cause(EUROPE, EUROPE) == ""


@pytest.mark.parametrize("turn", [45, 90, 135, 270])
def test_a_shift_as_large_elsewhere_is_not_a_chinese_map(turn: int) -> None:
    shift = wgs84_to_gcj02(XIAN) - XIAN
    sine, cosine = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    turned = shift @ np.array([[cosine, sine], [-sine, cosine]])
    assert position_cause(XIAN + turned, XIAN) == ""


@pytest.mark.parametrize(
    ("shift", "said"),
    [
        (wgs84_to_gcj02, "GPS or priors look like GCJ-02, poses like WGS84 (2 m would be left)"),
        (np.radians, "taken as radians the positions would fit (2 m would be left)"),
    ],
)
def test_prepare_names_the_mistake(
    place: Place,
    capsys: pytest.CaptureFixture[str],
    shift: Callable[[Floats], Floats],
    said: str,
) -> None:
    in_china(place)
    for name in NAMES:
        tag(place, name, crs=CHINA, lonlat=shift, yaw=None)
    assert said in warned(place, capsys)


def test_swapped_positions_are_named(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        tag(place, name, lonlat=swapped)
    said = warned(place, capsys)
    assert "with longitude and latitude swapped the positions would fit (2 m" in said


def test_swapped_positions_beyond_the_earth_are_refused_by_that_name(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    in_china(place)
    tag(place, "b.jpg", crs=CHINA, lonlat=swapped)
    assert run_main(*place.arguments()) == 2
    said = capsys.readouterr().err
    assert "b.jpg: no position on the earth: longitude 46.9" in said
    assert "fix:      swap longitude and latitude: one is beyond 90 degrees" in said


def test_swapped_columns_of_priors_are_refused_by_that_name(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    priors = tmp_path / "priors.csv"
    priors.write_text("image,lon,lat\na.jpg,34.2,108.9\n")
    assert run_main(*place.arguments(priors=priors)) == 2
    said = capsys.readouterr().err
    assert "column lat, line 2: '108.9'" in said
    assert "fix:      look whether lon and lat are swapped" in said


def test_angles_in_radians_are_named(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    priors, rows = tmp_path / "priors.csv", ["image,yaw_deg,pitch_deg,roll_deg"]
    rows += [f"{name},0.02,{np.radians(-89.0)},0" for name in NAMES]
    priors.write_text("\n".join(rows))
    assert run_main(*place.arguments(priors=priors)) == 0
    assert "the priors' angles are in radians in 4 of 4" in capsys.readouterr().err


def test_poses_with_x_and_y_swapped_are_refused_by_that_name(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, image in place.read_poses()["images"].items():
        x, y, z = image["center"]
        place.change_image(name, center=[y, x, z])
    assert run_main(*place.arguments()) == 2
    said = capsys.readouterr().err
    assert "fix:      swap x and y of the camera centres: these then lie on the surf" in said


def test_poses_from_a_shifted_map_are_named(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    in_china(place)

    def unshifted(lonlat: Floats) -> Floats:
        found = lonlat
        for _ in range(5):
            found = found + lonlat - wgs84_to_gcj02(found)
        return found

    for name in NAMES:
        tag(place, name, crs=CHINA, lonlat=unshifted)
    said = warned(place, capsys)
    assert "poses, and the map and surface model that they come from, look like GCJ-02" in said
    assert "(2 m would be left)" in said


@pytest.fixture
def geoid(tmp_path: Path) -> Path:
    return write_geoid(tmp_path, EGM2008).parent


@pytest.mark.parametrize(
    ("sign", "high", "low"), [(1, "poses", "GPS"), (-1, "GPS", "poses")], ids=["up", "down"]
)
def test_gps_off_by_the_undulation_is_named(
    place: Place, geoid: Path, capsys: pytest.CaptureFixture[str], sign: int, high: str, low: str
) -> None:
    for name in NAMES:
        tag(place, name, up=-sign * undulation_m(*HERE) + 1.0)
    with proj_with(geoid):
        said = warned(place, capsys)
    assert "that is the geoid's undulation here (+44.8 m by EGM2008) to 1.0 m" in said
    assert f"{high} look like heights above the ellipsoid, {low} like heights above sea" in said


def test_a_surface_model_off_by_the_undulation_is_named(
    place: Place, geoid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_raster(place.dsm, (LEVEL - undulation_m(*HERE)).astype(np.float32))
    with proj_with(geoid):
        said = warned(place, capsys)
    assert "(+44.8 m): poses and surface model may have different vertical datums" in said
    assert "to 0.0 m: poses look like heights above the ellipsoid, the surface model like" in said


def test_another_offset_is_not_called_the_undulation(
    place: Place, geoid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_raster(place.dsm, LEVEL - 27.5)
    with proj_with(geoid):
        said = warned(place, capsys)
    assert "that is not the geoid's undulation here (+44.8 m by EGM2008)" in said


def test_without_the_grid_it_says_how_to_install_it(
    place: Place, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_raster(place.dsm, LEVEL - 27.5)
    with proj_with(tmp_path):
        said = warned(place, capsys)
    assert "cannot be said without its grid: pyproj sync --file us_nga_egm08_25.tif" in said


def test_a_small_undulation_explains_nothing(tmp_path: Path) -> None:
    write_geoid(tmp_path, EGM2008, base_m=-5.0)  # -0.2 m here
    with proj_with(tmp_path):
        assert height_cause(4.0, HERE, "a", "b").startswith("that is not")


def test_the_place_in_china_is_where_the_formula_holds() -> None:
    assert np.isfinite(from_lonlat(CHINA, (117.0, 46.9))).all()
    assert (wgs84_to_gcj02((117.0, 46.9)) != (117.0, 46.9)).all()

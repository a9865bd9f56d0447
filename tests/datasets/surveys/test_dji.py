"""Folders of DJI photos: RTK quality, time stamps, lenses, and why there is no matching."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.surveys.dji_stamps import read_time_stamps
from airzoo_bench.datasets.surveys.dji_tags import read_tags
from tests.datasets.surveys.dji_folders import dji_folder, write_time_stamps
from tests.datasets.surveys.survey import (
    CORNER,
    GROUND_M,
    NAMES,
    PHOTO,
    Made,
    options_of,
    prior_file,
    read_scene,
)
from tests.geoids import EGM2008, proj_with, undulation_m, write_geoid
from tests.support import run_main


def scene(made: Made, folder: Path, *more: object):
    return read_scene(["dji", "--source", folder, *made.maps, *more])


def test_photos_without_a_fix_are_left_out_and_named(made: Made) -> None:
    found = scene(made, dji_folder(made, flags=(50, 34, 50, 16, 50)))

    assert found.names == (NAMES[0], NAMES[2], NAMES[4])
    assert found.unposed == (NAMES[1], NAMES[3])
    said = " ".join(found.notes)
    assert "without an RTK fix, left out: 2 of 5 (DJI_0002.JPG, DJI_0004.JPG)" in said
    assert "good to 0.014 m in plan and 0.020 m in height" in said
    assert found.truth_accuracy_m == pytest.approx(np.sqrt(2 * 0.01**2 + 0.02**2), abs=1e-4)


def test_the_users_accuracy_wins(made: Made) -> None:
    folder = dji_folder(made)
    assert scene(made, folder, "--truth-accuracy", 0.5).truth_accuracy_m == 0.5
    with pytest.raises(UserError, match="is no accuracy"):
        scene(made, folder, "--truth-accuracy", 0)


@pytest.mark.parametrize(
    ("changes", "turned"),
    [
        ({"GimbalRollDegree": "+180.0"}, True),
        ({"GimbalYawDegree": "-170.0", "FlightYawDegree": "+10.0"}, True),
        ({"GimbalYawDegree": "+10.0", "FlightYawDegree": "+10.0"}, False),
        # The drone's own way of writing no turn at all, straight down.
        (
            {
                "GimbalYawDegree": "-170.0",
                "GimbalPitchDegree": "-90.0",
                "GimbalRollDegree": "+180.0",
                "FlightYawDegree": "+10.0",
            },
            False,
        ),
    ],
)
def test_truth_that_is_turned_is_warned_of(
    made: Made, changes: dict[str, str], turned: bool
) -> None:
    said = " ".join(scene(made, dji_folder(made, changes=changes)).notes)

    assert ("WARNING: gimbal angles turn cameras by more than 135 degrees" in said) is turned


def test_any_position_will_do_by_name(made: Made) -> None:
    found = scene(made, dji_folder(made, flags=(None,) * 5), "--rtk", "any")

    assert found.names == NAMES
    assert "without an RTK fix, taken nevertheless: 5 of 5" in " ".join(found.notes)


def test_no_prior_is_the_truth(made: Made) -> None:
    found = scene(made, dji_folder(made))
    dataset, options = options_of(["dji", "--source", found.images, *made.maps])

    assert found.priors is None
    assert dataset.protocols(options, made.folder).matching.scores.orientation_is_trusted is False
    assert "cannot be the prior too" in dataset.without_truth["matching"]


def test_priors_of_another_source_serve_matching(made: Made) -> None:
    found = scene(made, dji_folder(made), "--priors", prior_file(made, 5e-5))

    away = np.linalg.norm(found.priors.centres - found.poses.centres, axis=1)
    np.testing.assert_allclose(away, 3.8, atol=0.1)


def test_without_a_surface_the_ground_is_where_the_drone_took_off(made: Made) -> None:
    arguments = ["dji", "--source", dji_folder(made), "--dom", made.dom]

    found = read_scene(arguments)

    assert found.dsm is None
    assert found.plane_height_m == pytest.approx(GROUND_M)
    assert any("a plane at 100.00 m, where the drone took off" in note for note in found.notes)
    dataset, options = options_of(arguments)
    assert dataset.protocols(options, made.folder).matching is None


def test_what_is_said_fits_what_was_given(
    made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("prepare", "dji", "--source", dji_folder(made), *made.maps, "--tile-size", 64)

    assert run_main(*command, "--name", "place") == 0

    said = capsys.readouterr()
    assert "it needs --priors of another source\n" in said.out  # --dsm was given
    assert "the photos' own positions and angles" in said.out
    assert "m from the photos' GPS" not in said.out
    assert "no prior" not in said.err
    assert run_main("check-geometry", "place") == 0
    assert "no prior" not in "".join(capsys.readouterr())
    priors = prior_file(made, 5e-5)
    priors.write_text("".join(priors.read_text().splitlines(keepends=True)[:-1]))
    assert run_main(*command, "--priors", priors, "--name", "other") == 0
    assert "have no whole row in --priors" in capsys.readouterr().err


def test_it_prepares_without_a_surface(
    made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = ("--source", dji_folder(made), "--dom", made.dom)

    assert run_main("prepare", "dji", *sources, "--tile-size", 64, "--name", "place") == 0

    said = capsys.readouterr()
    assert "5 queries" in said.out
    assert "the photos' metadata are the truth" in said.out
    assert "where the drone took off" in said.err


@pytest.mark.parametrize("stamped", [True, False])
def test_heights_above_the_ellipsoid_become_those_of_the_surface(
    made: Made, tmp_path: Path, stamped: bool
) -> None:
    """Time stamps are above the ellipsoid, and surface models above a geoid, as a rule."""
    write_geoid(tmp_path, EGM2008)
    folder = dji_folder(made)
    if stamped:
        write_time_stamps(made, folder)
    priors = ("--priors", prior_file(made, 5e-5))
    vertical = ("--vertical-crs", "EPSG:4979", "--dsm-vertical-crs", "EPSG:3855")
    undulation = undulation_m(*made.lonlat.mean(axis=0))

    with proj_with(tmp_path):
        found = scene(made, folder, *vertical, *priors)
        both = scene(made, folder, *vertical, *priors, "--priors-vertical-crs", "EPSG:4979")

    above = made.centres[:, 2] - undulation
    np.testing.assert_allclose(found.poses.centres[:, 2], above, atol=0.01)
    np.testing.assert_allclose(found.priors.centres[:, 2], made.centres[:, 2])
    np.testing.assert_allclose(both.priors.centres[:, 2], above, atol=0.01)
    altitudes = [found.metadata[name].altitude_m for name in NAMES]
    np.testing.assert_allclose(altitudes, found.poses.centres[:, 2], atol=0.01)
    assert "heights of the poses are converted to the surface model's" in " ".join(found.notes)


def test_the_plane_is_converted_with_the_photos(made: Made, tmp_path: Path) -> None:
    write_geoid(tmp_path, EGM2008)
    vertical = ("--vertical-crs", "EPSG:4979", "--dsm-vertical-crs", "EPSG:3855")
    arguments = ["dji", "--source", dji_folder(made), "--dom", made.dom, *vertical]

    with proj_with(tmp_path):
        found = read_scene(arguments)

    undulation = undulation_m(*made.lonlat.mean(axis=0))
    assert found.plane_height_m == pytest.approx(GROUND_M - undulation, abs=0.01)


@pytest.mark.parametrize("suffixes", [True, False])
def test_time_stamps_are_read_by_order(made: Made, suffixes: bool) -> None:
    folder = dji_folder(made)
    first, *_ = stamps = read_time_stamps(write_time_stamps(made, folder, suffixes))

    assert [stamp.number for stamp in stamps] == [1, 2, 3, 4, 5]
    assert (first.lat, first.lon) == pytest.approx(tuple(made.lonlat[0][::-1]), abs=1e-9)
    assert (first.height_m, first.std_m, first.flag) == (180.0, (0.016, 0.012, 0.03), 50)


@pytest.mark.parametrize(
    ("changes", "without", "film_mm", "lens", "named"),
    [
        ({"DewarpFlag": "1"}, (), None, {"fx": 42.0, "k1": 0.0}, "without distortion"),
        (
            {},
            (),
            None,
            {"fx": 42.0, "cx": 20.5, "cy": 14.25, "k1": 0.02, "k3": 0.003},
            "DewarpData",
        ),
        # The diagonal is 50 px, and that of the film 43.27 mm.
        ({}, ("DewarpData",), 24, {"fx": 24 / np.hypot(36, 24) * 50}, "35 mm film (24 mm)"),
        ({}, ("DewarpData",), None, {}, ""),
    ],
)
def test_lenses(
    made: Made,
    changes: dict[str, str],
    without: tuple[str, ...],
    film_mm: int | None,
    lens: dict[str, float],
    named: str,
) -> None:
    folder = dji_folder(made, changes=changes, without=without, film_mm=film_mm)

    found = read_tags(folder / NAMES[0], PHOTO)

    assert {key: found.lens[key] for key in lens} == pytest.approx(lens)
    assert bool(found.lens) == bool(lens)
    assert named in found.lens_from


def test_a_map_in_degrees_gets_the_photos_zone(made: Made) -> None:
    from rasterio import Affine

    from airzoo_bench.geometry.crs import to_lonlat
    from tests.support import write_raster

    west, north = to_lonlat("EPSG:32633", CORNER).tolist()
    dom = write_raster(
        made.folder / "degrees.tif",
        np.zeros((3, 200, 240), np.uint8),
        crs="EPSG:4326",
        transform=Affine(1.3e-5, 0, west, 0, -9e-6, north),
    )

    found = read_scene(["dji", "--source", dji_folder(made), "--dom", dom])

    assert found.crs == "EPSG:32633"
    assert any("UTM zone 33N, the photos' zone" in note for note in found.notes)

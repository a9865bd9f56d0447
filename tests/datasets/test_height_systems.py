"""`prepare photos` with vertical CRS: heights of poses and priors become the surface model's."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.datasets.tagged import LEVEL, NAMES, tag
from tests.geoids import EGM96, EGM2008, proj_with, undulation_m, write_geoid
from tests.support import PLACE_CRS, Place, run_main, write_raster

HERE = (15.0, 46.95)
N_M = undulation_m(*HERE)


@pytest.fixture
def geoids(tmp_path: Path) -> Iterator[Path]:
    write_geoid(tmp_path, EGM2008)
    write_geoid(tmp_path, EGM96, base_m=30.0)
    with proj_with(tmp_path):
        yield tmp_path


def above_the_ellipsoid(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[500_000.0 + x, 5_200_000.0 - y, 200.0 + N_M])


def queries(place: Place) -> pd.DataFrame:
    data = place.poses.parents[1] / "data"
    return pd.read_csv(data / "park" / "scenes" / "park" / "queries.csv")


def test_poses_above_the_ellipsoid_become_those_above_the_geoid(
    place: Place, geoids: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    above_the_ellipsoid(place)
    given = {"vertical-crs": "EPSG:4979", "dsm-vertical": "EPSG:3855"}
    assert run_main(*place.arguments(**given)) == 0
    said = capsys.readouterr().err
    assert "heights of the poses are converted to the surface model's, by -44.81 m (median" in said
    assert "WGS 84 to EGM2008 height" in said
    assert said.count("warning") == 1  # of the size of tiles
    # The geoid is 0.2 mm higher at the far photo than at the near one.
    np.testing.assert_allclose(queries(place)["z"], 200.0, atol=0.01)


def test_altitudes_of_photos_are_converted_too(
    place: Place, geoids: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in NAMES:
        tag(place, name, up=2.0 + N_M)
    given = {"priors-vertical": "EPSG:4979", "dsm-vertical": "EPSG:3855"}
    assert run_main(*place.arguments(**given)) == 0
    said = capsys.readouterr()
    assert "altitudes of the photos are converted to the surface model's, by -44.81 m" in said.err
    assert said.err.count("warning") == 1  # of the size of tiles
    assert "priors          4, off by 2.9 m" in said.out
    np.testing.assert_allclose(queries(place)["prior_z"], 202.0, atol=0.01)


def test_the_surface_models_own_vertical_crs_counts(place: Place, geoids: Path) -> None:
    above_the_ellipsoid(place)
    write_raster(place.dsm, LEVEL, crs=f"{PLACE_CRS}+3855")
    assert run_main(*place.arguments(**{"vertical-crs": "EPSG:4979"})) == 0
    np.testing.assert_allclose(queries(place)["z"], 200.0, atol=0.01)


def test_compound_crs_of_two_geoids_are_no_longer_mixed(
    place: Place, geoids: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_raster(place.dsm, LEVEL, crs=f"{PLACE_CRS}+3855")
    place.change_poses(crs=f"{PLACE_CRS}+5773")
    assert run_main(*place.arguments()) == 0
    # EGM96 lies 10 m lower here: what is 200 m above it is 190 m above EGM2008.
    np.testing.assert_allclose(queries(place)["z"], 190.0, atol=0.01)
    assert "converted to the surface model's, by -10.00 m" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"vertical-crs": "EPSG:4979", "dsm-vertical": "EPSG:3855"},
            ["--vertical-crs EPSG:4979: heights cannot be taken", "us_nga_egm08_25.tif is not ins"],
        ),
        (
            {"priors-vertical": "EPSG:5773", "dsm-vertical": "EPSG:4979"},
            ["--priors-vertical EPSG:5773", "us_nga_egm96_15.tif", "pyproj sync --file"],
        ),
        (
            {"vertical-crs": "EPSG:4979"},
            ["vertical CRS of the surface model is not known", "--dsm-vertical"],
        ),
        (
            {"vertical-crs": "EPSG:32633", "dsm-vertical": "EPSG:3855"},
            ["EPSG:32633 (WGS 84 / UTM zone 33N) has no heights"],
        ),
        ({"dsm-vertical": "sea"}, ["--dsm-vertical sea: unknown vertical CRS 'sea'"]),
        ({"vertical-crs": "sea"}, ["unknown vertical CRS 'sea'"]),
    ],
)
def test_what_cannot_be_exact_is_refused(
    place: Place,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    given: dict[str, str],
    said: list[str],
) -> None:
    with proj_with(tmp_path):
        assert run_main(*place.arguments(**given)) == 2
    error = capsys.readouterr().err
    assert all(part in error for part in said), error
    assert not (place.poses.parents[1] / "data" / "park").exists()

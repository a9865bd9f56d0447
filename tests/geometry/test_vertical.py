"""Heights: their units, and above ellipsoid and geoid, against geoids that are a formula."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.heightfield import (
    HeightField,
    blocked_heights,
    median_height,
    survey_heights,
)
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.vertical import changed_heights
from airzoo_bench.matching.lifting import lift
from tests.geoids import EGM96, EGM2008, proj_with, undulation_m, write_geoid
from tests.geometry.support import write_tif

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937


def tif(path: Path, crs: str, unit: str | None, value: float = 100.0, **profile: Any) -> Path:
    write_tif(path, np.full((6, 8), value, np.float32), crs=crs, **profile)
    if unit is not None:
        with rasterio.open(path, "r+") as dataset:
            dataset.units = (unit,)
    return path


@pytest.mark.parametrize(
    ("crs", "unit", "metres"),
    [
        ("EPSG:32615", None, 1.0),
        ("EPSG:32615", "Metre", 1.0),
        ("EPSG:32615", " Feet ", FOOT),
        ("EPSG:32615", "us-ft", SURVEY_FOOT),
        ("EPSG:32615+6360", None, SURVEY_FOOT),
        ("EPSG:32615+6360", "US survey foot", SURVEY_FOOT),
    ],
)
def test_every_reader_of_heights_makes_metres(
    crs: str, unit: str | None, metres: float, tmp_path: Path
) -> None:
    path = tif(tmp_path / "dsm.tif", crs, unit)
    wanted = pytest.approx(100.0 * metres, rel=1e-12)
    assert median_height(path) == wanted
    field = HeightField.read(path)
    assert field.heights[2, 3] == wanted
    info = open_info(path)
    with blocked_heights(path) as lazy:
        assert lazy.heights_at(np.array([3]), np.array([2]))[0] == wanted
        assert lazy.height_range == (wanted, wanted)
    found = survey_heights(path, 0.0, 1000.0)
    assert (found.low, found.high, found.valid_share) == (wanted, wanted, 1.0)
    assert lift([[3.5, 2.5]], info, path, jobs=1).points[0, 2] == wanted


@pytest.mark.parametrize(
    ("crs", "unit", "said"),
    [
        ("EPSG:32615", "degree", "'degree', which is no known unit of length"),
        ("EPSG:32615+6360", "ft", "two units of height: the band's is ft"),
    ],
)
def test_units_that_contradict_are_refused(crs: str, unit: str, said: str, tmp_path: Path) -> None:
    path = tif(tmp_path / "dsm.tif", crs, unit)
    for read in (HeightField.read, median_height):
        with pytest.raises(RasterError, match=said):
            read(path)


PLACES = np.array([[15.03, 46.95], [15.3, 47.21], [14.77, 46.6]])
HEIGHTS = np.array([200.0, -3.5, 8000.0])


@pytest.fixture
def grids(tmp_path: Path) -> Iterator[Path]:
    """Return a folder that PROJ looks for grids in, without any."""
    with proj_with(tmp_path):
        yield tmp_path


def of_places(base_m: float = 40.0) -> np.ndarray:
    return np.array([undulation_m(lon, lat, base_m) for lon, lat in PLACES])


@pytest.mark.parametrize(
    ("source", "target", "added"),
    [
        ("EPSG:4979", "EPSG:3855", -of_places()),
        ("EPSG:5773", "EPSG:3855", of_places(37.0) - of_places()),
        ("EPSG:32633+5773", "EPSG:9518", of_places(37.0) - of_places()),
        ("EPSG:3855", "EPSG:3855", np.zeros(3)),
        ("EPSG:4979", "{folder}", -of_places()),
    ],
)
def test_heights_change_by_the_undulation(
    grids: Path, source: str, target: str, added: np.ndarray
) -> None:
    own = write_geoid(grids, EGM2008)
    write_geoid(grids, EGM96, 37.0)
    target = target.replace("{folder}", f"+proj=longlat +datum=WGS84 +geoidgrids={own} +type=crs")
    with proj_with(grids):
        heights, operation = changed_heights(
            [*HEIGHTS, np.nan], [*PLACES, PLACES[0]], source, target
        )
    np.testing.assert_allclose(heights, [*(HEIGHTS + added), np.nan], atol=1e-4)
    assert operation


@pytest.mark.parametrize(
    ("source", "target", "said"),
    [
        ("EPSG:4979", "EPSG:3855", ("us_nga_egm08_25.tif is not", "pyproj sync --file us_nga_egm")),
        ("EPSG:5773", "EPSG:4979", ("us_nga_egm96_15.tif is not installed",)),
        ("EPSG:4979", "EPSG:4326", ("EPSG:4326 (WGS 84) has no heights", "EPSG:5773 (EGM96)")),
        ("EPSG:1", "EPSG:3855", ("unknown vertical CRS 'EPSG:1'",)),
    ],
)
def test_what_cannot_be_exact_is_refused(
    grids: Path, source: str, target: str, said: tuple[str, ...]
) -> None:
    with pytest.raises(UserError) as caught:
        changed_heights(HEIGHTS, PLACES, source, target)
    assert all(part in str(caught.value) for part in said), caught.value


def test_a_place_that_the_grid_does_not_cover_is_refused(grids: Path) -> None:
    write_geoid(grids, EGM2008)
    with proj_with(grids), pytest.raises(UserError, match="do not cover every place"):
        changed_heights([1.0, 2.0], [PLACES[0], (15.0, 70.0)], "EPSG:4979", "EPSG:3855")

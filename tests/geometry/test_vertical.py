"""Heights above ellipsoid and geoid, against geoids that are a formula."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.geometry.vertical import changed_heights
from tests.geoids import EGM96, EGM2008, proj_with, undulation_m, write_geoid

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
        ("EPSG:3855", "EPSG:4979", of_places()),
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
        changed = changed_heights(HEIGHTS, PLACES, source, target)
    np.testing.assert_allclose(changed.heights_m, HEIGHTS + added, atol=1e-4)
    assert changed.operation


def test_units_of_one_datum_need_no_grid_and_heights_stay_metres(grids: Path) -> None:
    changed = changed_heights(HEIGHTS, PLACES - (115, 0), "EPSG:6360", "EPSG:5703")
    np.testing.assert_allclose(changed.heights_m, HEIGHTS, atol=1e-6)


def test_unknown_heights_stay_unknown(grids: Path) -> None:
    write_geoid(grids, EGM2008)
    with proj_with(grids):
        changed = changed_heights([np.nan, 100.0], PLACES[:2], "EPSG:4979", "EPSG:3855")
        none = changed_heights([np.nan], PLACES[:1], "EPSG:4979", "EPSG:3855")
    assert np.isnan(changed.heights_m[0])
    assert changed.heights_m[1] == pytest.approx(100.0 - undulation_m(*PLACES[1]), abs=1e-4)
    assert np.isnan(none.heights_m).all()


@pytest.mark.parametrize(
    ("source", "target", "said"),
    [
        ("EPSG:4979", "EPSG:3855", ("us_nga_egm08_25.tif is not", "pyproj sync --file us_nga_egm")),
        ("EPSG:5773", "EPSG:4979", ("us_nga_egm96_15.tif is not installed",)),
        ("EPSG:4979", "EPSG:4326", ("EPSG:4326 (WGS 84) has no heights", "EPSG:5773 (EGM96)")),
        ("EPSG:4978", "EPSG:4979", ("has no heights",)),
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

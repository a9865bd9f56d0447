"""Units of heights: metres, whatever the file states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.heightfield import (
    HeightField,
    blocked_heights,
    median_height,
    survey_heights,
)
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.solving import lift
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
    assert (found.low, found.high, found.valid) == (wanted, wanted, found.pixels)
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

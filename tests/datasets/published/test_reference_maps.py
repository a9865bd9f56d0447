"""Surface models of benchmarks that do not say which number means none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio

from airzoo_bench.datasets.published.reference_maps import with_georeference
from airzoo_bench.geometry.heightfield import survey_heights
from tests.support import write_raster


@pytest.mark.parametrize("dtype", ["float32", "int16"])
@pytest.mark.parametrize(("unit", "scale", "metres"), [("ft", 1.0, 0.3048), ("m", 0.01, 0.01)])
def test_the_lowest_number_is_none_in_any_unit(
    tmp_path: Path, dtype: str, unit: str, scale: float, metres: float
) -> None:
    """Numbers of the file are no metres, and what GDAL takes for none is a number of the file."""
    heights = np.full((1, 20, 20), 300, dtype)
    heights[0, 5:10] = -9999
    if dtype == "float32":
        heights[0, 0], heights[0, 1] = np.nan, -np.inf
    path = write_raster(tmp_path / "dsm.tif", heights, crs="EPSG:4547")
    with rasterio.open(path, "r+") as raster:
        raster.units, raster.scales = (unit,), (scale,)

    found, said = with_georeference(path, tmp_path / "made", heights=True)

    survey = survey_heights(found, -1e9, 1e9)
    assert said == ["dsm.tif: -9999, its lowest number, is taken for no height"]
    assert survey.low == pytest.approx(300 * metres)
    assert survey.valid == np.count_nonzero(heights == 300)


def test_a_map_that_scenes_share_is_never_half_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heights = np.full((1, 20, 20), 300, "float32")
    heights[0, 5:10] = -9999
    path = write_raster(tmp_path / "dsm.tif", heights, crs="EPSG:4547")
    found, _ = with_georeference(path, tmp_path / "made", heights=True)
    open_raster, seen = rasterio.open, []

    def opened(place: Path, mode: str = "r") -> object:
        if mode == "r+":
            with open_raster(found) as shared:  # as another scene may, at this very moment
                seen.append(shared.nodata)
        return open_raster(place, mode)

    monkeypatch.setattr(rasterio, "open", opened)
    assert with_georeference(path, tmp_path / "made", heights=True)[0] == found
    assert seen == [-9999]
    assert list(found.parent.iterdir()) == [found]

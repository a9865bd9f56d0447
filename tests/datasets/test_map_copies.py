"""Copies of virtual rasters, read after what they were made of is gone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil
from rasterio.vrt import WarpedVRT

from airzoo_bench.datasets.map_copies import copy_map
from tests.support import write_raster


def test_a_warped_raster_is_copied_with_its_source(tmp_path: Path) -> None:
    """What `gdalwarp -of VRT` writes names its source in another element than other ones."""
    home = tmp_path / "home"
    home.mkdir()
    heights = np.random.default_rng(0).random((1, 40, 50), np.float32)
    path = write_raster(home / "surface.tif", heights, crs="EPSG:32633")
    with rasterio.open(path) as whole, WarpedVRT(whole, crs="EPSG:32634") as warped:
        expected = warped.read(1)
        rasterio.shutil.copy(warped, home / "warped.vrt", driver="VRT")

    copy_map(home / "warped.vrt", tmp_path / "data" / "dsm.vrt")

    home.rename(tmp_path / "elsewhere")
    (tmp_path / "data").rename(tmp_path / "moved")
    with rasterio.open(tmp_path / "moved" / "dsm.vrt") as copied:
        np.testing.assert_array_equal(copied.read(1), expected)

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio import Affine

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.crops import write_crop
from airzoo_bench.matching.lifting import LiftStatus, lift
from tests.geometry.support import write_tif

X, Y = 576000.0, 5188000.0


@pytest.fixture
def rasters(tmp_path: Path) -> tuple[Path, Path]:
    rng = np.random.default_rng(5)
    colours = rng.integers(0, 255, (4, 60, 80), np.uint8)
    dom = write_tif(
        tmp_path / "dom.tif",
        colours,
        transform=Affine(0.3, 0, X, 0, -0.3, Y),
        photometric="RGB",
        alpha="YES",
    )
    heights = rng.normal(0, 9, (50, 70)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = -9999
    grid = Affine(0.5, 0, X - 3.1, 0, -0.5, Y + 1.7)
    return dom, write_tif(tmp_path / "dsm.tif", heights, nodata=-9999, transform=grid)


def test_written_crops(rasters: tuple[Path, Path], tmp_path: Path) -> None:
    window = (11, 7, 40, 30)
    written = write_crop(*rasters, window, tmp_path / "crops", "photo")
    assert [path.name for path in written] == ["photo_dom.tif", "photo_dsm.tif"]
    with rasterio.open(rasters[0]) as whole, rasterio.open(written[0]) as crop:
        assert np.array_equal(crop.read(), whole.read()[:, 7:37, 11:51])
        assert (crop.colorinterp, crop.crs) == (whole.colorinterp, whole.crs)
        assert (crop.transform.c, crop.transform.f) == pytest.approx((X + 3.3, Y - 2.1), abs=1e-9)
    with rasterio.open(written[1]) as crop:
        assert (crop.nodata, crop.dtypes[0]) == (-9999, "float32")
    # The surface inside the crop is that of the whole, gaps and all, to the crop's very border.
    xy = np.random.default_rng(0).uniform((0, 0), (40, 30), (3000, 2))
    xy[:4] = (0, 0), (40, 0), (0, 30), (40, 30)
    whole = lift(xy + window[:2], open_info(rasters[0]), rasters[1], jobs=1)
    part = lift(xy, open_info(written[0]), written[1], jobs=1)
    np.testing.assert_allclose(part.points, whole.points, rtol=0, atol=1e-6)
    assert (whole.status == LiftStatus.NO_HEIGHT).any()
    again = write_crop(*rasters, window, tmp_path / "again", "photo")
    assert [p.read_bytes() for p in again] == [p.read_bytes() for p in written]
    assert len(list((tmp_path / "crops").iterdir())) == 2


def test_written_crop_keeps_mask_scale_and_palette(tmp_path: Path) -> None:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    dom = write_tif(tmp_path / "dom.tif", grey, photometric="palette")
    dsm = write_tif(tmp_path / "dsm.tif", grey.astype(np.int16))
    with rasterio.open(dom, "r+") as dataset:
        dataset.write_colormap(1, {7: (10, 20, 30, 255)})
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(dsm, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.1,), (100.0,)
        dataset.write_mask(np.where(grey == 20, 0, 255).astype(np.uint8))
    first, second = write_crop(dom, dsm, (2, 1, 5, 4), tmp_path / "out", "a")
    with rasterio.open(first) as crop:
        assert crop.colormap(1)[7] == (10, 20, 30, 255)
    whole, part = HeightField.read(dsm), HeightField.read(second)
    assert part.heights.shape == (6, 7)
    assert np.array_equal(part.heights, whole.heights[0:6, 1:8], equal_nan=True)
    assert np.isnan(part.heights).sum() == 1


def test_crops_that_cannot_be_written(rasters: tuple[Path, Path], tmp_path: Path) -> None:
    for window in ((-1, 0, 5, 5), (0, 0, 0, 5), (70, 0, 11, 5), (0, 50, 5, 11)):
        with pytest.raises(RasterError, match="not inside the map"):
            write_crop(*rasters, window, tmp_path / "crops", "photo")
    afar = write_tif(
        tmp_path / "afar.tif",
        np.zeros((9, 9), np.float32),
        transform=Affine(2.0, 0.0, X - 500, 0.0, -2.0, Y + 1000),
    )
    with pytest.raises(RasterError, match="does not meet"):
        write_crop(rasters[0], afar, (0, 0, 5, 5), tmp_path / "crops", "photo")
    assert not (tmp_path / "crops").exists()

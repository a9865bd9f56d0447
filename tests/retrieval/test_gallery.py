"""Cutting maps into tiles."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from rasterio.transform import Affine

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.prepare import box_growth, cut_gallery, tile_starts
from airzoo_bench.retrieval.settings import MapGallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS
from tests.support import write_raster

UTM = {"crs": "EPSG:32650", "transform": Affine(0.5, 0, 500_000, 0, -0.5, 3_000_000)}
BLANK = np.zeros((1, 100, 150), np.uint8)


def gallery(sizes: tuple[int, ...] = (64, 32), gsd_m: float | str = "any") -> MapGallery:
    rules = {"overlap": 0.5, "gsd_tolerance": 0.1, "least_valid_share": 0.0}
    return MapGallery.model_validate(rules | {"tile_sizes_px": sizes, "gsd_m": gsd_m})


@pytest.mark.parametrize(
    ("length", "starts"),
    [
        # 150 px, tiles of 64 at stride 32: 0, 32, 64 (ends at 128); the next would end at 160, so
        # the last one is anchored at 150 - 64 = 86. 128 px is met exactly.
        (150, [0, 32, 64, 86]),
        (128, [0, 32, 64]),
        (64, [0]),
        (40, [0]),
    ],
)
def test_starts_worked_by_hand(length: int, starts: list[int]) -> None:
    assert tile_starts(length, 64, 0.5).tolist() == starts


@given(
    length=st.integers(1, 5000), size=st.integers(16, 1500), overlap=st.sampled_from([0, 0.25, 0.5])
)
def test_tiles_cover_the_axis_and_stay_on_it(length: int, size: int, overlap: float) -> None:
    starts = tile_starts(length, size, overlap)
    assert starts[0] == 0
    assert (np.diff(starts) > 0).all()
    stride = max(1, (Fraction(size) * (1 - Fraction(overlap)) + Fraction(1, 2)).__floor__())
    assert (np.diff(starts)[:-1] == stride).all()
    assert (np.diff(starts)[-1:] <= stride).all()
    assert starts[-1] + min(size, length) == length


def test_a_projected_map(tmp_path: Path) -> None:
    # UTM 50N, 0.5 m pixels. The box of a tile holds its corners and is no larger than they ask.
    path = write_raster(tmp_path / "m.tif", BLANK, **UTM)
    tiles = cut_gallery(open_info(path), gallery(), "s")
    assert len(tiles) == 4 * 3 + 9 * 6
    assert tiles["id"].is_monotonic_increasing
    tile = tiles.set_index("id").loc["s/64_00002_00003"]
    # Row 2 begins at 100 - 64 = 36, column 3 at 86 px: 43 m east and 18 m south of the corner.
    assert (tile["x"], tile["y"]) == (86, 36)
    to_lonlat = Transformer.from_crs("EPSG:32650", "EPSG:4326", always_xy=True)
    xs, ys = np.array([43.0, 75.0]) + 500_000, 3_000_000 - np.array([18.0, 50.0])
    lon, lat = to_lonlat.transform(*np.meshgrid(xs, ys))
    expected = [lon.min(), lat.min(), lon.max(), lat.max()]
    np.testing.assert_allclose(tile[list(BOX_COLUMNS)].to_numpy(float), expected, atol=1e-9)
    # Off the central meridian's true scale by 0.04 %.
    assert tile["size_m"] == pytest.approx(32 / 0.9996, abs=2e-3)


def test_pixels_are_measured_on_the_ground_and_the_earth_ends(tmp_path: Path) -> None:
    # At 60 degrees north a web mercator metre is half a metre.
    y = Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True).transform(10, 60)[1]
    place = {"crs": "EPSG:3857", "transform": Affine(0.6, 0, 1_000_000, 0, -0.6, y)}
    info = open_info(write_raster(tmp_path / "m.tif", BLANK, **place))
    assert len(cut_gallery(info, gallery(gsd_m=0.3), "s")) == 66
    with pytest.raises(RasterError, match=r"0\.300.* m per pixel"):
        cut_gallery(info, gallery(gsd_m=0.6), "s")
    place = {"crs": "EPSG:4326", "transform": Affine(0.1, 0, 10, 0, -0.1, -84)}
    with pytest.raises(RasterError, match="not on the earth"):
        cut_gallery(open_info(write_raster(tmp_path / "n.tif", BLANK, **place)), gallery(), "s")


def test_boxes_of_a_turned_map_outgrow_its_tiles(tmp_path: Path) -> None:
    turned = Affine.translation(500_000, 10_000) @ Affine.rotation(45) @ Affine.scale(1, -1)
    info = open_info(write_raster(tmp_path / "m.tif", BLANK, crs="EPSG:32650", transform=turned))
    tiles = cut_gallery(info, gallery((64,)), "s")
    # A square turned by 45 degrees has a box of twice its area; its own side stays 64 m.
    assert box_growth(info, tiles) == pytest.approx(1, abs=0.01)
    np.testing.assert_allclose(tiles["size_m"], 64 / 0.9996, atol=0.2)


@pytest.mark.parametrize("how", ["nodata", "alpha", "mask"])
def test_shares_of_valid_pixels_are_counted_exactly(
    tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("airzoo_bench.retrieval.prepare._STRIP", 37)
    valid = np.random.default_rng(0).random((100, 150)) < 0.3
    valid[:40, :70] = False
    bands = np.repeat(np.where(valid, 200, 0).astype(np.uint8)[None], 3 + (how == "alpha"), axis=0)
    path = write_raster(tmp_path / "m.tif", bands, **UTM, nodata=0 if how == "nodata" else None)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "r+") as raster:
        if how == "alpha":
            raster.colorinterp = [*raster.colorinterp[:3], rasterio.enums.ColorInterp.alpha]
        if how == "mask":
            raster.write_mask(valid)
    tiles = cut_gallery(open_info(path), gallery(), "s")
    windows = tiles[["x", "y", "width", "height"]].to_numpy()
    expected = [valid[y : y + h, x : x + w].mean() for x, y, w, h in windows]
    np.testing.assert_array_equal(tiles["valid_share"], expected)
    assert (tiles["valid_share"] == 0).sum() == 3

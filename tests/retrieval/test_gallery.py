"""Cutting maps into tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from rasterio.transform import Affine

from airzoo_bench.errors import RasterError
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.gallery import cut_gallery, tile_starts
from airzoo_bench.retrieval.settings import Gallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS


def gallery(sizes: tuple[int, ...] = (64, 32), gsd_m: float | str = "any") -> Gallery:
    return Gallery.model_validate(
        {"tile_sizes_px": sizes, "overlap": 0.5, "gsd_m": gsd_m, "gsd_tolerance": 0.1}
    )


def write_map(path: Path, crs: str, transform: Affine, width: int = 150, height: int = 100) -> Path:
    profile = {"driver": "GTiff", "count": 1, "dtype": "uint8", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", width=width, height=height, **profile) as raster:
        raster.write(np.zeros((1, height, width), np.uint8))
    return path


def test_starts_worked_by_hand() -> None:
    # 150 px, tiles of 64 at stride 32: 0, 32, 64 (ends at 128); the next would end at 160, so the
    # last one is anchored at 150 - 64 = 86.
    assert tile_starts(150, 64, 0.5).tolist() == [0, 32, 64, 86]
    # 128 px is met exactly: no anchored tile is added.
    assert tile_starts(128, 64, 0.5).tolist() == [0, 32, 64]
    assert tile_starts(64, 64, 0.5).tolist() == [0]
    assert tile_starts(40, 64, 0.5).tolist() == [0]


@given(
    length=st.integers(1, 5000), size=st.integers(16, 1500), overlap=st.sampled_from([0, 0.25, 0.5])
)
def test_tiles_cover_the_axis_and_stay_on_it(length: int, size: int, overlap: float) -> None:
    starts = tile_starts(length, size, overlap)
    assert starts[0] == 0
    assert (np.diff(starts) > 0).all()
    assert (np.diff(starts) <= max(1, round(size * (1 - overlap)))).all()
    assert starts[-1] + min(size, length) == length


def test_a_projected_map(tmp_path: Path) -> None:
    # UTM 50N, 0.5 m pixels. The box of a tile holds its corners and is no larger than they ask.
    path = write_map(tmp_path / "m.tif", "EPSG:32650", Affine(0.5, 0, 500_000, 0, -0.5, 3_000_000))
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


def test_a_geographic_map_has_exact_boxes(tmp_path: Path) -> None:
    path = write_map(tmp_path / "m.tif", "EPSG:4326", Affine(1e-5, 0, 113.0, 0, -1e-5, 28.0))
    tile = cut_gallery(open_info(path), gallery((64,)), "s").set_index("id").loc["s/64_00001_00001"]
    # 32 px from the corner, 64 px wide, at 1e-5 degrees.
    expected = [113.00032, 28 - 0.00096, 113.00096, 28 - 0.00032]
    np.testing.assert_allclose(tile[list(BOX_COLUMNS)].to_numpy(float), expected, atol=1e-9)


def test_a_web_mercator_map_is_measured_on_the_ground(tmp_path: Path) -> None:
    # At 60 degrees north a web mercator metre is half a metre.
    y = Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True).transform(10, 60)[1]
    path = write_map(tmp_path / "m.tif", "EPSG:3857", Affine(0.6, 0, 1_000_000, 0, -0.6, y))
    assert len(cut_gallery(open_info(path), gallery(gsd_m=0.3), "s")) == 66
    with pytest.raises(RasterError, match=r"0\.300.* m per pixel"):
        cut_gallery(open_info(path), gallery(gsd_m=0.6), "s")


def test_a_map_smaller_than_a_tile_is_one_tile(tmp_path: Path) -> None:
    # UAV-VisLoc's scene 7 has such a map.
    path = write_map(tmp_path / "m.tif", "EPSG:32650", Affine(1, 0, 0, 0, -1, 10), 50, 20)
    tiles = cut_gallery(open_info(path), gallery((64,)), "s")
    assert tiles[["x", "y", "width", "height"]].to_numpy().tolist() == [[0, 0, 50, 20]]

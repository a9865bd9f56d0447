from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from rasterio import Affine
from scipy.ndimage import map_coordinates

from airzoo_bench.geometry.heightfield import HeightField, blocked_heights, median_height
from airzoo_bench.geometry.rasters import pixel_to_world

from .support import quick, seeds, write_tif

NAN = np.nan
UNIT = Affine(1, 0, 0, 0, 1, 0)


def field_of(heights: object) -> HeightField:
    return HeightField(np.array(heights, dtype=np.float64), UNIT, "EPSG:32615")


def test_pixel_centres_sit_at_one_half_and_borders_are_level() -> None:
    field = field_of([[0.0, 10.0], [20.0, 30.0]])
    # (0.75, 0.5) is a quarter of the way from 0 to 10.
    points = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.0, 1.0), (0.75, 0.5)]
    assert field.sample(points).tolist() == [0.0, 10.0, 20.0, 15.0, 2.5]
    points = [(0.0, 0.0), (2.0, 2.0), (0.1, 1.0), (2.0, 1.0), (1.0, 0.0)]
    assert field.sample(points).tolist() == [0.0, 30.0, 10.0, 20.0, 5.0]
    outside = [(-1e-9, 1.0), (2.0 + 1e-9, 1.0), (1.0, -0.1), (1.0, 2.1), (NAN, 1.0)]
    assert np.isnan(field.sample(outside)).all()


@quick
@given(seeds)
def test_bilinear_agrees_with_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heights = rng.uniform(-50, 100, rng.integers(1, 9, 2))
    transform = Affine(0.3, 0.05, 576000.0, 0.02, -0.4, 5188000.0)
    field = HeightField(heights, transform, "EPSG:32615")
    pixels = rng.uniform(0, 1, (3, 40, 2)) * heights.shape[::-1]
    expected = map_coordinates(
        heights, (pixels[..., 1] - 0.5, pixels[..., 0] - 0.5), order=1, mode="nearest"
    )
    sampled = field.sample(pixel_to_world(transform, pixels))
    inside = np.isfinite(sampled)
    # Points of the very border may fall off it by rounding at UTM size.
    assert inside.mean() > 0.9
    np.testing.assert_allclose(sampled[inside], expected[inside], rtol=0, atol=1e-5)
    np.testing.assert_allclose(field.sample_pixels(pixels), expected, rtol=0, atol=1e-10)


def test_nodata_corners() -> None:
    # Centres at 0.5 and 1.5; the lower right pixel has no height.
    field = field_of([[0.0, 10.0], [20.0, NAN]])
    sampled = field.sample([(0.6, 0.7), (1.4, 0.8), (0.8, 1.4), (1.3, 1.2), (1.2, 1.3)])
    assert sampled.tolist() == [0.0, 10.0, 20.0, 10.0, 20.0]
    # On the line between two pixels only those two are neighbours.
    assert field.sample([(1.0, 0.5), (0.5, 1.0)]).tolist() == [5.0, 10.0]
    # At the centre of a pixel without height its neighbours are a pixel away: not nearer.
    assert np.isnan(field.sample([(1.5, 1.5), (2.0, 2.0)])).all()
    lone = field_of([[-7.0, NAN], [NAN, NAN]])
    assert lone.sample([(0.5, 0.5), (1.2, 1.2), (1.499, 0.5)]).tolist() == [-7.0, -7.0, -7.0]
    # 1.13 px away.
    assert np.isnan(lone.sample([(1.3, 1.3), (1.5, 0.5), (1.5, 1.5)])).all()
    assert np.isnan(field_of([[NAN]]).sample((0.5, 0.5)))


@pytest.mark.parametrize(("nodata", "tiled"), [(NAN, True), (-9999.0, False), (None, True)])
def test_read_nodata_infinity_and_negative_heights(tmp_path, nodata, tiled) -> None:
    rng = np.random.default_rng(0)
    heights = rng.uniform(-40, 40, (300, 560)).astype(np.float32)
    heights[3:9, 5:40] = NAN if nodata is None else nodata
    heights[60, 80] = np.inf
    blocks = {"tiled": True, "blockxsize": 32, "blockysize": 16} if tiled else {}
    path = write_tif(tmp_path / "dsm.tif", heights, nodata=nodata, **blocks)
    field = HeightField.read(path)
    valid = np.isfinite(heights) & (heights != -9999)
    assert field.heights.dtype == np.float32
    assert np.array_equal(field.heights, np.where(valid, heights, NAN), equal_nan=True)
    assert (field.heights[valid] < 0).any()
    assert field.height_range == (heights[valid].min(), heights[valid].max())
    rows, columns = np.indices(heights.shape)  # of six blocks
    with blocked_heights(path) as lazy:
        np.testing.assert_array_equal(lazy.heights_at(columns, rows), field.heights)


def test_read_bounds_gives_the_same_surface(tmp_path: Path) -> None:
    heights = np.random.default_rng(0).normal(size=(70, 90)).astype(np.float32)
    for transform in (
        Affine(0.5, 0, 576000, 0, -0.5, 5188000),
        Affine(0.4, 0.1, 576000, 0.1, -0.4, 5188000),
    ):
        path = write_tif(tmp_path / "dsm.tif", heights, transform=transform)
        whole = HeightField.read(path)
        left, bottom = pixel_to_world(transform, (20.3, 40.7))
        bounds = (left, bottom, left + 4.0, bottom + 5.0)
        part = HeightField.read(path, bounds)
        assert part.heights.size < whole.heights.size / 4
        xy = np.random.default_rng(1).uniform(bounds[:2], bounds[2:], (200, 2))
        np.testing.assert_allclose(part.sample(xy), whole.sample(xy), rtol=0, atol=1e-7)


def test_integers_and_scaled_heights(tmp_path: Path) -> None:
    raw = np.array([[-50, 120, -32768], [7, 9, 11]], np.int16)
    path = write_tif(tmp_path / "i.tif", raw, nodata=-32768)
    field = HeightField.read(path)
    assert np.array_equal(field.heights, [[-50, 120, NAN], [7, 9, 11]], equal_nan=True)
    assert median_height(path) == 9
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.1,), (100.0,)
    np.testing.assert_allclose(HeightField.read(path).heights[0], (95.0, 112.0, NAN))
    assert median_height(path) == pytest.approx(100.9)


@quick
@given(seeds)
def test_median_is_numpys(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    dtype = rng.choice(["float32", "float64", "int16", "int32", "uint8"])
    shape = rng.integers(1, 40, 2)
    # Few distinct values as well as many; both signs; zeros of both signs.
    heights = np.round(rng.normal(0, 10.0 ** rng.uniform(-3, 3), shape), int(rng.integers(0, 6)))
    heights = np.abs(heights).clip(0, 250) if dtype == "uint8" else heights
    heights = heights.clip(-30000, 30000).astype(dtype)
    lost = rng.random(shape) < rng.choice([0.0, 0.5])
    lost.flat[0] = False
    nodata = NAN if dtype.startswith("float") else 255 if dtype == "uint8" else -32000
    path = tmp_path_factory.mktemp("median") / "dsm.tif"
    write_tif(path, np.where(lost, np.array(nodata, dtype), heights), nodata=nodata)
    assert median_height(path) == np.median(heights[~lost].astype(np.float64))

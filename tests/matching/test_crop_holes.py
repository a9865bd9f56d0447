"""Crops over a surface with holes: rays end on the nearest height, as if holes were filled."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from rasterio import Affine

from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rays import RayStatus
from tests.geometry.support import quick, seeds
from tests.matching.crop_support import NAN, X, Y, box, cut, plain_crop


def holed(heights: Any, step: float = 4.0) -> HeightField:
    """Ground about (X, Y) whose pixels are `step` wide."""
    rows, columns = np.shape(heights)
    grid = Affine(step, 0, X - columns * step / 2, 0, -step, Y + rows * step / 2)
    return HeightField(np.array(heights, float), grid, "EPSG:32615")


def test_without_any_height_cut_at_the_range() -> None:
    nothing = HeightField(np.full((9, 9), NAN), Affine(250, 0, X - 1000, 0, -250, Y + 1000), 32615)
    windows = cut(nothing, plain_crop(350.0))
    assert box(windows) == [(175, 450, 150, 100)]
    assert windows.rays.tolist() == [[RayStatus.OFF_RASTER] * 4]


def test_a_hole_meets_the_nearest_height() -> None:
    # Ground at 40 m with a lake of 200 m about (X, Y): 60 m down, 60 m by 40 m; cut, the whole map.
    heights = np.full((200, 200), 40.0)
    heights[75:125, 75:125] = NAN
    assert box(cut(holed(heights), plain_crop(700.0))) == [(235, 490, 30, 20)]
    # The plane of -20 m by name: 120 m down; and cut, as version 1 had it.
    assert box(cut(holed(heights), plain_crop(700.0, "plane"))) == [(220, 480, 60, 40)]
    assert box(cut(holed(heights), plain_crop(700.0, "cut"))) == [(100, 400, 300, 200)]
    # The nearest height of the point found counts, not that of the camera's place: 60 m up there.
    heights[100:, :] = 60.0
    heights[74:125, 74:125] = NAN
    windows = cut(holed(heights), plain_crop(700.0))
    assert box(windows) == [(235, 490, 30, 17)]


def test_past_the_edge_meets_the_nearest_height() -> None:
    afar = HeightField(np.full((9, 9), 10.0), Affine(1, 0, X + 900, 0, -1, Y), 32615)
    assert box(cut(afar, plain_crop(350.0))) == [(227, 485, 46, 30)]
    # Farther than the range it is cut all the same, and a camera below the ground sees none.
    assert box(cut(afar, plain_crop(100.0))) == [(228, 485, 44, 30)]
    assert box(cut(afar, plain_crop(350.0), (X, Y, 5.0))) == [(175, 450, 150, 100)]


def test_an_oblique_ray_ends_on_the_lake_and_not_on_its_far_shore() -> None:
    # 45 degrees to the north over a lake from 20 m before the camera to 1,500 m behind it: far
    # corners meet the level of the lake at 200 m; going on, they would meet the shore underground.
    heights = np.zeros((1000, 400))
    heights[125:495] = NAN
    heights[:125] = 400.0
    heights[-1, -1] = -5000.0
    field = holed(heights)
    found = cut(field, plain_crop(3000.0), tilt=45.0)
    assert found.windows[0][1] == 1000 / 2 - 200 / 2
    cutting = cut(field, plain_crop(3000.0, "cut"), tilt=45.0)
    assert cutting.rays[0, 0] == RayStatus.HIT
    assert cutting.windows[0][1] < 10


@settings(quick, max_examples=20)
@given(seeds)
def test_holes_as_if_they_had_been_filled(seed: int) -> None:
    # The oracle: SciPy fills each hole by its nearest height, NumPy pads the edge.
    from scipy.ndimage import distance_transform_edt

    rng = np.random.default_rng(seed)
    steps = np.kron(rng.uniform(0, 3, (6, 6)), np.ones((10, 10)))
    missing = rng.random((12, 12)) < 0.4
    heights = np.where(np.kron(missing, np.ones((5, 5), bool)), NAN, steps)
    nearest = distance_transform_edt(np.isnan(heights), return_distances=False, return_indices=True)
    filled = np.pad(heights[tuple(nearest)], 60, mode="edge")
    at = (X + rng.uniform(-60, 60), Y + rng.uniform(-60, 60), 100.0)
    tilt = rng.uniform(0, 20)
    found = cut(holed(heights), plain_crop(700.0), at, tilt).windows[0]
    whole = cut(holed(filled), plain_crop(700.0), at, tilt).windows[0]
    # Heights differ by 3 m at most, rays are 60 degrees off nadir at most: 5 m, in pixels of 2 m.
    np.testing.assert_allclose(found, whole, atol=6)

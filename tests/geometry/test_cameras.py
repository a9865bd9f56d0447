from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from hypothesis import given

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.cameras import (
    Cameras,
    anchor_pixels,
    back_project,
    distort,
    project,
    undistort,
)

from .support import LENSES, quick, seeds

K = np.array(((2000.0, 0.0, 1990.0), (0.0, 1980.0, 1120.0), (0.0, 0.0, 1.0)))


def cameras_of(distortion: np.ndarray) -> Cameras:
    return Cameras.from_matrices(np.tile(K, (len(distortion), 1, 1)), 4000, 2250, distortion)


def in_range(xy: np.ndarray, lenses: np.ndarray) -> np.ndarray:
    """Tell which points of the plane z = 1 have an image."""
    points = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
    return np.isfinite(project(cameras_of(lenses), points)).all(axis=-1)


def test_projection_agrees_with_colmap() -> None:
    rng = np.random.default_rng(3)
    rays, far = rng.uniform((-0.7, -0.4, 1.0), (0.7, 0.4, 1.0), (200, 3)), rng.uniform(1, 90, 200)
    points = rays * far[:, None]
    for lens in LENSES:
        params = [2000.0, 1980.0, 1990.0, 1120.0, *lens, 0.0, 0.0, 0.0]
        colmap = pycolmap.Camera(model="FULL_OPENCV", width=4000, height=2250, params=params)
        ours = project(cameras_of(np.array([lens])), points[None])[0]
        np.testing.assert_allclose(ours, colmap.img_from_cam(points), rtol=0, atol=1e-9)


def test_distortion_worked_by_hand() -> None:
    # x = 0.5, y = 0, s = 0.25: radial = 1 + 0.1/4 + 0.2/16 + 0.4/64 = 1.04375;
    # x_d = 0.5 * 1.04375 + 0.02 * 3 * 0.25 = 0.536875; y_d = 0.01 * 0.25 = 0.0025.
    lens = np.array([[0.1, 0.2, 0.01, 0.02, 0.4]])
    found = distort(np.array([[0.5, 0.0]]), lens)
    np.testing.assert_allclose(found, [[0.536875, 0.0025]], rtol=1e-15)


@quick
@given(seeds)
def test_undistort_inverts_distort_to_1e_12(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lenses = np.array(LENSES) * rng.uniform(0.2, 1.5, (len(LENSES), 1))
    xy = rng.uniform(-0.8, 0.8, (len(lenses), 64, 2))
    known = in_range(xy, lenses)
    distorted = distort(xy, lenses[:, None])
    back = undistort(distorted, lenses)
    assert known.any()
    np.testing.assert_allclose(back[known], xy[known], rtol=0, atol=1e-10)
    # A pixel of a point beyond the fold belongs to a point before it, or to none.
    found = np.isfinite(back).all(axis=-1)
    again = distort(np.where(found[..., None], back, 0.0), lenses[:, None])
    np.testing.assert_allclose(again[found], distorted[found], rtol=0, atol=3e-12)


def test_points_beyond_the_fold_of_the_lens_have_no_image_and_no_ray() -> None:
    # r (1 - 0.3 r^2) turns where 0.9 r^2 = 1: r = 1.0541, r_d = 2/3 r = 0.70273.
    lens = np.array([[-0.3, 0.0, 0.0, 0.0, 0.0]])
    radius = np.sqrt(1.0 / 0.9)
    xy = np.array([[[0.999 * radius, 0.0], [1.001 * radius, 0.0]]])
    assert in_range(xy, lens).tolist() == [[True, False]]
    edge = 2.0 / 3.0 * radius
    solved = undistort(np.array([[[0.999 * edge, 0.0], [1.001 * edge, 0.0]]]), lens)
    assert np.isfinite(solved[0, 0]).all()
    assert np.isnan(solved[0, 1]).all()
    # At r = 1.7 the polynomial comes back to 0.226, well inside the image.
    assert not in_range(np.array([[[1.7, 0.0]]]), lens).any()
    assert np.isnan(back_project(cameras_of(lens), np.array([[[1e5, 0.0]]]))).all()
    # r (1 - 0.3 s + 0.02 s^2), s = r^2: its slope 1 - 0.9 s + 0.1 s^2 is 0 at s = 1.298 and 7.702.
    # At s = 16 it rises again (12.2) and radial is positive (1.32), but that is past two folds.
    twice = np.array([[-0.3, 0.02, 0.0, 0.0, 0.0]])
    xy = np.array([[[np.sqrt(1.297), 0.0], [np.sqrt(1.299), 0.0], [4.0, 0.0]]])
    assert in_range(xy, twice).tolist() == [[True, False, False]]
    # x + 0.6 x y, y + 0.3 (x^2 + 3 y^2): at y = -0.2 the determinant of its derivatives,
    # 0.88 * 0.64 - 0.36 x^2, is 0 at x = 1.2508.
    leaning = np.array([[0.0, 0.0, 0.3, 0.0, 0.0]])
    xy = np.array([[[1.25, -0.2], [1.252, -0.2]]])
    assert in_range(xy, leaning).tolist() == [[True, False]]


def test_anchor_pixels_in_order() -> None:
    camera = Cameras.from_matrices(K[None], 160, 80)
    assert anchor_pixels(camera).tolist() == [[[10, 5], [150, 5], [150, 75], [10, 75]]]
    assert anchor_pixels(camera, inset=0.0).tolist() == [[[0, 0], [160, 0], [160, 80], [0, 80]]]


def test_matrices_that_are_none_are_counted() -> None:
    """What else is refused is in tests/goldens/refusals.txt."""
    matrices = np.tile(K, (6, 1, 1))
    matrices[1:5, 0, 0] = np.nan
    with pytest.raises(CameraError, match=r"4 of 6 \(first 3: b, c, d\)"):
        Cameras.from_matrices(matrices, 10, 10, names=list("abcdef"))

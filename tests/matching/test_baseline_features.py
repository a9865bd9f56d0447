"""Features of the baseline, their nearest pairs, and the way back to the pixels of the photo."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from scipy.ndimage import center_of_mass, gaussian_filter
from scipy.spatial.distance import cdist

from airzoo_bench.geometry.sift import extract, mutual_nearest
from airzoo_bench.matching.sift import resample
from tests.matching.baseline_support import texture


@pytest.mark.parametrize("turn_deg", [0.0, 89.0, 180.0, -91.0, 270.0, 725.0])
@pytest.mark.parametrize("scale", [1.0, 0.5, 0.37])
def test_the_way_back_from_a_smaller_turned_image(turn_deg: float, scale: float) -> None:
    grey = np.zeros((120, 171), np.uint8)
    grey[70, 30] = 255
    grey = (gaussian_filter(grey.astype(float), 6) * 200).astype(np.uint8)
    small, back = resample(grey, scale, turn_deg)
    sides = {round(171 * scale), round(120 * scale)}
    assert set(small.shape) == sides
    at = np.array(center_of_mass(small.astype(float))[::-1]) + 0.5
    np.testing.assert_allclose(back[:, :2] @ at + back[:, 2], (30.5, 70.5), rtol=0, atol=0.05)


def test_the_turn_brings_its_direction_to_the_right() -> None:
    grey = np.array(((1, 2, 3), (4, 5, 6)), np.uint8)
    # Clockwise a quarter from the right is down; 1 over 4 becomes 1 left of 4.
    assert resample(grey, 1.0, 90.0)[0].tolist() == [[3, 6], [2, 5], [1, 4]]
    assert resample(grey, 1.0, -90.0)[0].tolist() == [[4, 1], [5, 2], [6, 3]]
    assert resample(grey, 1.0, 44.0)[0].tolist() == grey.tolist()


def test_mutual_nearest_against_all_distances() -> None:
    random = np.random.default_rng(0)
    b = random.integers(0, 90, (1500, 128)).astype(np.float32)
    a = b[random.permutation(1500)[:1300]] + random.integers(0, 12, (1300, 128))
    a = np.vstack((a, random.integers(0, 90, (1000, 128)))).astype(np.float32)
    distances = cdist(a, b)
    nearest = distances.argmin(axis=1)
    first, second = np.sort(distances, axis=1)[:, :2].T
    kept = (distances.argmin(axis=0)[nearest] == np.arange(len(a))) & (first < 0.8 * second)
    rows_a, rows_b = mutual_nearest(a, b, 0.8)
    assert np.array_equal(rows_a, np.flatnonzero(kept))
    assert np.array_equal(rows_b, nearest[kept])
    assert 1200 < len(rows_a) < len(a)
    loose, _ = mutual_nearest(a, b, 1.0)
    assert len(loose) > len(rows_a)


def test_mutual_nearest_of_equals_and_of_none() -> None:
    one = np.full((1, 128), 3, np.float32)
    # Two equals are as near as each other, so neither is clearly nearest.
    assert mutual_nearest(one, np.vstack((one, one)), 0.8)[0].tolist() == []
    assert [rows.tolist() for rows in mutual_nearest(np.vstack((one, one)), one, 0.8)] == [[0], [0]]
    # The first of equals, however many rows lie between them.
    many = np.vstack((one, np.full((3000, 128), 90, np.float32), one))
    assert [rows.tolist() for rows in mutual_nearest(many, one, 0.8)] == [[0], [0]]
    assert len(mutual_nearest(one[:0], one, 0.8)[0]) == 0
    assert len(mutual_nearest(one, one[:0], 0.8)[0]) == 0


def test_features_sit_where_the_blobs_are() -> None:
    # A blob is a feature at its centre; COLMAP's corner is (0, 0), so pixel 40 has its centre at
    # 40.5.
    grey = np.zeros((100, 120))
    grey[60, 40] = grey[30, 80] = 1
    grey = gaussian_filter(grey, 4)
    places, descriptors = extract(
        (255 * grey / grey.max()).astype(np.uint8), 100, 0.0067, doubled=True
    )
    for centre in ((40.5, 60.5), (80.5, 30.5)):
        assert np.linalg.norm(places - centre, axis=1).min() < 0.1
    assert descriptors.shape == (len(places), 128)
    assert np.array_equal(descriptors, np.round(descriptors))
    np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 512, rtol=0.02)


def test_features_at_the_border_are_left_out() -> None:
    image = texture(200, 160)
    options = pycolmap.FeatureExtractionOptions(use_gpu=False)
    found, _ = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu).extract(
        pycolmap.Bitmap.from_array(image)
    )
    every = np.array([(k.x, k.y, 200 - k.x, 160 - k.y, k.compute_scale()) for k in found])
    inside = every[:, :4].min(axis=1) > every[:, 4] + 1
    assert not inside.all()
    places, _ = extract(image, 8192, options.sift.peak_threshold, doubled=True)
    assert np.array_equal(places, every[inside, :2])

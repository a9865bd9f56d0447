"""SIFT features where blobs are, and their nearest pairs."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.distance import cdist

from airzoo_bench.geometry.sift import extract, mutual_nearest


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

"""The SIFT and VLAD baseline."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from airzoo_bench.retrieval.baseline import describe, vlad
from airzoo_bench.retrieval.info import VladSettings


def textured(seed: int, size: int = 128) -> np.ndarray:
    random = np.random.default_rng(seed)
    coarse = np.kron(random.integers(0, 256, (size // 8, size // 8)), np.ones((8, 8)))
    return np.clip(coarse + random.normal(0, 8, (size, size)), 0, 255).astype(np.uint8)


SETTINGS = VladSettings(max_features=256)


def test_an_image_is_nearest_to_its_own_tile() -> None:
    tiles = [partial(textured, seed) for seed in range(6)]
    gallery, queries = (describe(some, SETTINGS, "tiles") for some in (tiles, tiles[::-1]))
    assert (queries @ gallery.T).argmax(axis=1).tolist() == [5, 4, 3, 2, 1, 0]
    np.testing.assert_allclose(np.linalg.norm(gallery, axis=1), 1, atol=1e-6)


def test_vlad_worked_by_hand() -> None:
    # Two words on the first two axes. Two features near the first with residuals r and 2r sum to
    # 3r, which intra-normalisation makes a unit vector; the second word has none and stays zero.
    words = np.zeros((2, 128), np.float32)
    words[0, 0] = words[1, 1] = 1
    features = np.repeat(words[:1], 2, axis=0)
    features[0, 5], features[1, 5] = 0.1, 0.2
    found = vlad(features, words)
    assert found[5] == pytest.approx(1)
    assert np.abs(np.delete(found, 5)).max() < 1e-6

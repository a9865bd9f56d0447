"""SIFT features of an image, and pairing them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.geometry.arrays import Floats, Ints

Grey = NDArray[np.uint8]
Descriptors = NDArray[np.float32]

_SIFT_DIMENSIONS = 128
_BLOCK = 1024


def extract(
    image: Grey, max_features: int, peak_threshold: float, *, doubled: bool
) -> tuple[Floats, Descriptors]:
    """Extract RootSIFT features from a grey image."""
    pycolmap = load_pycolmap()

    options = pycolmap.FeatureExtractionOptions(use_gpu=False)
    options.sift.max_num_features = max_features
    options.sift.peak_threshold = peak_threshold
    options.sift.first_octave = -1 if doubled else 0
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    keypoints, found = extractor.extract(pycolmap.Bitmap.from_array(np.ascontiguousarray(image)))
    features = np.array([(k.x, k.y, k.compute_scale()) for k in keypoints]).reshape(-1, 3)
    places, scale = features[:, :2], features[:, 2]
    margin = np.minimum(places, np.array(image.shape[::-1]) - places).min(axis=1, initial=np.inf)
    inside = margin > scale + 1
    descriptors = found.data.astype(np.float32).reshape(-1, _SIFT_DIMENSIONS)
    return places[inside], descriptors[inside]


def mutual_nearest(a: Descriptors, b: Descriptors, ratio: float) -> tuple[Ints, Ints]:
    """Pair descriptors that are each other's nearest and pass the ratio test from `a` to `b`."""
    if not (len(a) and len(b)):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    squares_b = (b * b).sum(axis=1)
    nearest = np.zeros(len(a), np.int64)
    clear = np.zeros(len(a), np.bool_)
    back, least = np.zeros(len(b), np.int64), np.full(len(b), np.inf, np.float32)
    for start in range(0, len(a), _BLOCK):
        part = a[start : start + _BLOCK]
        squared = (part * part).sum(axis=1)[:, None] + squares_b - 2 * (part @ b.T)
        low = squared.min(axis=0)
        back = np.where(low < least, start + squared.argmin(axis=0), back)
        least = np.minimum(low, least)
        rows = np.arange(len(part))
        pick = squared.argmin(axis=1)
        first = squared[rows, pick]
        squared[rows, pick] = np.inf
        nearest[start : start + _BLOCK] = pick
        clear[start : start + _BLOCK] = first < ratio**2 * squared.min(axis=1)
    kept = np.flatnonzero(clear & (back[nearest] == np.arange(len(a))))
    return kept, nearest[kept]

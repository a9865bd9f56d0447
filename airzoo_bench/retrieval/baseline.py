"""A retrieval baseline that needs no weights: SIFT aggregated to VLAD.

RootSIFT descriptors (Arandjelovic and Zisserman, CVPR 2012) are assigned to visual words learnt on
the gallery itself; their residuals are summed and normalised within each word (Arandjelovic and
Zisserman, "All about VLAD", CVPR 2013). It is a floor for other methods, not a rival.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.options import Option
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.workers import parallel_map
from airzoo_bench.evaluation.baseline import DOUBLED
from airzoo_bench.geometry.sift import extract

__all__ = ["VladSettings", "describe", "learn_words", "root_sift", "vlad"]

Floats = NDArray[np.float32]
Reader = Callable[[], NDArray[np.uint8]]

_SIFT_DIMENSIONS = 128
_ITERATIONS = 20
_PEAK_THRESHOLD = 0.02 / 3  # pycolmap's own


@dataclass(frozen=True)
class VladSettings:
    """How images are described.

    Attributes
    ----------
    words : int
        Number of visual words; descriptors have 128 times as many dimensions, and one more.
    max_features : int
        The strongest SIFT features of an image that are kept.
    training_features : int
        How many features the words are learnt from at the most.
    seed : int
        Of the sampling and of k-means.
    doubled : bool
        See `sift.extract`.
    long_side_px : int
        Photos are made this small.
    """

    words: Annotated[int, Option("words", "Visual words.", 2, 4096)] = 64
    max_features: int = 2048
    training_features: int = 200_000
    seed: Annotated[int, Option("seed", "Of sampling and k-means.", 0)] = 0
    doubled: Annotated[bool, DOUBLED] = True
    long_side_px: Annotated[int, Option("long-side", "Photos are made this small, px.", 64)] = 1024


def describe(
    gallery: Sequence[Reader],
    queries: Sequence[Reader],
    settings: VladSettings,
    *,
    workers: int = 1,
    progress: Progress = silent,
) -> tuple[Floats, Floats]:
    """Describe gallery and queries with words learnt on the gallery.

    Parameters
    ----------
    gallery, queries : sequence of callable
        Each returns one grey image (height, width) uint8.
    settings : VladSettings
    workers : int
        Processes that extract features; the descriptors do not depend on it.
    progress : Progress

    Returns
    -------
    gallery, queries : (G, D), (Q, D) float32
        Of unit length. An image without any feature gets a direction of its own, at right angles
        to all others, so that it is near to none of them.

    Raises
    ------
    BenchmarkError
        The gallery has fewer features than there are words.
    """
    features = list(_extracted(gallery, settings, workers, progress, "tiles"))
    words = learn_words(features, settings)
    described = np.stack([vlad(one, words) for one in features])
    asked = [vlad(one, words) for one in _extracted(queries, settings, workers, progress, "photos")]
    return described, np.stack(asked)


def root_sift(image: NDArray[np.uint8], max_features: int, *, doubled: bool) -> Floats:
    """Extract RootSIFT descriptors (n, 128), each of unit length, from a grey image."""
    _, descriptors = extract(image, max_features, _PEAK_THRESHOLD, doubled=doubled)
    lengths = np.linalg.norm(descriptors, axis=1, keepdims=True)
    unit: Floats = descriptors / np.maximum(lengths, np.finfo(np.float32).tiny)
    return unit


def learn_words(features: Sequence[Floats], settings: VladSettings) -> Floats:
    """Learn visual words (words, 128) by k-means on a seeded sample of the features.

    Raises
    ------
    BenchmarkError
        There are fewer features than words.
    """
    import faiss

    everything = np.concatenate([np.zeros((0, _SIFT_DIMENSIONS), np.float32), *features])
    if len(everything) < settings.words:
        raise BenchmarkError(
            f"the gallery has {len(everything)} SIFT features, fewer than {settings.words} words",
            fix="look at the map: is it blank?",
        )
    size = min(settings.training_features, len(everything))
    rows = np.random.default_rng(settings.seed).choice(len(everything), size, replace=False)
    kmeans = faiss.Kmeans(
        _SIFT_DIMENSIONS,
        settings.words,
        niter=_ITERATIONS,
        seed=settings.seed,
        min_points_per_centroid=1,
        max_points_per_centroid=size,
    )
    kmeans.train(everything[np.sort(rows)])
    return np.asarray(kmeans.centroids, np.float32)


def vlad(features: Floats, words: Floats) -> Floats:
    """Aggregate features (n, 128) to one descriptor (128 words + 1,) of unit length."""
    residuals = np.zeros(words.shape, np.float64)
    if len(features):
        nearest = np.argmax(features @ words.T - (words**2).sum(axis=1) / 2, axis=1)
        np.add.at(residuals, nearest, features.astype(np.float64) - words[nearest])
    lengths = np.linalg.norm(residuals, axis=1, keepdims=True)
    within = np.divide(residuals, lengths, out=residuals, where=lengths > 0)
    descriptor = np.append(within.ravel(), 0.0 if len(features) else 1.0)
    unit: Floats = (descriptor / np.linalg.norm(descriptor)).astype(np.float32)
    return unit


def _extracted(
    readers: Sequence[Reader],
    settings: VladSettings,
    workers: int,
    progress: Progress,
    label: str,
) -> Iterator[Floats]:
    # Processes, since pycolmap keeps the interpreter's lock while it extracts.
    found = parallel_map(
        partial(_features_of, settings.max_features, settings.doubled), readers, workers
    )
    yield from progress(found, label, len(readers))


def _features_of(max_features: int, doubled: bool, reader: Reader) -> Floats:
    return root_sift(reader(), max_features, doubled=doubled)

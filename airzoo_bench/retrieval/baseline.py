"""A retrieval baseline that needs no weights: SIFT aggregated to VLAD.

RootSIFT descriptors (Arandjelovic and Zisserman, CVPR 2012) are assigned to visual words; their
residuals are summed and normalised within each word (Arandjelovic and Zisserman, "All about VLAD",
CVPR 2013). The words are shipped, so that every machine has the same: 32 centres of k-means on the
67,278 features of AirZoo-Mini's maps (orthophotos and satellite mosaics, both regions, seed 0).
It is a floor for other methods, not a rival.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import faiss
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.images import read_grey, read_tile
from airzoo_bench.core.progress import Headed, Progress, silent
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.evaluation.predictions import check_npz, write_predictions
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.sift import extract
from airzoo_bench.retrieval.info import VladSettings
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import RetrievalTruth, scene_truth

Floats = NDArray[np.float32]
Reader = Callable[[], NDArray[np.uint8]]

_WORDS = Path(__file__).with_name("visual_words.npy")
_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as in the grey of photos
_PEAK_THRESHOLD = 0.02 / 3  # pycolmap's own


def predict(
    protocol: RetrievalProtocol,
    benchmark: Benchmark,
    settings: VladSettings,
    out: Path,
    run: Run,
    note: Callable[[str], None],
) -> None:
    """Describe every query and tile of a benchmark and write a prediction file."""
    check_npz(out)
    parts: dict[str, list[NDArray[Any]]] = {}
    for scene in protocol.scenes:
        truth = scene_truth(benchmark, scene.id)
        tiles, photos = _readers(benchmark, truth, settings.long_side_px)
        progress = Headed(scene.id, run.progress)
        for key, rows in {
            "query_ids": truth.queries["id"].to_numpy(str),
            "query_descriptors": describe(photos, settings, "photos", run.processes, progress),
            "gallery_ids": truth.tiles["id"].to_numpy(str),
            "gallery_descriptors": describe(tiles, settings, "tiles", run.processes, progress),
        }.items():
            parts.setdefault(key, []).append(rows)
    arrays = {key: np.concatenate(rows) for key, rows in parts.items()}
    write_predictions(out, protocol.name, arrays)


def _readers(
    benchmark: Benchmark, truth: RetrievalTruth, long_side_px: int
) -> tuple[list[Reader], list[Reader]]:
    """Return what reads each tile and each photo of a scene in grey."""
    scene = benchmark.scene(truth.scene)
    gallery = benchmark.resolve(needed(scene.gallery or scene.dom, "map", scene.id))
    images = benchmark.resolve(scene.images)
    photos: list[Reader] = [
        partial(read_grey, images / name, long_side_px) for name in truth.queries["image"]
    ]
    if truth.has_images:
        names = truth.tiles["image"]
        return [partial(read_grey, gallery / name, long_side_px) for name in names], photos
    return [partial(_grey_tile, gallery, tile) for _, tile in truth.tiles.iterrows()], photos


def _grey_tile(gallery: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    return np.asarray(np.round(read_tile(gallery, tile) @ _GREY), np.uint8)


def describe(
    images: Sequence[Reader],
    settings: VladSettings,
    label: str,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> Floats:
    """Describe images, a row each; `label` names them for progress."""
    words = np.load(_WORDS, allow_pickle=False).astype(np.float32)
    found = engine.map(
        _root_sift,
        list(enumerate(images, 1)),
        shared=settings,
        stage=label,
        name=lambda numbered: f"number {numbered[0]:,} of the {label}",
    )
    return np.stack([vlad(one, words) for one in progress(found, label, len(images))])


def _root_sift(settings: VladSettings, numbered: tuple[int, Reader]) -> Floats:
    """Extract RootSIFT descriptors (n, 128), each of unit length, from a numbered image."""
    image, most = numbered[1](), settings.max_features
    _, descriptors = extract(image, most, _PEAK_THRESHOLD, doubled=settings.doubled)
    lengths = np.linalg.norm(descriptors, axis=1, keepdims=True)
    unit: Floats = descriptors / np.maximum(lengths, np.finfo(np.float32).tiny)
    return unit


def vlad(features: Floats, words: Floats) -> Floats:
    """Aggregate features (n, 128) to one descriptor (128 words + 1,) of unit length."""
    residuals = np.zeros(words.shape, np.float64)
    if len(features):
        nearest = faiss.knn(features, words, 1)[1][:, 0]
        np.add.at(residuals, nearest, features.astype(np.float64) - words[nearest])
    lengths = np.linalg.norm(residuals, axis=1, keepdims=True)
    within = np.divide(residuals, lengths, out=residuals, where=lengths > 0)
    descriptor = np.append(within.ravel(), 0.0 if len(features) else 1.0)
    unit: Floats = (descriptor / np.linalg.norm(descriptor)).astype(np.float32)
    return unit

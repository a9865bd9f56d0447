"""SIFT and VLAD run on a benchmark folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.images import read_grey, read_tile
from airzoo_bench.evaluation.baseline import Baseline
from airzoo_bench.evaluation.prediction_files import check_npz, write_predictions
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.retrieval.baseline import Reader, VladSettings, describe
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["VLAD"]

_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as in the grey of photos


def _predict(
    protocol: RetrievalProtocol,
    benchmark: Benchmark,
    settings: VladSettings,
    out: Path,
    resources: Resources,
    note: Callable[[str], None],
) -> None:
    """Describe every query and tile of a benchmark and write a prediction file."""
    check_npz(out)
    parts: dict[str, list[NDArray[np.generic]]] = {}
    for scene in protocol.scenes:
        truth = read_truth(benchmark.scene_folder(scene.id), scene.id)
        tiles, photos = _readers(benchmark, truth, settings.long_side_px)
        gallery, queries = describe(
            tiles, photos, settings, workers=resources.jobs, progress=resources.progress
        )
        for key, rows in {
            "query_ids": truth.queries["id"].to_numpy(str),
            "query_descriptors": queries,
            "gallery_ids": truth.tiles["id"].to_numpy(str),
            "gallery_descriptors": gallery,
        }.items():
            parts.setdefault(key, []).append(rows)
    write_predictions(
        out, protocol.name, {key: np.concatenate(rows) for key, rows in parts.items()}
    )


def _readers(
    benchmark: Benchmark, truth: RetrievalTruth, long_side_px: int
) -> tuple[list[Reader], list[Reader]]:
    scene = benchmark.scene(truth.scene)
    gallery = benchmark.resolve(scene.gallery or scene.dom)
    images = benchmark.resolve(scene.images)
    tiles: list[Reader] = [partial(_grey_tile, gallery, tile) for _, tile in truth.tiles.iterrows()]
    photos: list[Reader] = [
        partial(read_grey, images / name, long_side_px) for name in truth.queries["image"]
    ]
    return tiles, photos


def _grey_tile(gallery: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    grey: NDArray[np.float64] = np.round(read_tile(gallery, tile) @ _GREY)
    return grey.astype(np.uint8)


VLAD = Baseline(
    method="SIFT and VLAD",
    summary="Describe photos and tiles by SIFT and VLAD, and write a prediction file.",
    settings=VladSettings(),
    demo=VladSettings(training_features=50_000, doubled=False),
    out="sift-vlad.npz",
    out_help="The .npz to write.",
    example="brighton-retrieval --out sift.npz",
    predict=_predict,
)

"""SIFT matching run on a benchmark folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.evaluation.parts import Baseline, Resources
from airzoo_bench.evaluation.prediction_files import check_npz, write_predictions
from airzoo_bench.matching.baseline import SiftSettings, Task, match_photos, plan
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth, read_truth

__all__ = ["SIFT"]


def _predict(
    protocol: MatchingProtocol,
    benchmark: Benchmark,
    settings: SiftSettings,
    out: Path,
    resources: Resources,
    note: Callable[[str], None],
) -> None:
    """Match every query of a benchmark to its crop and write a prediction file."""
    check_npz(out)
    ids: list[str] = []
    matches: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for scene in protocol.scenes:
        truth = read_truth(benchmark, scene.id)
        ids += truth.queries["id"].tolist()
        tasks = _tasks(benchmark, truth)
        matches += match_photos(
            tasks, settings, workers=resources.jobs, progress=resources.progress
        )
    offsets = np.concatenate([[0], np.cumsum([len(query_xy) for query_xy, _ in matches])])
    arrays = {
        "query_ids": np.array(ids, dtype=str),
        "offsets": offsets.astype(np.int64),
        "query_xy": np.concatenate([np.zeros((0, 2)), *(query_xy for query_xy, _ in matches)]),
        "map_xy": np.concatenate([np.zeros((0, 2)), *(map_xy for _, map_xy in matches)]),
    }
    write_predictions(out, protocol.name, arrays)


def _tasks(benchmark: Benchmark, truth: MatchingTruth) -> list[Task]:
    scene = benchmark.scene(truth.scene)
    images, cameras, priors = benchmark.resolve(scene.images), truth.cameras, truth.priors
    return [
        plan(
            images / name,
            cameras.take(row),
            priors.take(row),
            scene.crs,
            truth.dom,
            (int(x), int(y), int(width), int(height)),
            ground_height_m=scene.plane_height_m,
        )
        for row, (name, (x, y, width, height)) in enumerate(
            zip(truth.queries["image"], truth.crops, strict=True)
        )
    ]


SIFT = Baseline(
    method="SIFT",
    summary="Match photos to their crops by SIFT, mutual neighbours and ratio test.",
    settings=SiftSettings(),
    demo=SiftSettings(doubled=False),
    out="sift-matches.npz",
    out_help="The .npz to write.",
    example="brighton-matching --out matches.npz",
    predict=_predict,
)

"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.query_track import QueryTrack
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval.baseline_run import VLAD
from airzoo_bench.retrieval.chance import chance_level
from airzoo_bench.retrieval.claims import RankedScene, rank_scene
from airzoo_bench.retrieval.notes import retrieval_notes
from airzoo_bench.retrieval.predictions import (
    RetrievalPredictions,
    deep_validation_errors,
    validation_errors,
)
from airzoo_bench.retrieval.reading import read_retrieval
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.scoring import score_scene
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.template import descriptor_template, ranked_template
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["TRACK", "RetrievalTrack"]


@dataclass(frozen=True, eq=False)
class _ScoredScene:
    records: pd.DataFrame
    counts: dict[str, int]


class RetrievalTrack(
    QueryTrack[RetrievalProtocol, RetrievalPredictions, RetrievalTruth, RankedScene, _ScoredScene]
):
    """Aerial image retrieval; see `Track`."""

    name = "retrieval"
    summary = "Score aerial image retrieval: Recall@K, AP@5 and more, for each scene."
    protocol = RetrievalProtocol
    kinds = ".npz or .parquet"
    suffixes = (".npz", ".parquet")
    argument = "An .npz or .parquet prediction file."
    example = "preds.npz --out results/mymethod"
    jobs = 1
    baseline = VLAD
    template_kinds = ("ranked-ids", "descriptors")

    def read(self, path: Path, memory_bytes: int) -> RetrievalPredictions:
        """See `read_retrieval`."""
        return read_retrieval(path, memory_bytes)

    def validation_errors(
        self, predictions: RetrievalPredictions, protocol: RetrievalProtocol, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """See `predictions.validation_errors` and `predictions.deep_validation_errors`."""
        scores = protocol.scores
        yield from validation_errors(predictions, scores.depth)
        if thorough:
            scenes = [scene.id for scene in protocol.scenes]
            yield from deep_validation_errors(predictions, scores.descriptor_metric, scenes)

    def read_truth(self, benchmark: Benchmark, scene: str) -> RetrievalTruth:
        """See `truth.read_truth`."""
        return read_truth(benchmark.scene_folder(scene), scene)

    def claim(
        self,
        predictions: RetrievalPredictions,
        truth: RetrievalTruth,
        rows: NDArray[np.intp],
        protocol: RetrievalProtocol,
        resources: Resources,
    ) -> RankedScene:
        """See `rank_scene`."""
        memory, jobs = resources.memory_bytes, resources.jobs
        return rank_scene(
            predictions, truth, rows, protocol.scores, memory_bytes=memory, workers=jobs
        )

    def score(
        self,
        claim: RankedScene,
        truth: RetrievalTruth,
        protocol: RetrievalProtocol,
        resources: Resources,
    ) -> _ScoredScene:
        """See `score_scene`."""
        records = score_scene(truth, claim.ranking, claim.answered, protocol.scores)
        return _ScoredScene(records, claim.counts)

    def scores(self, protocol: RetrievalProtocol, scored: Sequence[_ScoredScene]) -> list[Score]:
        """See `retrieval_scores`."""
        return retrieval_scores(protocol.scores)

    def notes(
        self,
        predictions: RetrievalPredictions,
        protocol: RetrievalProtocol,
        truths: Sequence[RetrievalTruth],
        claims: Sequence[RankedScene],
        scored: Sequence[_ScoredScene],
    ) -> list[str]:
        """See `retrieval_notes`."""
        return retrieval_notes(predictions, claims, protocol)

    def check_notes(
        self,
        predictions: RetrievalPredictions,
        protocol: RetrievalProtocol,
        truths: Sequence[RetrievalTruth],
        claims: Sequence[RankedScene],
        resources: Resources,
    ) -> list[str]:
        """See `retrieval_notes`."""
        return retrieval_notes(predictions, claims, protocol)

    def references(
        self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]
    ) -> dict[str, Reference]:
        """Return what tiles in random order score."""
        return {"Chance level": chance_level(truths, protocol.scores)}

    def template(
        self,
        protocol: RetrievalProtocol,
        truths: Sequence[RetrievalTruth],
        kind: str,
        seed: int,
    ) -> dict[str, NDArray[Any]]:
        """Return random lists, or random descriptors."""
        if kind == "descriptors":
            return descriptor_template(truths, seed)
        return ranked_template(truths, protocol.scores.ranks_kept, seed)

    def template_note(self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]) -> str:
        """Say what random tiles score."""
        level = chance_level(truths, protocol.scores).overall
        headline = [score for score in retrieval_scores(protocol.scores) if score.headline]
        listed = ", ".join(f"{score.title} {level[score.column]:.2%}" for score in headline)
        return f"random tiles score by chance: {listed}"


TRACK = RetrievalTrack()

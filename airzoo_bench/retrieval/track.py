"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.evaluation.query_track import QueryTrack
from airzoo_bench.retrieval.baseline_settings import VLAD

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.results.result import Reference
    from airzoo_bench.results.scores import Score
    from airzoo_bench.retrieval.predictions import RetrievalPredictions
    from airzoo_bench.retrieval.ranking import SceneRanking
    from airzoo_bench.retrieval.settings import RetrievalProtocol
    from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["TRACK", "RetrievalTrack"]

_DIMENSIONS = 8  # of random descriptors


@dataclass(frozen=True, eq=False)
class _ScoredScene:
    records: pd.DataFrame
    counts: dict[str, int]


class RetrievalTrack(
    QueryTrack[
        "RetrievalProtocol",
        "RetrievalPredictions",
        "RetrievalTruth",
        "SceneRanking",
        _ScoredScene,
    ]
):
    """Aerial image retrieval; see `Track`."""

    name = "retrieval"
    summary = "Score aerial image retrieval: Recall@K, AP@5 and more, for each scene."
    kinds = ".npz or .parquet"
    suffixes = (".npz", ".parquet")
    argument = "An .npz or .parquet prediction file."
    example = "preds.npz --out results/mymethod"
    jobs = 1
    baseline = VLAD
    template_kinds = ("ranked-ids", "descriptors")

    @property
    def protocol(self) -> type[RetrievalProtocol]:
        """See `Track.protocol`."""
        from airzoo_bench.retrieval.settings import RetrievalProtocol

        return RetrievalProtocol

    @property
    def recorded(self) -> frozenset[str]:
        """See `Track.recorded`."""
        from airzoo_bench.retrieval.scoring import RECORDED

        return RECORDED

    def read(self, path: Path, memory_bytes: int) -> RetrievalPredictions:
        """See `read_retrieval`."""
        from airzoo_bench.retrieval.predictions import read_retrieval

        return read_retrieval(path, memory_bytes)

    def validation_errors(
        self, predictions: RetrievalPredictions, protocol: RetrievalProtocol, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """See `predictions.validation_errors` and `predictions.deep_validation_errors`."""
        from airzoo_bench.retrieval.checks import deep_validation_errors, validation_errors

        yield from validation_errors(predictions)
        if thorough:
            scenes = [scene.id for scene in protocol.scenes]
            metric = protocol.scores.descriptor_metric
            yield from deep_validation_errors(predictions, metric, scenes)

    def read_truth(self, benchmark: Benchmark, scene: str) -> RetrievalTruth:
        """See `truth.scene_truth`."""
        from airzoo_bench.retrieval.truth import scene_truth

        return scene_truth(benchmark, scene)

    def match_scene(
        self,
        predictions: RetrievalPredictions,
        truth: RetrievalTruth,
        rows: NDArray[np.intp],
        protocol: RetrievalProtocol,
        resources: Resources,
    ) -> SceneRanking:
        """See `rank_scene`."""
        from airzoo_bench.retrieval.ranking import rank_scene

        rank = partial(rank_scene, predictions, truth, rows, protocol.scores, resources)
        try:
            return resources.finish(f"ranking of {truth.scene}", truth, rank)
        except PredictionError as error:
            raise error.inside(predictions.path) from error

    def score(
        self,
        predicted: SceneRanking,
        truth: RetrievalTruth,
        protocol: RetrievalProtocol,
        resources: Resources,
    ) -> _ScoredScene:
        """See `score_scene`."""
        from airzoo_bench.retrieval.scoring import score_scene

        records = score_scene(
            truth,
            predicted.ranking,
            predicted.answered,
            protocol.scores,
            jobs=resources.jobs,
        )
        return _ScoredScene(records, predicted.counts)

    def scores(self, protocol: RetrievalProtocol, scored: Sequence[_ScoredScene]) -> list[Score]:
        """See `retrieval_scores`."""
        from airzoo_bench.retrieval.scoring import retrieval_scores

        return retrieval_scores(protocol.scores)

    def kind(self, predictions: RetrievalPredictions, scored: Sequence[_ScoredScene]) -> str:
        """See `Track.kind`."""
        return predictions.content.kind

    def notes(
        self,
        predictions: RetrievalPredictions,
        protocol: RetrievalProtocol,
        truths: Sequence[RetrievalTruth],
        scene_predictions: Sequence[SceneRanking],
        scored: Sequence[_ScoredScene],
    ) -> list[str]:
        """See `retrieval_notes`."""
        from airzoo_bench.retrieval.checks import retrieval_notes

        return retrieval_notes(predictions, scene_predictions, protocol)

    def references(
        self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]
    ) -> dict[str, Reference]:
        """Return what tiles in random order score."""
        from airzoo_bench.retrieval.chance import chance_level

        return {"Chance level": chance_level(truths, protocol.scores)}

    def template(
        self,
        protocol: RetrievalProtocol,
        truths: Sequence[RetrievalTruth],
        kind: str,
        seed: int,
    ) -> dict[str, NDArray[Any]]:
        """Return random lists, or random descriptors."""
        import numpy as np

        random = np.random.default_rng(seed)
        queries = np.concatenate([truth.queries["id"].to_numpy(str) for truth in truths])
        if kind == "ranked-ids":
            return {"query_ids": queries, "ranked_ids": _random_lists(truths, protocol, random)}
        gallery = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
        return {
            "query_ids": queries,
            "query_descriptors": random.standard_normal((len(queries), _DIMENSIONS), np.float32),
            "gallery_ids": gallery,
            "gallery_descriptors": random.standard_normal((len(gallery), _DIMENSIONS), np.float32),
        }

    def template_note(
        self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]
    ) -> str | None:
        """Say what random tiles score, unless the truth is sealed."""
        from airzoo_bench.retrieval.chance import chance_level
        from airzoo_bench.retrieval.scoring import retrieval_scores

        if not any(truth.positives.tiles.size for truth in truths):
            return None
        level = chance_level(truths, protocol.scores).overall
        headline = [
            score
            for score in retrieval_scores(protocol.scores)
            if score.headline and score.column in level
        ]
        listed = ", ".join(f"{score.title} {level[score.column]:.2%}" for score in headline)
        return f"random tiles score by chance: {listed}"


def _random_lists(
    truths: Sequence[RetrievalTruth], protocol: RetrievalProtocol, random: np.random.Generator
) -> NDArray[np.str_]:
    """Rank tiles at random for every query; lists of a small gallery end with empty ids."""
    import numpy as np

    ranks = protocol.scores.ranks_kept
    lists = []
    for truth in truths:
        tiles = truth.tiles["id"].to_numpy(str)
        for _ in range(len(truth.queries)):
            picked = random.permutation(tiles)[:ranks]
            lists.append([*picked, *[""] * (ranks - len(picked))])
    return np.array(lists, dtype=str)


TRACK = RetrievalTrack()

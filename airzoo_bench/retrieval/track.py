"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.evaluation.queries import QueryPart, assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval.chance import chance_level
from airzoo_bench.retrieval.info import INFO
from airzoo_bench.retrieval.notes import list_facts, retrieval_notes
from airzoo_bench.retrieval.predictions import (
    RetrievalPredictions,
    deep_validation_errors,
    validation_errors,
)
from airzoo_bench.retrieval.questions import scene_truth
from airzoo_bench.retrieval.reading import read_retrieval
from airzoo_bench.retrieval.scene_predictions import ScenePredictions, match_scene
from airzoo_bench.retrieval.scores import RECORDED, retrieval_scores
from airzoo_bench.retrieval.scoring import score_scene
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["TRACK", "RetrievalTrack"]

_DIMENSIONS = 8  # of random descriptors


class RetrievalTrack(Track):
    """Aerial image retrieval; see `Track`."""

    info = INFO
    protocol = RetrievalProtocol
    recorded = RECORDED

    def open(self, path: Path, memory_bytes: int) -> RetrievalPredictions:
        """See `Track.open`."""
        return read_retrieval(path, memory_bytes)

    def truth(self, benchmark: Benchmark, scene: str) -> RetrievalTruth:
        """See `Track.truth`."""
        return scene_truth(benchmark, scene)

    def assign(
        self,
        predictions: RetrievalPredictions,
        truths: Sequence[RetrievalTruth],
        protocol: RetrievalProtocol,
    ) -> Assignment:
        """See `Track.assign`."""
        errors = list(validation_errors(predictions))
        if not (errors or truths):  # ranking, which would find these, needs a gallery
            metric, scenes = protocol.scores.descriptor_metric, [one.id for one in protocol.scenes]
            errors += deep_validation_errors(predictions, metric, scenes)
        if errors:
            return Assignment(errors=errors)
        return assign_queries(predictions, truths, protocol)

    def score(
        self, part: QueryPart, truth: RetrievalTruth, protocol: RetrievalProtocol, run: Run
    ) -> Scored:
        """See `Track.score`."""
        ranked = _ranked(part, truth, protocol, run)
        records = score_scene(
            truth, ranked.ranking, ranked.answered, protocol.scores, jobs=run.jobs
        )
        kind = part.predictions.content.kind
        return Scored(records, ranked.counts, kind, facts=list_facts(ranked, protocol.scores))

    def check(
        self, part: QueryPart, truth: RetrievalTruth | None, protocol: RetrievalProtocol, run: Run
    ) -> Scored:
        """See `Track.check`."""
        if truth is None:
            return Scored()
        ranked = _ranked(part, truth, protocol, run)
        return Scored(counts=ranked.counts, facts=list_facts(ranked, protocol.scores))

    def scores(self, protocol: RetrievalProtocol) -> list[Score]:
        """See `Track.scores`."""
        return retrieval_scores(protocol.scores)

    def notes(
        self,
        predictions: RetrievalPredictions,
        truths: Sequence[RetrievalTruth],
        protocol: RetrievalProtocol,
        scored: Sequence[Scored],
    ) -> list[str]:
        """See `Track.notes`."""
        return retrieval_notes(predictions, truths, scored, protocol)

    def references(
        self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]
    ) -> dict[str, Reference]:
        """Return what tiles in random order score."""
        return {"Chance level": chance_level(truths, protocol.scores)}

    def template(
        self,
        out: Path,
        truths: Sequence[RetrievalTruth],
        protocol: RetrievalProtocol,
        kind: str,
        seed: int,
    ) -> str | None:
        """Write random lists, or random descriptors."""
        random = np.random.default_rng(seed)
        queries = np.concatenate([truth.queries["id"].to_numpy(str) for truth in truths])
        if kind == "ranked-ids":
            lists = _random_lists(truths, protocol, random)
            arrays = {"query_ids": queries, "ranked_ids": lists}
        else:
            tiles = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
            arrays = {
                "query_ids": queries,
                "query_descriptors": _random_descriptors(queries, random),
                "gallery_ids": tiles,
                "gallery_descriptors": _random_descriptors(tiles, random),
            }
        write_predictions(out, protocol.name, arrays)
        if not any(truth.positives.tiles.size for truth in truths):  # it is sealed
            return None
        level = chance_level(truths, protocol.scores).overall
        listed = ", ".join(
            f"{score.title} {level[score.column]:.2%}"
            for score in self.scores(protocol)
            if score.headline and score.column in level
        )
        return f"random tiles score by chance: {listed}"


def _ranked(
    part: QueryPart, truth: RetrievalTruth, protocol: RetrievalProtocol, run: Run
) -> ScenePredictions:
    return match_scene(part.predictions, truth, part.rows, protocol.scores, run)


def _random_descriptors(ids: NDArray[np.str_], random: np.random.Generator) -> NDArray[np.float32]:
    return random.standard_normal((len(ids), _DIMENSIONS), np.float32)


def _random_lists(
    truths: Sequence[RetrievalTruth], protocol: RetrievalProtocol, random: np.random.Generator
) -> NDArray[np.str_]:
    """Rank tiles at random for every query; lists of a small gallery end with empty ids."""
    ranks = protocol.scores.ranks_kept
    lists = []
    for truth in truths:
        tiles = truth.tiles["id"].to_numpy(str)
        for _ in range(len(truth.queries)):
            picked = random.permutation(tiles)[:ranks]
            lists.append([*picked, *[""] * (ranks - len(picked))])
    return np.array(lists, dtype=str)


TRACK = RetrievalTrack()

"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.queries import QueryPart, assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval.checks import check_predictions, list_facts, retrieval_notes
from airzoo_bench.retrieval.info import INFO
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions, read_retrieval
from airzoo_bench.retrieval.ranking import Ranking, rank_scene
from airzoo_bench.retrieval.scoring import RECORDED, chance_level, list_scores, score_scene
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import RetrievalTruth, scene_truth

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
        check_predictions(predictions)
        return assign_queries(predictions, truths, protocol)

    def score(
        self, part: QueryPart, truth: RetrievalTruth, protocol: RetrievalProtocol, run: Run
    ) -> Scored:
        """See `Track.score`."""
        ranking, answered, found = _ranked(part, truth, protocol, run)
        records = score_scene(truth, ranking, answered, protocol.scores, jobs=run.jobs)
        return replace(found, records=records)

    def check(
        self, part: QueryPart, truth: RetrievalTruth, protocol: RetrievalProtocol, run: Run
    ) -> Scored:
        """See `Track.check`."""
        return _ranked(part, truth, protocol, run)[2]

    def scores(self, protocol: RetrievalProtocol) -> list[Score]:
        """See `Track.scores`."""
        return list_scores(protocol.scores)

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
        queries, tiles = (
            np.concatenate([table["id"].to_numpy(str) for table in tables])
            for tables in ([one.queries for one in truths], [one.tiles for one in truths])
        )
        arrays: dict[str, Any] = {"query_ids": queries}
        if kind == "ranked-ids":
            arrays["ranked_ids"] = _random_lists(truths, protocol, random)
        else:
            arrays["gallery_ids"] = tiles
            for name, ids in (("query", queries), ("gallery", tiles)):
                shape = len(ids), _DIMENSIONS
                arrays[f"{name}_descriptors"] = random.standard_normal(shape, np.float32)
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
) -> tuple[Ranking, Bools, Scored]:
    """Rank a scene; also return which queries have a list, and all of `Scored` but the records."""
    predictions, given = part.predictions, part.rows >= 0
    try:
        ranking = rank_scene(predictions, truth, part.rows, protocol.scores, run)
    except PredictionError as error:
        raise error.inside(predictions.path) from error
    answered, content = given, predictions.content
    if isinstance(content, RankedIds):
        answered = given & (content.ids[part.rows] != "").any(axis=1)
    counts = {
        "queries": len(truth.queries),
        "tiles": len(truth.tiles),
        "missing": int((~answered).sum()),
        "empty_lists": int((given & ~answered).sum()),
        "tie_dependent": int(ranking.tie_dependent.sum()),
        "without_positive": len(truth.excluded) + int((truth.positives.counts == 0).sum()),
        "without_ground_point": truth.without_ground_point,
        "dropped_tiles": len(truth.dropped_tiles),
    }
    facts = list_facts(truth, ranking, answered, protocol.scores)
    return ranking, answered, Scored(counts=counts, kind=content.kind, facts=facts)


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

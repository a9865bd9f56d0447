"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.queries import QueryPart, assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.results.result import Reference, ScoreColumn
from airzoo_bench.retrieval import scoring
from airzoo_bench.retrieval.info import INFO
from airzoo_bench.retrieval.predictions import (
    Descriptors,
    RankedIds,
    RetrievalPredictions,
    check_predictions,
    read_retrieval,
)
from airzoo_bench.retrieval.ranking import rank_scene
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.retrieval.truth import TOO_EMPTY, UNANSWERED, RetrievalTruth, scene_truth

_DIMENSIONS = 8  # of random descriptors


class RetrievalTrack(Track):
    """Aerial image retrieval; see `Track`."""

    info = INFO
    protocol = RetrievalProtocol
    recorded = scoring.RECORDED

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
        predictions, given, settings = part.predictions, part.rows >= 0, protocol.scores
        answered, content = given, predictions.content
        if isinstance(content, RankedIds):
            answered = given & (content.ids[part.rows, 0] != "")
        try:
            ranked = rank_scene(predictions, truth, part.rows, settings, run)
            records = scoring.score_scene(truth, ranked, answered, settings, run.jobs)
        except PredictionError as error:
            raise error.inside(predictions.path) from error
        flat = answered & (records["ranked"] == 0)
        facts = {"flat": int(flat.sum()), "short": int(records.pop(scoring.CUT_SHORT).sum())}
        counts = {
            "queries": len(truth.queries),
            "tiles": len(truth.tiles),
            "missing": int((~answered).sum()),
            "empty_lists": int((given & ~answered).sum()),
            "tie_dependent": int(records["tie_dependent"].sum()),
            "without_positive": len(truth.excluded) + int((truth.positives.counts == 0).sum()),
            "without_ground_point": truth.without_ground_point,
            "dropped_tiles": len(truth.dropped_tiles),
        }
        return Scored(records, counts, content.kind, facts=facts)

    def scores(self, protocol: RetrievalProtocol) -> list[ScoreColumn]:
        """See `Track.scores`."""
        return scoring.list_scores(protocol.scores)

    def notes(
        self,
        predictions: RetrievalPredictions,
        truths: Sequence[RetrievalTruth],
        protocol: RetrievalProtocol,
        scored: Sequence[Scored],
    ) -> list[str]:
        """See `Track.notes`."""
        sums = {
            name: sum((scene.counts | scene.facts)[name] for scene in scored)
            for name in ("empty_lists", "tie_dependent", "dropped_tiles", "flat", "short")
        }
        kinds = (
            ("empty_lists", "query has", "queries have", "an empty list, scored as missing"),
            ("tie_dependent", "query depends", "queries depend", "on ties, broken against it"),
            ("flat", "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
            ("dropped_tiles", "tile is", "tiles are", f"{TOO_EMPTY}, and in no gallery"),
            ("short", "list ends", "lists end", "without all positives, which are not found"),
        )
        notes = [f"{counted(sums[n], one, many)} {what}" for n, one, many, what in kinds if sums[n]]
        excluded = pd.concat([truth.excluded for truth in truths])
        unanswered = excluded["id"][excluded["reason"] == UNANSWERED]
        if len(unanswered):
            notes.append(f"queries that no tile answers, left out: {first_of(unanswered)}")
        if isinstance(predictions.content, Descriptors):
            given = predictions.content.gallery_ids
            strange = given[~np.isin(given, _ids([truth.tiles for truth in truths]))]
            if strange.size:
                notes.append(f"described tiles that are in no gallery: {first_of(strange)}")
        return notes

    def references(
        self, protocol: RetrievalProtocol, truths: Sequence[RetrievalTruth]
    ) -> dict[str, Reference]:
        """Return what tiles in random order score."""
        return {"Chance level": scoring.chance_level(truths, protocol.scores)}

    def template(
        self,
        out: Path,
        truths: Sequence[RetrievalTruth],
        protocol: RetrievalProtocol,
        kind: str,
        seed: int,
    ) -> None:
        """Write random lists, or random descriptors."""
        random, arrays = np.random.default_rng(seed), dict[str, Any]()
        arrays["query_ids"] = _ids([truth.queries for truth in truths])
        if kind == "ranked-ids":
            ranks = protocol.scores.ranks_kept
            lists = [
                random.permutation(tiles)[:ranks]
                for tiles, count in ((_ids([t.tiles]), len(t.queries)) for t in truths)
                for _ in range(count)
            ]
            longest = max(map(len, lists))
            filled = [[*one, *[""] * (longest - len(one))] for one in lists]
            arrays["ranked_ids"] = np.array(filled, dtype=str)
        else:
            arrays["gallery_ids"] = _ids([truth.tiles for truth in truths])
            for name, ids in (("query", arrays["query_ids"]), ("gallery", arrays["gallery_ids"])):
                shape = len(ids), _DIMENSIONS
                arrays[f"{name}_descriptors"] = random.standard_normal(shape, np.float32)
        write_predictions(out, protocol.name, arrays)


def _ids(tables: Sequence[pd.DataFrame]) -> np.ndarray[Any, np.dtype[np.str_]]:
    return np.concatenate([table["id"].to_numpy(str) for table in tables])


TRACK = RetrievalTrack()

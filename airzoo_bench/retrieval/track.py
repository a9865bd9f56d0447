"""The retrieval track: a UAV photo finds its satellite tile."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.queries import QueryPart, assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval.info import INFO
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.predictions import (
    Descriptors,
    RankedIds,
    RetrievalPredictions,
    check_predictions,
    read_retrieval,
)
from airzoo_bench.retrieval.ranking import Ranking, rank_scene
from airzoo_bench.retrieval.scoring import RECORDED, chance_level, list_scores, score_scene
from airzoo_bench.retrieval.settings import ImageScores, RetrievalProtocol, TileScores
from airzoo_bench.retrieval.truth import UNANSWERED, RetrievalTruth, scene_truth

_DIMENSIONS = 8  # of random descriptors
_SHOWN_LETTERS = 80


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
        return _notes(predictions, truths, scored, protocol)

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
    facts = _list_facts(truth, ranking, answered, protocol.scores)
    return ranking, answered, Scored(counts=counts, kind=content.kind, facts=facts)


def _list_facts(
    truth: RetrievalTruth, ranking: Ranking, answered: Bools, settings: TileScores | ImageScores
) -> dict[str, Any]:
    """Count the queries without a ranking, and the lists that end without all positives.

    `reached` is the last rank of the shortest of these lists.
    """
    positives, n_tiles = truth.positives, len(truth.tiles)
    lengths = np.count_nonzero(ranking.tiles >= 0, axis=1)
    lacking = lengths > 0
    if isinstance(settings, ImageScores):
        lost = ranking.hit_ranks == 0
        lacking &= np.bincount(positives.queries, lost, positives.n_queries) > 0
    else:
        hits = hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
        lacking &= np.count_nonzero(hits, axis=1) < positives.counts
        lacking &= lengths < min(settings.ranks_kept, n_tiles)
    return {
        "flat": int((answered & (lengths == 0)).sum()),
        "shorter": int(lacking.sum()),
        "reached": int(lengths[lacking].min(initial=n_tiles)),
    }


def _notes(
    predictions: RetrievalPredictions,
    truths: Sequence[RetrievalTruth],
    scored: Sequence[Scored],
    protocol: RetrievalProtocol,
) -> list[str]:
    """Return what `eval` and `check` note besides the scores."""
    sums: Counter[str] = Counter()
    for scene in scored:
        sums.update(scene.counts | scene.facts)
    left_out, against = protocol.gallery.dropped, "on ties, which were broken against the method"
    kinds = (
        ("empty_lists", "query has", "queries have", "an empty list, scored as if it were missing"),
        ("tie_dependent", "query depends", "queries depend", against),
        ("flat", "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
        ("dropped_tiles", f"tile {left_out} is", f"tiles {left_out} are", "in no gallery"),
    )
    notes = [f"{counted(sums[n], one, many)} {what}" for n, one, many, what in kinds if sums[n]]
    tables = [truth.excluded for truth in truths]
    unanswered = [one for some in tables for one in some["id"][some["reason"] == UNANSWERED]]
    if unanswered:
        notes.append(f"queries that no tile answers, left out: {first_of(unanswered)}")
    if isinstance(predictions.content, Descriptors):
        given = predictions.content.gallery_ids
        known = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
        # Cut, since ids of a file may be long, and notes stand under tables.
        strange = [name[:_SHOWN_LETTERS] for name in given[~np.isin(given, known)].tolist()]
        if strange:
            named = first_of(strange)
            notes.append(f"described tiles that are in no gallery, left aside: {named}")
    if sums["shorter"]:
        ending = counted(sums["shorter"], "list ends", "lists end")
        reached = min(scene.facts["reached"] for scene in scored if scene.facts["shorter"])
        notes.append(
            f"{ending} without all positives, the shortest after rank {reached}: to scores that "
            "read deeper (mAP, MRR) the others are not found"
        )
    return notes


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

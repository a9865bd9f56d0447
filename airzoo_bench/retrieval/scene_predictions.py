"""The predictions of one scene: the gallery ranked for each of its queries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.pairs import hit_matrix
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.scene_ranking import Asked, rank_scene
from airzoo_bench.retrieval.settings import ImageScores, RetrievalScores
from airzoo_bench.retrieval.ties import Ranking
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["ScenePredictions", "match_scene", "strange_tiles"]


@dataclass(frozen=True)
class ScenePredictions:
    """The gallery of a scene, ranked for each of its Q queries.

    Attributes
    ----------
    ranking : Ranking
        Q rows; those of missing queries hold no tile.
    answered, given : (Q,) bool
        Which queries have a list that is not empty, and which have a list.
    """

    truth: RetrievalTruth
    ranking: Ranking
    answered: Bools
    given: Bools

    @property
    def lengths(self) -> Ints:
        """How many ranks each query has a tile at."""
        lengths: Ints = np.count_nonzero(self.ranking.tiles >= 0, axis=1)
        return lengths

    def shorter(self, depth: int) -> int:
        """Count the lists that end before a rank, and not all of whose positives they hold."""
        positives = self.truth.positives
        if self.ranking.hit_ranks is not None:
            lacking = np.zeros(positives.n_queries, np.bool_)
            lacking[positives.queries[self.ranking.hit_ranks == 0]] = True
            return int((lacking & (self.lengths > 0)).sum())
        hits = hit_matrix(
            self.ranking.tiles, positives.offsets, positives.tiles, len(self.truth.tiles)
        )
        short = (self.lengths > 0) & (self.lengths < min(depth, len(self.truth.tiles)))
        return int((short & (np.count_nonzero(hits, axis=1) < positives.counts)).sum())

    @property
    def counts(self) -> dict[str, int]:
        """What a result states of the scene."""
        truth = self.truth
        return {
            "queries": len(truth.queries),
            "tiles": len(truth.tiles),
            "missing": int((~self.answered).sum()),
            "empty_lists": int((self.given & ~self.answered).sum()),
            "tie_dependent": int(self.ranking.tie_dependent.sum()),
            "without_positive": len(truth.excluded) + int((truth.positives.counts == 0).sum()),
            "without_ground_point": truth.without_ground_point,
            "dropped_tiles": len(truth.dropped_tiles),
        }


def match_scene(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    settings: RetrievalScores | ImageScores,
    run: Run,
) -> ScenePredictions:
    """Rank the gallery of one scene for each of its queries, as predicted."""
    content, there = predictions.content, np.flatnonzero(rows >= 0)
    names = predictions.query_ids[rows[there]]
    asked = Asked(rows[there], names, truth.positives.take(there))
    try:
        ranking = rank_scene(content, truth, asked, settings, run)
    except PredictionError as error:
        raise error.inside(predictions.path) from error
    given = rows >= 0
    answered = given
    if isinstance(content, RankedIds):
        answered = given & (content.ids[rows] != "").any(axis=1)
    return ScenePredictions(
        truth, _with_all_queries(ranking, given, truth.positives.counts), answered, given
    )


def strange_tiles(
    predictions: RetrievalPredictions, truths: Sequence[RetrievalTruth]
) -> NDArray[np.str_]:
    """Return the ids of described tiles that are in no gallery."""
    if isinstance(predictions.content, RankedIds):
        return np.zeros(0, "<U1")
    given = predictions.content.gallery_ids
    known = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
    return given[~np.isin(given, known)]


def _with_all_queries(ranking: Ranking, given: Bools, counts: Ints) -> Ranking:
    """Add the rows of queries that the predictions lack; `counts` of positives is of all."""
    tiles = np.full((len(given), ranking.tiles.shape[1]), -1, np.int32)
    tied = np.zeros(len(given), np.bool_)
    tiles[given], tied[given] = ranking.tiles, ranking.tie_dependent
    if ranking.hit_ranks is None:
        return Ranking(tiles, tied)
    ranks = np.zeros(counts.sum(), np.int64)
    ranks[np.repeat(given, counts)] = ranking.hit_ranks
    return Ranking(tiles, tied, ranks)

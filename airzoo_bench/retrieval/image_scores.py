"""Scores of a gallery of images, each as the code of the benchmark that introduced it has it.

Throughout, ``hit_ranks`` is (P,), see `Ranking.hit_ranks`, and ``offsets`` (Q + 1,) says where
the numbers of each query begin. A query without a positive in the gallery scores 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.distance_metrics import dis_at, is_within, sdm_at, top1_distance
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.positions import degrees_apart, distances_of, farthest, metres_apart
from airzoo_bench.retrieval.scores import recall_at_share_name
from airzoo_bench.retrieval.settings import DistanceScores, ImageScores
from airzoo_bench.retrieval.ties import Ranking
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = [
    "average_precision",
    "average_precision_by_trapezoids",
    "image_columns",
    "rank_of_share",
]


def rank_of_share(n_tiles: int, share: float) -> int:
    """Return the rank that recall at a share of the gallery reads."""
    return round(n_tiles * share) + 1


def average_precision_by_trapezoids(hit_ranks: Ints, positives: Positives) -> Floats:
    r"""AP as the area under the precision-recall curve, by trapezoids."""
    ordinal, at = _ordinals(positives), _precision_at_hits(hit_ranks, positives)
    before = np.divide(ordinal - 1, hit_ranks - 1, out=np.ones(len(ordinal)), where=hit_ranks > 1)
    return _mean_by_query(np.where(hit_ranks > 0, (before + at) / 2, 0.0), positives)


def average_precision(hit_ranks: Ints, positives: Positives) -> Floats:
    """AP over the whole list: the mean over positives of the precision at their ranks."""
    return _mean_by_query(_precision_at_hits(hit_ranks, positives), positives)


def _precision_at_hits(hit_ranks: Ints, positives: Positives) -> Floats:
    """Return the precision at the rank of each positive, 0 where it is not in the list."""
    at = np.zeros(len(hit_ranks))
    return np.divide(_ordinals(positives), hit_ranks, out=at, where=hit_ranks > 0)


def image_columns(
    truth: RetrievalTruth, ranking: Ranking, settings: ImageScores
) -> dict[str, Floats]:
    """Return the columns of the records that a gallery of images has besides Recall@K."""
    if ranking.hit_ranks is None:
        raise ValueError("the ranking was not made for scores that read whole lists")
    ranks, positives = ranking.hit_ranks, truth.positives
    first = _first_ranks(ranks, positives)
    rank = rank_of_share(len(truth.tiles), settings.recall_at_share)
    columns = {
        recall_at_share_name(settings.recall_at_share): ((first > 0) & (first <= rank)).astype(
            float
        ),
        "ap/trapezoid": average_precision_by_trapezoids(ranks, positives),
        "map": average_precision(ranks, positives),
        "mrr": np.divide(1.0, first, out=np.zeros(len(first)), where=first > 0),
    }
    if settings.distances is not None:
        columns |= _distance_columns(truth, ranking.tiles, settings.distances)
    return columns


def _distance_columns(
    truth: RetrievalTruth, ranked: NDArray[np.int32], settings: DistanceScores
) -> dict[str, Floats]:
    positions = truth.positions
    if positions is None:
        raise ValueError(f"the truth of scene {truth.scene} has no positions")
    between = metres_apart(settings.metres)
    depth = max(*settings.sdm_at, *settings.dis_at)
    metres = distances_of(between, positions, ranked[:, :depth])
    apart = metres
    if settings.sdm_unit == "degree":
        apart = distances_of(degrees_apart, positions, ranked[:, :depth])
    first, worst = top1_distance(metres), farthest(between, positions)
    return {
        **{f"sdm@{k}": sdm_at(apart, k, settings.sdm_scale) for k in settings.sdm_at},
        **{f"ma@{m:g}m": is_within(first, m) for m in settings.ma_below_m},
        **{f"dis@{k}": dis_at(metres, k, worst) for k in settings.dis_at},
    }


def _ordinals(positives: Positives) -> Ints:
    """Count the hits of each query from 1."""
    counts: Ints = np.arange(len(positives.tiles)) - positives.offsets[positives.queries] + 1
    return counts


def _mean_by_query(values: Floats, positives: Positives) -> Floats:
    sums = np.bincount(positives.queries, values, minlength=positives.n_queries)
    mean: Floats = sums / np.maximum(positives.counts, 1)
    return mean


def _first_ranks(hit_ranks: Ints, positives: Positives) -> Ints:
    """Return the first rank (Q,) that holds a positive; 0 for none."""
    first = np.zeros(positives.n_queries, np.int64)
    some = positives.counts > 0
    first[some] = hit_ranks[positives.offsets[:-1][some]]
    return first

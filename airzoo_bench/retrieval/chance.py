"""The chance level: expected scores of tiles in random order.

With R of G tiles positive and every order as likely as any other, the ranks hold positives as draws
without replacement do. All expectations here are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import comb

import numpy as np
import pandas as pd

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import concatenate, summarise
from airzoo_bench.retrieval.scoring import ap_name, rank_of_share, retrieval_scores, share_name
from airzoo_bench.retrieval.settings import ImageScores, RetrievalScores
from airzoo_bench.retrieval.truth import RetrievalTruth


def chance_scores(
    positives: Ints, n_tiles: int, settings: RetrievalScores | ImageScores
) -> dict[str, Floats]:
    """Return the expected score of each query under a random order of its gallery."""
    kinds, back = np.unique(positives, return_inverse=True)
    if isinstance(settings, ImageScores):
        scores = _image_scores(kinds, n_tiles, settings)
    else:
        scores = _tile_scores(kinds, n_tiles, settings)
    return {name: values[back] for name, values in scores.items()}


def _image_scores(kinds: Ints, n_tiles: int, settings: ImageScores) -> dict[str, Floats]:
    right, divisor = kinds.astype(np.float64), np.maximum(kinds, 1)
    share = settings.recall_at_share
    none = _none_among(kinds, n_tiles, max(n_tiles, *settings.recall_at))
    scores = {f"recall@{n}": 1 - none[:, n] for n in settings.recall_at}
    scores[share_name(share)] = 1 - none[:, rank_of_share(n_tiles, share)]
    scores["map"] = _precision_sums(right, n_tiles, n_tiles) / divisor
    scores["ap/trapezoid"] = (scores["map"] + _precision_before(right, n_tiles) / divisor) / 2
    scores["mrr"] = -np.diff(none[:, : n_tiles + 1], axis=1) @ (1 / np.arange(1.0, n_tiles + 1))
    return scores


def _tile_scores(kinds: Ints, n_tiles: int, settings: RetrievalScores) -> dict[str, Floats]:
    k, kept = settings.ap_at, min(settings.ranks_kept, n_tiles)
    right, divisor = kinds.astype(np.float64), np.maximum(kinds, 1)
    none = _none_among(kinds, n_tiles, max(kept, *settings.recall_at))
    sums = _precision_sums(right, n_tiles, min(k, n_tiles))
    scores = {f"recall@{n}": 1 - none[:, n] for n in settings.recall_at}
    scores[ap_name(k, "precision")] = right / n_tiles * min(k, n_tiles) / k
    scores[ap_name(k, "min")] = sums / np.minimum(divisor, k)
    scores[ap_name(k, "trec")] = sums / divisor
    scores[ap_name(k, "hits")] = np.array([_over_hits(int(r), n_tiles, k) for r in kinds])
    scores["map"] = _precision_sums(right, n_tiles, kept) / divisor
    scores["mrr"] = -np.diff(none[:, : kept + 1], axis=1) @ (1 / np.arange(1.0, kept + 1))
    for depth in settings.ndcg_at:
        gain = np.concatenate(([0.0], np.cumsum(1 / np.log2(np.arange(2, depth + 2)))))
        best = gain[np.clip(kinds, 1, depth)]
        scores[f"ndcg@{depth}"] = right / n_tiles * gain[min(depth, n_tiles)] / best
    return scores


def chance_level(
    truths: Sequence[RetrievalTruth], settings: RetrievalScores | ImageScores
) -> Reference:
    """Return what tiles in random order score, by scene; see `chance_scores`."""
    records = concatenate(
        [
            pd.DataFrame(chance_scores(truth.positives.counts, len(truth.tiles), settings)).assign(
                scene=truth.scene
            )
            for truth in truths
        ]
    )
    scores = [score for score in retrieval_scores(settings) if score.column in records]
    summary = summarise(records, scores, [truth.scene for truth in truths])
    return Reference(
        meaning="what tiles in random order score on average, computed exactly",
        **asdict(summary),
    )


def _none_among(positives: Ints, n_tiles: int, most: int) -> Floats:
    """Give the probability (n, most + 1) that the first 0, 1, ... tiles hold no positive."""
    drawn = np.arange(most)
    left = np.maximum(n_tiles - positives[:, None] - drawn, 0)
    each = np.where(drawn < n_tiles, left / np.maximum(n_tiles - drawn, 1), 1.0)
    return np.concatenate([np.ones((len(positives), 1)), np.cumprod(each, axis=1)], axis=1)


def _precision_sums(positives: Floats, n_tiles: int, depth: int) -> Floats:
    """Give the expected sum of the precisions at hits among the first ranks."""
    rank = np.arange(1.0, depth + 1)
    also = (positives - 1) / max(n_tiles - 1, 1)
    return np.asarray(positives / n_tiles * ((1 / rank).sum() + also * ((rank - 1) / rank).sum()))


def _precision_before(positives: Floats, n_tiles: int) -> Floats:
    """Give the expected sum, over the hits, of the precision just before each; 1 at rank 1."""
    also = (positives - 1) / max(n_tiles - 1, 1)
    return positives / n_tiles * (1 + (n_tiles - 1) * also)


def _over_hits(positives: int, n_tiles: int, k: int) -> float:
    """Give the expected mean precision at hits among the first k; 0 without a hit."""
    depth = min(k, n_tiles)
    rank = np.arange(1.0, depth + 1)
    total = 0.0
    for hits in range(1, min(positives, depth) + 1):
        ways = comb(positives, hits) * comb(n_tiles - positives, depth - hits)
        # Given their number, hits are anywhere among the first k alike.
        also = (hits - 1) / max(depth - 1, 1)
        mean = ((1 + (rank - 1) * also) / rank).mean()
        total += ways / comb(n_tiles, depth) * float(mean)
    return total

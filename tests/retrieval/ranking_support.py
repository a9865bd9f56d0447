"""Rankings worked out plainly, to compare with."""

from __future__ import annotations

import numpy as np

from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval.ranking import Ranking, rank_by_descriptors
from airzoo_bench.retrieval.track import score_scene
from airzoo_bench.retrieval.truth import Positives

METRICS = ["l2", "cosine", "inner_product"]


def positives_of(*tiles):
    offsets = np.concatenate([[0], np.cumsum([len(some) for some in tiles])])
    flat = [tile for some in tiles for tile in some]
    return Positives(offsets.astype(np.int64), np.array(flat, np.int32))


def random_positives(rng, n_queries, n_tiles, most=4):
    counts = rng.integers(0, min(most, n_tiles) + 1, n_queries)
    return positives_of(*[np.sort(rng.choice(n_tiles, n, replace=False)) for n in counts])


def rank(queries, gallery, metric="l2", k=3, tie_ranks=5, positives=None, run=None, names=None):
    """All blocks in one."""
    blocks = rank_by_descriptors(
        queries,
        gallery,
        k=k,
        metric=metric,
        positives=positives or positives_of(*[[]] * len(queries)),
        tie_ranks=tie_ranks,
        run=run or Run(),
        names=names or range(len(queries)),
        tile_names=names or range(len(gallery)),
    )
    parts = [Ranking.blank(0, k), *(found for _, found in blocks)]
    tiles, tied = zip(*[(part.tiles, part.tie_dependent) for part in parts], strict=True)
    return Ranking(np.concatenate(tiles), np.concatenate(tied))


def records_of(truth, ranking, settings, answered=True):
    """Score the ranking of all queries of a scene."""
    rows = np.arange(len(truth.queries))
    return score_scene(
        truth, [(rows, ranking)], rows >= 0 if answered is True else answered, settings
    )


def similarities(queries, gallery, metric):
    """Float64, the plain way; a query of zeros is alike to all."""
    queries, gallery = queries.astype(float), gallery.astype(float)
    if metric == "l2":
        return -((queries[:, None] - gallery) ** 2).sum(axis=2) * queries.any(axis=1)[:, None]
    if metric == "cosine":
        queries = queries / np.linalg.norm(queries, axis=1, keepdims=True)
        gallery = gallery / np.linalg.norm(gallery, axis=1, keepdims=True)
    return (queries[:, None] * gallery).sum(axis=2)


def naive(scores, positives, k, tie_ranks):
    """Sort whole rows by the tie rule; look at whole runs of equal scores."""
    n_queries, n_tiles = scores.shape
    tiles, tied = np.full((n_queries, k), -1), np.zeros(n_queries, bool)
    for query, row in enumerate(scores):
        positive = np.isin(np.arange(n_tiles), positives.tiles_of(query))
        order = np.lexsort((np.arange(n_tiles), positive, -row))
        tiles[query, : min(k, n_tiles)] = order[:k]
        for tile in order[:tie_ranks]:
            run = positive[row == row[tile]]
            tied[query] |= run.any() and not run.all()
        if n_tiles > 1 and (row == row[0]).all() and not positive.all():
            tiles[query] = -1  # no ranking at all
    return tiles, tied


def assert_is(ranking, expected):
    assert ranking.tiles.dtype == np.int32
    assert ranking.tiles.tolist() == expected[0].tolist()
    assert ranking.tie_dependent.tolist() == expected[1].tolist()

"""Rankings and records of whole scenes at once."""

from __future__ import annotations

import numpy as np

from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval.ranking import Ranking, rank_by_descriptors
from airzoo_bench.retrieval.track import score_scene
from airzoo_bench.retrieval.truth import Positives, offsets_of


def positives_of(*tiles):
    flat = [tile for some in tiles for tile in some]
    return Positives(offsets_of([len(some) for some in tiles]), np.array(flat, np.int32))


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

"""Rankings and records of whole scenes at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval.ranking import Depths, Ranking, rank_by_descriptors
from airzoo_bench.retrieval.track import score_scene
from airzoo_bench.retrieval.truth import Positives, offsets_of


def positives_of(*tiles: Any) -> Positives:
    flat = [tile for some in tiles for tile in some]
    return Positives(offsets_of([len(some) for some in tiles]), np.array(flat, np.int32))


def rank(
    queries: Any, gallery: Any, metric="l2", k=3, scored=5, positives=None, run=None, names=None
) -> Ranking:
    """All blocks in one."""
    blocks = rank_by_descriptors(
        queries,
        gallery,
        metric,
        positives or positives_of(*[[]] * len(queries)),
        Depths(len(gallery), k, scored),
        run or Run(),
        (names or range(len(queries)), names or range(len(gallery))),
    )
    whole = Ranking.blank(len(queries), k)
    for rows, (tiles, tied) in blocks:
        whole.tiles[rows], whole.tie_dependent[rows] = tiles, tied
    return whole


def records_of(truth: Any, ranking: Any, settings: Any, answered: Any = True) -> pd.DataFrame:
    """Score the ranking of all queries of a scene."""
    rows = np.arange(len(truth.queries))
    return score_scene(
        truth, [(rows, ranking)], rows >= 0 if answered is True else answered, settings
    )

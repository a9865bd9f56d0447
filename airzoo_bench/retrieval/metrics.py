"""Scores of a ranking, one value per query, from its hit matrix.

Throughout, ``hits`` is (Q, K) bool, best rank first; ``n_positives`` is (Q,), the number R of
positives that a query has in the gallery, ranked or not. A list shorter than k is filled with
non-hits. A query with R = 0 scores 0 in every metric. All scores lie between 0 and 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.settings import ApVariant

__all__ = [
    "average_precision",
    "average_precision_at",
    "first_hit_rank",
    "ndcg_at",
    "recall_at",
    "reciprocal_rank",
]


# Cells of the hit matrix looked at in one go; bounds the memory where nearly everything is a hit.
_CELLS = 1 << 20


def recall_at(hits: Bools, k: int) -> Floats:
    """Recall@k of place recognition: 1 when a positive is among the first k.

    Information retrieval calls this success@k or hit rate@k; its own recall@k, the share of the
    positives that is found, is another number.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.
    k : int
        At least 1.

    Returns
    -------
    (Q,) float64
        1 or 0.

    Raises
    ------
    ValueError
        `hits` is not a matrix, or k is below 1.

    References
    ----------
    trec_eval, measure ``success``; Arandjelovic et al., NetVLAD, CVPR 2016.
    """
    found: Bools = np.any(_first(hits, k), axis=1)
    return found.astype(np.float64)


def average_precision_at(hits: Bools, n_positives: Ints, k: int, variant: ApVariant) -> Floats:
    r"""AP@k in one of the four readings that are in use.

    With :math:`h_i` = 1 where rank i is a hit and :math:`P_i = \frac{1}{i} \sum_{j \le i} h_j`:

    - ``precision``: :math:`P_k`, the mean over the first k ranks of :math:`h_i`; R plays no part,
      so that a query with R < k cannot reach 1
    - ``trec``: :math:`\frac{1}{R} \sum_{i \le k} h_i P_i`
    - ``min``: :math:`\frac{1}{\min(R, k)} \sum_{i \le k} h_i P_i`
    - ``hits``: :math:`\frac{1}{\sum_{i \le k} h_i} \sum_{i \le k} h_i P_i`, 0 without a hit. One
      more hit at the end of the list can lower it.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.
    n_positives : (Q,) int
        R, the positives of each query in the gallery, ranked or not.
    k : int
        At least 1.
    variant : {"precision", "min", "trec", "hits"}

    Returns
    -------
    (Q,) float64
        0 to 1.

    Raises
    ------
    ValueError
        The shapes do not fit together, k is below 1, or the variant is unknown.

    References
    ----------
    ``precision`` and ``trec`` are the measures ``P`` and ``map_cut`` of trec_eval; ``min`` is the
    AP@k of the Kaggle competitions (Landmark Retrieval, with k = 100).
    """
    first = _first(hits, k)
    positives = _per_query(n_positives, hits)
    n_hits: Ints = np.count_nonzero(first, axis=1)
    match variant:
        case "precision":
            return np.divide(n_hits, k)
        case "min":
            divisor = np.minimum(positives, k)
        case "trec":
            divisor = positives
        case "hits":
            divisor = n_hits
        case _:
            raise ValueError(f"unknown variant {variant!r}, expected one of {get_args(ApVariant)}")
    sums = _sum_over_hits(first, np.divide)
    return np.divide(sums, np.maximum(divisor, 1))


def average_precision(hits: Bools, n_positives: Ints) -> Floats:
    r"""Average precision over the whole list: :math:`\frac{1}{R} \sum_i h_i P_i`.

    Its mean over queries is mAP. Positives that were not ranked count as never found.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.
    n_positives : (Q,) int
        Positives of each query in the gallery, ranked or not.

    Returns
    -------
    (Q,) float64
        0 to 1.

    Raises
    ------
    ValueError
        The shapes do not fit together.

    References
    ----------
    trec_eval, measure ``map``.
    """
    return average_precision_at(hits, n_positives, max(hits.shape[-1], 1), "trec")


def first_hit_rank(hits: Bools) -> Ints:
    """Rank of the first hit, counted from 1.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.

    Returns
    -------
    (Q,) int64
        0 where there is no hit.

    Raises
    ------
    ValueError
        `hits` is not a matrix.
    """
    listed = _first(hits, max(hits.shape[-1], 1))
    if listed.shape[1] == 0:
        return np.zeros(len(listed), dtype=np.int64)
    column = listed.argmax(axis=1)
    return np.where(listed[np.arange(len(listed)), column], column + 1, 0)


def reciprocal_rank(hits: Bools) -> Floats:
    """Reciprocal rank: 1 / (rank of the first hit), 0 without a hit; its mean is MRR.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.

    Returns
    -------
    (Q,) float64
        0 to 1.

    Raises
    ------
    ValueError
        `hits` is not a matrix.

    References
    ----------
    trec_eval, measure ``recip_rank``; Voorhees, TREC-8 question answering track, 1999.
    """
    rank = first_hit_rank(hits)
    return np.divide(1.0, rank, out=np.zeros(len(rank)), where=rank > 0)


def ndcg_at(hits: Bools, n_positives: Ints, k: int) -> Floats:
    r"""nDCG@k with binary gain.

    :math:`\sum_{i \le k} h_i / \log_2(i + 1)` over its value for the best possible list, which
    has its first min(R, k) ranks hit.

    Parameters
    ----------
    hits : (Q, K) bool
        Whether the tile at each rank is a positive, best first.
    n_positives : (Q,) int
        R, the positives of each query in the gallery, ranked or not.
    k : int
        At least 1.

    Returns
    -------
    (Q,) float64
        0 to 1.

    Raises
    ------
    ValueError
        The shapes do not fit together, or k is below 1.

    References
    ----------
    Jaervelin and Kekaelaeinen, Cumulated gain-based evaluation of IR techniques, ACM TOIS 20(4),
    2002, with the discount :math:`\log_2(i + 1)` of trec_eval's ``ndcg_cut``; theirs,
    :math:`\log_b i` from rank b on, does not tell ranks 1 and 2 apart.
    """
    first = _first(hits, k)
    positives = _per_query(n_positives, hits)
    discount = 1 / np.log2(np.arange(2, k + 2))
    dcg = _sum_over_hits(first, lambda _, rank: discount[rank - 1])
    ideal = np.concatenate(([0.0], np.cumsum(discount)))[np.minimum(positives, k)]
    return np.divide(dcg, ideal, out=np.zeros(len(dcg)), where=ideal > 0)


def _sum_over_hits(hits: Bools, term: Callable[[Ints, Ints], Floats]) -> Floats:
    """Sum term(ordinal, rank) over each query's hits; its n-th hit has the ordinal n."""
    depth = hits.shape[1]
    sums = np.zeros(len(hits))
    rows = max(1, _CELLS // max(depth, 1))
    for start in range(0, len(hits), rows):
        block = hits[start : start + rows]
        query, column = np.divmod(np.flatnonzero(block), depth)
        counts = np.bincount(query, minlength=len(block))
        before = np.cumsum(counts) - counts
        ordinal = np.arange(1, len(query) + 1) - before[query]
        weights = term(ordinal, column + 1)
        sums[start : start + rows] = np.bincount(query, weights, minlength=len(block))
    return sums


def _first(hits: Bools, k: int) -> Bools:
    if hits.ndim != 2 or hits.dtype != np.bool_:
        raise ValueError(f"hits is {hits.dtype} of shape {hits.shape}, expected bool (Q, K)")
    if k < 1:
        raise ValueError(f"k is {k}, expected at least 1")
    return hits[:, :k]


def _per_query(n_positives: Ints, hits: Bools) -> Ints:
    if n_positives.shape != (len(hits),):
        raise ValueError(f"n_positives has shape {n_positives.shape}, expected ({len(hits)},)")
    return n_positives

"""Formulas of the scores of a ranking, one value a query.

`hits` is (Q, K) bool, best rank first, and `n_positives` (Q,) is R, the number of positives in
the gallery, ranked or not. `distances` is (Q, K), infinite where no tile is ranked. Ranks beyond
the end of a list hold nothing. A query without a positive has no hit and scores 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.settings import ApVariant, ImageScoring, TileScoring

_BITMAP_CELLS = 1 << 22  # 4 MB stay in the cache, where random reads are cheap


def ap_name(k: int, variant: str) -> str:
    """Name an AP variant: plain ``ap@5`` is mean precision at 5, every other carries its name."""
    return f"ap@{k}" if variant == "precision" else f"ap@{k}/{variant}"


def share_name(share: float) -> str:
    """Name the recall at a share of the gallery: ``recall@1%``."""
    return f"recall@{100 * share:g}%"


def rank_of_share(n_tiles: int, share: float) -> int:
    """Return the rank that the recall at a share of the gallery reads, as University-1652 does."""
    return round(n_tiles * share) + 1


def hit_matrix(
    ranked: NDArray[np.int32], offsets: Ints, tiles: NDArray[np.int32], n_tiles: int
) -> Bools:
    """Mark the ranks (Q, K) that hold a positive; `offsets` and `tiles` as in `Positives`."""
    n_queries, depth = ranked.shape
    width = n_tiles + 1  # column 0 of the bitmap stands for -1 and stays False
    rows = max(1, _BITMAP_CELLS // max(width, depth))
    bitmap = np.zeros(min(rows, n_queries) * width, np.bool_)
    hits = np.empty(ranked.shape, np.bool_)
    for start in range(0, n_queries, rows):
        stop = min(start + rows, n_queries)
        origin = np.arange(stop - start) * width + 1
        bounds = offsets[start : stop + 1]
        positive = np.repeat(origin, np.diff(bounds)) + tiles[bounds[0] : bounds[-1]]
        bitmap[positive] = True
        np.take(bitmap, origin[:, None] + ranked[start:stop], out=hits[start:stop], mode="clip")
        bitmap[positive] = False
    return hits


def recall_at(hits: Bools, k: int) -> Floats:
    """Recall@k of place recognition: 1 where a positive is among the first k, else 0.

    Information retrieval calls it success@k or hit rate@k (trec_eval: ``success``); see
    Arandjelovic et al., NetVLAD, CVPR 2016.
    """
    return np.asarray(hits[:, :k].any(axis=1), np.float64)


def average_precision_at(hits: Bools, n_positives: Ints, k: int, variant: ApVariant) -> Floats:
    r"""AP@k, 0 to 1, in one of the four readings that are in use.

    With :math:`h_i` = 1 where rank i is a hit and :math:`P_i = \frac{1}{i} \sum_{j \le i} h_j`:

    - ``precision``: :math:`P_k`; R plays no part, so that a query with R < k cannot reach 1
      (``P`` of trec_eval)
    - ``trec``: :math:`\frac{1}{R} \sum_{i \le k} h_i P_i` (``map_cut`` of trec_eval)
    - ``min``: :math:`\frac{1}{\min(R, k)} \sum_{i \le k} h_i P_i` (Kaggle's Landmark Retrieval)
    - ``hits``: :math:`\frac{1}{\sum_{i \le k} h_i} \sum_{i \le k} h_i P_i`, 0 without a hit; one
      more hit at the end of the list can lower it
    """
    first = hits[:, :k]
    n_hits: Ints = np.count_nonzero(first, axis=1)
    if variant == "precision":
        return n_hits / k
    divisors = {"trec": n_positives, "min": np.minimum(n_positives, k), "hits": n_hits}
    return np.asarray(_sum_over_hits(first, np.divide) / np.maximum(divisors[variant], 1))


def average_precision(hits: Bools, n_positives: Ints) -> Floats:
    """AP over the whole list; its mean over queries is mAP (``map`` of trec_eval)."""
    return average_precision_at(hits, n_positives, max(hits.shape[1], 1), "trec")


def first_hit_rank(hits: Bools) -> Ints:
    """Return the rank of the first hit, from 1; 0 without a hit."""
    if hits.shape[1] == 0:
        return np.zeros(len(hits), np.int64)
    column = hits.argmax(axis=1)
    return np.where(hits[np.arange(len(hits)), column], column + 1, 0)


def reciprocal_rank(hits: Bools) -> Floats:
    """1 / rank of the first hit, 0 without one; the mean is MRR (``recip_rank`` of trec_eval)."""
    rank = first_hit_rank(hits)
    return np.asarray((rank > 0) / np.maximum(rank, 1))


def ndcg_at(hits: Bools, n_positives: Ints, k: int) -> Floats:
    r"""nDCG@k with binary gain, 0 to 1.

    :math:`\sum_{i \le k} h_i / \log_2(i + 1)` over its value for the best list, which has its
    first min(R, k) ranks hit. Jaervelin and Kekaelaeinen, ACM TOIS 20(4), 2002, with the discount
    of trec_eval's ``ndcg_cut``.
    """
    discount = 1 / np.log2(np.arange(2, k + 2))
    dcg = _sum_over_hits(hits[:, :k], lambda _, rank: discount[rank - 1])
    return np.asarray(dcg / np.cumsum(discount)[np.clip(n_positives, 1, k) - 1])


def _sum_over_hits(hits: Bools, term: Callable[[Ints, Ints], Floats]) -> Floats:
    """Sum term(ordinal, rank) over each query's hits; its n-th hit has the ordinal n."""
    query, column = np.nonzero(hits)
    counts = np.bincount(query, minlength=len(hits))
    before = np.cumsum(counts) - counts
    ordinal = np.arange(1, len(query) + 1) - before[query]
    return np.asarray(np.bincount(query, term(ordinal, column + 1), len(hits)), np.float64)


def trapezoid_precision(hits: Bools, n_positives: Ints) -> Floats:
    r"""Area under the precision-recall curve of whole lists, as University-1652's code has it.

    The n-th positive of a query, at rank :math:`r_n`, adds the mean of the precision there,
    :math:`n / r_n`, and of that just before it, :math:`(n - 1) / (r_n - 1)`, which is 1 at rank 1.
    """

    def term(ordinal: Ints, rank: Ints) -> Floats:
        before = np.divide(ordinal - 1, rank - 1, out=np.ones(len(rank)), where=rank > 1)
        return np.asarray((before + ordinal / rank) / 2)

    return np.asarray(_sum_over_hits(hits, term) / np.maximum(n_positives, 1))


def sdm_at(distances: Floats, k: int, scale: float) -> Floats:
    r"""SDM@k, 0 to 1: how near the first k tiles are, early ranks more.

    :math:`\sum_{i \le k} w_i e^{-s d_i} / \sum_{i \le k} w_i` with :math:`w_i = k - i + 1` and s
    per unit of the distances: 0.001 per metre in Game4Loc, 5000 per degree in DenseUAV (Dai et
    al., arXiv:2201.09201).
    """
    return _rank_weighted_mean(distances, k, lambda _, column: np.exp(-scale * column))


def pdm_at(distances: Floats, k: int, sizes: Floats, steepness: float, tolerance: float) -> Floats:
    r"""PDM@k of AnyVisLoc: SDM@k with distances in tiles and a gain that falls as a sigmoid.

    The gain is :math:`1 / (1 + e^{\lambda (d / w - \alpha)})` for tiles of the sides w (Q, K);
    the authors' code has the steepness :math:`\lambda` = 6 and the tolerance :math:`\alpha` = 0.9.
    It divides by the weights of the ranks that are there; here the others gain 0.
    Ye et al., arXiv:2503.10692.
    """

    def gain(rank: int, column: Floats) -> Floats:
        with np.errstate(over="ignore"):  # exp overflows to infinity, and the gain is rightly 0
            return 1 / (1 + np.exp(steepness * (column / sizes[:, rank] - tolerance)))

    return _rank_weighted_mean(distances, k, gain)


def _rank_weighted_mean(distances: Floats, k: int, gain: Callable[[int, Floats], Floats]) -> Floats:
    # One rank after the other: the sum has one order, whatever the layout or the BLAS.
    total = np.zeros(len(distances))
    for rank, column in enumerate(distances[:, :k].T):
        total += (k - rank) * gain(rank, column)
    return total / (k * (k + 1) / 2)


def dis_at(distances: Floats, k: int, worst: Floats) -> Floats:
    """Dis@k of Game4Loc: the mean distance of the first k tiles.

    Ranks without a tile count as `worst` (Q,), the distance of the farthest tile, so that a short
    list gains nothing. ``get_dis`` in ``game4loc/evaluate/gta.py`` of Yux1angJi/GTA-UAV.
    """
    first = distances[:, :k]
    total: Floats = (k - first.shape[1]) * worst
    for column in first.T:
        total += np.where(np.isfinite(column), column, worst)
    return total / k


def chance_scores(
    positives: Ints, n_tiles: int, settings: TileScoring | ImageScoring
) -> dict[str, Floats]:
    """Return the exact expected scores of queries (Q,) for a gallery in random order.

    Every order is as likely as any other, so that the ranks draw positives without replacement.
    """
    kinds, back = np.unique(positives, return_inverse=True)
    kept = n_tiles
    if isinstance(settings, TileScoring):
        kept = min(settings.ranks_kept, n_tiles)
    missed = _miss_probabilities(kinds, n_tiles, max(kept, *settings.recall_at))
    divisor, share = np.maximum(kinds, 1), kinds / n_tiles
    inverse = 1 / np.arange(1.0, kept + 1)
    beside = (kinds - 1) / max(n_tiles - 1, 1)  # the share of positives beside a hit

    def precisions(depth: int) -> Floats:
        """Return the sum of the precisions at the hits among the first ranks."""
        first: float = inverse[:depth].sum()  # of each hit itself, at rank r a share of 1 / r
        return np.asarray(share * (first + beside * (depth - first)))

    scores = {f"recall@{k}": 1 - missed[:, k] for k in settings.recall_at}
    scores["map"] = precisions(kept) / divisor
    scores["mrr"] = -np.diff(missed[:, : kept + 1], axis=1) @ inverse
    if isinstance(settings, ImageScoring):
        rank = min(rank_of_share(n_tiles, settings.recall_at_share), n_tiles)
        scores[share_name(settings.recall_at_share)] = 1 - missed[:, rank]
        before = share * (1 + (n_tiles - 1) * beside)  # precision before hits; 1 at rank 1
        scores["ap/trapezoid"] = (scores["map"] + before / divisor) / 2
    else:
        k, depth = settings.ap_at, min(settings.ap_at, n_tiles)
        found, alone = 1 - missed[:, depth], inverse[:depth].mean()
        more = (share * depth - found) / max(depth - 1, 1)  # hits beside one, as a share of ranks
        scores[ap_name(k, "precision")] = share * depth / k
        scores[ap_name(k, "min")] = precisions(depth) / np.minimum(divisor, k)
        scores[ap_name(k, "trec")] = precisions(depth) / divisor
        scores[ap_name(k, "hits")] = found * alone + more * (1 - alone)
        for last in settings.ndcg_at:
            gain = np.cumsum(1 / np.log2(np.arange(2, last + 2)))  # of the first ranks, all hit
            best = gain[np.clip(kinds, 1, last) - 1]
            scores[f"ndcg@{last}"] = share * gain[min(last, n_tiles) - 1] / best
    return {name: values[back] for name, values in scores.items()}


def _miss_probabilities(positives: Ints, n_tiles: int, most: int) -> Floats:
    """Return the probability (n, most + 1) that the first 0, 1, ... tiles hold no positive."""
    drawn = np.arange(most)
    left = np.maximum(n_tiles - positives[:, None] - drawn, 0)
    each = np.where(drawn < n_tiles, left / np.maximum(n_tiles - drawn, 1), 1.0)
    return np.concatenate([np.ones((len(positives), 1)), np.cumprod(each, axis=1)], axis=1)

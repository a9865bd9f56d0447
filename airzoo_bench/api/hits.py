"""Recall and average precision of lists that say at each rank whether it is a hit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import choice, floats, in_order, whole
from airzoo_bench.api.labels import ranks_in_order, same_index
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.settings import ApVariant

__all__ = ["average_precision", "recall_at_k"]


def recall_at_k(hits: ArrayLike, k: int) -> float:
    """Recall@k: the share of queries with a positive among the first k.

    This is the recall of place recognition, which information retrieval calls success or hit
    rate. A list shorter than k is as if misses followed.

    Parameters
    ----------
    hits : (Q, K) array-like
        Whether the tile at each rank is a positive, best rank first: booleans, or 0 and 1. Lists
        may differ in length. One list (K,) is one query.
    k : int
        At least 1.

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    ArgumentError
        No query, values other than 0 and 1, k below 1.

    References
    ----------
    Arandjelovic et al., NetVLAD, CVPR 2016; measure ``success`` of trec_eval.

    Examples
    --------
    Of two queries, one has its positive first, the other third:

    >>> recall_at_k([[1, 0, 0], [0, 0, 1]], k=1)
    0.5
    >>> recall_at_k([[1, 0, 0], [0, 0, 1]], k=3)
    1.0
    """
    return float(metrics.recall_at(_hits(hits), whole("k", k)).mean())


def average_precision(
    hits: ArrayLike, n_positives: ArrayLike, k: int | None = None, *, variant: ApVariant = "trec"
) -> float:
    r"""Average precision, averaged over queries: mAP, or AP@k in one of its four readings.

    With :math:`h_i` = 1 where rank i is a hit, :math:`P_i` the precision of the first i ranks, and
    R positives: ``trec`` is :math:`\frac{1}{R} \sum_{i \le k} h_i P_i`; ``min`` divides by min(R,
    k), ``hits`` by the number of hits; ``precision`` is :math:`P_k`, the AP@5 of the AirZoo paper.

    Parameters
    ----------
    hits : (Q, K) array-like
        See `recall_at_k`.
    n_positives : (Q,) array-like of int, or int
        R: how many positives each query has in the gallery, ranked or not. Taken from the hits
        alone, AP would rise when positives are not found.
    k : int, optional
        How many ranks count; all where left out.
    variant : {"trec", "min", "hits", "precision"}

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    ArgumentError
        See `recall_at_k`; a query with no positive or with fewer than it has hits; an unknown
        variant.

    References
    ----------
    Measures ``map``, ``map_cut`` and ``P`` of trec_eval; ``min`` is that of Kaggle's Landmark
    Retrieval.

    Examples
    --------
    Hits at ranks 1 and 3, and three positives: (1/1 + 2/3) / 3.

    >>> round(average_precision([1, 0, 1, 0, 0], n_positives=3), 4)
    0.5556
    >>> average_precision([1, 0, 1, 0, 0], n_positives=3, k=5, variant="precision")
    0.4
    """
    choice("variant", variant, get_args(ApVariant))
    same_index({"hits": hits, "n_positives": n_positives})
    matrix = _hits(hits)
    counts = _counts(n_positives, matrix)
    depth = max(matrix.shape[1], 1) if k is None else whole("k", k)
    return float(metrics.average_precision_at(matrix, counts, depth, variant).mean())


def _hits(hits: ArrayLike) -> Bools:
    """Return hits as a matrix; shorter lists are filled up with misses."""
    hits = in_order("hits", hits)
    ranks_in_order("hits", hits)
    rows = hits if hasattr(hits, "__array__") else _filled_up(hits)
    values = np.asarray(rows)
    values = values.astype(np.int64) if values.dtype == np.bool_ else values
    one_query = values.ndim == 1 and len(values) > 0
    matrix = floats("hits", values[None] if one_query else values, (None, None))
    if len(matrix) == 0 or not np.isin(matrix, (0.0, 1.0)).all():
        raise ArgumentError(
            "holds other values than 0 and 1" if len(matrix) else "holds no query",
            where="hits",
            expected="for each query whether each rank is a hit: booleans, or 0 and 1",
        )
    return matrix.astype(np.bool_)


def _filled_up(rows: Any) -> Any:
    lists = list(rows) if isinstance(rows, Iterable) else [rows]
    if not any(isinstance(row, Sequence) for row in lists):
        return lists
    lengths = [len(row) if isinstance(row, Sequence) else -1 for row in lists]
    return [
        row if size < 0 else [*row, *[0] * (max(lengths) - size)]
        for row, size in zip(lists, lengths, strict=True)
    ]


def _counts(n_positives: ArrayLike, hits: Bools) -> Ints:
    given = np.asarray(in_order("n_positives", n_positives))
    if given.dtype.kind not in "iu":
        raise ArgumentError(
            f"is of type {given.dtype}", where="n_positives", expected="whole numbers, one a query"
        )
    if given.shape not in ((), (len(hits),)):
        raise ArgumentError(
            f"has shape {given.shape}", where="n_positives", expected=f"({len(hits)},), one a query"
        )
    counts = np.broadcast_to(given, (len(hits),)).astype(np.int64)
    wrong = np.flatnonzero(counts < np.maximum(hits.sum(axis=1), 1))
    if wrong.size:
        raise ArgumentError(
            f"is below the number of hits, or below 1, for queries "
            f"{first_of(wrong.tolist(), len(hits))}",
            where="n_positives",
            expected="all positives that each query has in the gallery, ranked or not",
            fix="leave out queries that have no positive, as the protocols do",
        )
    return counts

"""Retrieval scores from hits, ranked ids, similarities or descriptors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import choice, finite, floats, in_order, refused, whole
from airzoo_bench.api.ids import (
    Ids,
    gallery_row,
    id_row,
    id_rows,
    indexed_lists,
    paired_queries,
    score_rows,
)
from airzoo_bench.api.labels import ranks_in_order, same_columns, same_index
from airzoo_bench.api.scores import Asked, QueryScores, WithoutPositive, rank_scores
from airzoo_bench.core.errors import ArgumentError
from airzoo_bench.retrieval.checks import list_errors
from airzoo_bench.retrieval.descriptors import Metric
from airzoo_bench.retrieval.ranking import rank_by_descriptors, rank_by_ids
from airzoo_bench.retrieval.settings import ApVariant

__all__ = ["descriptor_scores", "retrieval_scores", "similarity_scores"]


def retrieval_scores(
    ranked_ids: Any,
    positives: Any,
    ks: Iterable[int] = (1, 5, 10),
    *,
    scores: Any = None,
    gallery_ids: Any = None,
    ap: ApVariant = "precision",
    without_positive: WithoutPositive = "exclude",
) -> QueryScores:
    """Score ranked galleries: recall, AP and nDCG at each k, mAP and MRR.

    All queries are of one scene, and rank its gallery; the average over scenes is the mean of what
    this function returns for each.

    Parameters
    ----------
    ranked_ids : (Q, K) array-like, sequence of sequences, or mapping by query
        Ids of the gallery, best first: whole numbers or texts. Lists may differ in length; -1, as
        FAISS has it, or an empty text ends a list.
    positives : sequence of Q sets or lists, or mapping by query
        Ids that answer each query. Queries of a mapping that `ranked_ids` lacks have no answer,
        and score 0.
    ks : iterable of int
        Ranks, each at least 1.
    scores : (Q, K) array-like, optional
        Similarities or distances of the ranked ids. Ties are broken against the method: of equal
        scores those that are no positives come first. Needs `gallery_ids`, since the last ids of
        a list may tie with those that were left out.
    gallery_ids : (G,) array-like, optional
        Everything that could be ranked; other ids are then refused.
    ap : {"precision", "min", "trec", "hits"}
        The reading of AP@k, see `average_precision`; all but the first name it: ``ap@5/trec``.
    without_positive : {"exclude", "miss"}
        Queries without a positive cannot be answered: they are left out and counted, as in the
        shipped protocols, or score 0.

    Returns
    -------
    QueryScores
        ``recall@k``, ``ap@k``, ``ndcg@k``, ``map`` (over the whole lists) and ``mrr``.

    Raises
    ------
    ArgumentError
        Lists that do not fit, ids of two kinds, an id ranked twice, scores out of order, k below
        1, no query that has a positive.

    References
    ----------
    See `recall_at_k` and `average_precision`; Järvelin and Kekäläinen, ACM TOIS 20(4), 2002, for
    nDCG; Voorhees, TREC-8, 1999, for MRR.

    Examples
    --------
    >>> ranked = [["t3", "t1", "t2"], ["t5", "t2", "t9"]]
    >>> retrieval_scores(ranked, [{"t1", "t2"}, {"t5"}], ks=(1, 3))
    QueryScores
      queries           2
      without_positive  0
      without_answer    0
      tie_dependent     0
      recall@1          0.5000
      recall@3          1.0000
      ap@1              0.5000
      ap@3              0.5000
      map               0.7917
      mrr               0.7500
      ndcg@1            0.5000
      ndcg@3            0.8467
    """
    same_index({"ranked_ids": ranked_ids, "positives": positives, "scores": scores})
    same_columns({"ranked_ids": ranked_ids, "scores": scores}, may_be_renamed=True)
    ranks_in_order("ranked_ids", ranked_ids)
    names, lists, right = paired_queries(ranked_ids, positives)
    asked = Asked.checked(ks, ap, without_positive)
    gallery = None if gallery_ids is None else id_row("gallery_ids", gallery_ids)
    if scores is not None and gallery is None:
        raise ArgumentError(
            "are given without gallery_ids",
            where="scores",
            expected="all ids of the gallery: the end of a list may tie with what it leaves out",
        )
    count = len(names)
    found = indexed_lists(
        id_rows("ranked_ids", lists, count),
        id_rows("positives", right, count, unordered=True),
        gallery,
    )
    similar = None if scores is None else score_rows(scores, found.ranked)
    with refused("ranked_ids"):
        for error in list_errors(found.ranked, similar, names):
            raise error
        ranking = rank_by_ids(
            found.ranked,
            similar,
            found.positives,
            n_tiles=found.n_tiles,
            k=max(found.ranked.shape[1], 1),
            depth=asked.depth,
        )
    answered = np.asarray((found.ranked >= 0).any(axis=1))
    return rank_scores(names, ranking, found.positives, answered, found.n_tiles, asked)


def similarity_scores(
    similarity: ArrayLike,
    positives: Sequence[Any],
    ks: Iterable[int] = (1, 5, 10),
    *,
    gallery_ids: Any = None,
    ap: ApVariant = "precision",
    without_positive: WithoutPositive = "exclude",
) -> QueryScores:
    """Score a matrix of similarities, as `retrieval_scores` does with its rows sorted.

    Parameters
    ----------
    similarity : (Q, G) array-like
        Of every query to all of the gallery, larger is nearer; turn the sign of distances.
    positives : sequence of Q sets or lists
        Columns that answer each query, or their ids.
    ks : iterable of int
        Ranks, each at least 1.
    gallery_ids : (G,) array-like, optional
        Ids of the columns; their numbers from 0 where left out.
    ap, without_positive : str
        See `retrieval_scores`.

    Returns
    -------
    QueryScores
        See `retrieval_scores`.

    Raises
    ------
    ArgumentError
        See `retrieval_scores`; similarities that are NaN or infinite.

    Examples
    --------
    A method that finds all tiles alike has found nothing:

    >>> found = similarity_scores([[0.9, 0.2, 0.1], [0.5, 0.5, 0.5]], [[0], [1]], ks=(1,))
    >>> found["recall@1"], found.counts["tie_dependent"]
    (0.5, 1)
    """
    same_index({"similarity": similarity, "positives": positives})
    values = finite("similarity", floats("similarity", similarity, (None, None)))
    columns = gallery_row(gallery_ids, values.shape[1])
    _check_columns(similarity, columns, gallery_ids is None)
    order = np.argsort(-values, axis=1, kind="stable")
    return retrieval_scores(
        columns[order],
        positives,
        ks,
        scores=np.take_along_axis(values, order, axis=1),
        gallery_ids=columns,
        ap=ap,
        without_positive=without_positive,
    )


def descriptor_scores(
    queries: ArrayLike,
    gallery: ArrayLike,
    positives: Sequence[Any],
    ks: Iterable[int] = (1, 5, 10),
    *,
    metric: Metric = "l2",
    gallery_ids: Any = None,
    ranks_kept: int = 100,
    ap: ApVariant = "precision",
    without_positive: WithoutPositive = "exclude",
) -> QueryScores:
    """Score descriptors, ranked exactly in float64, with ties broken against the method.

    Parameters
    ----------
    queries : (Q, D) array-like
        A descriptor a query.
    gallery : (G, D) array-like
        A descriptor a tile.
    positives : sequence of Q sets or lists
        Rows of the gallery that answer each query, or their ids.
    ks : iterable of int
        Ranks, each at least 1.
    metric : {"l2", "cosine", "inner_product"}
    gallery_ids : (G,) array-like, optional
        Ids of the gallery's rows; their numbers from 0 where left out.
    ranks_kept : int
        How deep to rank, at least the largest k: what mAP and MRR look at, 100 in the shipped
        protocols.
    ap, without_positive : str
        See `retrieval_scores`.

    Returns
    -------
    QueryScores
        See `retrieval_scores`.

    Raises
    ------
    ArgumentError
        See `retrieval_scores`; descriptors of unequal lengths, NaN or infinite, or zero under
        cosine; `ranks_kept` below the largest k.

    Examples
    --------
    >>> found = descriptor_scores([[1.0, 0.0]], [[0.9, 0.1], [0.0, 1.0]], [{0}], ks=(1,))
    >>> found["recall@1"]
    1.0
    """
    choice("metric", metric, get_args(Metric))
    same_index({"queries": queries, "positives": positives})
    same_index({"gallery": gallery, "gallery_ids": gallery_ids})
    same_columns({"queries": queries, "gallery": gallery})
    asked = Asked.checked(ks, ap, without_positive)
    given, tiles = _descriptors("queries", queries), _descriptors("gallery", gallery)
    ids = gallery_row(gallery_ids, len(tiles))
    right = id_rows("positives", positives, len(given), unordered=True)
    found = indexed_lists([ids[:0]] * len(right), right, ids)
    order = np.argsort(ids)
    with refused("queries, gallery"):
        ranking = rank_by_descriptors(
            given,
            tiles if (np.diff(order) == 1).all() else tiles[order],
            k=min(whole("ranks_kept", ranks_kept, asked.depth), max(len(tiles), 1)),
            metric=metric,
            positives=found.positives,
            depth=asked.depth,
        )
    answered = np.ones(len(given), np.bool_)
    names = list(range(len(given)))
    return rank_scores(names, ranking, found.positives, answered, len(tiles), asked)


def _check_columns(similarity: Any, ids: Ids, are_numbers: bool) -> None:
    """Refuse a DataFrame whose columns are called otherwise than the gallery."""
    names = list(getattr(similarity, "columns", range(len(ids))))
    if names not in ([*range(len(ids))], ids.tolist()):
        raise ArgumentError(
            "has columns that are called otherwise than the gallery",
            where="similarity",
            expected="columns in the order of gallery_ids, which are 0, 1, 2 ... where left out",
            fix="gallery_ids=similarity.columns" if are_numbers else "similarity[gallery_ids]",
        )


def _descriptors(name: str, values: ArrayLike) -> NDArray[Any]:
    """Return descriptors as they are, where they are floating-point numbers: they may be large."""
    ordered = in_order(name, values)
    if hasattr(ordered, "__array__"):
        given: NDArray[Any] = np.asanyarray(ordered)
        if given.ndim == 2 and given.dtype.kind == "f":
            return given
    return floats(name, values, (None, None))

"""Retrieval from Python: scores of hits, of ranked ids and of matrices of similarities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.checks import list_errors
from airzoo_bench.retrieval.metrics import chance_scores
from airzoo_bench.retrieval.ranking import rank_by_ids
from airzoo_bench.retrieval.scoring import hit_columns
from airzoo_bench.retrieval.settings import ApVariant, RetrievalScores
from airzoo_bench.retrieval.truth import Positives, offsets_of

__all__ = ["QueryScores", "average_precision", "chance_level", "recall_at_k", "retrieval_scores"]

WithoutPositive = Literal["exclude", "miss"]


@dataclass(frozen=True, eq=False, repr=False)
class QueryScores(Shown):
    """Scores of queries, and the rows that they are averages of.

    Attributes
    ----------
    scores : dict of str to float
        By the names that results have; shares are 0 to 1, errors metres or degrees.
        ``found["recall@1"]`` is short for ``found.scores["recall@1"]``.
    records : DataFrame
        A row a query, with a column for each score.
    counts : dict of str to int
        Queries, and how many of them are special.
    """

    scores: dict[str, float]
    records: pd.DataFrame
    counts: dict[str, int]

    def __getitem__(self, name: str) -> float:
        return self.scores[name]

    def _display_fields(self) -> Mapping[str, object]:
        return self.counts | {name: number(value) for name, value in self.scores.items()}


def recall_at_k(hits: ArrayLike, k: int) -> float:
    """Return Recall@k: the share of queries with a positive among the first k.

    This is the recall of place recognition; information retrieval calls it success or hit rate.

    Parameters
    ----------
    hits : (Q, K) array-like
        Whether the tile at each rank is a positive, best rank first: booleans, or 0 and 1. Lists
        may differ in length; misses follow a short one. One list (K,) is one query.
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
    >>> recall_at_k([[1, 0, 0], [0, 0, 1]], k=1)
    0.5
    """
    return float(metrics.recall_at(_hits(hits), arg.whole("k", k)).mean())


def average_precision(
    hits: ArrayLike, n_positives: ArrayLike, k: int | None = None, *, variant: ApVariant = "trec"
) -> float:
    r"""Return the average precision, averaged over queries: mAP, or AP@k in one of four readings.

    With :math:`h_i` = 1 where rank i is a hit, :math:`P_i` the precision of the first i ranks, and
    R positives: ``trec`` is :math:`\frac{1}{R} \sum_{i \le k} h_i P_i`; ``min`` divides by min(R,
    k), ``hits`` by the number of hits; ``precision`` is :math:`P_k`, the AP@5 of the AirZoo paper.

    Parameters
    ----------
    hits : (Q, K) array-like
        See `recall_at_k`.
    n_positives : (Q,) array-like of int, or int
        R: how many positives each query has in the gallery, ranked or not.
    k : int, optional
        How many ranks count; by default all.
    variant : {"trec", "min", "hits", "precision"}

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    ArgumentError
        See `recall_at_k`; a query without a positive or with fewer than it has hits.

    References
    ----------
    Measures ``map``, ``map_cut`` and ``P`` of trec_eval; ``min`` is Kaggle's (Landmark Retrieval).

    Examples
    --------
    Hits at ranks 1 and 3, and three positives: (1/1 + 2/3) / 3.

    >>> round(average_precision([1, 0, 1, 0, 0], n_positives=3), 4)
    0.5556
    """
    arg.choice("variant", variant, get_args(ApVariant))
    arg.same_index(hits=hits, n_positives=n_positives)
    matrix = _hits(hits)
    counts = _counts("n_positives", n_positives, len(matrix), np.maximum(matrix.sum(axis=1), 1))
    depth = max(matrix.shape[1], 1) if k is None else arg.whole("k", k)
    return float(metrics.average_precision_at(matrix, counts, depth, variant).mean())


def _counts(name: str, values: Any, queries: int, least: ArrayLike) -> Ints:
    """Return a number of positives a query, each as large as it must be."""
    counts = arg.array_of(name, values)
    expected = f"{queries} whole numbers, at least 1 and at least the hits of each query"
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (queries,)):
        found = f"is {counts.dtype} of shape {counts.shape}"
        raise ArgumentError(found, where=name, expected=expected)
    counts = np.broadcast_to(counts, queries).astype(np.int64)
    wrong = np.flatnonzero(counts < least).tolist()
    if wrong:
        found = f"is too small for queries {first_of(wrong, queries)}"
        raise ArgumentError(found, where=name, expected=expected)
    return counts


def _hits(hits: Any) -> Bools:
    """Return hits as a matrix; shorter lists are filled up with misses."""
    rows = hits
    if isinstance(hits, list | tuple) and any(isinstance(row, Sequence) for row in hits):
        lists = [row if isinstance(row, Sequence) else [row] for row in hits]
        longest = max(map(len, lists))
        rows = [[*row, *[0] * (longest - len(row))] for row in lists]
    values = arg.array_of("hits", rows)
    values = values.astype(np.int64) if values.dtype == np.bool_ else values
    is_one_query = values.ndim == 1 and len(values) > 0
    matrix = arg.floats("hits", values[None] if is_one_query else values, (None, None))
    if len(matrix) == 0 or not np.isin(matrix, (0.0, 1.0)).all():
        raise ArgumentError(
            "holds other values than 0 and 1" if len(matrix) else "holds no query",
            where="hits",
            expected="for each query whether each rank is a hit: booleans, or 0 and 1",
        )
    return matrix.astype(np.bool_)


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

    All queries are of one scene; the average over scenes is the mean of the scores of each.

    Parameters
    ----------
    ranked_ids : (Q, K) array-like, sequence of sequences, mapping by query, or None
        Ids of the gallery, best first: whole numbers or texts. Lists may differ in length; -1, as
        FAISS has it, or an empty text ends a list. None ranks the gallery by `scores`.
    positives : sequence of Q sets or lists, or mapping by query
        Ids that answer each query, each once. A query of the mapping that `ranked_ids` lacks
        scores 0.
    ks : iterable of int
        Ranks, each at least 1.
    scores : (Q, K) array-like, optional
        Similarities or distances of the ranked ids; or, without `ranked_ids`, similarities (Q, G)
        to the whole gallery, larger is nearer. Ties are broken against the method: of equal scores
        the positives come last.
    gallery_ids : (G,) array-like, optional
        Every id that could be ranked, which `scores` need, since the last of a list may tie with
        others; by default, without `ranked_ids`, 0 to G - 1.
    ap : {"precision", "min", "trec", "hits"}
        The reading of AP@k, see `average_precision`; all but the first name it: ``ap@5/trec``.
    without_positive : {"exclude", "miss"}
        Queries without a positive are left out and counted, as in the shipped protocols, or
        score 0.

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
    >>> found = retrieval_scores(ranked, [{"t1", "t2"}, {"t5"}], ks=(1, 3))
    >>> found["recall@1"], found["mrr"]
    (0.5, 0.75)

    A method that finds all tiles alike has found nothing:

    >>> similar = [[0.9, 0.2, 0.1], [0.5, 0.5, 0.5]]
    >>> retrieval_scores(None, [[0], [1]], ks=(1,), scores=similar)["recall@1"]
    0.5
    """
    arg.choice("ap", ap, get_args(ApVariant))
    arg.choice("without_positive", without_positive, get_args(WithoutPositive))
    depths = _depths(ks)
    arg.same_index(ranked_ids=ranked_ids, positives=positives, scores=scores)
    if ranked_ids is None:
        ranked_ids, scores, gallery_ids = _sorted_gallery(scores, gallery_ids)
    names, ranked, right = _paired(ranked_ids, positives)
    gallery = None if gallery_ids is None else _ids("gallery_ids", gallery_ids)
    if scores is not None and gallery is None:
        expected = "all ids of the gallery, with which the end of a list may tie"
        raise ArgumentError("are given alone", where="scores", expected=f"gallery_ids: {expected}")
    tiles, positive_tiles, n_tiles = _numbered_lists(ranked, right, gallery)
    similar = None if scores is None else _score_rows(scores, tiles)
    with arg.refused("ranked_ids"):
        for error in list_errors(tiles, similar, names):
            raise error
        ranking = rank_by_ids(
            tiles,
            similar,
            positive_tiles,
            n_tiles=n_tiles,
            k=max(tiles.shape[1], 1),
            depth=max(depths),
        )
    counts = positive_tiles.counts
    hits = metrics.hit_matrix(ranking.tiles, positive_tiles.offsets, positive_tiles.tiles, n_tiles)
    columns = hit_columns(hits, counts, depths, dict.fromkeys(depths, (ap,)), depths)
    records = pd.DataFrame(
        {
            "query": names,
            "answered": (tiles >= 0).any(axis=1),
            "positives": counts,
            "tie_dependent": ranking.tie_dependent,
            "first_hit_rank": metrics.first_hit_rank(hits),
            **columns,
        }
    )
    if not counts.any():
        expected = "at least one query that can be answered"
        raise ArgumentError("hold nothing for any query", where="positives", expected=expected)
    if without_positive == "exclude":
        records = records[counts > 0].reset_index(drop=True)
    special = {
        "queries": len(records),
        "without_positive": int((counts == 0).sum()),
        "without_answer": int((~records["answered"]).sum()),
        "tie_dependent": int(records["tie_dependent"].sum()),
    }
    return QueryScores({name: float(records[name].mean()) for name in columns}, records, special)


def chance_level(
    n_positives: ArrayLike, n_tiles: int, ks: Iterable[int] = (1, 5, 10)
) -> QueryScores:
    """Return the expected scores of a gallery in random order, exactly.

    Parameters
    ----------
    n_positives : (Q,) array-like of int
        How many tiles of the gallery answer each query.
    n_tiles : int
        The size of the gallery.
    ks : iterable of int
        Ranks, each at least 1.

    Returns
    -------
    QueryScores
        As of `retrieval_scores` with whole galleries ranked: ``recall@k``, ``ap@k`` (the
        precision of the first k), ``ndcg@k``, ``map`` and ``mrr``.

    Raises
    ------
    ArgumentError
        No query, one with no positive or more than tiles; k below 1.

    Examples
    --------
    >>> found = chance_level([1, 2], n_tiles=4, ks=(1, 2))
    >>> found["recall@1"], round(found["recall@2"], 4)
    (0.375, 0.6667)
    """
    size = arg.whole("n_tiles", n_tiles)
    positives = _counts(
        "n_positives", n_positives, np.size(arg.array_of("n_positives", n_positives)), 1
    )
    if not 0 < positives.max(initial=0) <= size:
        expected = f"numbers from 1 to {size}, one a query"
        raise ArgumentError("no query, or more than tiles", where="n_positives", expected=expected)
    columns: dict[str, Floats] = {}
    for k in _depths(ks):
        settings = RetrievalScores.model_construct(
            ranks_kept=size, recall_at=(k,), ap_at=k, ndcg_at=(k,)
        )
        found = chance_scores(positives, size, settings)
        columns |= {name: values for name, values in found.items() if "/" not in name}
    records = pd.DataFrame({"positives": positives, **columns})
    averages = {name: float(values.mean()) for name, values in columns.items()}
    return QueryScores(averages, records, {"queries": len(records)})


def _depths(ks: Any) -> tuple[int, ...]:
    depths = tuple(dict.fromkeys(arg.whole("ks", k) for k in arg.listed("ks", ks)))
    if not depths:
        raise ArgumentError("is empty", where="ks", expected="ranks such as (1, 5, 10)")
    return depths


def _sorted_gallery(scores: Any, gallery_ids: Any) -> tuple[Any, Floats, Any]:
    """Rank the whole gallery by similarity: lists of ids, sorted similarities, and all ids."""
    similar = arg.finite("scores", arg.floats("scores", scores, (None, None)))
    labels = [*getattr(scores, "columns", range(similar.shape[1]))]
    gallery = (
        [*range(similar.shape[1])] if gallery_ids is None else _ids("gallery_ids", gallery_ids)
    )
    if len(gallery) != similar.shape[1] or labels not in ([*range(len(gallery))], gallery):
        raise ArgumentError(
            f"have {len(labels)} columns for {len(gallery)} tiles, or columns of other names",
            where="scores",
            expected="a column for each of gallery_ids, by default 0, 1, 2 ...",
        )
    order = np.argsort(-similar, axis=1, kind="stable")
    ids = np.array(gallery, dtype=object)
    return ids[order].tolist(), np.take_along_axis(similar, order, axis=1), gallery


def _paired(ranked: Any, positives: Any) -> tuple[list[Any], list[list[Any]], list[list[Any]]]:
    """Return the names of queries, their ranked ids and their positives."""
    if isinstance(ranked, Mapping) != isinstance(positives, Mapping):
        raise ArgumentError(
            "one is a mapping by query and the other is not",
            where="ranked_ids, positives",
            expected="both by query id, or both in one order of the queries",
        )
    if isinstance(positives, Mapping):
        strange = [query for query in ranked if query not in positives]
        if strange:
            what = f"queries that positives lacks: {first_of(strange, len(ranked))}"
            raise ArgumentError(what, where="ranked_ids", expected="queries of positives")
        names, right = list(positives), list(positives.values())
        lists = [ranked.get(name, ()) for name in names]
    else:
        right, lists = arg.listed("positives", positives), arg.listed("ranked_ids", ranked)
        names = list(range(len(right)))
    if len(lists) != len(right):
        expected = f"{len(right)}, a row a query"
        raise ArgumentError(f"has {len(lists)} rows", where="ranked_ids", expected=expected)
    sets = [_ids(f"positives[{row}]", ids, is_set=True) for row, ids in enumerate(right)]
    return names, [_ids(f"ranked_ids[{row}]", ids) for row, ids in enumerate(lists)], sets


def _ids(name: str, values: Any, *, is_set: bool = False) -> list[Any]:
    """Return ids as Python's whole numbers or texts; only positives may be a set."""
    if isinstance(values, set | frozenset) and not is_set:
        raise ArgumentError("is a set, which has no order", where=name, expected="a list of ids")
    given = arg.listed(name, values)
    ids = [one.item() if isinstance(one, np.generic) else one for one in given]
    is_text = all(isinstance(one, str) for one in ids)
    if not is_text and any(not isinstance(one, Integral) or isinstance(one, bool) for one in ids):
        kinds = ", ".join(sorted({type(one).__name__ for one in ids}))
        expected = "ids in a row that are all whole numbers, or all texts"
        raise ArgumentError(f"holds {kinds}", where=name, expected=expected)
    if is_set and len(set(ids)) < len(ids):
        raise ArgumentError(
            "holds an id twice",
            where=name,
            expected="the ids that answer the query, each once",
            fix="np.flatnonzero(row), where the row says of every tile whether it is a positive",
        )
    return ids


def _numbered_lists(
    ranked: list[list[Any]], positives: list[list[Any]], gallery: list[Any] | None
) -> tuple[Ints, Positives, int]:
    """Return lists (Q, K) of tiles in the order of ids, -1 beyond their ends, and positives."""
    ends = {"", -1}
    used = {one for row in (*ranked, *positives) for one in row}
    if gallery is not None and (len(set(gallery)) < len(gallery) or ends & {*gallery}):
        what = "holds an id twice, or an empty one"
        raise ArgumentError(what, where="gallery_ids", expected="each id once")
    if len({isinstance(one, str) for one in used.union(gallery or ())}) > 1:
        raise ArgumentError(
            "are texts and whole numbers, which never match",
            where="ids",
            expected="the same kind of id everywhere",
            fix="turn one into the other: str(id), or int(id)",
        )
    strange = set() if gallery is None else used - {*gallery} - ends
    if strange:
        what = f"ids that gallery_ids lacks: {first_of(sorted(strange))}"
        raise ArgumentError(what, where="ranked_ids, positives", expected="ids of gallery_ids")
    if any(ends & {*row} for row in positives):
        raise ArgumentError("holds -1 or an empty id", where="positives", expected="ids of tiles")
    place = {
        one: row for row, one in enumerate(sorted((used if gallery is None else {*gallery}) - ends))
    }
    tiles = np.full((len(ranked), max(map(len, ranked), default=0)), -1, np.int64)
    for line, ids in zip(tiles, ranked, strict=True):
        line[: len(ids)] = [place.get(one, -1) for one in ids]
    right = [sorted(place[one] for one in ids) for ids in positives]
    offsets = offsets_of(np.array([len(row) for row in right], np.int64))
    flat = np.array([one for row in right for one in row], np.int32)
    return tiles, Positives(offsets, flat), len(place)


def _score_rows(scores: Any, tiles: Ints) -> Floats:
    """Return scores in the shape of the lists; beyond the end of a list they do not count."""
    rows = [
        arg.floats(f"scores[{n}]", row, (None,))
        for n, row in enumerate(arg.listed("scores", scores))
    ]
    least = (tiles >= 0).sum(axis=1).tolist()
    if len(rows) != len(tiles) or any(
        not low <= len(row) <= tiles.shape[1] for low, row in zip(least, rows, strict=True)
    ):
        expected = f"{len(tiles)} rows, a number for each ranked id"
        raise ArgumentError(f"has {len(rows)} rows", where="scores", expected=expected)
    filled = np.full(tiles.shape, np.nan)
    for line, values in zip(filled, rows, strict=True):
        line[: len(values)] = values
    return filled

"""Retrieval from Python: scores of hits, of ranked ids and of matrices of similarities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from itertools import chain
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.arguments import Scores
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.predictions import check_lists
from airzoo_bench.retrieval.ranking import Depths, rank_by_ids
from airzoo_bench.retrieval.settings import ApVariant
from airzoo_bench.retrieval.track import hit_columns
from airzoo_bench.retrieval.truth import Positives, offsets_of


def recall_at_k(hits: ArrayLike, k: int) -> float:
    """Return Recall@k: the share of queries with a positive among the first k.

    Raises an `ArgumentError` for no query, values other than 0 and 1, k below 1. Source:
    Arandjelovic et al., NetVLAD, CVPR 2016; measure ``success`` of trec_eval.

    Parameters
    ----------
    hits : (Q, K) array-like
        Whether each rank holds a positive, best first; lists may be of different lengths.
    k : int
        At least 1.
    """
    return float(metrics.recall_at(_read_hits(hits), arg.whole("k", k)).mean())


def average_precision(
    hits: ArrayLike, n_positives: ArrayLike, k: int | None = None, *, variant: ApVariant = "trec"
) -> float:
    r"""Return the average precision, averaged over queries: mAP, or AP@k in one of four readings.

    With :math:`h_i` = 1 where rank i is a hit, :math:`P_i` the precision of the first i ranks, and
    R positives: ``trec`` is :math:`\frac{1}{R} \sum_{i \le k} h_i P_i`; ``min`` divides by min(R,
    k), ``hits`` by the number of hits; ``precision`` is :math:`P_k`, the AP@5 of the AirZoo paper.

    Raises an `ArgumentError` as `recall_at_k`, and for a query with fewer positives than hits.
    Source: ``map``, ``map_cut`` and ``P`` of trec_eval; ``min`` is Kaggle's (Landmark Retrieval).

    Parameters
    ----------
    hits : (Q, K) array-like
        As in `recall_at_k`.
    n_positives : (Q,) array-like of int, or int
        R: how many positives each query has in the gallery, ranked or not.
    k : int, optional
        How many ranks count; by default all.
    variant : {"trec", "min", "hits", "precision"}
        The reading.
    """
    arg.choice("variant", variant, get_args(ApVariant))
    matrix = _read_hits(hits)
    counts = _read_counts(n_positives, len(matrix), np.maximum(matrix.sum(axis=1), 1))
    depth = max(matrix.shape[1], 1) if k is None else arg.whole("k", k)
    return float(metrics.average_precision_at(matrix, counts, depth, variant).mean())


def _read_hits(hits: Any) -> Bools:
    """Return hits as a matrix; shorter lists are filled up with misses."""
    if isinstance(hits, list | tuple) and hits and all(isinstance(one, Sequence) for one in hits):
        longest = max(map(len, hits))
        hits = [[*row, *[0] * (longest - len(row))] for row in hits]
    matrix = arg.numbers("hits", hits, (None, None))
    if len(matrix) == 0 or not np.isin(matrix, (0, 1)).all():
        expected = "for each query whether each rank is a hit: booleans, or 0 and 1"
        raise arg.fault("hits", "holds no query, or other values than 0 and 1", expected)
    return matrix.astype(np.bool_)


def _read_counts(values: Any, queries: int, least: ArrayLike) -> Ints:
    """Return a number of positives a query, each as large as it must be."""
    counts = arg.as_array("n_positives", values)
    expected = f"{queries} whole numbers, at least 1 and at least the hits of each query"
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (queries,)):
        raise arg.fault("n_positives", f"is {counts.dtype} of shape {counts.shape}", expected)
    counts = np.broadcast_to(counts, queries).astype(np.int64)
    arg.refuse_rows("n_positives", counts < least, "too small a number", expected)
    return counts


def retrieval_scores(
    ranked_ids: Any,
    positives: Any,
    ks: Iterable[int] = (1, 5, 10),
    *,
    scores: ArrayLike | None = None,
    ap: ApVariant = "precision",
) -> Scores:
    """Score ranked galleries of one scene: recall, AP and nDCG at each k, mAP and MRR.

    Returns ``recall@k``, ``ap@k``, ``ndcg@k``, ``map`` (over the whole lists) and ``mrr``; how many
    ``queries``, ``without_positive`` (left out), ``without_answer`` (an empty list, which scores 0)
    and ``tie_dependent``; and ``records``, a row a query. Raises an `ArgumentError` for lists that
    do not fit, ids of two kinds, an id ranked twice, no query with a positive.

    Source: `recall_at_k`, `average_precision`; Järvelin and Kekäläinen, ACM TOIS 20(4), 2002
    (nDCG); Voorhees, TREC-8, 1999 (MRR).

    Parameters
    ----------
    ranked_ids : (Q, K) array-like or Q lists, or None
        Ids of the gallery, whole numbers or texts, best first; -1 or an empty text ends a list.
    positives : Q sets or lists
        Ids that answer each query, each once.
    ks : iterable of int
        Ranks, each at least 1.
    scores : (Q, G) array-like, optional
        Instead of `ranked_ids`: similarities to the whole gallery of ids 0 to G - 1, larger is
        nearer. Of equal scores the positives come last.
    ap : {"precision", "min", "trec", "hits"}
        The reading of AP@k; all but the first name it: ``ap@5/trec``.
    """
    arg.choice("ap", ap, get_args(ApVariant))
    depths, similar = _read_ranks(ks), None
    right = [[*ids] if isinstance(ids, Set) else ids for ids in arg.listed("positives", positives)]
    right = _list_ids("positives", right)
    if (ranked_ids is None) == (scores is None):
        raise arg.fault("ranked_ids, scores", "do not go together", "one of them, and None")
    if scores is None:
        arg.check_pairs(ranked_ids=ranked_ids, positives=positives)
        lists = _list_ids("ranked_ids", ranked_ids)
        gallery = dict.fromkeys(one for one in chain(*lists, *right) if one not in ("", -1))
        place = {one: row for row, one in enumerate(gallery)}
        tiles = np.full((len(lists), max(map(len, lists), default=0)), -1, np.int64)
        for line, ids in zip(tiles, lists, strict=True):
            line[: len(ids)] = [place.get(one, -1) for one in ids]
    else:
        arg.check_pairs(scores=scores, positives=positives)
        similar = arg.floats("scores", scores, (None, None), finite=True)
        place = {row: row for row in range(similar.shape[1])}
        tiles = np.argsort(-similar, axis=1, kind="stable")
        similar = np.take_along_axis(similar, tiles, axis=1)
    if len({isinstance(one, str) for one in place}) > 1:
        raise arg.fault("ids", "are texts beside whole numbers", "one kind of id")
    queries, size = range(len(right)), len(place)
    with arg.refused("ranked_ids"):
        check_lists(tiles, similar, queries)
    answers = _number_positives(right, place)
    kept = Depths(size, max(tiles.shape[1], 1), max(depths))
    ranking = rank_by_ids(tiles, similar, answers, kept)
    hits = metrics.hit_matrix(ranking.tiles, answers.offsets, answers.tiles, size)
    columns = hit_columns(hits, answers.counts, depths, dict.fromkeys(depths, (ap,)), depths)
    first = {
        "query": queries,
        "answered": (tiles >= 0).any(axis=1),
        "positives": answers.counts,
        "tie_dependent": ranking.tie_dependent,
        "first_hit_rank": metrics.first_hit_rank(hits),
    }
    records = pd.DataFrame(first | columns)[answers.counts > 0].reset_index(drop=True)
    if records.empty:
        raise arg.fault("positives", "hold nothing for any query", "some query with an answer")
    counts = {
        "queries": len(records),
        "without_positive": len(queries) - len(records),
        "without_answer": int((~records["answered"]).sum()),
        "tie_dependent": int(records["tie_dependent"].sum()),
    }
    means = {name: float(records[name].mean()) for name in columns}
    return Scores(counts | means, records=records)


def chance_level(n_positives: ArrayLike, n_tiles: int, ks: Iterable[int] = (1, 5, 10)) -> Scores:
    """Return the expected scores of a gallery in random order, exactly.

    They are those of `retrieval_scores` for whole galleries, with the precision as ``ap@k``. Raises
    an `ArgumentError` for no query, one with no positive or more than tiles, k below 1.

    Parameters
    ----------
    n_positives, n_tiles : (Q,) array-like of int, int
        How many tiles of the gallery answer each query, and how many it has.
    ks : iterable of int
        Ranks, each at least 1.
    """
    size = arg.whole("n_tiles", n_tiles)
    positives = _read_counts(n_positives, np.size(n_positives), 1)
    if not 0 < positives.max(initial=0) <= size:
        raise arg.fault("n_positives", "no query, or more than tiles", f"numbers up to {size}")
    columns: dict[str, Floats] = {}
    for k in _read_ranks(ks):
        depths = {"recall_at": (k,), "ap_at": k, "ndcg_at": (k,)}
        rules = arg.shipped("retrieval", "scores", ranks_kept=size, **depths)
        columns |= metrics.chance_scores(positives, size, rules)
    columns = {key: values for key, values in columns.items() if "/" not in key}
    averages = {key: float(values.mean()) for key, values in columns.items()}
    return Scores(averages, records=pd.DataFrame({"positives": positives, **columns}))


def _read_ranks(ks: Any) -> tuple[int, ...]:
    depths = tuple(dict.fromkeys(arg.whole("ks", k) for k in arg.listed("ks", ks)))
    if not depths:
        raise arg.fault("ks", "is empty", "ranks such as (1, 5, 10)")
    return depths


def _list_ids(name: str, values: Any) -> list[list[Any]]:
    return [arg.listed(f"{name}[{n}]", ids) for n, ids in enumerate(arg.listed(name, values))]


def _number_positives(right: Sequence[Sequence[Any]], place: dict[Any, int]) -> Positives:
    """Return the positives of each query as rows of the gallery."""
    for query, ids in enumerate(right):
        if len({*ids} & place.keys()) < len(ids):
            what, expected = "an id twice, or one that no tile has", "ids of the gallery, each once"
            raise arg.fault(f"positives[{query}]", what, expected)
    rows = [sorted(place[one] for one in ids) for ids in right]
    offsets = offsets_of(np.array([*map(len, rows)], np.int64))
    return Positives(offsets, np.array([*chain(*rows)], np.int32))

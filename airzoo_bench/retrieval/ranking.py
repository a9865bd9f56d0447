"""Ranked galleries, with ties broken against the submitter.

Tiles with equal scores are ordered non-positive first, then by their index in the gallery table
(which is sorted by id), so that a scorer gains nothing by giving equal scores. A query whose whole
gallery ties, as it does with a descriptor of zeros, has no ranking: none of its tiles has a rank,
unless all are positive.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.engines.engine import HERE, Engine, split
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.candidates import most_kept
from airzoo_bench.retrieval.descriptor_rows import Rows, rows_of
from airzoo_bench.retrieval.descriptor_search import Candidates, Request, nearest
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.similarity import Metric, Names, Queries, point_one_way
from airzoo_bench.retrieval.ties import Ranking, break_ties, cut_at, without_constant

__all__ = ["Ranking", "rank_by_descriptors", "rank_by_ids"]

_LEAST_QUERIES = 64  # at a time, whatever the memory
_SENT_QUERIES = 256  # at a time to another process
_BYTES_OF_A_CANDIDATE = 64  # query, tile and value, and what sorting them takes


def rank_by_ids(
    ranked: NDArray[np.integer[Any]],
    scores: NDArray[np.floating[Any]] | None,
    positives: Positives,
    *,
    n_tiles: int,
    k: int,
    depth: int,
    names: Names | None = None,
) -> Ranking:
    """Take a ranking as given, and reorder runs of equal scores against the submitter."""
    if ranked.ndim != 2 or len(ranked) != positives.n_queries:
        raise ValueError(f"ranked is {ranked.shape} for {positives.n_queries} queries")
    tiles = ranked.astype(np.int64)
    _check_tiles(tiles, names)
    if scores is None or tiles.size == 0:
        return Ranking(cut_at(tiles, k), np.zeros(len(tiles), bool))
    if scores.shape != tiles.shape:
        raise ValueError(f"scores are {scores.shape} and ranked is {tiles.shape}")
    _check_scores(scores, tiles >= 0, names)
    return break_ties(tiles, scores, positives, n_tiles, k, depth)


def rank_by_descriptors(
    queries: NDArray[np.floating[Any]],
    gallery: NDArray[np.floating[Any]] | Rows,
    *,
    k: int,
    metric: Metric,
    positives: Positives,
    depth: int,
    memory_bytes: int = 1 << 30,
    jobs: int | None = None,
    names: Names | None = None,
    tile_names: Names | None = None,
    engine: Engine = HERE,
) -> Ranking:
    """Rank the gallery by descriptors, exactly as float64 has it."""
    _check_request(queries, gallery, k, metric, positives, depth, jobs)
    with np.errstate(invalid="ignore"):  # what is not finite is refused below
        blank = np.flatnonzero(~queries.any(axis=1))
    if len(blank):  # ranked as any other descriptor, and then taken to tie with every tile
        queries = queries.copy()
        queries[blank] = 1
    prepared = Queries.of(queries, metric, names)
    sought = min(max(k, depth), max(len(gallery), 1))
    threads = jobs or os.cpu_count() or 1
    whole = Request(
        prepared, positives, rows_of(gallery), sought, memory_bytes, threads, tile_names
    )
    if point_one_way(whole.gallery, metric, max(1, whole.block // 8)):
        none = np.zeros(0, np.int64)
        constant = Candidates(none, none, none, np.zeros(0), np.arange(len(queries)))
        return _ordered(constant, positives, len(gallery), k, depth)
    step = max(_LEAST_QUERIES, memory_bytes // 2 // _bytes_of_a_query(prepared, sought))
    step = min(step, _SENT_QUERIES) if engine.distributed else step
    parts = [
        (prepared.part(one), positives.take(np.arange(one.start, one.stop)))
        for one in split(len(queries), step) or [slice(0, 0)]
    ]
    empty = prepared.part(slice(0)), positives.take(np.arange(0))
    common = replace(whole, queries=empty[0], positives=empty[1]), k, depth
    rankings = list(
        engine.map(
            _rank_part, parts, shared=common, stage="queries ranked", name=lambda _: "some queries"
        )
    )
    ranking = Ranking(
        np.concatenate([one.tiles for one in rankings]),
        np.concatenate([one.tie_dependent for one in rankings]),
    )
    if not len(blank):
        return ranking
    ranking.tiles[blank[positives.counts[blank] == len(gallery)]] = -1  # to be in the tiles' order
    return without_constant(ranking, blank, positives, len(gallery))


def _rank_part(common: tuple[Request, int, int], item: tuple[Queries, Positives]) -> Ranking:
    request, k, depth = common
    queries, positives = item
    found = nearest(replace(request, queries=queries, positives=positives))
    return _ordered(found, positives, len(request.gallery), k, depth)


def _bytes_of_a_query(queries: Queries, k: int) -> int:
    """Return what the descriptors and the candidates of a query take."""
    numbers: int = 2 * queries.rows.shape[1] * (queries.rows.itemsize + queries.single.itemsize)
    return numbers + _BYTES_OF_A_CANDIDATE * most_kept(k)


def _ordered(found: Candidates, positives: Positives, n_tiles: int, k: int, depth: int) -> Ranking:
    """Order the candidates of each query by the tie rule and cut them at k."""
    positive = positives.holds(found.query, found.tile, n_tiles)
    order = np.lexsort((found.tile, positive, -found.score, found.cluster, found.query))
    query, positive = found.query[order], positive[order]
    cluster, score = found.cluster[order], found.score[order]
    counts = np.bincount(query, minlength=positives.n_queries)
    rank = np.arange(len(order)) - offsets_of(counts)[query]
    tied = (np.diff(query) == 0) & (np.diff(cluster) == 0) & (score[1:] == score[:-1])
    begins = rank - _steps_into_run(tied, len(order))
    mixed = tied & ~positive[:-1] & positive[1:] & (begins[1:] < depth)
    tie_dependent = np.zeros(positives.n_queries, bool)
    tie_dependent[query[1:][mixed]] = True
    tiles = np.full((positives.n_queries, k), -1, np.int32)
    first = rank < k
    tiles[query[first], rank[first]] = found.tile[order[first]]
    return without_constant(Ranking(tiles, tie_dependent), found.flat, positives, n_tiles)


def _steps_into_run(tied: Bools, n: int) -> Ints:
    """How many elements of its run come before each of n; `tied` to the one before, from 1 on."""
    place = np.arange(n)
    opens = np.ones(n, bool)
    opens[1:] = ~tied
    return place - np.maximum.accumulate(np.where(opens, place, 0))


def _check_request(
    queries: NDArray[Any],
    gallery: NDArray[Any] | Rows,
    k: int,
    metric: str,
    positives: Positives,
    depth: int,
    jobs: int | None,
) -> None:
    if metric not in ("l2", "cosine", "inner_product"):
        raise ValueError(f"no such metric: {metric}")
    if k < 1 or depth < 0 or (jobs is not None and jobs < 1):
        raise ValueError(f"k {k}, depth {depth} and jobs {jobs} do not fit")
    for which, array in (("query_descriptors", queries), ("gallery_descriptors", gallery)):
        if array.ndim != 2 or array.dtype.kind != "f" or array.dtype.itemsize > 8:
            raise PredictionError(
                f"descriptors have type {array.dtype} and shape {array.shape}",
                where=which,
                expected="a row of float16, float32 or float64 for each name",
            )
    if queries.shape[1] != gallery.shape[1]:
        raise PredictionError(
            f"descriptors of queries have {queries.shape[1]} numbers, "
            f"those of the gallery {gallery.shape[1]}",
            where="query_descriptors, gallery_descriptors",
            expected="the same length",
        )
    if len(queries) != positives.n_queries or positives.tiles.max(initial=-1) >= len(gallery):
        raise ValueError("the positives are of other queries or another gallery")


def _check_tiles(tiles: Ints, names: Names | None) -> None:
    resumed = ((tiles[:, 1:] >= 0) & (tiles[:, :-1] < 0)).any(axis=1) | (tiles < -1).any(axis=1)
    _refuse_rows(resumed, "rankings that go on after their end", "tiles, then -1", names)
    ascending = np.sort(tiles, axis=1)
    repeated = ((ascending[:, 1:] == ascending[:, :-1]) & (ascending[:, 1:] >= 0)).any(axis=1)
    _refuse_rows(repeated, "rankings that name a tile twice", "each tile once", names)


def _check_scores(scores: NDArray[np.floating[Any]], valid: Bools, names: Names | None) -> None:
    _refuse_rows((np.isnan(scores) & valid).any(axis=1), "NaN scores", "numbers", names)
    rises = ((scores[:, 1:] > scores[:, :-1]) & valid[:, 1:]).any(axis=1)
    falls = ((scores[:, 1:] < scores[:, :-1]) & valid[:, 1:]).any(axis=1)
    if rises.any() and falls.any():
        # The direction of most rows is meant; the others are named.
        wrong = rises if rises.sum() <= falls.sum() else falls
        expected = "similarities that never rise, or distances that never fall, in all rows alike"
        _refuse_rows(wrong, "scores out of order", expected, names)


def _refuse_rows(wrong: Any, what: str, expected: str, names: Names | None) -> None:
    rows = np.flatnonzero(wrong)
    if len(rows):
        named = [f"row {row}" if names is None else names[row] for row in rows.tolist()]
        raise PredictionError(
            f"{what}: {first_of(named, len(wrong))}",
            where="ranked_ids, scores",
            expected=expected,
            fix="sort each query's tiles by its scores, best first, and write the file again",
        )

"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

The gallery is read once for the search, which keeps of each query every tile that its error
bound cannot exclude from the first k. Of these, tiles closer to each other than twice the bound
form a cluster, and only clusters of several tiles are evaluated in float64. Queries with so many
candidates that keeping them would not be bounded (a scorer that gives every tile the same) are
evaluated block by block instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.candidate_search import Search, rounded_down
from airzoo_bench.retrieval.descriptor_rows import RowSource, as_float32
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.similarity import (
    Names,
    Queries,
    check_norms,
    norms_of,
    points_one_way,
    roundoff,
    similarity,
    usable,
)

__all__ = ["Candidates", "nearest"]


_BLOCK_BYTES = 1 << 26
_BLOCK_ROWS = 4096
_PAIRS = 16  # pairs at a time in float64, at least
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache


@dataclass
class Candidates:
    """Pairs of query and tile that may be among the first k, in no order.

    Parameters
    ----------
    query, tile : (n,) arrays
        The pair.
    cluster : (n,) array
        Of one query, tiles of a smaller cluster come first whatever their score.
    score : (n,) array
        Similarity in float64, comparable within a cluster; one value for what ties.
    flat : (m,) array
        Queries for which all tiles of the gallery tie.
    """

    query: Ints
    tile: Ints
    cluster: Ints
    score: Floats
    flat: Ints


@dataclass(frozen=True)
class _Gallery:
    """The gallery's rows, and how to go through them."""

    rows: RowSource
    queries: Queries
    block: int
    jobs: int

    def blocks(self) -> Iterator[tuple[int, NDArray[Any], NDArray[np.float32], Floats]]:
        """Give (first row, rows, rows in float32, norms), in order."""
        for start, rows in self.rows.blocks(self.block):
            single = as_float32(rows)
            yield start, rows, single, norms_of(rows, single)

    def finite(self, rows: Ints) -> Bools:
        """Whether all numbers of each row are finite."""
        return np.array([np.isfinite(self.rows.read(row, row + 1)).all() for row in rows], bool)

    def scores(self, query: Ints, tile: Ints) -> tuple[Floats, Floats]:
        """Similarities in float64 of pairs and their errors, reading only the rows they need."""
        scores, slacks = np.empty(len(query)), np.empty(len(query))
        order = np.argsort(tile, kind="stable")
        piece = max(_PAIRS, _PIECE_NUMBERS // max(self.rows.array.shape[1], 1))
        chunk = tile[order] // (4 * piece)
        firsts = np.flatnonzero(np.diff(chunk, prepend=-1))
        groups = [group for group in np.split(order, firsts[1:]) if len(group)]

        def evaluate(group: Ints) -> None:
            start = int(tile[group[0]])
            rows = self.rows.read(start, int(tile[group[-1]]) + 1)
            for first in range(0, len(group), piece):
                some = group[first : first + piece]
                asked = self.queries.rows[query[some]].astype(np.float64)
                given = rows[tile[some] - start].astype(np.float64)
                scores[some] = similarity(asked, given, self.queries.metric)
                slacks[some] = roundoff(asked, given, scores[some], self.queries.metric)

        with ThreadPoolExecutor(self.jobs) as pool:
            list(pool.map(evaluate, groups))
        return scores, slacks


def nearest(
    queries: Queries,
    gallery: NDArray[Any],
    k: int,
    positives: Positives,
    *,
    memory_bytes: int,
    jobs: int,
    names: Names | None = None,
) -> Candidates:
    """Find the pairs that hold the k most similar tiles of each query, and all that tie with them.

    Where a tie crosses rank k, its positives are there, and of its other tiles those of least
    index as far as k reaches.

    Raises
    ------
    PredictionError
        Where the gallery's descriptors cannot be ranked.
    """
    row_bytes = max(1, gallery.shape[1] * max(gallery.itemsize, 4))
    block = int(np.clip(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, 1, _BLOCK_ROWS))
    part = max(1, memory_bytes // 16 // (4 * block))
    batch = max(1, memory_bytes // 8 // (16 * max(1, len(gallery))))
    stored = _Gallery(RowSource.of(gallery), queries, block, jobs)
    if points_one_way(stored.rows, queries.metric, max(1, block // 8)):
        none = np.zeros(0, np.int64)
        return Candidates(none, none, none, np.zeros(0), np.arange(len(queries.norms)))
    caution = 1.0
    while True:
        searches, bounds = _search(stored, k, part, caution, names)
        found = [_evaluated(stored, search, bounds[search.part]) for search in searches]
        worst = max((error for _, error in found), default=0.0)
        if worst <= 1:
            break
        caution *= 4 * worst  # never seen; the bound holds with all but certainty
    crowds = [search for search in searches if search.crowded.any()]
    parts = [candidates for candidates, _ in found] + _exhausted(
        stored, crowds, bounds, positives, batch
    )
    joined = (
        np.concatenate([np.zeros(0, dtype), *(getattr(one, name) for one in parts)])
        for name, dtype in (
            ("query", np.int64),
            ("tile", np.int64),
            ("cluster", np.int64),
            ("score", np.float64),
            ("flat", np.int64),
        )
    )
    return Candidates(*joined)


def _search(
    gallery: _Gallery, k: int, part: int, caution: float, names: Names | None
) -> tuple[list[Search], Floats]:
    """Search in float32; also give every query's bound, for the greatest norm of the gallery."""
    n = len(gallery.queries.norms)
    parts = [slice(start, min(start + part, n)) for start in range(0, n, part)]
    searches = [Search.of(part, k) for part in parts]
    norms = np.empty(len(gallery.rows))
    bounds = np.zeros(n)
    metric, wild = gallery.queries.metric, False
    for start, _, single, here in gallery.blocks():
        norms[start : start + len(here)] = here
        so_far = norms[: start + len(here)]
        wild = wild or not usable(here, metric)
        if wild:
            continue  # read on, to count them all
        bounds = caution * gallery.queries.bounds(so_far.min(), so_far.max())
        for search in searches:
            values = gallery.queries.similarities(search.part, single, here)
            search.absorb(values, start, bounds[search.part])
    if wild:
        check_norms(norms, gallery.finite, "gallery_descriptors", metric, names)
    return searches, bounds


def _evaluated(gallery: _Gallery, search: Search, bounds: Floats) -> tuple[Candidates, float]:
    """Form clusters of candidates that the search cannot tell apart, and evaluate these.

    Also gives the greatest error seen, as a share of its bound. The best candidate of each query
    is always evaluated, so that there is something to see.
    """
    order = np.lexsort((-search.value, search.query))
    query, tile = search.query[order], search.tile[order]
    value, bound = search.value[order].astype(np.float64), bounds[query]
    best = np.diff(query, prepend=-1) != 0
    opens = best | (-np.diff(value, prepend=0) > 2 * bound)
    cluster = np.cumsum(opens)
    several = np.bincount(cluster, minlength=1)[cluster] > 1
    doubtful = np.flatnonzero(best | several)
    query = query + search.part.start
    score, slack = np.zeros(len(query)), np.zeros(len(query))
    score[doubtful], slack[doubtful] = gallery.scores(query[doubtful], tile[doubtful])
    exact = gallery.queries.searched(query[doubtful], score[doubtful])
    error = np.abs(value[doubtful] - exact) / bound[doubtful]
    score = _with_ties(query, cluster, score, slack)
    flat = _all_tied(query, cluster, score, len(gallery.rows))
    return Candidates(query, tile, cluster, score, flat), float(error.max(initial=0))


def _all_tied(query: Ints, cluster: Ints, score: Floats, n_tiles: int) -> Ints:
    """Find the queries all of whose tiles are in one tie; pairs are in the order of clusters."""
    changes = (np.diff(query) == 0) & ((np.diff(cluster) != 0) | (np.diff(score) != 0))
    several = np.zeros(int(query.max(initial=-1)) + 1, bool)
    several[query[1:][changes]] = True
    flat: Ints = np.flatnonzero((np.bincount(query) == n_tiles) & ~several)
    return flat


def _exhausted(
    gallery: _Gallery, crowds: list[Search], bounds: Floats, positives: Positives, batch: int
) -> list[Candidates]:
    """Evaluate in float64 every tile that the search could not exclude, some queries at a time.

    Gives the first k tiles of each query and, of what ties with them, all positives.
    """
    columns = [np.flatnonzero(search.crowded) for search in crowds]
    numbers = [some + search.part.start for some, search in zip(columns, crowds, strict=True)]
    queries = np.concatenate([np.zeros(0, np.int64), *numbers])
    kth = [search.kth[some] for some, search in zip(columns, crowds, strict=True)]
    floors = np.concatenate([np.zeros(0), *kth]) - 2 * bounds[queries]
    found = []
    for first in range(0, len(queries), batch):
        part = slice(first, first + batch)
        score, slack = _whole_rows(gallery, queries[part], floors[part])
        found += [
            _first_of_row(gallery, crowds[0].k, positives, *row)
            for row in zip(queries[part].tolist(), score, slack, strict=True)
        ]
    return found


def _whole_rows(gallery: _Gallery, queries: Ints, floors: Floats) -> tuple[Floats, Floats]:
    """Similarities (n, G) of queries to all tiles, and their errors; -inf below the floors."""
    score = np.full((len(queries), len(gallery.rows)), -np.inf)
    slack = np.zeros_like(score)
    least = rounded_down(floors)
    for start, rows, single, norms in gallery.blocks():
        values = gallery.queries.similarities(queries, single, norms)
        row, column = np.nonzero(values >= least)
        # Equal rows, the usual cause of a crowd, count as one.
        whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))
        first, same = np.unique(whole[:, 0], return_index=True, return_inverse=True)[1:]
        pair, back = np.unique(first[same][row] * len(queries) + column, return_inverse=True)
        one_row, one_column = np.divmod(pair, len(queries))
        found = gallery.scores(queries[one_column], one_row + start)
        score[column, row + start], slack[column, row + start] = (part[back] for part in found)
    return score, slack


def _first_of_row(
    gallery: _Gallery, k: int, positives: Positives, query: int, score: Floats, slack: Floats
) -> Candidates:
    tile = np.flatnonzero(score > -np.inf)
    here = np.full(len(tile), query)
    score = _with_ties(here, here, score[tile], slack[tile])
    positive = np.isin(tile, positives.of(query))
    order = np.lexsort((tile, positive, -score))
    kept = order[(np.arange(len(order)) < k) | positive[order]]
    flat = len(tile) == len(gallery.rows) and bool((score == score[0]).all())
    return Candidates(
        here[kept],
        tile[kept],
        np.zeros(len(kept), np.int64),
        score[kept],
        here[:1] if flat else here[:0],
    )


def _with_ties(query: Ints, cluster: Ints, score: Floats, slack: Floats) -> Floats:
    """Give similarities that rounding may have told apart the best value among them."""
    order = np.lexsort((-score, cluster, query))
    tied = (np.diff(query[order]) == 0) & (np.diff(cluster[order]) == 0)
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    opens = np.ones(len(order), bool)
    opens[1:] = ~tied
    level = np.empty_like(score)
    level[order] = score[order][opens][np.cumsum(opens) - 1]
    return level

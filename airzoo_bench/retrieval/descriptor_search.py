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

from airzoo_bench.retrieval.candidate_search import Search, rounded_down
from airzoo_bench.retrieval.descriptor_rows import RowSource, as_float32
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.similarity import Queries, check_norms, norms_of, similarity, usable

__all__ = ["Candidates", "nearest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
        Similarity in float64, comparable within a cluster.
    """

    query: Ints
    tile: Ints
    cluster: Ints
    score: Floats


@dataclass(frozen=True)
class _Gallery:
    """The gallery's rows, and how to go through them."""

    rows: RowSource
    queries: Queries
    block: int
    workers: int

    def blocks(self) -> Iterator[tuple[int, NDArray[Any], NDArray[np.float32], Floats]]:
        """Give (first row, rows, rows in float32, norms), in order."""
        for start, rows in self.rows.blocks(self.block):
            single = as_float32(rows)
            yield start, rows, single, norms_of(rows, single)

    def finite(self, rows: Ints) -> NDArray[np.bool_]:
        """Whether all numbers of each row are finite."""
        return np.array([np.isfinite(self.rows.read(row, row + 1)).all() for row in rows], bool)

    def scores(self, query: Ints, tile: Ints) -> Floats:
        """Similarities in float64 of pairs, reading only the rows that they need."""
        scores = np.empty(len(query))
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
                scores[some] = similarity(
                    self.queries.rows[query[some]].astype(np.float64),
                    rows[tile[some] - start].astype(np.float64),
                    self.queries.metric,
                )

        with ThreadPoolExecutor(self.workers) as pool:
            list(pool.map(evaluate, groups))
        return scores


def nearest(
    queries: Queries,
    gallery: NDArray[Any],
    k: int,
    positives: Positives,
    *,
    memory_bytes: int,
    workers: int,
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
    stored = _Gallery(RowSource.of(gallery), queries, block, workers)
    caution = 1.0
    while True:
        searches, bounds = _search(stored, k, part, caution)
        found = [_settled(stored, search, bounds[search.part]) for search in searches]
        worst = max((error for _, error in found), default=0.0)
        if worst <= 1:
            break
        caution *= 4 * worst  # never seen; the bound holds with all but certainty
    crowds = [search for search in searches if search.crowded.any()]
    parts = [candidates for candidates, _ in found] + _exhausted(stored, crowds, bounds, positives)
    joined = (
        np.concatenate([np.zeros(0, dtype), *(getattr(one, name) for one in parts)])
        for name, dtype in (
            ("query", np.int64),
            ("tile", np.int64),
            ("cluster", np.int64),
            ("score", np.float64),
        )
    )
    return Candidates(*joined)


def _search(gallery: _Gallery, k: int, part: int, caution: float) -> tuple[list[Search], Floats]:
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
        check_norms(norms, gallery.finite, "gallery_descriptors", metric)
    return searches, bounds


def _settled(gallery: _Gallery, search: Search, bounds: Floats) -> tuple[Candidates, float]:
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
    score = np.zeros(len(query))
    score[doubtful] = gallery.scores(query[doubtful], tile[doubtful])
    exact = gallery.queries.searched(query[doubtful], score[doubtful])
    error = np.abs(value[doubtful] - exact) / bound[doubtful]
    return Candidates(query, tile, cluster, score), float(error.max(initial=0))


@dataclass
class _Crowd:
    """Queries of too many candidates: the k best other tiles so far, and all positives.

    `floor` is the least value in float32 of a tile that may still matter; `kth` is the k-th best
    score of those that are not positive. Tiles come in order, so that a later one that ties with
    `kth` comes after it.
    """

    gallery: _Gallery
    positives: Positives
    k: int
    queries: Ints
    bounds: Floats
    floor: Floats
    kth: Floats
    column: Ints
    tile: Ints
    score: Floats

    @classmethod
    def of(cls, gallery: _Gallery, positives: Positives, search: Search, bounds: Floats) -> _Crowd:
        columns = np.flatnonzero(search.crowded)
        queries = columns + search.part.start
        bounds, kth = bounds[queries], np.full(len(columns), -np.inf)
        floor = search.kth[columns] - 2 * bounds
        none = np.zeros(0, np.int64)
        return cls(
            gallery, positives, search.k, queries, bounds, floor, kth, none, none, np.zeros(0)
        )

    def absorb(
        self, start: int, rows: NDArray[Any], single: NDArray[np.float32], norms: Floats
    ) -> None:
        values = self.gallery.queries.similarities(self.queries, single, norms)
        row, column = np.nonzero(values >= rounded_down(self.floor))
        score = self._scores(start, rows, row, column)
        positive = self._positive(column, row + start)
        new = np.flatnonzero(positive | (score > self.kth[column]))
        self.column = np.concatenate([self.column, column[new]])
        self.tile = np.concatenate([self.tile, row[new] + start])
        self.score = np.concatenate([self.score, score[new]])
        self._prune()

    def candidates(self) -> Candidates:
        return Candidates(
            self.queries[self.column], self.tile, np.zeros(len(self.tile), np.int64), self.score
        )

    def _positive(self, column: Ints, tile: Ints) -> NDArray[np.bool_]:
        return self.positives.holds(self.queries[column], tile, len(self.gallery.rows))

    def _scores(self, start: int, rows: NDArray[Any], row: Ints, column: Ints) -> Floats:
        """Similarities in float64; equal rows, the usual cause of a crowd, count as one."""
        whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))
        first, same = np.unique(whole[:, 0], return_index=True, return_inverse=True)[1:]
        pair, back = np.unique(first[same][row] * len(self.queries) + column, return_inverse=True)
        one_row, one_column = np.divmod(pair, len(self.queries))
        scores = self.gallery.scores(self.queries[one_column], one_row + start)
        return scores[back]

    def _prune(self) -> None:
        positive = self._positive(self.column, self.tile)
        order = np.lexsort((self.tile, -self.score, positive, self.column))
        column, positive = self.column[order], positive[order]
        counts = np.bincount(column, minlength=len(self.queries))
        rank = np.arange(len(order)) - offsets_of(counts)[column]
        last = ~positive & (rank == self.k - 1)
        self.kth[column[last]] = self.score[order[last]]
        exact = self.gallery.queries.searched(self.queries, self.kth)
        self.floor = np.maximum(self.floor, exact - self.bounds)
        kept = order[positive | (rank < self.k)]
        self.column, self.tile, self.score = self.column[kept], self.tile[kept], self.score[kept]


def _exhausted(
    gallery: _Gallery, crowds: list[Search], bounds: Floats, positives: Positives
) -> list[Candidates]:
    """Evaluate in float64 every tile that the search could not exclude, block by block."""
    if not crowds:
        return []
    states = [_Crowd.of(gallery, positives, search, bounds) for search in crowds]
    for start, rows, single, norms in gallery.blocks():
        for state in states:
            state.absorb(start, rows, single, norms)
    return [state.candidates() for state in states]

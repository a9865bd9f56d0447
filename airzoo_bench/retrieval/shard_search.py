"""What is done with the rows of one shard of a gallery, each a task on whatever engine there is.

A shard is some rows of the gallery and the index of the first; what a task returns counts tiles
from the start of the gallery. No number depends on where the gallery was cut but `value`s, `kth`
and what follows from them, whose errors the bounds hold for.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.candidate_search import Search, rounded_down
from airzoo_bench.retrieval.descriptor_rows import Rows, Run, as_float32
from airzoo_bench.retrieval.one_way import one_way
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.similarity import (
    Metric,
    Queries,
    finite_rows,
    norms_of,
    roundoff,
    similarity,
    unusable,
)

__all__ = [
    "Arrays",
    "Crowd",
    "Pairs",
    "Request",
    "Shard",
    "joined",
    "points_like",
    "score_crowd",
    "score_pairs",
    "search_shard",
]

Arrays = dict[str, NDArray[Any]]
"""What a task returns."""

_BLOCK_BYTES = 1 << 26
_BLOCK_ROWS = 4096
_PAIRS = 16  # pairs at a time in float64, at least
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_BYTES_OF_A_TILE = 32  # of a crowd: query, tile, score, error


@dataclass(frozen=True)
class Shard:
    """Some rows of the gallery, of which the first is tile `start`."""

    start: int
    rows: Rows

    @property
    def name(self) -> str:
        """What it is, in a message."""
        last = self.start + len(self.rows) - 1
        return f"rows {self.start:,} to {last:,} of gallery_descriptors"


@dataclass(frozen=True)
class Request:
    """What all tasks of a search share.

    Parameters
    ----------
    queries : Queries
    k : int
        How many tiles are sought.
    memory_bytes : int
        Bound of the working memory of a task.
    jobs : int
        Threads of a task.
    caution : float
        What bounds are multiplied by.
    """

    queries: Queries
    k: int
    memory_bytes: int
    jobs: int
    caution: float = 1.0

    def block(self, rows: Rows) -> int:
        """How many rows to take at a time."""
        row_bytes = max(1, rows.shape[1] * max(rows.itemsize, 4))
        return int(np.clip(min(_BLOCK_BYTES, self.memory_bytes // 8) // row_bytes, 1, _BLOCK_ROWS))

    def parts(self, block: int) -> list[slice]:
        """Cut the queries into parts whose values for a block fit the memory."""
        n, step = len(self.queries.norms), max(1, self.memory_bytes // 16 // (4 * block))
        return [slice(start, min(start + step, n)) for start in range(0, max(1, n), step)]

    def bounds(self, least: float, most: float) -> Floats:
        """Bound the error of every query's values, for the norms of a gallery."""
        return self.caution * self.queries.bounds(least, most)


def points_like(shared: tuple[Floats, Metric, int], shard: Shard) -> Arrays:
    """Tell whether a shard's rows all point the way of one; see `similarity.one_way`."""
    return {"one_way": np.array([one_way(shard.rows, *shared)])}


def search_shard(request: Request, shard: Shard) -> Arrays:
    """Search a shard in float32."""
    block = request.block(shard.rows)
    searches = [Search.of(part, request.k) for part in request.parts(block)]
    queries, norms = request.queries, np.array([np.inf, 0.0])
    wild, faults = False, [unusable(np.zeros(0), np.isfinite, queries.metric)]
    for start, rows in shard.rows.blocks(block):
        single = as_float32(rows)
        here = norms_of(rows, single)
        found = unusable(here, partial(finite_rows, rows), queries.metric)
        faults.append({name: some + (shard.start + start) for name, some in found.items()})
        wild = wild or any(map(len, found.values()))
        if wild:
            continue  # read on, to count them all
        norms = np.array([min(norms[0], here.min()), max(norms[1], here.max())])
        bounds = request.bounds(*norms)
        for one in searches:
            values = queries.similarities(one.part, single, here)
            one.absorb(values, shard.start + start, bounds[one.part])
    return joined([_kept(one) for one in searches]) | {"norms": norms} | joined(faults)


def _kept(part: Search) -> Arrays:
    names = ("tile", "value", "kth", "crowded", "top")
    return {"query": part.query + part.part.start} | {name: getattr(part, name) for name in names}


@dataclass(frozen=True)
class Pairs:
    """Pairs of a query and a row of a shard, (n,) and (n,)."""

    shard: Shard
    query: NDArray[np.integer[Any]]
    row: NDArray[np.integer[Any]]


def score_pairs(request: Request, pairs: Pairs) -> Arrays:
    """Evaluate pairs in float64, reading only the rows they need: ``score`` and its ``slack``."""
    query, row, rows = pairs.query, pairs.row, pairs.shard.rows
    score, slack = np.empty(len(query)), np.empty(len(query))
    order = np.argsort(row, kind="stable")
    piece = _piece(rows.shape[1])
    chunk = row[order] // (4 * piece)
    firsts = np.flatnonzero(np.diff(chunk, prepend=-1))
    groups = [group for group in np.split(order, firsts[1:]) if len(group)]
    bounds = [(int(row[group[0]]), int(row[group[-1]]) + 1) for group in groups]

    def evaluate(group: Ints, run: Run) -> None:
        given = rows.read(*run)
        for first in range(0, len(group), piece):
            some = group[first : first + piece]
            score[some], slack[some] = _scores(request, query[some], given[row[some] - run[0]])

    with ThreadPoolExecutor(request.jobs) as pool:
        list(pool.map(evaluate, groups, bounds))
    return {"score": score, "slack": slack}


def _scores(
    request: Request, query: NDArray[np.integer[Any]], rows: NDArray[Any]
) -> tuple[Floats, Floats]:
    metric = request.queries.metric
    asked, given = request.queries.rows[query].astype(np.float64), rows.astype(np.float64)
    scores = similarity(asked, given, metric)
    return scores, roundoff(asked, given, scores, metric)


@dataclass(frozen=True)
class Crowd:
    """Queries that too many tiles may answer: all of these are evaluated in float64.

    Parameters
    ----------
    request : Request
        Of these n queries.
    floors : (n,) array
        Search values below which a tile is not among the first k.
    positives : Positives
        Of these queries.
    n_tiles : int
        Of the whole gallery.
    """

    request: Request
    floors: Floats
    positives: Positives
    n_tiles: int

    @property
    def most(self) -> int:
        """How many tiles may be kept at a time, of all queries together."""
        return max(1, self.request.memory_bytes // 8 // _BYTES_OF_A_TILE)

    def reduced(self, found: Arrays) -> Arrays:
        """Keep of equal scores of a query the first k tiles, and all positives."""
        query, tile = found["query"], found["tile"]
        positive = self.positives.holds(query, tile, self.n_tiles)
        order = np.lexsort((tile, positive, found["slack"], found["score"], query))
        alike = np.ones(len(order), bool)
        for name in ("query", "score", "slack"):
            alike[1:] &= np.diff(found[name][order]) == 0
        alike[:1] = False
        place = np.arange(len(order))
        rank = place - np.maximum.accumulate(np.where(alike, 0, place))
        kept = order[(rank < self.request.k) | positive[order]]
        return {name: found[name][kept] for name in ("query", "tile", "score", "slack")}


def score_crowd(crowd: Crowd, shard: Shard) -> Arrays:
    """Evaluate in float64 every tile of a shard that the search could not exclude."""
    request, n = crowd.request, len(crowd.floors)
    kept, count = [_no_pairs()], np.zeros(n, np.int64)
    least = rounded_down(crowd.floors)
    for start, rows in shard.rows.blocks(request.block(shard.rows)):
        single = as_float32(rows)
        values = request.queries.similarities(slice(None), single, norms_of(rows, single))
        row, query = np.nonzero(values >= least)
        count += np.bincount(query, minlength=n)
        score, slack = _scores_of_rows(request, query, row, rows)
        here = {"query": query, "tile": row + (shard.start + start), "score": score, "slack": slack}
        kept.append(crowd.reduced(here))
        if sum(len(one["query"]) for one in kept) > crowd.most:
            kept = [crowd.reduced(joined(kept))]
            if len(kept[0]["query"]) > crowd.most and n > 1:
                return _no_pairs() | {"count": count[:0]}
    return crowd.reduced(joined(kept)) | {"count": count}


def joined(parts: Sequence[Arrays]) -> Arrays:
    """Put arrays of the same names together, of one part or several."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _no_pairs() -> Arrays:
    none, zero = np.zeros(0, np.int64), np.zeros(0)
    return {"query": none, "tile": none, "score": zero, "slack": zero}


def _scores_of_rows(
    request: Request, query: Ints, row: Ints, rows: NDArray[Any]
) -> tuple[Floats, Floats]:
    """Evaluate pairs of queries and rows; equal rows, the usual cause of a crowd, count as one."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))
    first, same = np.unique(whole[:, 0], return_index=True, return_inverse=True)[1:]
    n = len(request.queries.norms)
    pair, back = np.unique(first[same][row] * n + query, return_inverse=True)
    one_row, one_query = np.divmod(pair, n)
    score, slack = np.empty(len(pair)), np.empty(len(pair))
    piece = _piece(rows.shape[1])

    def evaluate(start: int) -> None:
        some = slice(start, start + piece)
        score[some], slack[some] = _scores(request, one_query[some], rows[one_row[some]])

    with ThreadPoolExecutor(request.jobs) as pool:
        list(pool.map(evaluate, range(0, len(pair), piece)))
    return score[back], slack[back]


def _piece(dimensions: int) -> int:
    return max(_PAIRS, _PIECE_NUMBERS // max(dimensions, 1))

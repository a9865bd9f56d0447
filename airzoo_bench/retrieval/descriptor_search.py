"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

The search keeps of each query every tile that its error bound cannot exclude from the first k. Of
these, tiles closer to each other than twice the bound form a cluster, and only clusters of several
tiles are evaluated in float64. Queries with so many candidates that keeping them would not be
bounded (a scorer that gives every tile the same) are evaluated tile by tile instead. No number
depends on the blocks that the gallery is read in, except search values, whose errors the bounds
hold for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.candidates import Kept, rounded_down
from airzoo_bench.retrieval.descriptor_rows import Rows, as_float32
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.similarity import (
    Names,
    Queries,
    finite_rows,
    norms_of,
    refuse_unusable,
    roundoff,
    similarity,
    unusable,
)

__all__ = ["Candidates", "Request", "nearest"]

Arrays = dict[str, NDArray[Any]]

_BLOCK_BYTES = 1 << 26
_BLOCK_ROWS = 4096
_PAIRS = 16  # pairs at a time in float64, at least
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_BYTES_OF_A_TILE = 32  # of a crowd: query, tile, score, error
_BYTES_OF_AN_ENTRY = 128  # of a crowd: what finding a candidate takes


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


@dataclass(frozen=True, eq=False)
class Request:
    """Queries, the gallery that is searched for them, and what the search may use.

    Parameters
    ----------
    queries : Queries
    positives : Positives
        Of these queries.
    gallery : Rows
    k : int
        How many tiles are sought.
    memory_bytes : int
        Bound of the working memory.
    jobs : int
        Threads.
    names : sequence, optional
        Of the tiles, for messages.
    """

    queries: Queries
    positives: Positives
    gallery: Rows
    k: int
    memory_bytes: int
    jobs: int
    names: Names | None

    @property
    def block(self) -> int:
        """Return how many rows of the gallery are taken at a time."""
        row_bytes = max(1, self.gallery.shape[1] * max(self.gallery.itemsize, 4))
        return int(np.clip(min(_BLOCK_BYTES, self.memory_bytes // 8) // row_bytes, 1, _BLOCK_ROWS))


def nearest(request: Request, caution: float = 1.0) -> Candidates:
    """Find the pairs that hold the k most similar tiles of each query, and all that tie with them.

    Where a tie crosses rank k, its positives are there, and of its other tiles those of least
    index as far as k reaches. Bounds of errors are multiplied by `caution`.

    Raises
    ------
    PredictionError
        Where the gallery's descriptors cannot be ranked.
    """
    kept, bounds = _search(request, caution)
    found, worst = _evaluate(request, kept, bounds)
    if worst > 1:  # never seen; the bound holds with all but certainty
        return nearest(request, caution * 4 * worst)
    parts = [found, *_evaluate_crowds(request, kept, bounds)]
    names = ("query", "tile", "cluster", "score", "flat")
    return Candidates(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


def _search(request: Request, caution: float) -> tuple[Kept, Floats]:
    """Search in float32; also return every query's bound, for the norms of the gallery."""
    queries, block = request.queries, request.block
    step = max(1, request.memory_bytes // 16 // (4 * block))
    starts = range(0, max(1, len(queries)), step)
    parts = [slice(start, min(start + step, len(queries))) for start in starts]
    kept = [Kept(part.stop - part.start, request.k) for part in parts]
    least, most, bounds = np.inf, 0.0, np.zeros(len(queries))
    faults = [unusable(np.zeros(0), np.isfinite, queries.metric)]
    for start, rows in request.gallery.blocks(block):
        single = as_float32(rows)
        norms = norms_of(rows, single)
        found = unusable(norms, partial(finite_rows, rows), queries.metric)
        faults.append({name: some + start for name, some in found.items()})
        if any(len(some) for fault in faults for some in fault.values()):
            continue  # read on, to count them all
        least, most = min(least, norms.min()), max(most, norms.max())
        bounds = caution * queries.bounds(least, most)
        for part, one in zip(parts, kept, strict=True):
            one.absorb(queries.similarities(part, single, norms), start, bounds[part])
    refuse_unusable(_joined(faults), len(request.gallery), "gallery_descriptors", request.names)
    for part, one in zip(parts, kept, strict=True):
        one.prune(bounds[part])
    return Kept.joined(kept, [part.start for part in parts]), bounds


def _evaluate(request: Request, kept: Kept, bounds: Floats) -> tuple[Candidates, float]:
    """Form clusters of candidates that the search cannot tell apart, and evaluate these."""
    order = np.lexsort((-kept.value, kept.query))
    query, tile = kept.query[order], kept.tile[order]
    value, bound = kept.value[order].astype(np.float64), bounds[query]
    best = np.diff(query, prepend=-1) != 0
    opens = best | (-np.diff(value, prepend=0) > 2 * bound)
    cluster = np.cumsum(opens)
    several = np.bincount(cluster, minlength=1)[cluster] > 1
    doubtful = np.flatnonzero(best | several)
    score, slack = np.zeros(len(query)), np.zeros(len(query))
    score[doubtful], slack[doubtful] = _score_pairs(request, query[doubtful], tile[doubtful])
    exact = request.queries.searched(query[doubtful], score[doubtful])
    error = np.abs(value[doubtful] - exact) / bound[doubtful]
    score = _with_ties(query, cluster, score, slack)
    flat = _all_tied(query, cluster, score, len(request.gallery))
    return Candidates(query, tile, cluster, score, flat), float(error.max(initial=0))


def _score_pairs(request: Request, query: Ints, tile: Ints) -> tuple[Floats, Floats]:
    """Return similarities in float64 and their errors, reading only the rows they need."""
    rows, piece = request.gallery, _piece(request)
    score, slack = np.empty(len(query)), np.empty(len(query))
    order = np.argsort(tile, kind="stable")
    firsts = np.flatnonzero(np.diff(tile[order] // (4 * piece), prepend=-1))
    groups = [group for group in np.split(order, firsts[1:]) if len(group)]

    def evaluate(group: Ints) -> None:
        first = int(tile[group[0]])
        given = rows.read(first, int(tile[group[-1]]) + 1)
        for start in range(0, len(group), piece):
            some = group[start : start + piece]
            score[some], slack[some] = _scores(request, query[some], given[tile[some] - first])

    with ThreadPoolExecutor(request.jobs) as pool:
        list(pool.map(evaluate, groups))
    return score, slack


def _scores(request: Request, query: Ints, rows: NDArray[Any]) -> tuple[Floats, Floats]:
    metric = request.queries.metric
    asked, given = request.queries.rows[query].astype(np.float64), rows.astype(np.float64)
    scores = similarity(asked, given, metric)
    return scores, roundoff(asked, given, scores, metric)


def _all_tied(query: Ints, cluster: Ints, score: Floats, n_tiles: int) -> Ints:
    """Find the queries all of whose tiles are in one tie; pairs are in the order of clusters."""
    changes = (np.diff(query) == 0) & ((np.diff(cluster) != 0) | (np.diff(score) != 0))
    several = np.zeros(int(query.max(initial=-1)) + 1, bool)
    several[query[1:][changes]] = True
    flat: Ints = np.flatnonzero((np.bincount(query) == n_tiles) & ~several)
    return flat


def _evaluate_crowds(request: Request, kept: Kept, bounds: Floats) -> Iterator[Candidates]:
    """Evaluate every tile that the search could not exclude, of some crowded queries at a time."""
    step = max(1, request.memory_bytes // 8 // (_BYTES_OF_AN_ENTRY * request.block))
    queries = np.flatnonzero(kept.crowded)
    waiting = [queries[start : start + step] for start in range(0, len(queries), step)][::-1]
    while waiting:
        some = waiting.pop()
        found = _crowd(request, some, kept.kth[some] - 2 * bounds[some])
        if found is None:
            waiting += [some[len(some) // 2 :], some[: len(some) // 2]]
        else:
            yield from _first_of_crowd(request, some, found)


def _crowd(request: Request, some: Ints, floors: Floats) -> Arrays | None:
    """Evaluate the tiles above these floors; return None where there are too many at once."""
    queries, positives = request.queries.part(some), request.positives.take(some)
    most = max(1, request.memory_bytes // 8 // _BYTES_OF_A_TILE)
    least = rounded_down(floors)
    none, zero = np.zeros(0, np.int64), np.zeros(0)
    kept: list[Arrays] = [{"query": none, "tile": none, "score": zero, "slack": zero}]
    count = np.zeros(len(some), np.int64)
    reduce = partial(_first_of_equals, positives, len(request.gallery), request.k)
    for start, rows in request.gallery.blocks(request.block):
        single = as_float32(rows)
        values = queries.similarities(slice(None), single, norms_of(rows, single))
        row, query = np.nonzero(values >= least)
        count += np.bincount(query, minlength=len(some))
        score, slack = _scores_of_rows(request, some[query], row, rows)
        kept.append(reduce({"query": query, "tile": row + start, "score": score, "slack": slack}))
        if sum(len(one["query"]) for one in kept) > most:
            kept = [reduce(_joined(kept))]
            if len(kept[0]["query"]) > most and len(some) > 1:
                return None
    return reduce(_joined(kept)) | {"count": count}


def _first_of_equals(positives: Positives, n_tiles: int, k: int, found: Arrays) -> Arrays:
    """Keep of equal scores of a query the first k tiles, and all positives."""
    query, tile = found["query"], found["tile"]
    positive = positives.holds(query, tile, n_tiles)
    order = np.lexsort((tile, positive, found["slack"], found["score"], query))
    alike = np.ones(len(order), bool)
    for name in ("query", "score", "slack"):
        alike[1:] &= np.diff(found[name][order]) == 0
    alike[:1] = False
    place = np.arange(len(order))
    rank = place - np.maximum.accumulate(np.where(alike, 0, place))
    kept = order[(rank < k) | positive[order]]
    return {name: found[name][kept] for name in ("query", "tile", "score", "slack")}


def _scores_of_rows(
    request: Request, query: Ints, row: Ints, rows: NDArray[Any]
) -> tuple[Floats, Floats]:
    """Evaluate pairs of queries and rows; equal rows, the usual cause of a crowd, count as one."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))
    first, same = np.unique(whole[:, 0], return_index=True, return_inverse=True)[1:]
    n = len(request.queries)
    pair, back = np.unique(first[same][row] * n + query, return_inverse=True)
    one_row, one_query = np.divmod(pair, n)
    score, slack = np.empty(len(pair)), np.empty(len(pair))
    piece = _piece(request)

    def evaluate(start: int) -> None:
        some = slice(start, start + piece)
        score[some], slack[some] = _scores(request, one_query[some], rows[one_row[some]])

    with ThreadPoolExecutor(request.jobs) as pool:
        list(pool.map(evaluate, range(0, len(pair), piece)))
    return score[back], slack[back]


def _first_of_crowd(request: Request, queries: Ints, found: Arrays) -> Iterator[Candidates]:
    order = np.argsort(found["query"], kind="stable")
    ends = np.searchsorted(found["query"][order], np.arange(1, len(queries)))
    for row, some in enumerate(np.split(order, ends)):
        score, flat = found["score"][some], found["count"][row] == len(request.gallery)
        here, tile = np.full(len(some), queries[row]), found["tile"][some]
        score = _with_ties(here, here, score, found["slack"][some])
        positive = np.isin(tile, request.positives.of(int(queries[row])))
        best = np.lexsort((tile, positive, -score))
        kept = best[(np.arange(len(best)) < request.k) | positive[best]]
        flat &= bool((score == score[:1]).all())
        cluster = np.zeros(len(kept), np.int64)
        yield Candidates(here[kept], tile[kept], cluster, score[kept], here[: int(flat)])


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


def _joined(parts: Sequence[Arrays]) -> Arrays:
    """Put arrays of the same names together, of one part or several."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _piece(request: Request) -> int:
    return max(_PAIRS, _PIECE_NUMBERS // max(request.gallery.shape[1], 1))

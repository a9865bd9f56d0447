"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

Larger is more similar: q.g for `inner_product`, the same of normalised vectors for `cosine`, and
-|q - g|^2 / 2 for `l2`. The search keeps of each query every tile that its error bound cannot
exclude from the first k, and these are evaluated in float64. A query with too many of them (a
method that gives many tiles the same) is compared with the whole gallery. No result depends on the
blocks that the gallery is read in.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.registry import resolve
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.settings import Metric

Names = Sequence[object] | NDArray[Any]
Pairs = tuple[Ints, Ints, Ints]
"""Query, tile and level of pairs: of two, the smaller level comes first, equal ones tie."""

_SINGLE, _DOUBLE = 2.0**-24, 2.0**-53  # roundoff of float32 and float64
_TINY = 2.0**-126  # smallest normal float32
_LAMBDA = 10.0
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_LEAST_NORM, _MOST_NORM = 1e-15, 1e18  # squares of others underflow or overflow in float32
_SPARE = 64  # candidates beyond 2k that a query may keep
_BYTES_OF_A_CANDIDATE = 64  # query, tile and value, and what sorting them takes
_BYTES_OF_A_PAIR = 256  # the same of a pair that is ordered
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_BLOCK_BYTES, _BLOCK_ROWS = 1 << 25, 1 << 15


@dataclass(frozen=True, eq=False)
class Search:
    """A gallery that is searched, and what the search may use."""

    gallery: NDArray[Any]  # (G, D), may be mapped
    metric: Metric
    k: int  # how many tiles are sought
    memory_bytes: int  # bounds the working memory
    threads: int
    names: Names  # of the tiles, for messages

    @property
    def capacity(self) -> int:
        """How many candidates a query may keep."""
        return 2 * self.k + _SPARE

    def queries_at_a_time(self) -> int:
        """Return the number of queries for one call of `nearest`."""
        own: int = 16 * self.gallery.shape[1] + _BYTES_OF_A_CANDIDATE * self.capacity
        return max(64, self.memory_bytes // 2 // own)


def nearest(
    search: Search, queries: NDArray[Any], caution: float = 1.0
) -> Iterator[tuple[Ints, Pairs]]:
    """Yield some queries at a time, and pairs of them and of tiles that hold their k most similar.

    Every tile that ties with one of these is there. `caution` is a factor of all error bounds.
    """
    n_tiles, length = search.gallery.shape
    single, norms = rounded(queries)
    value, tile, most = _find_candidates(search, _scaled(single, norms, search.metric))
    if search.metric == "cosine":
        norms, most = np.ones(len(norms)), 1.0
    bounds = caution * error_bounds(norms, most, length, search.metric)
    kth = np.partition(value, search.capacity - search.k, axis=1)[:, search.capacity - search.k]
    floors = kth - 2 * bounds
    near: Bools = value >= floors[:, None]
    crowded: Bools = np.asarray(near.all(axis=1) & (search.capacity < n_tiles))
    query, column = np.nonzero(near & (tile >= 0) & ~crowded[:, None])
    value, tile = value[query, column], tile[query, column]
    score, slack = _similarities(search, queries, query, tile)
    worst = (np.abs(value - score) / bounds[query]).max(initial=0)
    if worst > 1:  # never seen; the bound holds with all but certainty
        yield from nearest(search, queries, caution * 4 * float(worst))
        return
    yield np.arange(len(bounds)), (query, tile, _levels(query, score, slack))
    crowd = np.flatnonzero(crowded)
    step = max(1, search.memory_bytes // (_BYTES_OF_A_PAIR * max(n_tiles, 1)))
    for start in range(0, len(crowd), step):
        some = crowd[start : start + step]
        query, tile = np.divmod(np.arange(len(some) * n_tiles), n_tiles)
        score, slack = _similarities(search, queries[some], query, tile)
        high = score >= floors[some][query]
        query, tile = query[high], tile[high]
        yield some, (query, tile, _levels(query, score[high], slack[high]))


def _find_candidates(
    search: Search, queries: NDArray[np.float32]
) -> tuple[NDArray[np.float32], Ints, float]:
    """Return similarities and tiles (Q, kept) of the best, and the largest norm of a tile."""
    knn = resolve("faiss:knn")  # takes a while to import, which ranked ids do without
    measure = 1 if search.metric == "l2" else 0  # faiss.METRIC_L2, METRIC_INNER_PRODUCT
    shape, most = (len(queries), search.capacity), 0.0
    value, tile = np.full(shape, -np.inf, np.float32), np.full(shape, -1, np.int64)
    for start, rows in blocks(search.gallery, search.memory_bytes):
        single, norms = rounded(rows)
        names = search.names[start : start + len(rows)]
        check_descriptors(rows, norms, search.metric, "gallery_descriptors", names)
        single, most = _scaled(single, norms, search.metric), max(most, float(norms.max()))
        found, near = knn(queries, single, min(search.capacity, len(rows)), measure)
        value = np.concatenate([value, found / -2 if measure else found], axis=1)
        tile = np.concatenate([tile, near + start], axis=1)
        best = np.argpartition(value, -search.capacity, axis=1)[:, -search.capacity :]
        value = np.take_along_axis(value, best, axis=1)
        tile = np.take_along_axis(tile, best, axis=1)
    return value, tile, most


def _scaled(single: NDArray[np.float32], norms: Floats, metric: Metric) -> NDArray[np.float32]:
    return single / norms.astype(np.float32)[:, None] if metric == "cosine" else single


def blocks(
    rows: NDArray[Any], memory_bytes: int = 8 * _BLOCK_BYTES
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yield (first row, rows) in order; pages of a map that were read leave the memory."""
    row_bytes = max(1, rows.shape[1] * max(rows.dtype.itemsize, 4))
    step = int(np.clip(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, 1, _BLOCK_ROWS))
    for start in range(0, len(rows), step):
        yield start, np.asarray(rows[start : start + step])
        release_pages(rows)


def release_pages(rows: Any) -> None:
    """Let go of the pages of a mapped file, which count as memory of the process."""
    pages = getattr(rows, "_mmap", None)  # a copy in another process has none
    if pages is not None and rows.mode != "c" and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)


def _similarities(search: Search, queries: NDArray[Any], query: Ints, tile: Ints) -> Floats:
    """Return similarities of pairs in float64 and bounds of their errors (2, n)."""
    order = np.argsort(tile, kind="stable")  # by tile, as they lie in a file
    step = max(1, _PIECE_NUMBERS // max(queries.shape[1], 1))
    gallery, found = np.asarray(search.gallery), np.empty((2, len(query)))

    def evaluate(start: int) -> None:
        some = order[start : start + step]
        found[:, some] = similarity(queries[query[some]], gallery[tile[some]], search.metric)

    with ThreadPoolExecutor(search.threads) as pool:
        for number, _ in enumerate(pool.map(evaluate, range(0, len(order), step))):
            if number % 64 == 0:
                release_pages(search.gallery)
    return found


def _levels(query: Ints, score: Floats, slack: Floats) -> Ints:
    """Return the order of each query's pairs by falling score, equal where slack allows a tie."""
    order = np.lexsort((-score, query))
    tied = np.diff(query[order]) == 0
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    level = np.zeros(len(order), np.int64)
    level[order[1:]] = np.cumsum(~tied)
    return level


def all_equal(rows: NDArray[Any]) -> bool:
    """Return whether a gallery says nothing: several descriptors, all equal."""
    return len(rows) > 1 and all((some == rows[0]).all() for _, some in blocks(rows, 1 << 20))


def rounded(rows: NDArray[Any]) -> tuple[NDArray[np.float32], Floats]:
    """Round descriptors to float32, and return their norms, nearly."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        single = np.ascontiguousarray(rows, dtype=np.float32)
        return single, np.sqrt(np.vecdot(single, single).astype(np.float64))


def check_descriptors(
    rows: NDArray[Any], norms: Floats, metric: Metric, field: str, names: Names
) -> None:
    """Refuse descriptors that cannot be ranked, by the names of their rows."""
    what, expected = "descriptors too large to rank", "norms up to 1e18"
    faulty = np.flatnonzero(~(norms <= _MOST_NORM))  # also tells NaN
    infinite = faulty[~np.isfinite(rows[faulty]).all(axis=1)]
    if len(infinite):
        what, expected, faulty = "NaN or infinite descriptors", "finite numbers", infinite
    elif metric == "cosine" and not len(faulty):
        what, expected = "descriptors of zero", "a direction, to take its cosine"
        faulty = np.flatnonzero(norms < _LEAST_NORM)
    if len(faulty):
        raise PredictionError(
            f"{what}: {first_of([names[row] for row in faulty.tolist()])}",
            where=f"field '{field}'",
            expected=expected,
            fix="export them again, and look for a division by zero or half precision",
        )


def error_bounds(norms: Floats, most: float, n: int, metric: Metric) -> Floats:
    """Bound the error of every similarity in float32, for tiles of norms up to `most`."""
    bound = 2 * gamma(n, _SINGLE) * norms * most
    if metric == "l2":
        bound = gamma(n, _SINGLE) * (norms + most) ** 2 / 2
    return np.asarray(bound + n * _TINY * (1 + norms + most))


def similarity(asked: NDArray[Any], near: NDArray[Any], metric: Metric) -> tuple[Floats, Floats]:
    """Return similarities in float64 of pairs, (n, D) and (n, D), and bounds of their errors.

    The order in which they are summed depends on D alone.
    """
    error = gamma(asked.shape[1], _DOUBLE)
    if metric == "l2":
        apart = np.subtract(asked, near, dtype=np.float64)
        found = -_dot(apart, apart) / 2
        return found, error * np.abs(found)
    asked, near = asked.astype(np.float64), near.astype(np.float64)
    sizes = np.sqrt(_dot(asked, asked) * _dot(near, near))
    found = _dot(asked, near)
    if metric == "cosine":
        return found / sizes, np.full(len(found), 2 * error)
    return found, error * sizes


def gamma(n: int, unit: float) -> float:
    """Return the relative error of a sum of n products, and of a few roundings around it."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total

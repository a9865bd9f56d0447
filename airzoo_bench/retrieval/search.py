"""The tiles that are most similar to queries: float32 finds candidates, float64 orders them.

Larger is more similar: q.g for `inner_product`, the same of normalised vectors for `cosine`, and
-|q - g|^2 / 2 for `l2`. A tile whose float32 similarity is below the k-th one by more than the
errors of both cannot be among the first k; all others are evaluated in float64. So no result
depends on the blocks that the gallery is read in.
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
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.settings import Metric

Names = Sequence[object] | NDArray[Any]
Singles = NDArray[np.float32]
Pairs = tuple[Ints, Ints, Ints]
"""Query, tile and level of pairs: of two, the smaller level comes first, equal ones tie."""

_BYTES_OF_A_PAIR = 256  # query, tile, similarities, and what sorting them takes
_SINGLE, _DOUBLE = 2.0**-24, 2.0**-53  # roundoff of float32 and float64
_TINY = 2.0**-126  # smallest normal float32
_LAMBDA = 10.0  # a sum has a larger error once in 10^21 times
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_LEAST_NORM, _MOST_NORM = 1e-15, 1e18  # squares of others underflow or overflow in float32
_CELLS = 1 << 19  # of one product
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_BLOCK_BYTES, _BLOCK_ROWS = 1 << 25, 1 << 15


@dataclass(frozen=True, eq=False)
class Search:
    """A gallery that is searched, and what the search may use."""

    gallery: NDArray[Any]  # (G, D), may be mapped
    longest: float  # the largest norm in it
    metric: Metric
    k: int  # how many tiles are sought, at most G
    memory_bytes: int  # bounds the working memory
    threads: int


def find_nearest(search: Search, queries: NDArray[Any]) -> Pairs | None:
    """Return pairs of queries and tiles that hold the k most similar tiles of each query.

    Every tile that ties with one of these is there. None is returned if the pairs of several
    queries do not fit the memory.
    """
    n_queries, n_tiles = len(queries), len(search.gallery)
    most_pairs = search.memory_bytes // _BYTES_OF_A_PAIR if n_queries > 1 else n_tiles
    if n_queries * search.k > most_pairs:
        return None
    if search.k == n_tiles:
        query, tile = np.divmod(np.arange(n_queries * n_tiles), max(n_tiles, 1))
    elif (found := _find_candidates(search, queries, most_pairs)) is not None:
        query, tile = found
    else:
        return None
    score, slack = _similarities(search, queries, query, tile)
    order = np.lexsort((-score, query))
    tied = np.diff(query[order]) == 0
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    level = np.zeros(len(order), np.int64)
    level[order[1:]] = np.cumsum(~tied)
    return query, tile, level


def _find_candidates(
    search: Search, queries: NDArray[Any], most_pairs: int
) -> tuple[Ints, Ints] | None:
    """Return query and tile of pairs that may be among the first k."""
    single, norms = _rounded(queries, search.metric)
    bounds = error_bounds(norms, search.longest, queries.shape[1], search.metric)
    n_queries, floors = len(queries), np.full((len(queries), 1), -np.inf, np.float32)
    kept = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.float32))]
    held = most_held = 0
    for start, rows in blocks(search.gallery, search.memory_bytes, _CELLS // n_queries):
        tiles, norms = _rounded(rows, search.metric)
        value = single @ tiles.T
        if search.metric == "l2":  # and -|q|^2 / 2, which orders nothing
            value -= (norms**2 / 2).astype(np.float32)
        place = np.flatnonzero(value >= floors)
        query, column = np.divmod(place, len(rows))
        kept.append((query, start + column, value.ravel()[place]))
        held += len(place)
        if held > most_held or start + len(rows) == len(search.gallery):
            kept = [_drop_low(kept, floors, bounds, search.k)]
            held = len(kept[0][0])
            most_held = held + n_queries * search.k
            if held > most_pairs:
                return None
    return kept[0][:2]


def _drop_low(
    kept: list[tuple[Ints, Ints, Singles]], floors: Singles, bounds: Floats, k: int
) -> tuple[Ints, Ints, Singles]:
    """Raise the floors (Q, 1) to the k-th similarity less the errors, and drop pairs below."""
    query, tile, value = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    # One whole number holds query and value: its sort is ten times as fast as one by both.
    keys, counts = np.sort((query << 32) + _flipped(value.view(np.int32))), np.bincount(query)
    some = np.flatnonzero(counts >= k)
    kth = keys[np.cumsum(counts)[some] - k] - (some << 32)
    kth = _flipped(kth.astype(np.int32)).view(np.float32)
    floors[some, 0] = np.nextafter((kth - 2 * bounds[some]).astype(np.float32), np.float32(-np.inf))
    high = value >= floors[query, 0]
    return query[high], tile[high], value[high]


def _flipped(bits: NDArray[np.int32]) -> NDArray[np.int32]:
    """Turn the bits of float32 into whole numbers in the same order, and back."""
    return np.asarray(bits ^ (bits >> 31 & 0x7FFFFFFF), np.int32)


def _rounded(rows: NDArray[Any], metric: Metric) -> tuple[Singles, Floats]:
    """Round descriptors to float32, and return their norms, nearly; cosine makes these 1."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        single = np.ascontiguousarray(rows, dtype=np.float32)
        norms = np.sqrt(np.vecdot(single, single).astype(np.float64))
    if metric != "cosine":
        return single, norms
    return single / norms.astype(np.float32)[:, None], np.ones(len(norms))


def error_bounds(norms: Floats, longest: float, n: int, metric: Metric) -> Floats:
    """Bound the error of every similarity in float32, for tiles of norms up to `longest`."""
    longest = 1.0 if metric == "cosine" else longest
    bound = 2 * _gamma(n, _SINGLE) * norms * longest
    if metric == "l2":
        bound = _gamma(n, _SINGLE) * (norms + longest) ** 2 / 2
    return np.asarray(bound + n * _TINY * (1 + norms + longest))


def _gamma(n: int, unit: float) -> float:
    """Return the relative error of a sum of n products, and of a few roundings around it."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _similarities(
    search: Search, queries: NDArray[Any], query: Ints, tile: Ints
) -> tuple[Floats, Floats]:
    """Return similarities of pairs in float64 and bounds of their errors.

    The order in which numbers are summed depends on the length of descriptors alone.
    """
    order = np.argsort(tile, kind="stable")  # by tile, as they lie in a file
    step = max(1, _PIECE_NUMBERS // max(queries.shape[1], 1))
    gallery, error = np.asarray(search.gallery), _gamma(queries.shape[1], _DOUBLE)
    score, slack = np.empty(len(query)), np.empty(len(query))

    def evaluate(start: int) -> None:
        some = order[start : start + step]
        asked, near = queries[query[some]], gallery[tile[some]]
        if search.metric == "l2":
            apart = np.subtract(asked, near, dtype=np.float64)
            sizes = _dot(apart, apart) / 2
            score[some] = -sizes
        else:
            asked, near = asked.astype(np.float64), near.astype(np.float64)
            score[some], sizes = _dot(asked, near), np.sqrt(_dot(asked, asked) * _dot(near, near))
            if search.metric == "cosine":
                score[some], sizes = score[some] / sizes, np.array(2.0)
        slack[some] = error * sizes

    with ThreadPoolExecutor(search.threads) as pool:
        for number, _ in enumerate(pool.map(evaluate, range(0, len(order), step))):
            if number % 64 == 0:
                _release_pages(search.gallery)
    return score, slack


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total


def blocks(
    rows: NDArray[Any], memory_bytes: int = 8 * _BLOCK_BYTES, most_rows: int = _BLOCK_ROWS
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yield (first row, rows) in order; pages of a map that were read leave the memory."""
    row_bytes = max(1, rows.shape[1] * max(rows.dtype.itemsize, 4))
    step = max(1, min(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, most_rows))
    for start in range(0, len(rows), step):
        yield start, np.asarray(rows[start : start + step])
        _release_pages(rows)


def _release_pages(rows: Any) -> None:
    """Let go of the pages of a mapped file, which count as memory of the process."""
    pages = getattr(rows, "_mmap", None)  # a copy in another process has none
    if pages is not None and rows.mode != "c" and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)


def check_descriptors(rows: NDArray[Any], metric: Metric, field: str, names: Names) -> float:
    """Refuse descriptors that cannot be ranked, by the names of their rows; return the top norm."""
    longest, least = 0.0, _LEAST_NORM if metric == "cosine" else 0.0
    for start, block in blocks(rows):
        norms = _rounded(block, "l2")[1]
        faulty = np.flatnonzero(~((norms >= least) & (norms <= _MOST_NORM)))  # also tells NaN
        if len(faulty):
            what = "descriptors that cannot be ranked (NaN, infinite, zero or far too large): "
            raise PredictionError(
                what + first_of([names[start + row] for row in faulty.tolist()]),
                where=f"field '{field}'",
                expected="finite numbers; for the cosine, of some length",
                fix="look for empty images, a division by zero or half precision",
            )
        longest = max(longest, float(norms.max(initial=0.0)))
    return longest

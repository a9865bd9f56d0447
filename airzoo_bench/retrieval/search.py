"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

Larger is more similar: q.g for `inner_product`, the same of normalised vectors for `cosine`, and
-|q - g|^2 / 2 for `l2`. The search keeps of each query every tile that its error bound cannot
exclude from the first k, and these are evaluated in float64. A query with too many of them (a
method that gives many tiles the same) is evaluated by itself, against the whole gallery. No result
depends on the blocks that the gallery is read in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.registry import resolve
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.predictions import Rows, in_windows
from airzoo_bench.retrieval.settings import Metric

Names = Sequence[object] | NDArray[Any]
Pairs = tuple[Ints, Ints, Ints]
"""Query, tile and level of pairs: of two, the smaller level comes first, equal ones tie."""

_SINGLE, _DOUBLE = 2.0**-24, 2.0**-53  # roundoff of float32 and float64
_TINY = 2.0**-126  # smallest normal float32
_SMALL = 1e-12  # norms below it are divided by in float64
_LAMBDA = 10.0
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_LEAST_SQUARE = 1e-25  # below, squares summed in float32 have lost digits to underflow
_MOST_NORM = 1e18  # beyond, products overflow in float32
_SPARE = 64  # candidates beyond 2k that a query may keep
_BYTES_OF_A_CANDIDATE = 64  # query, tile and value, and what sorting them takes
_BYTES_OF_A_PAIR = 256  # the same of a pair that is ordered
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_FEW = 256  # rows at a time in float64
_FAULTS = (
    ("NaN or infinite descriptors", "finite numbers"),
    ("descriptors too large to rank", "norms up to 1e18"),
    ("descriptors of zero", "a direction, to take its cosine"),
)


@dataclass(frozen=True, eq=False)
class Gallery:
    """Descriptors that are searched, and what the search may use."""

    rows: Rows
    metric: Metric
    k: int  # how many tiles are sought
    memory_bytes: int  # bounds the working memory
    jobs: int  # threads
    names: Names | None  # of the tiles, for messages

    @property
    def most(self) -> int:
        """How many candidates a query may keep."""
        return 2 * self.k + _SPARE

    def queries_at_a_time(self, row_bytes: int) -> int:
        """Return the number of queries for one call of `nearest`, by the bytes of a descriptor."""
        own = 2 * row_bytes + _BYTES_OF_A_CANDIDATE * self.most
        return max(64, self.memory_bytes // 2 // own)


@dataclass(frozen=True, eq=False)
class Queries:
    """Query descriptors (Q, D) as given, rounded to float32, and their norms.

    For cosine, float32 has them normalised, and norms are 1.
    """

    rows: NDArray[Any]
    single: NDArray[np.float32]
    norms: Floats

    @classmethod
    def prepare(cls, rows: NDArray[Any], metric: Metric, names: Names | None) -> Queries:
        """Check query descriptors, and round them."""
        norms, single = np.empty(len(rows)), as_float32(rows)
        parts = [slice(start, start + _FEW) for start in range(0, len(rows), _FEW)]
        for part in parts:
            norms[part] = exact_norms(rows[part])
        refuse_faults(faults_of(rows, norms, metric), "query_descriptors", names)
        if metric == "cosine":
            single = np.empty(rows.shape, np.float32)
            for part in parts:
                single[part] = normalised(rows[part])
            norms[:] = 1
        return cls(rows, single, norms)

    def take(self, some: slice | Ints) -> Queries:
        """Return some of them."""
        return Queries(self.rows[some], self.single[some], self.norms[some])

    def bounds(self, most: float, metric: Metric) -> Floats:
        """Bound the error of every similarity in float32, for tiles of norms up to `most`."""
        n, most = self.single.shape[1], 1.0 if metric == "cosine" else most
        bound = 2 * gamma(n, _SINGLE) * self.norms * most
        if metric == "l2":
            bound = gamma(n, _SINGLE) * (self.norms + most) ** 2 / 2
        return np.asarray(bound + n * _TINY * (1 + self.norms + most))


def nearest(
    gallery: Gallery, queries: Queries, caution: float = 1.0
) -> Iterator[tuple[Ints, Pairs]]:
    """Yield some queries at a time, and pairs of them and of tiles that hold their k most similar.

    Every tile that ties with one of these is there. `caution` is a factor of all error bounds.
    """
    value, tile, bounds = _search(gallery, queries, caution)
    kth = np.partition(value, gallery.most - gallery.k, axis=1)[:, gallery.most - gallery.k]
    floors = kth - 2 * bounds
    near: Bools = value >= floors[:, None]
    crowded: Bools = np.asarray(near.all(axis=1) & (gallery.most < len(gallery.rows)))
    query, column = np.nonzero(near & (tile >= 0) & ~crowded[:, None])
    value, tile = value[query, column], tile[query, column]
    score, slack = _similarities(gallery, queries, query, tile)
    worst = (np.abs(value - score) / bounds[query]).max(initial=0)
    if worst > 1:  # never seen; the bound holds with all but certainty
        yield from nearest(gallery, queries, caution * 4 * float(worst))
        return
    yield np.arange(len(bounds)), (query, tile, _levels(query, score, slack))
    crowd = np.flatnonzero(crowded)
    step = max(1, gallery.memory_bytes // (_BYTES_OF_A_PAIR * max(len(gallery.rows), 1)))
    for start in range(0, len(crowd), step):
        some = crowd[start : start + step]
        scores, slacks = _all_similarities(gallery, queries.take(some))
        query, tile = np.nonzero(scores >= floors[some, None])
        yield some, (query, tile, _levels(query, scores[query, tile], slacks[query, tile]))


def _search(
    gallery: Gallery, queries: Queries, caution: float
) -> tuple[NDArray[np.float32], Ints, Floats]:
    """Return similarities in float32 and tiles (Q, M) of the best, and bounds of their errors."""
    knn = resolve("faiss:knn")  # takes a while to import, which ranked ids do without
    measure = 1 if gallery.metric == "l2" else 0  # faiss.METRIC_L2, METRIC_INNER_PRODUCT
    shape = len(queries.norms), gallery.most
    value, tile, most = np.full(shape, -np.inf, np.float32), np.full(shape, -1, np.int64), 0.0
    faults = [np.zeros(0, np.int8)]
    for start, rows in gallery.rows.blocks(gallery.memory_bytes):
        single = as_float32(rows)
        norms = norms_of(rows, single)
        faults.append(faults_of(rows, norms, gallery.metric))
        if any(some.any() for some in faults) or not len(queries.norms):
            continue  # read on, to count them all
        if gallery.metric == "cosine":
            single = single / np.maximum(norms, _SMALL).astype(np.float32)[:, None]
            single[norms < _SMALL] = normalised(rows[norms < _SMALL])
        most = max(most, norms.max())
        found, near = knn(queries.single, single, min(gallery.most, len(rows)), measure)
        value = np.concatenate([value, found / -2 if measure else found], axis=1)
        tile = np.concatenate([tile, near + start], axis=1)
        best = np.argpartition(value, -gallery.most, axis=1)[:, -gallery.most :]
        value = np.take_along_axis(value, best, axis=1)
        tile = np.take_along_axis(tile, best, axis=1)
    refuse_faults(np.concatenate(faults), "gallery_descriptors", gallery.names)
    return value, tile, caution * queries.bounds(most, gallery.metric)


def _similarities(gallery: Gallery, queries: Queries, query: Ints, tile: Ints) -> Floats:
    """Return similarities of pairs in float64 and bounds of their errors (2, n)."""
    piece = _rows_a_piece(gallery)
    found = np.empty((2, len(query)))

    def evaluate(group: Ints) -> None:
        first = int(tile[group[0]])
        rows = gallery.rows.read(first, int(tile[group[-1]]) + 1)
        for start in range(0, len(group), piece):
            some = group[start : start + piece]
            asked = queries.rows[query[some]].astype(np.float64)
            near = rows[tile[some] - first].astype(np.float64)
            found[:, some] = similarity(asked, near, gallery.metric)

    with ThreadPoolExecutor(gallery.jobs) as pool:
        list(pool.map(evaluate, in_windows(tile, 4 * piece)))
    return found


def _all_similarities(gallery: Gallery, queries: Queries) -> Floats:
    """Return similarities of queries and all tiles in float64, and bounds of errors (2, Q, G)."""
    asked, piece = queries.rows.astype(np.float64), _rows_a_piece(gallery)
    found = np.empty((2, len(asked), len(gallery.rows)))

    def evaluate(start: int) -> None:
        near = gallery.rows.read(start, start + piece).astype(np.float64)
        for number, one in enumerate(asked):
            part = similarity(np.broadcast_to(one, near.shape), near, gallery.metric)
            found[:, number, start : start + piece] = part

    with ThreadPoolExecutor(gallery.jobs) as pool:
        list(pool.map(evaluate, range(0, len(gallery.rows), piece)))
    return found


def _rows_a_piece(gallery: Gallery) -> int:
    return max(16, _PIECE_NUMBERS // max(gallery.rows.shape[1], 1))


def _levels(query: Ints, score: Floats, slack: Floats) -> Ints:
    """Return the order of each query's pairs by falling score, equal where slack allows a tie."""
    order = np.lexsort((-score, query))
    tied = np.diff(query[order]) == 0
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    level = np.zeros(len(order), np.int64)
    level[order[1:]] = np.cumsum(~tied)
    return level


# --- descriptors as numbers ---


def as_float32(rows: NDArray[Any]) -> NDArray[np.float32]:
    """Round rows to float32; too large a number becomes infinite."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.ascontiguousarray(rows, dtype=np.float32)


def similarity(queries: Floats, gallery: Floats, metric: Metric) -> tuple[Floats, Floats]:
    """Return similarities of pairs, (n, D) and (n, D), and bounds of their errors.

    The order in which they are summed depends on D alone.
    """
    error = gamma(queries.shape[1], _DOUBLE)
    if metric == "l2":
        apart = queries - gallery
        found = -_dot(apart, apart) / 2
        return found, error * np.abs(found)
    if metric == "cosine":
        found = _dot(normalised(queries), normalised(gallery))
        return found, np.full(len(found), 2 * error)
    bound = error * np.sqrt(_dot(queries, queries) * _dot(gallery, gallery))
    return _dot(queries, gallery), bound


def gamma(n: int, unit: float) -> float:
    """Return the relative error of a sum of n products, and of a few roundings around it."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total


def normalised(rows: NDArray[Any]) -> Floats:
    """Divide rows by their norms."""
    scaled, _ = _scaled(rows)
    return np.asarray(scaled / np.sqrt(_dot(scaled, scaled))[:, None])


def _scaled(rows: NDArray[Any]) -> tuple[Floats, Ints]:
    """Divide rows by powers of two, which is exact, so that their squares do not underflow."""
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused elsewhere
        double = rows.astype(np.float64)
        _, exponents = np.frexp(np.abs(double).max(axis=1, initial=0.0))
        return np.ldexp(double, -exponents[:, None]), exponents


def exact_norms(rows: NDArray[Any]) -> Floats:
    """Return Euclidean norms in float64."""
    scaled, exponents = _scaled(rows)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused elsewhere
        return np.asarray(np.ldexp(np.sqrt(_dot(scaled, scaled)), exponents))


def norms_of(rows: NDArray[Any], single: NDArray[np.float32]) -> Floats:
    """Return norms, nearly; infinite or NaN where a number is, or where float32 overflows."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        squares = np.vecdot(single, single).astype(np.float64)
    norms: Floats = np.sqrt(squares)
    small = np.flatnonzero(squares < _LEAST_SQUARE)
    norms[small] = exact_norms(rows[small])
    return norms


def faults_of(rows: NDArray[Any], norms: Floats, metric: Metric) -> NDArray[np.int8]:
    """Return for each row which of `_FAULTS` it has, counted from 1; 0 where it can be ranked."""
    faults = np.where(norms <= _MOST_NORM, 0, 2).astype(np.int8)  # also tells NaN
    wild = np.flatnonzero(faults)
    faults[wild[~np.isfinite(rows[wild]).all(axis=1)]] = 1
    if metric == "cosine":
        faults[norms == 0] = 3
    return faults


def refuse_faults(faults: NDArray[np.int8], field: str, names: Names | None) -> None:
    """Refuse descriptors that have faults, by the names of their rows."""
    for number, (what, expected) in enumerate(_FAULTS, 1):
        rows = np.flatnonzero(faults == number).tolist()
        if rows:
            named = [f"row {row}" if names is None else names[row] for row in rows]
            raise PredictionError(
                f"{what}: {first_of(named, len(faults))}",
                where=f"field '{field}'",
                expected=expected,
                fix="export them again, and look for a division by zero or half precision",
            )


def points_one_way(rows: Rows, metric: Metric) -> bool:
    """Return whether all rows are equal, or under cosine multiples of one vector up to rounding.

    No ranking of such a gallery means anything.
    """
    first: Floats | None = None
    for start in range(0, len(rows), _FEW):
        with np.errstate(all="ignore"):  # what is not finite is near nothing, and refused elsewhere
            some = rows.read(start, start + _FEW).astype(np.float64)
            some = normalised(some) if metric == "cosine" else some
            first = some[:1] if first is None else first
            lost = 4 * float(np.finfo(rows.dtype).eps) if metric == "cosine" else 0.0
            if not (np.abs(some - first) <= lost * np.abs(first)).all():
                return False
    return len(rows) > 1

"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

The search keeps of each query every tile that its error bound cannot exclude from the first k, and
these are evaluated in float64. Queries with so many candidates that keeping them would not be
bounded (a method that gives many tiles the same) are evaluated against the whole gallery. No result
depends on the blocks that the gallery is read in: the bounds hold for whatever float32 values these
give.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.descriptors import (
    Metric,
    Names,
    Rows,
    as_float32,
    exact_norms,
    faults_of,
    gamma,
    in_windows,
    normalised,
    norms_of,
    refuse_faults,
    similarity,
)
from airzoo_bench.retrieval.truth import Positives

_UNIT = 2.0**-24  # roundoff of float32
_TINY = 2.0**-126  # smallest normal float32
_LEAST = 1 / float(np.finfo(np.float32).max)  # norms whose reciprocal float32 still holds
_SPARE = 64  # candidates beyond 2k that a query may keep
_BYTES_OF_A_CANDIDATE = 64  # query, tile and value, and what sorting them takes
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache
_FEW = 256  # queries at a time in float64

Candidates = tuple[Ints, Ints, Ints]
"""Query, tile and level of pairs: of two, the smaller level comes first, equal ones tie."""


@dataclass(frozen=True, eq=False)
class Gallery:
    """Descriptors that are searched, and what the search may use."""

    rows: Rows
    metric: Metric
    k: int  # how many tiles are sought
    memory_bytes: int  # bounds the working memory
    jobs: int  # threads
    names: Names | None  # of the tiles, for messages

    def queries_at_a_time(self, row_bytes: int) -> int:
        """Return the number of queries for one call of `nearest`, by the bytes of a descriptor."""
        own = 2 * row_bytes + _BYTES_OF_A_CANDIDATE * (2 * self.k + _SPARE)
        values = 4 * self.rows.block(self.memory_bytes)
        return max(64, min(self.memory_bytes // 2 // own, self.memory_bytes // 16 // values))


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
        if metric != "cosine":
            return cls(rows, single, norms)
        single = np.empty(rows.shape, np.float32)
        for part in parts:
            single[part] = normalised(rows[part])
        return cls(rows, single, np.ones(len(rows)))

    def take(self, some: slice | Ints) -> Queries:
        """Return some of them."""
        return Queries(self.rows[some], self.single[some], self.norms[some])

    def values(
        self, gallery: NDArray[np.float32], norms: Floats, metric: Metric
    ) -> NDArray[np.float32]:
        """Return the values (rows of the gallery, queries) that are searched by, in float32.

        They are similarities, for l2 without the half square of the query, which all tiles share.
        """
        values: NDArray[np.float32] = gallery @ self.single.T
        if metric == "l2":
            values -= (norms**2 / 2).astype(np.float32)[:, None]
        if metric == "cosine":
            # Where float32 cannot hold the reciprocal, the bound excludes nothing anyway.
            values *= (1 / np.maximum(norms, _LEAST)).astype(np.float32)[:, None]
        return values

    def bounds(self, least: float, most: float, metric: Metric) -> Floats:
        """Bound the error of every query's values, for tiles of norms from least to most."""
        n = self.single.shape[1]
        error = gamma(n, _UNIT)
        if metric == "cosine":
            # Twice: once for q.g, and at most once for the norm of g.
            return np.full(len(self.norms), 2 * error + n * _TINY * (1 + 1 / max(least, _LEAST)))
        bound: Floats = error * self.norms * most + n * _TINY * (1 + self.norms + most)
        return bound + error * most**2 / 2 if metric == "l2" else bound


def nearest(
    gallery: Gallery, queries: Queries, positives: Positives, caution: float = 1.0
) -> tuple[Candidates, Ints]:
    """Find pairs that hold the k most similar tiles of each query, and all that tie with them.

    Of a tie that crosses rank k all positives are there, and of its other tiles those of least
    index as far as k reaches. Also returns the queries for which the whole gallery ties. Bounds
    of errors are multiplied by `caution`.
    """
    kept, bounds = _search(gallery, queries, caution)
    score, slack = _similarities(gallery, gallery.rows, queries, kept.query, kept.tile)
    shared = queries.norms[kept.query] ** 2 / 2 if gallery.metric == "l2" else 0.0
    errors = np.abs(kept.value - (score + shared)) / bounds[kept.query]
    if (worst := errors.max(initial=0)) > 1:  # never seen; the bound holds with all but certainty
        return nearest(gallery, queries, positives, caution * 4 * float(worst))
    level, n_tiles = _levels(kept.query, score, slack), len(gallery.rows)
    whole = np.bincount(kept.query, minlength=len(bounds)) == n_tiles
    levels = level[whole[kept.query]].reshape(int(whole.sum()), n_tiles)
    flat = np.flatnonzero(whole)[(levels == levels[:, :1]).all(axis=1)]
    parts = [((kept.query, kept.tile, level), flat)]
    parts += _evaluate_crowds(gallery, queries, positives, kept, bounds)
    found, flats = zip(*parts, strict=True)
    query, tile, level = (np.concatenate(column) for column in zip(*found, strict=True))
    return (query, tile, level), np.concatenate(flats)


class _Kept:
    """The candidates of n queries: every tile so far that may be among the first k."""

    def __init__(self, n: int, k: int) -> None:
        self.k, self.most = k, 2 * k + _SPARE
        self.kth: Floats = np.full(n, -np.inf)  # the k-th best value, -inf before there are k
        self.crowded: Bools = np.zeros(n, np.bool_)  # queries that have too many to keep any
        self.query: Ints = np.zeros(0, np.int64)  # the candidates, with tile and value
        self.tile: Ints = np.zeros(0, np.int64)
        self.value: NDArray[np.float32] = np.zeros(0, np.float32)

    def absorb(self, values: NDArray[np.float32], start: int, bounds: Floats) -> None:
        """Take in the values (B, n) of the tiles from `start` on."""
        hits: Bools = values >= self._floors(bounds)
        many = np.flatnonzero(np.count_nonzero(hits, axis=0) > self.most)
        if len(many):  # they alone are enough to hold a better k-th value
            there = len(values) - self.k
            best = np.partition(values[:, many], there, axis=0)[there]
            self.kth[many] = np.maximum(self.kth[many], best)
            hits[:, many] = values[:, many] >= self._floors(bounds)[many]
            self.crowded[many] |= np.count_nonzero(hits[:, many], axis=0) > self.most
            hits[:, self.crowded] = False
        row, query = np.nonzero(hits)
        self._add(query, row + start, values[row, query])
        self.prune(bounds)

    def prune(self, bounds: Floats) -> None:
        """Drop what cannot be among the first k, and queries that keep too much even so."""
        kept = self.value >= self._floors(bounds)[self.query]
        counts = np.bincount(self.query[kept], minlength=len(self.kth))
        self.crowded |= counts > self.most
        kept &= ~self.crowded[self.query]
        self.query, self.tile, self.value = self.query[kept], self.tile[kept], self.value[kept]

    def _floors(self, bounds: Floats) -> NDArray[np.float32]:
        return rounded_down(np.where(self.crowded, np.inf, self.kth - 2 * bounds))

    def _add(self, query: Ints, tile: Ints, value: NDArray[np.float32]) -> None:
        """Add candidates, sorted by query, and raise the k-th best values."""
        query = np.concatenate([self.query, query])
        order = np.argsort(query, kind="stable")
        self.query, self.tile = query[order], np.concatenate([self.tile, tile])[order]
        self.value = np.concatenate([self.value, value])[order]
        counts = np.bincount(query, minlength=len(self.kth))
        width = counts.max(initial=0)
        if width >= self.k:
            column = np.arange(len(order)) - (np.cumsum(counts) - counts)[self.query]
            table = np.full((len(self.kth), width), -np.inf, np.float32)
            table[self.query, column] = self.value
            best = np.partition(table, width - self.k, axis=1)[:, width - self.k]
            self.kth = np.maximum(self.kth, best)


def rounded_down(values: Floats) -> NDArray[np.float32]:
    """Round to float32 so that no value grows; at the very least one step down."""
    return np.nextafter(values.astype(np.float32), np.float32(-np.inf))


def _search(gallery: Gallery, queries: Queries, caution: float) -> tuple[_Kept, Floats]:
    """Search in float32; also return every query's bound, for the norms of the gallery."""
    n_queries = len(queries.norms)
    kept, faults = _Kept(n_queries, gallery.k), [np.zeros(0, np.int8)]
    least, most, bounds = np.inf, 0.0, np.zeros(n_queries)
    for start, rows in gallery.rows.blocks(gallery.memory_bytes):
        single = as_float32(rows)
        norms = norms_of(rows, single)
        faults.append(faults_of(rows, norms, gallery.metric))
        if any(some.any() for some in faults):
            continue  # read on, to count them all
        least, most = min(least, norms.min()), max(most, norms.max())
        bounds = caution * queries.bounds(least, most, gallery.metric)
        kept.absorb(queries.values(single, norms, gallery.metric), start, bounds)
    refuse_faults(np.concatenate(faults), "gallery_descriptors", gallery.names)
    kept.prune(bounds)
    return kept, bounds


def _similarities(
    gallery: Gallery, source: Rows, queries: Queries, query: Ints, tile: Ints
) -> Floats:
    """Return similarities in float64 and bounds of their errors (2, n), reading needed rows."""
    piece = max(16, _PIECE_NUMBERS // max(source.shape[1], 1))
    found = np.empty((2, len(query)))

    def evaluate(group: Ints) -> None:
        first = int(tile[group[0]])
        rows = source.read(first, int(tile[group[-1]]) + 1)
        for start in range(0, len(group), piece):
            some = group[start : start + piece]
            asked = queries.rows[query[some]].astype(np.float64)
            near = rows[tile[some] - first].astype(np.float64)
            found[:, some] = similarity(asked, near, gallery.metric)

    with ThreadPoolExecutor(gallery.jobs) as pool:
        list(pool.map(evaluate, in_windows(tile, 4 * piece)))
    return found


def _levels(query: Ints, score: Floats, slack: Floats) -> Ints:
    """Return the order of each query's pairs by falling score, equal where slack allows a tie."""
    order = np.lexsort((-score, query))
    tied = np.diff(query[order]) == 0
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    level = np.zeros(len(order), np.int64)
    level[order[1:]] = np.cumsum(~tied)
    return level


def _evaluate_crowds(
    gallery: Gallery, queries: Queries, positives: Positives, kept: _Kept, bounds: Floats
) -> Iterator[tuple[Candidates, Ints]]:
    """Evaluate every tile that the search could not exclude, of some crowded queries at a time."""
    crowd, n_tiles = np.flatnonzero(kept.crowded), len(gallery.rows)
    step = max(1, gallery.memory_bytes // 8 // (16 * max(n_tiles, 1)))
    for start in range(0, len(crowd), step):
        some = crowd[start : start + step]
        floors = rounded_down(kept.kth[some] - 2 * bounds[some])
        scores, slacks = _whole_gallery(gallery, queries.take(some), floors)
        for query, score, slack in zip(some.tolist(), scores, slacks, strict=True):
            tile = np.flatnonzero(score > -np.inf)
            level = _levels(np.zeros(len(tile), np.int64), score[tile], slack[tile])
            positive = np.isin(tile, positives.of_query(query))
            best = np.lexsort((tile, positive, level))
            first = best[(np.arange(len(best)) < gallery.k) | positive[best]]
            flat = len(tile) == n_tiles and not level.any()
            pairs = np.full(len(first), query), tile[first], level[first]
            yield pairs, np.full(int(flat), query)


def _whole_gallery(gallery: Gallery, queries: Queries, floors: NDArray[np.float32]) -> Floats:
    """Return similarities in float64, -inf below the floors, and bounds of errors (2, Q, tiles)."""
    found = np.zeros((2, len(floors), len(gallery.rows)))
    for start, rows in gallery.rows.blocks(gallery.memory_bytes):
        # Equal rows, the usual cause of a crowd, are evaluated once.
        whole = np.ascontiguousarray(rows).view((np.void, rows.shape[1] * rows.itemsize))
        first, same = np.unique(whole[:, 0], return_index=True, return_inverse=True)[1:]
        single = as_float32(rows[first])
        values = queries.values(single, norms_of(rows[first], single), gallery.metric)
        row, query = np.nonzero(values >= floors)
        part = np.full((2, len(floors), len(first)), -np.inf)
        unique = Rows.join(rows[first])
        part[:, query, row] = _similarities(gallery, unique, queries, query, row)
        found[:, :, start : start + len(same)] = part[:, :, same]
    return found

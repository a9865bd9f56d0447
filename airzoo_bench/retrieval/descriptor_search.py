"""Exact nearest neighbours: a search in float32, and float64 where that cannot tell.

The gallery is cut into shards, each searched by itself (`shard_search`), which keeps of each query
every tile that its error bound cannot exclude from the first k. What the shards kept is put
together, and pruned by what all of them know. Of what is left, tiles closer to each other than
twice the bound form a cluster, and only clusters of several tiles are evaluated in float64. Queries
with so many candidates that keeping them would not be bounded (a scorer that gives every tile the
same) are evaluated tile by tile instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from airzoo_bench.engines.engine import Engine
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.candidate_search import Search
from airzoo_bench.retrieval.descriptor_rows import Rows
from airzoo_bench.retrieval.one_way import direction
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.shard_search import (
    Arrays,
    Crowd,
    Pairs,
    Request,
    Shard,
    joined,
    points_like,
    score_crowd,
    score_pairs,
    search_shard,
)
from airzoo_bench.retrieval.similarity import Names, refuse_unusable

__all__ = ["Candidates", "Gallery", "nearest"]

S = TypeVar("S")
T = TypeVar("T", Shard, Pairs)

_SHARD_BYTES = 1 << 28
_SENT_BYTES = 1 << 25  # of a shard that is in no file, and so is sent to the worker
_SHARD_WORK = 1 << 37  # products, and for each pair what looking at it costs: seconds of a core
_LOOK = 100
_CROWD = ("query", "tile", "score", "slack")
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
class Gallery:
    """The gallery's rows, cut into shards, and where the work on them is done."""

    rows: Rows
    shards: tuple[Shard, ...]
    engine: Engine
    names: Names | None

    @classmethod
    def of(cls, rows: Rows, n_queries: int, engine: Engine, names: Names | None) -> Gallery:
        """Cut a gallery into shards that take no long time for so many queries."""
        width = max(1, rows.shape[1])
        most = _SHARD_BYTES if rows.by_reference else _SENT_BYTES
        work = (width + _LOOK) * max(1, n_queries)
        size = min(most // (width * rows.itemsize), _SHARD_WORK // work)
        cuts = engine.cut(len(rows), max(1, size))
        shards = tuple(Shard(cut.start, rows.part(cut.start, cut.stop)) for cut in cuts)
        return cls(rows, shards, engine, names)

    def __len__(self) -> int:
        return len(self.rows)

    def points_one_way(self, request: Request) -> bool:
        """Whether all rows are the same, or under cosine multiples of one as far as stored."""
        if len(self) < 2 or not self.rows.shape[1]:
            return False
        metric = request.queries.metric
        shared = direction(self.rows.read(0, 1), metric), metric, request.block(self.rows) // 8 or 1
        # Hardly any gallery does: its first shard tells, and the others need not be read.
        return all(
            bool(found["one_way"].all())
            for shards in (self.shards[:1], self.shards[1:])
            for found in self.map(points_like, shards, shared, "shards compared")
        )

    def map(
        self, work: Callable[[S, T], Arrays], items: Sequence[T], shared: S, stage: str
    ) -> Iterator[Arrays]:
        """Do work on shards; see `Engine.map`."""
        return self.engine.map(work, items, shared=shared, stage=stage, name=_name)

    def scores(self, request: Request, query: Ints, tile: Ints) -> tuple[Floats, Floats]:
        """Similarities in float64 of pairs and their errors."""
        order = np.argsort(tile, kind="stable")
        ends = [(shard.start, shard.start + len(shard.rows)) for shard in self.shards]
        groups = [order[slice(*np.searchsorted(tile[order], run))] for run in ends]
        some = [pair for pair in zip(groups, self.shards, strict=True) if len(pair[0])]
        pairs = [Pairs(shard, query[group], tile[group] - shard.start) for group, shard in some]
        scores, slacks = np.empty(len(query)), np.empty(len(query))
        found = self.map(score_pairs, pairs, request, "shards evaluated")
        for (group, _), part in zip(some, found, strict=True):
            scores[group], slacks[group] = part["score"], part["slack"]
        return scores, slacks


def _name(item: Shard | Pairs) -> str:
    return item.name if isinstance(item, Shard) else item.shard.name


def nearest(gallery: Gallery, request: Request, positives: Positives) -> Candidates:
    """Find the pairs that hold the k most similar tiles of each query, and all that tie with them.

    Where a tie crosses rank k, its positives are there, and of its other tiles those of least
    index as far as k reaches.

    Raises
    ------
    PredictionError
        Where the gallery's descriptors cannot be ranked.
    """
    while True:
        merged, bounds = _searched(gallery, request)
        found, worst = _evaluated(gallery, request, merged, bounds)
        if worst <= 1:
            break
        # Never seen; the bound holds with all but certainty.
        request = replace(request, caution=request.caution * 4 * worst)
    parts = [found, *_exhausted(gallery, request, merged, bounds, positives)]
    names = ("query", "tile", "cluster", "score", "flat")
    return Candidates(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


def _searched(gallery: Gallery, request: Request) -> tuple[Search, Floats]:
    """Search all shards; also give every query's bound, for the greatest norm of the gallery."""
    n = len(request.queries.norms)
    merged, bounds, norms = Search.of(slice(0, n), request.k), np.zeros(n), np.array([np.inf, 0.0])
    faults = []
    for found in gallery.map(search_shard, gallery.shards, request, "shards searched"):
        faults.append({name: found[name] for name in ("wild", "broken", "zero")})
        if any(len(some) for some in faults[-1].values()):
            continue
        least, most = found["norms"]
        norms = np.array([min(norms[0], least), max(norms[1], most)])
        bounds = request.bounds(*norms)
        kept = (found[name] for name in ("kth", "crowded", "top", "query", "tile", "value"))
        merged.merge(Search(merged.part, request.k, *kept), bounds)
    if faults:
        refuse_unusable(joined(faults), len(gallery), "gallery_descriptors", gallery.names)
    merged.settle(bounds)
    return merged, bounds


def _evaluated(
    gallery: Gallery, request: Request, search: Search, bounds: Floats
) -> tuple[Candidates, float]:
    """Form clusters of candidates that the search cannot tell apart, and evaluate these."""
    order = np.lexsort((-search.value, search.query))
    query, tile = search.query[order], search.tile[order]
    value, bound = search.value[order].astype(np.float64), bounds[query]
    best = np.diff(query, prepend=-1) != 0
    opens = best | (-np.diff(value, prepend=0) > 2 * bound)
    cluster = np.cumsum(opens)
    several = np.bincount(cluster, minlength=1)[cluster] > 1
    doubtful = np.flatnonzero(best | several)
    score, slack = np.zeros(len(query)), np.zeros(len(query))
    score[doubtful], slack[doubtful] = gallery.scores(request, query[doubtful], tile[doubtful])
    exact = request.queries.searched(query[doubtful], score[doubtful])
    error = np.abs(value[doubtful] - exact) / bound[doubtful]
    score = _with_ties(query, cluster, score, slack)
    flat = _all_tied(query, cluster, score, len(gallery))
    return Candidates(query, tile, cluster, score, flat), float(error.max(initial=0))


def _all_tied(query: Ints, cluster: Ints, score: Floats, n_tiles: int) -> Ints:
    """Find the queries all of whose tiles are in one tie; pairs are in the order of clusters."""
    changes = (np.diff(query) == 0) & ((np.diff(cluster) != 0) | (np.diff(score) != 0))
    several = np.zeros(int(query.max(initial=-1)) + 1, bool)
    several[query[1:][changes]] = True
    flat: Ints = np.flatnonzero((np.bincount(query) == n_tiles) & ~several)
    return flat


def _exhausted(
    gallery: Gallery, request: Request, search: Search, bounds: Floats, positives: Positives
) -> list[Candidates]:
    """Evaluate in float64 every tile that the search could not exclude, some queries at a time."""
    step = max(1, request.memory_bytes // 8 // (_BYTES_OF_AN_ENTRY * request.block(gallery.rows)))
    queries = np.flatnonzero(search.crowded)
    waiting = [queries[start : start + step] for start in range(0, len(queries), step)][::-1]
    found: list[Candidates] = []
    while waiting:
        some = waiting.pop()
        floors = search.kth[some] - 2 * bounds[some]
        part = replace(request, queries=request.queries.part(some))
        crowd = Crowd(part, floors, positives.take(some), len(gallery))
        scores = _crowd_scores(gallery, crowd)
        if scores is None:
            waiting += [some[len(some) // 2 :], some[: len(some) // 2]]
        else:
            found += _first_of_crowd(crowd, some, scores)
    return found


def _crowd_scores(gallery: Gallery, crowd: Crowd) -> Arrays | None:
    """Evaluate some queries against all shards; None where they have too many tiles together."""
    n = len(crowd.floors)
    kept: list[Arrays] = []
    count = np.zeros(n, np.int64)
    for found in gallery.map(score_crowd, gallery.shards, crowd, "shards evaluated whole"):
        if len(found["count"]) < n:
            return None
        count += found["count"]
        kept = [crowd.reduced(joined([*kept, {name: found[name] for name in _CROWD}]))]
        if n > 1 and len(kept[0]["query"]) > crowd.most:
            return None
    return kept[0] | {"count": count}


def _first_of_crowd(crowd: Crowd, queries: Ints, found: Arrays) -> Iterator[Candidates]:
    order = np.argsort(found["query"], kind="stable")
    ends = np.searchsorted(found["query"][order], np.arange(1, len(queries)))
    for row, some in enumerate(np.split(order, ends)):
        score, flat = found["score"][some], found["count"][row] == crowd.n_tiles
        here, tile = np.full(len(some), queries[row]), found["tile"][some]
        score = _with_ties(here, here, score, found["slack"][some])
        positive = np.isin(tile, crowd.positives.of(row))
        best = np.lexsort((tile, positive, -score))
        kept = best[(np.arange(len(best)) < crowd.request.k) | positive[best]]
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

"""The gallery of a scene, ranked for each of its queries, with ties broken against the submitter.

Tiles that tie are ordered non-positive first, then by their row in the gallery table (which is
sorted by id), so that a method gains nothing by giving equal scores. A query whose whole gallery
ties, as it does with a descriptor of zeros, has no ranking: none of its tiles has a rank, unless
all are positive. Queries are ranked in blocks, and scored as they come.

Of descriptors, larger is more similar: q.g for `inner_product`, the same of normalised vectors for
`cosine`, and -|q - g|^2 / 2 for `l2`. A tile whose float32 similarity is below the k-th one by more
than the errors of both cannot be among the first k; all others are evaluated in float64. So no
result depends on the blocks that the gallery is read in.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.engines.engine import split
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.arrays import release_pages, row_blocks, rows_among, temporary_array
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.settings import ImageScoring, Metric, TileScoring
from airzoo_bench.retrieval.truth import Positives, RetrievalTruth, offsets_of

Singles = NDArray[np.float32]

_CELLS = 1 << 20  # ranks at a time
_MOST_QUERIES = 4096  # of one search
_SENT_QUERIES = 256  # at a time to another process
_PAIR_BYTES = 256  # query, tile, similarities, and what sorting them takes
_SINGLE, _DOUBLE = 2.0**-24, 2.0**-53  # roundoff of float32 and float64
_TINY = 2.0**-126  # smallest normal float32
_LAMBDA = 10.0  # a sum has a larger error once in 10^21 times
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_LEAST_NORM, _MOST_NORM = 1e-15, 1e18  # squares of others underflow or overflow in float32
_PRODUCT_CELLS = 1 << 19
_PIECE_NUMBERS = 1 << 17  # of descriptors at a time in float64; stays in the cache


class Ranking(NamedTuple):
    """The gallery of each query, best first.

    A query is tie-dependent where a tie that begins among the ranks that decide scores holds a
    positive and another tile.
    """

    tiles: NDArray[np.int32]  # (Q, K) rows of the gallery table; -1 where there are no more
    tie_dependent: Bools  # (Q,)

    @classmethod
    def blank(cls, n_queries: int, k: int) -> Ranking:
        """Return one without any tile."""
        return cls(np.full((n_queries, k), -1, np.int32), np.zeros(n_queries, np.bool_))

    def clear_tied(self, rows: Ints, positives: Positives, n_tiles: int) -> None:
        """Remove the tiles of queries whose whole gallery ties, unless all are positive."""
        some = rows[positives.counts[rows] < n_tiles] if n_tiles >= 2 else rows[:0]
        self.tiles[some] = -1
        self.tie_dependent[some] = positives.counts[some] > 0


class Depths(NamedTuple):
    """How deep a gallery of `n_tiles` is ranked."""

    n_tiles: int
    k: int  # ranks that are kept
    scored: int  # ranks of recall and AP; a tie that begins later does not count


RankedBlocks = Iterator[tuple[Ints, Ranking]]
"""Blocks of queries by their numbers, and how each ranks the gallery."""


def rank_scene(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    settings: TileScoring | ImageScoring,
    run: Run,
) -> RankedBlocks:
    """Rank the gallery for the queries of a scene, which the predictions answer in these rows.

    The row is -1 for queries that they lack, which rank no tile.
    """
    content, there = predictions.content, np.flatnonzero(rows >= 0)
    names, tiles = predictions.query_ids[rows[there]], truth.tiles["id"].to_numpy(str)
    positives, depths = truth.positives.take(there), Depths(*[len(tiles)] * 3)
    if isinstance(settings, TileScoring):  # of images whole lists are scored
        k, scored = min(settings.ranks_kept, len(tiles)), max(*settings.recall_at, settings.ap_at)
        depths = Depths(len(tiles), k, scored)
    if isinstance(content, RankedIds):
        found = _rank_lists(content, names, rows[there], truth, positives, depths)
    else:
        queries = content.queries[rows[there]]
        gallery = _scene_gallery(content.gallery, content.gallery_ids, truth)
        metric, ids = settings.descriptor_metric, (names, tiles)
        found = rank_by_descriptors(queries, gallery, metric, positives, depths, run, ids)
    yield from ((there[part], ranking) for part, ranking in found)
    lacking = np.flatnonzero(rows < 0)
    for part in split(len(lacking), max(1, _CELLS // depths.k)):
        yield lacking[part], Ranking.blank(len(lacking[part]), 1)


def _order_pairs(
    query: Ints, tile: Ints, group: Ints, positives: Positives, depths: Depths
) -> Ranking:
    """Rank queries by pairs of query and tile; a smaller group comes first, one group ties."""
    positive = positives.holds(query, tile, depths.n_tiles)
    order = np.lexsort((tile, positive, group, query))
    query, tile, group, positive = query[order], tile[order], group[order], positive[order]
    n_queries, place = len(positives.counts), np.arange(len(order))
    counts = np.bincount(query, minlength=n_queries)
    rank = place - offsets_of(counts)[query]
    tied = (np.diff(query) == 0) & (np.diff(group) == 0)
    opens = np.concatenate([[True], ~tied])[: len(order)]
    begins = rank - (place - np.maximum.accumulate(np.where(opens, place, 0)))
    mixed = tied & ~positive[:-1] & positive[1:] & (begins[1:] < depths.scored)
    ranking = Ranking.blank(n_queries, depths.k)
    ranking.tie_dependent[query[1:][mixed]] = True
    first = rank < depths.k
    ranking.tiles[query[first], rank[first]] = tile[first]
    groups = np.bincount(query[opens], minlength=n_queries)
    all_tied = np.flatnonzero((counts == depths.n_tiles) & (groups == 1))
    ranking.clear_tied(all_tied, positives, depths.n_tiles)
    return ranking


# --- ranked lists ---


def rank_by_ids(
    ranked: NDArray[np.integer[Any]],
    scores: NDArray[np.floating[Any]] | None,
    positives: Positives,
    depths: Depths,
) -> Ranking:
    """Take lists (Q, K) of tiles as given, and reorder runs of equal scores.

    A run at the end of a list that is shorter than the gallery ties with what was left out.
    """
    n_tiles, k, scored = depths
    if scores is None or ranked.size == 0:
        return Ranking(ranked[:, :k].astype(np.int32), np.zeros(len(ranked), np.bool_))
    ranking = Ranking.blank(len(ranked), k)
    ranking.tiles[:, : ranked.shape[1]] = ranked[:, :k]
    tied = (scores[:, 1:] == scores[:, :-1]) & (ranked[:, 1:] >= 0)
    some = np.flatnonzero(tied.any(axis=1))
    listed, right = ranked[some].astype(np.int64), positives.take(some)
    opens = np.concatenate([np.ones((len(some), 1), np.bool_), ~tied[some]], axis=1)
    begins = np.maximum.accumulate(np.where(opens, np.arange(ranked.shape[1]), 0), axis=1)
    length = np.count_nonzero(listed >= 0, axis=1)
    last = begins[np.arange(len(some)), length - 1]  # where the last run begins
    row, column = np.nonzero(listed >= 0)
    pairs = [(row, listed[row, column], begins[row, column])]
    left_out = np.zeros(len(some), np.bool_)
    for one in np.flatnonzero((length - last > 1) & (length < n_tiles)).tolist():
        tiles, answers, start = listed[one, : length[one]], right.tiles_of(one), last[one]
        # Of those left out, k that are not positive are enough to fill the ranks.
        others = np.arange(min(n_tiles, k + len(tiles) + len(answers)))
        others = np.setdiff1d(others, np.concatenate([tiles, answers]), assume_unique=True)[:k]
        pairs.append((np.full(len(others), one), others, np.full(len(others), start)))
        # Positives that are left out are not found, whatever the order of the tie.
        is_mixed = len(others) > 0 or not np.isin(tiles[start:], answers).all()
        left_out[one] = start < scored and is_mixed and not np.isin(answers, tiles).all()
    query, tile, group = (np.concatenate(column) for column in zip(*pairs, strict=True))
    found = _order_pairs(query, tile, group, right, depths)
    found.tie_dependent[left_out] = True
    found.clear_tied(np.flatnonzero((last == 0) & (length > 1)), right, n_tiles)
    ranking.tiles[some], ranking.tie_dependent[some] = found
    return ranking


def _rank_lists(
    ranked: RankedIds,
    names: NDArray[np.str_],
    rows: NDArray[np.intp],
    truth: RetrievalTruth,
    positives: Positives,
    depths: Depths,
) -> RankedBlocks:
    """Rank queries by the lists of these rows."""
    known, k = truth.tiles["id"].to_numpy(str), depths.k
    for part in split(len(rows), max(1, _CELLS // max(k, ranked.ids.shape[1]))):
        ids, scores, width = ranked.ids[rows[part]], None, k
        if ranked.scores is not None:  # the ties that go on beyond rank k matter too
            scores = ranked.scores[rows[part]]
            on = (scores[:, k:] == scores[:, k - 1 : -1]) & (ids[:, k:] != "")
            width = k + int(np.logical_and.accumulate(on, axis=1).sum(axis=1).max(initial=0)) + 1
            scores = scores[:, :width]
        ids = ids[:, :width]
        tiles = rows_among(ids.ravel(), known).reshape(ids.shape)
        strange = (tiles < 0) & (ids != "")
        if strange.any():
            named, tile = names[part][strange.any(axis=1)], str(ids[strange][0])
            raise PredictionError(
                f"tiles that are not in the gallery of scene {truth.scene}, such as {tile!r}, in "
                f"the lists of {first_of(named, noun='query')}",
                where="field 'ranked_ids'",
                expected=f"ids of the query's own scene, such as {known[0]}, no file's ending",
                fix="cut the gallery by the protocol's sizes, or take ids from tiles.parquet",
            )
        some = np.arange(part.start, part.stop)
        yield some, rank_by_ids(tiles, scores, positives.take(some), depths)


# --- descriptors ---


def _scene_gallery(
    gallery: NDArray[Any], given: NDArray[np.str_], truth: RetrievalTruth
) -> NDArray[Any]:
    """Return the descriptors of the scene's tiles, in the tiles' order."""
    ids = truth.tiles["id"].to_numpy(str)
    rows = rows_among(ids, given)
    if (lacking := ids[rows < 0]).size:
        raise PredictionError(
            f"lacks descriptors of tiles of scene {truth.scene}: {first_of(lacking, len(ids))}",
            where="field 'gallery_ids'",
            expected="every tile of the gallery: leaving some out would make the task easier",
            fix="describe all tiles of tiles.parquet; of runs a scene, name the folder of all",
        )
    if (np.diff(rows) == 1).all():
        return gallery[rows[0] : rows[0] + len(rows)]
    ordered = temporary_array((len(rows), gallery.shape[1]), gallery.dtype)
    for part in split(len(rows), max(1, _CELLS // gallery.shape[1])):
        ordered[part] = gallery[rows[part]]
        release_pages(gallery)
        release_pages(ordered)
    return ordered


@dataclass(frozen=True, eq=False)
class _Search:
    """Queries, the gallery that is searched for them, and what the search may use."""

    queries: NDArray[Any]  # (Q, D)
    gallery: NDArray[Any]  # (G, D), may be mapped
    norms: tuple[Floats, Floats]  # of both, nearly
    metric: Metric
    depths: Depths
    memory_bytes: int  # bounds the working memory
    threads: int


def rank_by_descriptors(
    queries: NDArray[Any],
    gallery: NDArray[Any],
    metric: Metric,
    positives: Positives,
    depths: Depths,
    run: Run,
    names: tuple[Any, Any],
) -> RankedBlocks:
    """Rank the gallery by descriptors, exactly as float64 has it; `names` are of both sides."""
    all_tied = np.asarray((queries == 0).all(axis=1))
    asked = queries[~all_tied] if all_tied.any() else queries
    own = _measure_norms(asked, metric, "query_descriptors", np.asarray(names[0])[~all_tied])
    norms = own, _measure_norms(gallery, metric, "gallery_descriptors", names[1])
    if len(gallery) > 1 and all((b == gallery[0]).all() for _, b in row_blocks(gallery, 1 << 20)):
        all_tied[:] = True
    most = min(_SENT_QUERIES if run.engine.distributed else _MOST_QUERIES, _CELLS // depths.k + 1)
    most = min(most, max(64, run.memory_bytes // (32 * queries.shape[1] + 1)))
    rows, tied = np.flatnonzero(~all_tied), np.flatnonzero(all_tied)
    parts = split(len(rows), most)
    found = run.engine.map(
        _rank_part,
        [(part, positives.take(rows[part])) for part in parts],
        shared=_Search(asked, gallery, norms, metric, depths, run.memory_bytes, run.jobs),
        stage="queries ranked",
        name=lambda _: "some queries",
    )
    yield from zip((rows[part] for part in parts), found, strict=True)
    for some in (tied[part] for part in split(len(tied), most)):
        ranking = Ranking.blank(len(some), depths.k)
        ranking.tiles[:, : len(gallery)] = np.arange(min(depths.k, len(gallery)))
        ranking.clear_tied(np.arange(len(some)), positives.take(some), len(gallery))
        yield some, ranking


def _rank_part(search: _Search, item: tuple[slice, Positives]) -> Ranking:
    """Rank the gallery for some queries, which have these positives."""
    part, positives = item
    pairs = _find_candidates(search, part)
    if pairs is None:  # nearly everything ties: half of the queries each
        middle, ranked = (part.start + part.stop + 1) // 2, []
        for half in (slice(part.start, middle), slice(middle, part.stop)):
            own = positives.take(np.arange(half.start, half.stop) - part.start)
            ranked.append(_rank_part(search, (half, own)))
        return Ranking(*map(np.concatenate, zip(*ranked, strict=True)))
    query, tile = np.divmod(pairs, max(search.depths.n_tiles, 1))
    score, slack = _similarities(search, search.queries[part], query, tile)
    order = np.lexsort((-score, query))
    tied = np.diff(query[order]) == 0
    tied &= -np.diff(score[order]) <= slack[order][1:] + slack[order][:-1]
    group = np.zeros(len(order), np.int64)
    group[order[1:]] = np.cumsum(~tied)
    return _order_pairs(query, tile, group, positives, search.depths)


def _find_candidates(search: _Search, part: slice) -> Ints | None:
    """Return pairs of query and tile that may be among the first, or tie with one that is.

    A pair is query * n_tiles + tile; None says that those of several queries do not fit the memory.
    """
    n_queries, (n_tiles, k, scored) = part.stop - part.start, search.depths
    sought = min(max(k, scored), n_tiles)
    most_pairs = search.memory_bytes // _PAIR_BYTES if n_queries > 1 else n_tiles
    if n_queries * sought > most_pairs:
        return None
    if sought == n_tiles:
        return np.arange(n_queries * n_tiles)
    norms, of_tiles = search.norms[0][part], search.norms[1]
    single = _round_to_singles(search.queries[part], norms, search.metric)
    bounds = _error_bounds(norms, of_tiles.max(), single.shape[1], search.metric)
    floors = np.full((n_queries, 1), -np.inf, np.float32)
    kept = list[tuple[Ints, Singles]]()
    held = most_held = 0
    for start, rows in row_blocks(search.gallery, search.memory_bytes, _PRODUCT_CELLS // n_queries):
        norms = of_tiles[start : start + len(rows)]
        value = single @ _round_to_singles(rows, norms, search.metric).T
        if search.metric == "l2":  # and -|q|^2 / 2, which orders nothing
            value -= (norms**2 / 2).astype(np.float32)
        if not start and len(rows) >= sought:  # or all of the first block would be kept
            kth = np.partition(value, -sought, axis=1)[:, -sought]
            floors[:, 0] = _lower(kth, bounds)
        place = np.flatnonzero(value >= floors)
        pair = place + place // len(rows) * (n_tiles - len(rows)) + start
        kept.append((pair, value.ravel()[place]))
        held += len(place)
        if held > most_held or start + len(rows) == n_tiles:
            kept = [_drop_low(kept, floors, bounds, sought, n_tiles)]
            held = len(kept[0][0])
            most_held = held + n_queries * sought
            if held > most_pairs:
                return None
    return kept[0][0]


def _drop_low(
    kept: list[tuple[Ints, Singles]], floors: Singles, bounds: Floats, k: int, n_tiles: int
) -> tuple[Ints, Singles]:
    """Raise the floors (Q, 1) to the k-th similarity less the errors, and drop pairs below."""
    pair, value = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    query = pair // n_tiles
    # One whole number holds query and value: its sort is five times as fast as one by both.
    bits = value.view(np.int32)
    order = np.argsort((query << 32) + (bits ^ (bits >> 31 & 0x7FFFFFFF)))
    counts = np.bincount(query)
    some = np.flatnonzero(counts >= k)
    floors[some, 0] = _lower(value[order[np.cumsum(counts)[some] - k]], bounds[some])
    high = value >= floors[query, 0]
    return pair[high], value[high]


def _lower(kth: Singles, bounds: Floats) -> Singles:
    """Return the least value of a tile that may be as similar as the k-th."""
    return np.nextafter((kth - 2 * bounds).astype(np.float32), np.float32(-np.inf))


def _round_to_singles(rows: NDArray[Any], norms: Floats, metric: Metric) -> Singles:
    """Round descriptors of these norms to float32; the cosine divides by the norms."""
    single = np.ascontiguousarray(rows, dtype=np.float32)
    return single / norms.astype(np.float32)[:, None] if metric == "cosine" else single


def _error_bounds(norms: Floats, longest: float, n: int, metric: Metric) -> Floats:
    """Bound the error of every similarity in float32, for tiles of norms up to `longest`."""
    if metric == "cosine":
        norms, longest = np.ones(len(norms)), 1.0
    bound = 2 * _gamma(n, _SINGLE) * norms * longest
    if metric == "l2":
        bound = _gamma(n, _SINGLE) * (norms + longest) ** 2 / 2
    return np.asarray(bound + n * _TINY * (1 + norms + longest))


def _gamma(n: int, unit: float) -> float:
    """Return the relative error of a sum of n products, and of a few roundings around it."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _similarities(
    search: _Search, queries: NDArray[Any], query: Ints, tile: Ints
) -> tuple[Floats, Floats]:
    """Return similarities of pairs in float64 and bounds of their errors.

    The order in which numbers are summed depends on the length of descriptors alone.
    """
    order = np.argsort(tile, kind="stable")  # by tile, as they lie in a file
    rows = max(1, _PIECE_NUMBERS // max(queries.shape[1], 1))
    gallery, error = np.asarray(search.gallery), _gamma(queries.shape[1], _DOUBLE)
    score, slack = np.empty(len(query)), np.empty(len(query))

    def evaluate(part: slice) -> None:
        some = order[part]
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
        if part.start % (16 * rows) == 0:
            release_pages(search.gallery)

    with ThreadPoolExecutor(search.threads) as pool:
        list(pool.map(evaluate, split(len(order), rows)))
    return score, slack


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total


def _measure_norms(rows: NDArray[Any], metric: Metric, field: str, names: Any) -> Floats:
    """Return norms, nearly, and refuse descriptors that cannot be ranked by their names."""
    norms, least = np.empty(len(rows)), _LEAST_NORM if metric == "cosine" else 0.0
    for start, block in row_blocks(rows):
        with np.errstate(over="ignore", invalid="ignore"):
            single = np.ascontiguousarray(block, dtype=np.float32)
            some = np.sqrt(np.vecdot(single, single).astype(np.float64))
        faulty = np.flatnonzero(~((some >= least) & (some <= _MOST_NORM)))  # also tells NaN
        if len(faulty):
            what = "descriptors that cannot be ranked (NaN, infinite, zero or far too large): "
            raise PredictionError(
                what + first_of([names[start + row] for row in faulty.tolist()]),
                where=f"field '{field}'",
                expected="finite numbers; for the cosine, of some length",
                fix="look for empty images, a division by zero or half precision",
            )
        norms[start : start + len(block)] = some
    return norms

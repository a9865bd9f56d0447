"""The gallery of a scene, ranked for each of its queries, with ties broken against the submitter.

Tiles that tie are ordered non-positive first, then by their row in the gallery table (which is
sorted by id), so that a method gains nothing by giving equal scores. A query whose whole gallery
ties, as it does with a descriptor of zeros, has no ranking: none of its tiles has a rank, unless
all are positive. Queries are ranked in blocks, and scored as they come.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import rows_among
from airzoo_bench.engines.engine import split
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.search import (
    Names,
    Pairs,
    Search,
    blocks,
    check_descriptors,
    find_nearest,
)
from airzoo_bench.retrieval.settings import ImageScores, Metric, TileScores
from airzoo_bench.retrieval.truth import Positives, RetrievalTruth, offsets_of

_CELLS = 1 << 20  # ranks at a time
_MOST_QUERIES = 4096  # of one search
_SENT_QUERIES = 256  # at a time to another process


@dataclass(frozen=True, eq=False)
class Ranking:
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

    def copy_rows(self, rows: Ints, found: Ranking) -> None:
        """Copy the rankings of some queries."""
        self.tiles[rows] = found.tiles
        self.tie_dependent[rows] = found.tie_dependent

    def drop_flat(self, rows: Ints, positives: Positives, n_tiles: int) -> None:
        """Remove the tiles of a query if its whole gallery ties, unless all are positive."""
        if n_tiles >= 2:
            some = rows[positives.counts[rows] < n_tiles]
            self.tiles[some] = -1
            self.tie_dependent[some] = positives.counts[some] > 0


RankedBlocks = Iterator[tuple[Ints, Ranking]]
"""Blocks of queries by their numbers, and how each ranks the gallery."""


def rank_scene(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    settings: TileScores | ImageScores,
    run: Run,
) -> RankedBlocks:
    """Rank the gallery for the queries of a scene, which the predictions answer in these rows.

    The row is -1 for queries that they lack, which rank no tile.
    """
    content, there = predictions.content, np.flatnonzero(rows >= 0)
    names, tiles = predictions.query_ids, truth.tiles["id"].to_numpy(str)
    positives, k = truth.positives.take(there), min(settings.ranks_kept, len(tiles))
    tie_ranks = settings.tie_ranks
    if isinstance(settings, ImageScores):  # they read whole lists
        k = tie_ranks = len(tiles)
    if isinstance(content, RankedIds):
        found = _rank_lists(content, names, rows[there], truth, positives, k, tie_ranks)
    else:
        found = rank_by_descriptors(
            content.queries[rows[there]],
            _scene_gallery(content.gallery, content.gallery_ids, truth),
            k=k,
            metric=settings.descriptor_metric,
            positives=positives,
            tie_ranks=tie_ranks,
            run=run,
            names=names[rows[there]],
            tile_names=tiles,
        )
    yield from ((there[part], ranking) for part, ranking in found)
    lacking = np.flatnonzero(rows < 0)
    for part in split(len(lacking), max(1, _CELLS // k)):
        yield lacking[part], Ranking.blank(len(lacking[part]), 1)


def order_pairs(
    pairs: Pairs, positives: Positives, n_tiles: int, k: int, tie_ranks: int
) -> Ranking:
    """Rank queries by their pairs (query, tile, level), by the tie rule."""
    query, tile, level = pairs
    positive = positives.holds(query, tile, n_tiles)
    order = np.lexsort((tile, positive, level, query))
    query, tile, level, positive = query[order], tile[order], level[order], positive[order]
    place, counts = np.arange(len(order)), np.bincount(query, minlength=positives.n_queries)
    rank = place - offsets_of(counts)[query]
    tied = (np.diff(query) == 0) & (np.diff(level) == 0)
    opens = np.concatenate([[True], ~tied])[: len(order)]
    begins = rank - (place - np.maximum.accumulate(np.where(opens, place, 0)))
    mixed = tied & ~positive[:-1] & positive[1:] & (begins[1:] < tie_ranks)
    ranking = Ranking.blank(positives.n_queries, k)
    ranking.tie_dependent[query[1:][mixed]] = True
    first = rank < k
    ranking.tiles[query[first], rank[first]] = tile[first]
    runs = np.bincount(query[opens], minlength=positives.n_queries)
    ranking.drop_flat(np.flatnonzero((counts == n_tiles) & (runs == 1)), positives, n_tiles)
    return ranking


# --- ranked lists ---


def rank_by_ids(
    ranked: NDArray[np.integer[Any]],
    scores: NDArray[np.floating[Any]] | None,
    positives: Positives,
    *,
    n_tiles: int,
    k: int,
    tie_ranks: int,
) -> Ranking:
    """Take lists (Q, K) of tiles as given, and reorder runs of equal scores.

    A run at the end of a list that is shorter than the gallery ties with what was left out.
    """
    if scores is None or ranked.size == 0:
        return Ranking(ranked[:, :k].astype(np.int32), np.zeros(len(ranked), np.bool_))
    ranking = Ranking.blank(len(ranked), k)
    ranking.tiles[:, : ranked.shape[1]] = ranked[:, :k]
    tied = (scores[:, 1:] == scores[:, :-1]) & (ranked[:, 1:] >= 0)
    some = np.flatnonzero(tied.any(axis=1))
    opens = np.concatenate([np.ones((len(some), 1), np.bool_), ~tied[some]], axis=1)
    begins = np.maximum.accumulate(np.where(opens, np.arange(ranked.shape[1]), 0), axis=1)
    listed, right = ranked[some].astype(np.int64), positives.take(some)
    length = np.count_nonzero(listed >= 0, axis=1)
    last = begins[np.arange(len(some)), length - 1]
    row, column = np.nonzero(listed >= 0)
    pairs, lost = [(row, listed[row, column], begins[row, column])], np.zeros(len(some), np.bool_)
    for one in np.flatnonzero((length - last > 1) & (length < n_tiles)).tolist():
        tiles, answers, start = listed[one, : length[one]], right.of_query(one), last[one]
        # Of those left out, k that are not positive are enough to fill the ranks.
        others = np.arange(min(n_tiles, k + len(tiles) + len(answers)))
        others = np.setdiff1d(others, np.concatenate([tiles, answers]), assume_unique=True)[:k]
        pairs.append((np.full(len(others), one), others, np.full(len(others), start)))
        # Positives that are left out are not found, whatever the order of the tie.
        is_mixed = len(others) > 0 or not np.isin(tiles[start:], answers).all()
        lost[one] = start < tie_ranks and is_mixed and not np.isin(answers, tiles).all()
    query, tile, level = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    found = order_pairs((query, tile, level), right, n_tiles, k, tie_ranks)
    found.tie_dependent[lost] = True
    found.drop_flat(np.flatnonzero((last == 0) & (length > 1)), right, n_tiles)
    ranking.copy_rows(some, found)
    return ranking


def _rank_lists(
    ranked: RankedIds,
    names: NDArray[np.str_],
    rows: NDArray[np.intp],
    truth: RetrievalTruth,
    positives: Positives,
    k: int,
    tie_ranks: int,
) -> RankedBlocks:
    """Rank queries by the lists of these rows."""
    known = truth.tiles["id"].to_numpy(str)
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
            named, tile = first_of(names[rows[part]][strange.any(axis=1)]), str(ids[strange][0])
            raise PredictionError(
                f"tiles that are not in the gallery of scene {truth.scene}, ranked for queries "
                f"{named}; the first is {tile!r}",
                where="field 'ranked_ids'",
                expected=f"ids scene/name of the query's own scene, such as {known[0]}",
                fix="cut the gallery by the protocol's sizes, or take ids from tiles.parquet",
            )
        some = np.arange(part.start, part.stop)
        right, depths = positives.take(some), {"k": k, "tie_ranks": tie_ranks}
        yield some, rank_by_ids(tiles, scores, right, n_tiles=len(known), **depths)


# --- descriptors ---


def rank_by_descriptors(
    queries: NDArray[Any],
    gallery: NDArray[Any],
    *,
    k: int,
    metric: Metric,
    positives: Positives,
    tie_ranks: int,
    run: Run,
    names: Names,
    tile_names: Names,
) -> RankedBlocks:
    """Rank the gallery by descriptors, exactly as float64 has it."""
    n_tiles, flat = len(gallery), np.asarray((queries == 0).all(axis=1))
    asked = queries[~flat] if flat.any() else queries
    check_descriptors(asked, metric, "query_descriptors", np.asarray(names)[~flat])
    longest = check_descriptors(gallery, metric, "gallery_descriptors", tile_names)
    if n_tiles > 1 and all((rows == gallery[0]).all() for _, rows in blocks(gallery, 1 << 20)):
        flat[:] = True
    sought = min(max(k, tie_ranks), n_tiles)
    search = Search(gallery, longest, metric, sought, run.memory_bytes, run.jobs)
    most = max(64, run.memory_bytes // (32 * queries.shape[1] + 1))
    most = min(most, _SENT_QUERIES if run.engine.distributed else _MOST_QUERIES, _CELLS // k + 1)
    parts, places = split(len(queries), most), np.arange(len(queries))
    found = run.engine.map(
        _rank_part,
        [(queries[part], positives.take(places[part]), flat[part]) for part in parts],
        shared=(search, k, tie_ranks),
        stage="queries ranked",
        name=lambda _: "some queries",
    )
    yield from ((places[part], ranking) for part, ranking in zip(parts, found, strict=True))


def _rank_part(
    shared: tuple[Search, int, int], item: tuple[NDArray[Any], Positives, Bools]
) -> Ranking:
    """Rank some queries; those that are flat tie with every tile."""
    (search, k, tie_ranks), (queries, positives, flat) = shared, item
    n_tiles, ranking = len(search.gallery), Ranking.blank(len(queries), k)
    some, blank = np.flatnonzero(~flat), np.flatnonzero(flat)
    ranking.tiles[blank, : min(k, n_tiles)] = np.arange(min(k, n_tiles))
    ranking.drop_flat(blank, positives, n_tiles)
    waiting = [some] if len(some) else []
    while waiting:
        rows = waiting.pop()
        right, asked = positives.take(rows), queries
        if len(rows) < len(queries):
            asked = queries[rows]
        if (pairs := find_nearest(search, asked)) is not None:
            ranking.copy_rows(rows, order_pairs(pairs, right, n_tiles, k, tie_ranks))
        else:  # nearly everything ties: half of the queries each
            waiting += np.array_split(rows, 2)
    return ranking


def _scene_gallery(
    gallery: NDArray[Any], given: NDArray[np.str_], truth: RetrievalTruth
) -> NDArray[Any]:
    """Return the descriptors of the scene's tiles, in the tiles' order."""
    ids, field = truth.tiles["id"].to_numpy(str), "field 'gallery_ids'"
    rows = rows_among(ids, given)
    if (lacking := ids[rows < 0]).size:
        raise PredictionError(
            f"lacks descriptors of tiles of scene {truth.scene}: {first_of(lacking, len(ids))}",
            where=field,
            expected="every tile of the gallery: leaving some out would make the task easier",
            fix="describe all tiles of tiles.parquet; of runs a scene, name the folder of all",
        )
    if (np.diff(rows) == 1).all():
        return gallery[rows[0] : rows[0] + len(rows)]
    return np.asarray(gallery[rows])

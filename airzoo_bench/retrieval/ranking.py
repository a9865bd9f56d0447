"""The gallery of a scene, ranked for each of its queries, with ties broken against the submitter.

Tiles that tie are ordered non-positive first, then by their row in the gallery table (which is
sorted by id), so that a method gains nothing by giving equal scores. A query whose whole gallery
ties, as it does with a descriptor of zeros, has no ranking: none of its tiles has a rank, unless
all are positive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import rows_among, scene_of, with_endings
from airzoo_bench.core.validation import nearest as suggestion
from airzoo_bench.engines.engine import split
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions
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
    positive and another tile. Where scores read whole lists, which are not kept, `hit_ranks` has
    for each query as many numbers as it has positives: the ranks (from 1) that hold one,
    ascending, and 0 for those that are not ranked.
    """

    tiles: NDArray[np.int32]  # (Q, K) rows of the gallery table; -1 where there are no more
    tie_dependent: Bools  # (Q,)
    hit_ranks: Ints | None = None  # (P,)

    @classmethod
    def blank(cls, n_queries: int, k: int) -> Ranking:
        """Return one without any tile."""
        return cls(np.full((n_queries, k), -1, np.int32), np.zeros(n_queries, np.bool_))

    def copy_rows(self, rows: Ints, found: Ranking) -> None:
        """Copy the rankings of some queries, up to the ranks that are kept."""
        self.tiles[rows] = found.tiles[:, : self.tiles.shape[1]]
        self.tie_dependent[rows] = found.tie_dependent

    def drop_flat(self, rows: Ints, positives: Positives, n_tiles: int) -> None:
        """Remove the tiles of a query if its whole gallery ties, unless all are positive."""
        if n_tiles >= 2:
            some = rows[positives.counts[rows] < n_tiles]
            self.tiles[some] = -1
            self.tie_dependent[some] = positives.counts[some] > 0


def rank_scene(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    settings: TileScores | ImageScores,
    run: Run,
) -> Ranking:
    """Rank the gallery for the queries of a scene, which the predictions answer in these rows.

    The row is -1 for queries that they lack, which rank no tile.
    """
    content, positives, n_tiles = predictions.content, truth.positives, len(truth.tiles)
    whole_lists = isinstance(settings, ImageScores)
    kept, there = min(settings.ranks_kept, n_tiles), np.flatnonzero(rows >= 0)
    width = content.ids.shape[1] if isinstance(content, RankedIds) else 0
    ranked = isinstance(content, RankedIds) and content.scores is None
    if ranked and isinstance(settings, TileScores):
        # Ranks beyond short lists would hold nothing, for each of a million queries.
        kept = min(kept, max(width, settings.ranks_scored))
    k, tie_ranks = (n_tiles, n_tiles) if whole_lists else (kept, settings.tie_ranks)
    step = max(1, _CELLS // max(k, width)) if whole_lists or width else max(1, len(there))
    if isinstance(content, RankedIds):
        rank = _list_ranker(content, truth, k, tie_ranks)
    else:
        rank = _descriptor_ranker(content, truth, k, tie_ranks, settings.descriptor_metric, run)
    ranking = Ranking.blank(len(rows), kept)
    hit_ranks = np.zeros(len(positives.tiles), np.int64) if whole_lists else None
    for part in split(len(there), step):
        some = there[part]
        right = positives.take(some)
        found = rank(rows[some], predictions.query_ids[rows[some]], right)
        ranking.copy_rows(some, found)
        if hit_ranks is not None:
            hit_ranks[positives.pairs(some)] = _ranks_of_hits(found.tiles, right, n_tiles)
    return Ranking(ranking.tiles, ranking.tie_dependent, hit_ranks)


Ranker = Callable[[NDArray[np.intp], NDArray[np.str_], Positives], Ranking]
"""Takes rows of the predictions, the ids of their queries and their positives."""


def _ranks_of_hits(tiles: NDArray[np.int32], positives: Positives, n_tiles: int) -> Ints:
    """Return `Ranking.hit_ranks` of whole lists."""
    hits = hit_matrix(tiles, positives.offsets, positives.tiles, n_tiles)
    query, column = np.nonzero(hits)
    first = offsets_of(np.bincount(query, minlength=positives.n_queries))[query]
    ranks = np.zeros(len(positives.tiles), np.int64)
    ranks[positives.offsets[query] + np.arange(len(query)) - first] = column + 1
    return ranks


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
    ranking = Ranking.blank(len(ranked), k)
    ranking.tiles[:, : ranked.shape[1]] = ranked[:, :k]
    if scores is None or ranked.size == 0:
        return ranking
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


def _list_ranker(ranked: RankedIds, truth: RetrievalTruth, k: int, tie_ranks: int) -> Ranker:
    """Return the function that ranks some queries by their lists."""
    known = truth.tiles["id"].to_numpy(str)

    def rank(rows: NDArray[np.intp], names: NDArray[np.str_], positives: Positives) -> Ranking:
        ids, scores, width = ranked.ids[rows], None, k
        if ranked.scores is not None:  # the ties that go on beyond rank k matter too
            scores = ranked.scores[rows]
            on = (scores[:, k:] == scores[:, k - 1 : -1]) & (ids[:, k:] != "")
            width = k + int(np.logical_and.accumulate(on, axis=1).sum(axis=1).max(initial=0)) + 1
            scores = scores[:, :width]
        ids = ids[:, :width]
        tiles = rows_among(ids.ravel(), known).reshape(ids.shape)
        strange = (tiles < 0) & (ids != "")
        if strange.any():
            named = names[strange.any(axis=1)]
            raise _strange_tile(str(ids[strange][0]), named, len(names), truth)
        return rank_by_ids(tiles, scores, positives, n_tiles=len(known), k=k, tie_ranks=tie_ranks)

    return rank


def _strange_tile(
    tile: str, queries: NDArray[np.str_], total: int, truth: RetrievalTruth
) -> PredictionError:
    """Return the error for a ranked tile that is not in the scene's gallery."""
    scene = str(scene_of(np.array([tile]))[0])
    fix = "cut the gallery with the protocol's tile sizes, or take the ids from tiles.parquet"
    if "/" not in tile:
        fix = f"put the scene before each tile: {truth.scene}/{tile}"
    elif scene != truth.scene:
        fix = f"rank each query against its own scene only; this tile is of scene {scene!r}"
    elif with_endings(np.array([tile])):
        fix = "leave out the file's ending: ids are names without it"
    return PredictionError(
        f"tiles that are not in the gallery of scene {truth.scene}, ranked for "
        f"{first_of(queries, total, noun='query')}; the first is {tile!r}"
        + suggestion(tile, truth.tiles["id"].tolist(), 1),
        where="field 'ranked_ids'",
        expected=f"ids such as {truth.tiles['id'].iloc[0]}",
        fix=fix,
    )


# --- descriptors ---


def _descriptor_ranker(
    described: Descriptors, truth: RetrievalTruth, k: int, tie_ranks: int, metric: Metric, run: Run
) -> Ranker:
    """Return the function that ranks some queries by their descriptors."""
    gallery = _scene_gallery(described, truth, run.memory_bytes)

    def rank(rows: NDArray[np.intp], names: NDArray[np.str_], positives: Positives) -> Ranking:
        return rank_by_descriptors(
            described.queries[rows],
            gallery,
            k=k,
            metric=metric,
            positives=positives,
            tie_ranks=tie_ranks,
            run=run,
            names=names,
            tile_names=truth.tiles["id"].to_numpy(),
        )

    return rank


def rank_by_descriptors(
    queries: NDArray[Any],
    gallery: NDArray[Any],
    *,
    k: int,
    metric: Metric,
    positives: Positives,
    tie_ranks: int,
    run: Run = Run(),  # noqa: B008 - frozen
    names: Names | None = None,
    tile_names: Names | None = None,
) -> Ranking:
    """Rank the gallery by descriptors, exactly as float64 has it."""
    n_tiles, ranking = len(gallery), Ranking.blank(len(queries), k)
    names = np.arange(len(queries)) if names is None else np.asarray(names)
    tile_names = range(n_tiles) if tile_names is None else tile_names
    flat: Bools = (queries == 0).all(axis=1)  # zeros are taken to tie with every tile
    asked = queries[~flat] if flat.any() else queries
    check_descriptors(asked, metric, "query_descriptors", names[~flat])
    longest = check_descriptors(gallery, metric, "gallery_descriptors", tile_names)
    if n_tiles > 1 and all((rows == gallery[0]).all() for _, rows in blocks(gallery, 1 << 20)):
        flat[:] = True
    some, blank = np.flatnonzero(~flat), np.flatnonzero(flat)
    sought = min(max(k, tie_ranks), n_tiles)
    search = Search(gallery, longest, metric, sought, run.memory_bytes, run.jobs)
    step = int(np.clip(run.memory_bytes // (32 * queries.shape[1] + 1), 64, _MOST_QUERIES))
    parts = split(len(some), min(step, _SENT_QUERIES) if run.engine.distributed else step)
    found = run.engine.map(
        _rank_part,
        [(asked[part], positives.take(some[part])) for part in parts],
        shared=(search, k, tie_ranks),
        stage="queries ranked",
        name=lambda _: "some queries",
    )
    for part, ranked in zip(parts, found, strict=True):
        ranking.copy_rows(some[part], ranked)
    ranking.tiles[blank, : min(k, n_tiles)] = np.arange(min(k, n_tiles))
    ranking.drop_flat(blank, positives, n_tiles)
    return ranking


def _rank_part(shared: tuple[Search, int, int], item: tuple[NDArray[Any], Positives]) -> Ranking:
    (search, k, tie_ranks), (queries, positives) = shared, item
    pairs = find_nearest(search, queries)
    if pairs is not None:
        return order_pairs(pairs, positives, len(search.gallery), k, tie_ranks)
    ranking = Ranking.blank(len(queries), k)  # nearly everything ties: half of the queries each
    for half in split(len(queries), (len(queries) + 1) // 2):
        rows = np.arange(half.start, half.stop)
        ranking.copy_rows(rows, _rank_part(shared, (queries[half], positives.take(rows))))
    return ranking


def _scene_gallery(
    described: Descriptors, truth: RetrievalTruth, memory_bytes: int
) -> NDArray[Any]:
    """Return the descriptors of the scene's tiles, in the tiles' order."""
    ids, gallery = truth.tiles["id"].to_numpy(str), described.gallery
    rows = rows_among(ids, described.gallery_ids)
    lacking = rows < 0
    if lacking.any():
        strange = described.gallery_ids[~np.isin(described.gallery_ids, ids)].tolist()
        near = suggestion(str(ids[lacking][0]), strange, 1).replace("did you mean", "it has")
        runs = ", of each scene; where each was run by itself, name the folder that holds all runs"
        raise PredictionError(
            f"lacks descriptors of tiles of scene {truth.scene}: "
            f"{first_of(ids[lacking], len(ids))}{near}",
            where="field 'gallery_ids'",
            expected="every tile of the gallery: leaving some out would make the task easier",
            fix="describe all tiles of tiles.parquet" + runs * bool(lacking.all()),
        )
    if (np.diff(rows) == 1).all():
        return gallery[rows[0] : rows[0] + len(rows)]
    needed = len(rows) * gallery[:1].nbytes
    if isinstance(gallery, np.memmap) and needed > memory_bytes:
        raise PredictionError(
            f"the gallery of scene {truth.scene} takes {needed:,} bytes and is not in the order "
            f"of tiles.parquet, so that it cannot be read in pieces within {memory_bytes:,}",
            where="field 'gallery_descriptors'",
            fix="save the rows in the order of tiles.parquet, or raise --max-memory",
        )
    return np.asarray(gallery[rows])

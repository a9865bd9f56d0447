"""The gallery of a scene, ranked for each of its queries, with ties broken against the submitter.

Tiles that tie are ordered non-positive first, then by their row in the gallery table (which is
sorted by id), so that a method gains nothing by giving equal scores. A query whose whole gallery
ties, as it does with a descriptor of zeros, has no ranking: none of its tiles has a rank, unless
all are positive.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import rows_among, scene_of, with_endings
from airzoo_bench.core.validation import nearest as suggestion
from airzoo_bench.engines.engine import HERE, Engine, split
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.descriptors import Metric, Names, Rows, points_one_way
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.search import Candidates, Gallery, Queries, nearest
from airzoo_bench.retrieval.settings import ImageScores, RetrievalScores
from airzoo_bench.retrieval.truth import Positives, RetrievalTruth, offsets_of

_CELLS = 1 << 20  # ranks at a time
_SENT_QUERIES = 256  # at a time to another process


@dataclass(frozen=True, eq=False)
class Ranking:
    """The gallery of each query, best first.

    A query is tie-dependent where a tie that begins before the depth of the scores holds a
    positive and another tile. Where scores read whole lists, which are not kept, `hit_ranks` has
    for each query as many numbers as it has positives: the ranks (from 1) that hold one,
    ascending, and 0 for those that are not ranked.
    """

    tiles: NDArray[np.int32]  # (Q, K) rows of the gallery table; -1 where there are no more
    tie_dependent: Bools  # (Q,)
    hit_ranks: Ints | None = None  # (P,)


def _no_ranks(n_queries: int, k: int) -> Ranking:
    return Ranking(np.full((n_queries, k), -1, np.int32), np.zeros(n_queries, np.bool_))


def rank_scene(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    settings: RetrievalScores | ImageScores,
    run: Run,
) -> Ranking:
    """Rank the gallery for the queries of a scene, which the predictions answer in these rows.

    The row is -1 for queries that they lack, which rank no tile.
    """
    content, positives, n_tiles = predictions.content, truth.positives, len(truth.tiles)
    kept = min(settings.ranks_kept, n_tiles)
    whole, depth, of_images = kept, settings.depth, isinstance(settings, ImageScores)
    if of_images:
        whole = depth = n_tiles
    if isinstance(content, RankedIds):
        if isinstance(settings, RetrievalScores) and content.scores is None:
            # Ranks beyond short lists would hold nothing, for each of a million queries.
            whole = kept = min(kept, max(content.ids.shape[1], settings.deepest))
        step = max(1, _CELLS // max(1, content.ids.shape[1], whole))
    else:
        gallery = _scene_gallery(content, truth, run.memory_bytes)
        step = max(1, _CELLS // n_tiles if of_images else len(rows))
    there = np.flatnonzero(rows >= 0)
    ranking = _no_ranks(len(rows), kept)
    hit_ranks = np.zeros(len(positives.tiles), np.int64) if of_images else None
    for start in range(0, max(1, len(there)), step):
        some = there[start : start + step]
        names, right = predictions.query_ids[rows[some]], positives.take(some)
        if isinstance(content, RankedIds):
            found = _rank_lists(content, truth, rows[some], names, right, whole, depth)
        else:
            found = rank_by_descriptors(
                content.queries[rows[some]],
                gallery,
                k=whole,
                metric=settings.descriptor_metric,
                positives=right,
                depth=depth,
                memory_bytes=run.memory_bytes,
                jobs=run.jobs,
                names=names,
                tile_names=truth.tiles["id"].to_numpy(),
                engine=run.engine,
            )
        ranking.tiles[some] = found.tiles[:, :kept]
        ranking.tie_dependent[some] = found.tie_dependent
        if hit_ranks is not None:
            hit_ranks[positives.pairs(some)] = _ranks_of_hits(found.tiles, right, n_tiles)
    return Ranking(ranking.tiles, ranking.tie_dependent, hit_ranks)


def _ranks_of_hits(tiles: NDArray[np.int32], positives: Positives, n_tiles: int) -> Ints:
    """Return `Ranking.hit_ranks` of whole lists."""
    hits = hit_matrix(tiles, positives.offsets, positives.tiles, n_tiles)
    query, column = np.nonzero(hits)
    first = offsets_of(np.bincount(query, minlength=positives.n_queries))[query]
    ranks = np.zeros(len(positives.tiles), np.int64)
    ranks[positives.offsets[query] + np.arange(len(query)) - first] = column + 1
    return ranks


def _rank_lists(
    ranked: RankedIds,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    names: NDArray[np.str_],
    positives: Positives,
    k: int,
    depth: int,
) -> Ranking:
    ids, scores, width = ranked.ids[rows], None, k
    if ranked.scores is not None:  # the ties that go on beyond the ranks that are kept matter too
        scores = ranked.scores[rows]
        on = (scores[:, k:] == scores[:, k - 1 : -1]) & (ids[:, k:] != "")
        width = k + int(np.logical_and.accumulate(on, axis=1).sum(axis=1).max(initial=0)) + 1
        scores = scores[:, :width]
    tiles = _tile_rows(truth, ids[:, :width], names)
    return rank_by_ids(tiles, scores, positives, n_tiles=len(truth.tiles), k=k, depth=depth)


def rank_by_ids(
    ranked: NDArray[np.integer[Any]],
    scores: NDArray[np.floating[Any]] | None,
    positives: Positives,
    *,
    n_tiles: int,
    k: int,
    depth: int,
) -> Ranking:
    """Take lists (Q, K) of tiles as given, and reorder runs of equal scores.

    A run at the end of a list that is shorter than the gallery ties with what was left out.
    """
    ranking = _no_ranks(len(ranked), k)
    ranking.tiles[:, : ranked.shape[1]] = ranked[:, :k]
    if scores is None or ranked.size == 0:
        return ranking
    tied = (scores[:, 1:] == scores[:, :-1]) & (ranked[:, 1:] >= 0)
    some = np.flatnonzero(tied.any(axis=1))
    opens = np.concatenate([np.ones((len(some), 1), np.bool_), ~tied[some]], axis=1)
    begins = np.maximum.accumulate(np.where(opens, np.arange(ranked.shape[1]), 0), axis=1)
    listed = ranked[some].astype(np.int64)
    valid = listed >= 0
    query = np.broadcast_to(np.arange(len(some))[:, None], valid.shape)
    right, pairs = positives.take(some), (query[valid], listed[valid], begins[valid])
    ranking.tiles[some], ranking.tie_dependent[some] = _in_order(pairs, right, n_tiles, k, depth)
    length = valid.sum(axis=1)
    last = begins[np.arange(len(some)), length - 1]
    for number in np.flatnonzero((length - last > 1) & (length < n_tiles)).tolist():
        row, start, given = some[number], last[number], listed[number, : length[number]]
        run, mixed = _run_with_left_out(given, start, right.of_query(number), n_tiles)
        room = ranking.tiles[row, start:]
        room[:] = -1
        room[: len(run)] = run[: len(room)]
        ranking.tie_dependent[row] |= mixed and start < depth
    _drop_constant(ranking, some[(last == 0) & (length > 1)], positives, n_tiles)
    return ranking


def _run_with_left_out(
    given: Ints, start: int, positives: NDArray[np.int32], n_tiles: int
) -> tuple[Ints, bool]:
    """Order the run at the end of a list, from `start` on, with the tiles that are left out.

    Positives that are left out are not found. Also tells whether the tie holds tiles of both kinds.
    """
    is_positive, is_free = np.zeros(n_tiles, np.bool_), np.ones(n_tiles, np.bool_)
    is_positive[positives], is_free[given[:start]] = True, False
    others = np.flatnonzero(is_free & ~is_positive)
    found = np.sort(given[start:][is_positive[given[start:]]])
    return np.concatenate([others, found]), bool(len(others) and (is_free & is_positive).any())


def rank_by_descriptors(
    queries: NDArray[np.floating[Any]],
    gallery: NDArray[np.floating[Any]] | Rows,
    *,
    k: int,
    metric: Metric,
    positives: Positives,
    depth: int,
    memory_bytes: int = 1 << 30,
    jobs: int | None = None,
    names: Names | None = None,
    tile_names: Names | None = None,
    engine: Engine = HERE,
) -> Ranking:
    """Rank the gallery by descriptors, exactly as float64 has it."""
    rows = gallery if isinstance(gallery, Rows) else Rows.join(gallery).located()
    if queries.shape[1] != rows.shape[1]:
        raise PredictionError(
            f"descriptors of queries have {queries.shape[1]} numbers, "
            f"those of the gallery {rows.shape[1]}",
            where="query_descriptors, gallery_descriptors",
            expected="the same length",
        )
    n_tiles, ranking = len(rows), _no_ranks(len(queries), k)
    with np.errstate(invalid="ignore"):  # what is not finite is refused below
        constant = np.asarray(~queries.any(axis=1))  # zeros are taken to tie with every tile
    if constant.any():
        queries = np.where(constant[:, None], queries.dtype.type(1), queries)
    prepared = Queries.prepare(queries, metric, names)
    if points_one_way(rows, metric):
        constant[:] = True
    some, blank = np.flatnonzero(~constant), np.flatnonzero(constant)
    if len(blank):
        prepared = prepared.take(some)
    sought = min(max(k, depth), max(n_tiles, 1))
    threads = jobs or os.cpu_count() or 1
    searched = Gallery(rows, metric, sought, memory_bytes, threads, tile_names)
    step = searched.queries_at_a_time(queries.shape[1] * (queries.itemsize + 4))
    step = min(step, _SENT_QUERIES) if engine.distributed else step
    parts = split(len(some), step) or [slice(0, 0)]
    found = engine.map(
        _rank_part,
        [(prepared.take(part), positives.take(some[part])) for part in parts],
        shared=(searched, k, depth),
        stage="queries ranked",
        name=lambda _: "some queries",
    )
    for part, (tiles, tied) in zip(parts, found, strict=True):
        ranking.tiles[some[part]], ranking.tie_dependent[some[part]] = tiles, tied
    ranking.tiles[blank, : min(k, n_tiles)] = np.arange(min(k, n_tiles))
    _drop_constant(ranking, blank, positives, n_tiles)
    return ranking


def _rank_part(
    shared: tuple[Gallery, int, int], item: tuple[Queries, Positives]
) -> tuple[NDArray[np.int32], Bools]:
    (gallery, k, depth), (queries, positives) = shared, item
    candidates, flat = nearest(gallery, queries, positives)
    ranking = Ranking(*_in_order(candidates, positives, len(gallery.rows), k, depth))
    _drop_constant(ranking, flat, positives, len(gallery.rows))
    return ranking.tiles, ranking.tie_dependent


def _in_order(
    pairs: Candidates, positives: Positives, n_tiles: int, k: int, depth: int
) -> tuple[NDArray[np.int32], Bools]:
    """Order pairs (query, tile, level) by the tie rule; see `Ranking`.

    Of two tiles of a query that of the lower level comes first, and those of one level tie.
    """
    query, tile, level = pairs
    positive = positives.holds(query, tile, n_tiles)
    order = np.lexsort((tile, positive, level, query))
    query, tile, level, positive = query[order], tile[order], level[order], positive[order]
    place = np.arange(len(order))
    rank = place - offsets_of(np.bincount(query, minlength=positives.n_queries))[query]
    tied = (np.diff(query) == 0) & (np.diff(level) == 0)
    opens = np.concatenate([[True], ~tied])[: len(order)]
    begins = rank - (place - np.maximum.accumulate(np.where(opens, place, 0)))
    mixed = tied & ~positive[:-1] & positive[1:] & (begins[1:] < depth)
    ranking = _no_ranks(positives.n_queries, k)
    ranking.tie_dependent[query[1:][mixed]] = True
    first = rank < k
    ranking.tiles[query[first], rank[first]] = tile[first]
    return ranking.tiles, ranking.tie_dependent


def _drop_constant(ranking: Ranking, flat: Ints, positives: Positives, n_tiles: int) -> None:
    """Remove the tiles of `flat` queries, whose whole gallery ties, unless all are positive."""
    if n_tiles >= 2:
        some = flat[positives.counts[flat] < n_tiles]
        ranking.tiles[some] = -1
        ranking.tie_dependent[some] = positives.counts[some] > 0


def _tile_rows(
    truth: RetrievalTruth, ids: NDArray[np.str_], names: NDArray[np.str_]
) -> NDArray[np.intp]:
    """Return the rows of ranked tiles in the gallery table, -1 beyond the end of a list."""
    found = rows_among(ids.ravel(), truth.tiles["id"].to_numpy(str)).reshape(ids.shape)
    strange = (found < 0) & (ids != "")
    rows = np.flatnonzero(strange.any(axis=1))
    if not rows.size:
        return found
    tile = str(ids[rows[0]][strange[rows[0]]][0])
    scene = str(scene_of(np.array([tile]))[0])
    fix = "cut the gallery with the protocol's tile sizes, or take the ids from tiles.parquet"
    if "/" not in tile:
        fix = f"put the scene before each tile: {truth.scene}/{tile}"
    elif scene != truth.scene:
        fix = f"rank each query against its own scene only; this tile is of scene {scene!r}"
    elif with_endings(np.array([tile])):
        fix = "leave out the file's ending: ids are names without it"
    raise PredictionError(
        f"tiles that are not in the gallery of scene {truth.scene}, ranked for "
        f"{first_of(names[rows], len(names), noun='query')}; the first is {tile!r}"
        + suggestion(tile, truth.tiles["id"].tolist(), 1),
        where="field 'ranked_ids'",
        expected=f"ids such as {truth.tiles['id'].iloc[0]}",
        fix=fix,
    )


def _scene_gallery(described: Descriptors, truth: RetrievalTruth, memory_bytes: int) -> Rows:
    """Return the descriptors of the scene's tiles, in the tiles' order."""
    ids = truth.tiles["id"].to_numpy(str)
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
    gallery = described.gallery.located()
    if (np.diff(rows) == 1).all():
        return gallery.part(int(rows[0]), int(rows[0]) + len(rows))
    needed = len(rows) * gallery.shape[1] * gallery.dtype.itemsize
    if gallery.in_files and needed > memory_bytes:
        raise PredictionError(
            f"the gallery of scene {truth.scene} takes {needed:,} bytes and is not in the order "
            f"of tiles.parquet, so that it cannot be read in pieces within {memory_bytes:,}",
            where="field 'gallery_descriptors'",
            fix="save the rows in the order of tiles.parquet, or raise --max-memory",
        )
    return Rows.join(gallery.take(rows))

"""Ranking the gallery of one scene for the queries that the predictions answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import rows_among, scene_of, with_endings
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.retrieval.descriptor_rows import Rows, rows_of
from airzoo_bench.retrieval.pairs import Positives, hit_matrix, offsets_of
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds
from airzoo_bench.retrieval.ranking import rank_by_descriptors, rank_by_ids
from airzoo_bench.retrieval.settings import ImageScores, RetrievalScores
from airzoo_bench.retrieval.similarity import Metric
from airzoo_bench.retrieval.ties import Ranking
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["Asked", "rank_scene"]

_CELLS = 1 << 20  # ranks at a time

_ALL_SCENES = (
    "describe all tiles of tiles.parquet, of each scene; where each was run by itself, name the "
    "folder that holds all runs"
)


@dataclass(frozen=True)
class Asked:
    """The queries of a scene that the predictions answer: in which rows, names, positives."""

    rows: NDArray[np.intp]
    names: NDArray[np.str_]
    positives: Positives

    def part(self, some: slice) -> Asked:
        """Return some of them."""
        order = np.arange(len(self.rows))[some]
        return Asked(self.rows[some], self.names[some], self.positives.take(order))


def rank_scene(
    content: RankedIds | Descriptors,
    truth: RetrievalTruth,
    asked: Asked,
    settings: RetrievalScores | ImageScores,
    run: Run,
) -> Ranking:
    """Rank the gallery for the queries that are asked."""
    n_tiles, cut = len(truth.tiles), None
    kept, depth = min(settings.ranks_kept, n_tiles), settings.depth
    if isinstance(settings, ImageScores):
        kept, depth, cut = n_tiles, n_tiles, kept
    match content:
        case RankedIds() as ranked:
            if isinstance(settings, RetrievalScores) and ranked.scores is None:
                # Ranks beyond short lists would hold nothing, for each of a million queries.
                kept = min(kept, max(ranked.ids.shape[1], settings.deepest))
            step = max(1, _CELLS // max(1, ranked.ids.shape[1], kept))
            rank = partial(_rank_some, ranked, truth, kept, depth)
        case Descriptors() as described:
            step = max(1, len(asked.rows) if cut is None else _CELLS // n_tiles)
            gallery = _scene_gallery(described, truth, run.memory_bytes)
            metric = settings.descriptor_metric
            rank = partial(_rank_described, described, gallery, truth, kept, depth, metric, run)
    return _rank_by_parts(rank, asked, step, cut, n_tiles)


def _rank_by_parts(
    rank: Callable[[Asked], Ranking], asked: Asked, step: int, cut: int | None, n_tiles: int
) -> Ranking:
    """Rank the gallery for some queries at a time; whole lists are then cut to `cut` ranks."""
    parts = []
    for start in range(0, max(1, len(asked.rows)), step):
        some = asked.part(slice(start, start + step))
        ranking = rank(some)
        parts.append(ranking if cut is None else _without_lists(ranking, some, cut, n_tiles))
    return Ranking(
        np.concatenate([part.tiles for part in parts]),
        np.concatenate([part.tie_dependent for part in parts]),
        None
        if cut is None
        else np.concatenate([part.hit_ranks for part in parts if part.hit_ranks is not None]),
    )


def _without_lists(ranking: Ranking, asked: Asked, cut: int, n_tiles: int) -> Ranking:
    """Keep the first ranks of whole lists, and the ranks of positives."""
    positives = asked.positives
    hits = hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
    query, column = np.nonzero(hits)
    first = offsets_of(np.bincount(query, minlength=positives.n_queries))[query]
    ranks = np.zeros(len(positives.tiles), np.int64)
    ranks[positives.offsets[query] + np.arange(len(query)) - first] = column + 1
    tiles = ranking.tiles[:, : min(cut, n_tiles)].copy()  # or the whole lists would stay
    return Ranking(tiles, ranking.tie_dependent, ranks)


def _rank_described(
    described: Descriptors,
    gallery: Rows,
    truth: RetrievalTruth,
    kept: int,
    depth: int,
    metric: Metric,
    run: Run,
    asked: Asked,
) -> Ranking:
    return rank_by_descriptors(
        described.queries[asked.rows],
        gallery,
        k=kept,
        metric=metric,
        positives=asked.positives,
        depth=depth,
        memory_bytes=run.memory_bytes,
        jobs=run.jobs,
        names=asked.names,
        tile_names=truth.tiles["id"].to_numpy(),
        engine=run.engine,
    )


def _rank_some(
    ranked: RankedIds, truth: RetrievalTruth, kept: int, depth: int, asked: Asked
) -> Ranking:
    ids = ranked.ids[asked.rows]
    scores = None if ranked.scores is None else ranked.scores[asked.rows]
    width = _ranks_that_matter(ids, scores, kept)
    return rank_by_ids(
        _tile_indices(truth, ids[:, :width], asked.names),
        None if scores is None else scores[:, :width],
        asked.positives,
        n_tiles=len(truth.tiles),
        k=kept,
        depth=depth,
        names=asked.names,
    )


def _ranks_that_matter(ids: NDArray[np.str_], scores: Floats | None, kept: int) -> int:
    """Return how many ranks decide the first `kept`: as many, and the ties that go on beyond."""
    if scores is None:
        return kept
    on = (scores[:, kept:] == scores[:, kept - 1 : -1]) & (ids[:, kept:] != "")
    tied = np.logical_and.accumulate(on, axis=1).sum(axis=1)
    return kept + int(tied.max(initial=0)) + 1


def _tile_indices(
    truth: RetrievalTruth, ids: NDArray[np.str_], names: NDArray[np.str_]
) -> NDArray[np.int32]:
    found = rows_among(ids.ravel(), truth.tiles["id"].to_numpy(str)).reshape(ids.shape)
    strange = (found < 0) & (ids != "")
    rows = np.flatnonzero(strange.any(axis=1))
    if rows.size:
        tile = str(ids[rows[0]][strange[rows[0]]][0])
        raise PredictionError(
            f"tiles that are not in the gallery of scene {truth.scene}, ranked for "
            f"{first_of(names[rows], len(names), noun='query')}; the first is {tile!r}"
            + nearest(tile, truth.tiles["id"].tolist(), 1),
            where="field 'ranked_ids'",
            expected=f"ids such as {truth.tiles['id'].iloc[0]}",
            fix=_fix_for_strange_tile(tile, truth),
        )
    tiles: NDArray[np.int32] = found.astype(np.int32)
    return tiles


def _fix_for_strange_tile(tile: str, truth: RetrievalTruth) -> str:
    scene = str(scene_of(np.array([tile]))[0])
    if "/" not in tile:
        return f"put the scene before each tile: {truth.scene}/{tile}"
    if scene != truth.scene:
        return f"rank each query against its own scene only; this tile is of scene {scene!r}"
    dropped = truth.dropped_tiles.set_index("id")["valid_share"]
    if tile in dropped.index:
        share = f"{dropped[tile]:.1%} of its pixels are valid"
        return f"leave this tile out: {share}, and dropped_tiles.csv lists it"
    if with_endings(np.array([tile])):
        return "leave out the file's ending: ids are names without it"
    return "cut the gallery with the protocol's tile sizes, or take the ids from tiles.parquet"


def _scene_gallery(described: Descriptors, truth: RetrievalTruth, memory_bytes: int) -> Rows:
    """Return the descriptors of the scene's tiles, in the tiles' order."""
    rows, gallery = _gallery_rows(described, truth), rows_of(described.gallery)
    if (np.diff(rows) == 1).all():
        return gallery.part(int(rows[0]), int(rows[0]) + len(rows))
    needed = len(rows) * gallery.shape[1] * gallery.itemsize
    if gallery.by_reference and needed > memory_bytes:
        raise PredictionError(
            f"the gallery of scene {truth.scene} takes {needed:,} bytes and is not in the order "
            f"of tiles.parquet, so that it cannot be read in pieces within {memory_bytes:,}",
            where="field 'gallery_descriptors'",
            fix="save the rows in the order of tiles.parquet, or raise --max-memory",
        )
    return rows_of(gallery.take(rows))


def _gallery_rows(described: Descriptors, truth: RetrievalTruth) -> NDArray[np.intp]:
    """Return the row of the descriptors for each tile of the scene."""
    rows = rows_among(truth.tiles["id"].to_numpy(str), described.gallery_ids)
    lacking = truth.tiles["id"].to_numpy()[rows < 0]
    if lacking.size:
        raise PredictionError(
            f"lacks descriptors of tiles of scene {truth.scene}: "
            f"{first_of(lacking, len(truth.tiles))}"
            + _meant(str(lacking[0]), described.gallery_ids, truth),
            where="field 'gallery_ids'",
            expected="every tile of the gallery: leaving some out would make the task easier",
            fix=_ALL_SCENES if lacking.size == len(rows) else "describe all tiles of tiles.parquet",
        )
    return rows


def _meant(lacking: str, given: NDArray[np.str_], truth: RetrievalTruth) -> str:
    """Show the given id that may be another spelling of a tile that is lacking."""
    strange = given[~np.isin(given, truth.tiles["id"].to_numpy(str))]
    near = nearest(lacking, strange.tolist(), 1)
    return near.replace("did you mean", "it has") if near else ""

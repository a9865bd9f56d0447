"""The retrieval track: a UAV photo finds its satellite tile; its scores, and a record a query."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import conditions_of
from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.predictions import QueryPart, assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores, Track
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import geodesic_distance_m, great_circle_m
from airzoo_bench.results.result import Reference, ScoreColumn, summarise
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.info import INFO
from airzoo_bench.retrieval.metrics import ap_name, share_name
from airzoo_bench.retrieval.predictions import (
    RankedIds,
    RetrievalPredictions,
    check_predictions,
    read_retrieval,
)
from airzoo_bench.retrieval.ranking import Ranking, rank_scene
from airzoo_bench.retrieval.settings import (
    ApVariant,
    DistanceScoring,
    ImageScoring,
    RetrievalProtocol,
    TileScoring,
)
from airzoo_bench.retrieval.truth import TOO_EMPTY, UNANSWERED, RetrievalTruth, scene_truth

RANKED_TILE = "tile@"
"""How the columns begin that name the first tiles of each list."""

Truths = Sequence[RetrievalTruth]
Measure = Callable[[Floats, Floats], Floats]

_CUT_SHORT = "cut_short"  # column of `score_scene`: lengths of lists without all positives, or 0
_NOTES = (  # count, its subject for one and for many, what of it
    ("empty_lists", "query has", "queries have", "an empty list, scored as missing"),
    ("tie_dependent", "query depends", "queries depend", "on ties, broken against the method"),
    ("unranked", "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
    ("dropped_tiles", "tile is", "tiles are", f"{TOO_EMPTY}, and in no gallery"),
)


class RetrievalTrack(Track):
    """Aerial image retrieval; see `Track`."""

    info = INFO
    protocol = RetrievalProtocol
    recorded = Track.recorded | {
        *("positives", "tie_dependent", "first_hit_rank", "ranked", f"{RANKED_TILE}*")
    }

    def open(self, path: Path, memory_bytes: int) -> RetrievalPredictions:
        """See `Track.open`."""
        return read_retrieval(path, memory_bytes)

    def truth(self, benchmark: Benchmark, scene: str) -> RetrievalTruth:
        """See `Track.truth`."""
        return scene_truth(benchmark, scene)

    def assign(
        self, predictions: RetrievalPredictions, truths: Truths, protocol: RetrievalProtocol
    ) -> Assignment:
        """See `Track.assign`."""
        check_predictions(predictions)
        return assign_queries(predictions, truths, protocol)

    def score(
        self, part: QueryPart, truth: RetrievalTruth, protocol: RetrievalProtocol, run: Run
    ) -> SceneScores:
        """See `Track.score`."""
        predictions, given, settings = part.predictions, part.rows >= 0, protocol.scores
        answered, content = given, predictions.content
        if isinstance(content, RankedIds):
            answered = given & (content.ids[part.rows, 0] != "")
        try:
            ranked = rank_scene(predictions, truth, part.rows, settings, run)
            records = score_scene(truth, ranked, answered, settings, run.jobs)
        except PredictionError as error:
            raise error.inside(predictions.path) from error
        unranked = answered & (records["ranked"] == 0)
        lengths = records.pop(_CUT_SHORT)
        facts = {"unranked": int(unranked.sum()), "short": lengths[lengths > 0].tolist()}
        counts = {
            "queries": len(truth.queries),
            "tiles": len(truth.tiles),
            "missing": int((~answered).sum()),
            "empty_lists": int((given & ~answered).sum()),
            "tie_dependent": int(records["tie_dependent"].sum()),
            "without_positive": len(truth.excluded) + int((truth.positives.counts == 0).sum()),
            "without_ground_point": truth.without_ground_point,
            "dropped_tiles": len(truth.dropped_tiles),
        }
        return SceneScores(records, counts, content.kind, facts=facts)

    def scores(self, protocol: RetrievalProtocol) -> list[ScoreColumn]:
        """See `Track.scores`."""
        return list_scores(protocol.scores)

    def notes(
        self,
        predictions: RetrievalPredictions,
        truths: Truths,
        protocol: RetrievalProtocol,
        scored: Sequence[SceneScores],
    ) -> list[str]:
        """See `Track.notes`."""
        notes = []
        for name, one, many, what in _NOTES:
            if count := sum((scene.counts | scene.facts)[name] for scene in scored):
                notes.append(f"{counted(count, one, many)} {what}")
        if short := [length for scene in scored for length in scene.facts["short"]]:
            deep, whole = map(", ".join, _scores_beyond(protocol.scores, min(short)))
            ends = f"{counted(len(short), 'list ends', 'lists end')} without all positives"
            most = max(map(int, re.findall(r"@(\d+)", deep)), default=0)
            shortest = f"the shortest after {min(short):,}; give {most} tiles a query"
            notes.append(f"{deep or whole}: {ends}, {shortest if deep else 'which are not found'}")
        excluded = pd.concat([truth.excluded for truth in truths])
        unanswered = excluded["id"][excluded["reason"] == UNANSWERED]
        if len(unanswered):
            notes.append(f"queries that no tile answers, left out: {first_of(unanswered)}")
        return notes

    def references(self, protocol: RetrievalProtocol, truths: Truths) -> dict[str, Reference]:
        """Return what tiles in random order score, by scene."""
        by_scene = {
            one.scene: metrics.chance_scores(one.positives.counts, len(one.tiles), protocol.scores)
            for one in truths
        }
        records = pd.concat(pd.DataFrame(found).assign(scene=s) for s, found in by_scene.items())
        scores = [score for score in list_scores(protocol.scores) if score.key in records]
        summary = asdict(summarise(records, scores, [truth.scene for truth in truths]))
        meaning = "what tiles in random order score on average, computed exactly"
        return {"Chance level": Reference(meaning=meaning, **summary)}

    def template(self, out: Path, truths: Truths, protocol: RetrievalProtocol, kind: str) -> None:
        """Write random lists, or random descriptors."""
        random = np.random.default_rng(0)
        queries = [truth.queries["id"].to_numpy(str) for truth in truths]
        galleries = [truth.tiles["id"].to_numpy(str) for truth in truths]
        arrays: dict[str, Any] = {"query_ids": np.concatenate(queries)}
        if kind == "ranked-ids":
            longest = min(protocol.scores.ranks_kept, max(map(len, galleries)))
            lists = [
                [*random.permutation(tiles)[:longest], *[""] * longest][:longest]
                for asked, tiles in zip(queries, galleries, strict=True)
                for _ in asked
            ]
            arrays["ranked_ids"] = np.array(lists, dtype=str)
        else:
            arrays["gallery_ids"] = np.concatenate(galleries)
            for name in ("query", "gallery"):
                shape = len(arrays[f"{name}_ids"]), 8
                arrays[f"{name}_descriptors"] = random.standard_normal(shape, np.float32)
        write_predictions(out, protocol.name, arrays)


def list_scores(settings: TileScoring | ImageScoring) -> list[ScoreColumn]:
    """Return the scores that a protocol asks for, the paper's first."""
    share, error = ScoreColumn.share, ScoreColumn.error
    scores = [share(f"recall@{k}", f"R@{k}", headline=True) for k in settings.recall_at]
    if isinstance(settings, TileScoring):
        variants = dict.fromkeys((settings.ap, *get_args(ApVariant)))  # the protocol's own first
        names = [ap_name(settings.ap_at, one) for one in variants]
        return [
            *scores,
            *(share(n, n.replace("ap", "AP"), headline=n == names[0]) for n in names),
            *(share("map", "mAP"), share("mrr", "MRR")),
            *(share(f"ndcg@{k}", f"nDCG@{k}") for k in settings.ndcg_at),
            error("distance_m", "Distance", "m", "median"),
            *(share(f"distance<{m:g}m", f"D<{m:g}m") for m in settings.distance_below_m),
            *(share(f"sdm@{k}", f"SDM@{k}") for k in settings.sdm_at),
            *(share(f"pdm@{k}", f"PDM@{k}") for k in settings.pdm_at),
        ]
    recall, distances = share_name(settings.recall_at_share), settings.distances
    aps = [("map", "mAP"), ("ap/trapezoid", "AP/trapezoid")]
    own, other = aps if settings.ap == "trec" else aps[::-1]
    scores.append(share(recall, recall.replace("recall", "R"), headline=True))
    scores.append(share(own[0], "AP", headline=True))
    if distances is not None:
        scores += [share(f"sdm@{k}", f"SDM@{k}", headline=True) for k in distances.sdm_at]
        for k in distances.dis_at:
            scores.append(error(f"dis@{k}", f"Dis@{k}", "m", "mean", headline=True))
        scores += [share(f"ma@{m:g}m", f"MA@{m:g}m") for m in distances.ma_below_m]
    return [*scores, share(*other), share("mrr", "MRR")]


def _scores_beyond(settings: TileScoring | ImageScoring, rank: int) -> tuple[list[str], list[str]]:
    """Name the headline scores at ranks beyond one, and the others that look beyond it."""
    at_rank, others = list[str](), list[str]()
    for score in list_scores(settings):
        found = re.match(r"(?:recall|ap|ndcg)@(\d+)(?:/|$)", score.key)
        if int(found[1]) > rank if found else re.match("recall|ap|map|mrr", score.key):
            (at_rank if found and score.headline else others).append(score.title)
    return at_rank, others


def score_scene(
    truth: RetrievalTruth,
    ranked: Iterable[tuple[Ints, Ranking]],
    answered: Bools,
    settings: TileScoring | ImageScoring,
    jobs: int = 1,
) -> pd.DataFrame:
    """Score every query of a scene, in the blocks in which they are ranked."""
    blocks = [(rows, _score_block(truth, rows, found, settings, jobs)) for rows, found in ranked]
    order = np.concatenate([rows for rows, _ in blocks])
    scores = pd.concat([table for _, table in blocks], ignore_index=True)
    if (np.diff(order) < 0).any():  # those that are not searched come last
        scores = scores.iloc[np.argsort(order)].reset_index(drop=True)
    first = pd.DataFrame({"scene": truth.scene, "query": truth.queries["id"].array})
    first = first.assign(answered=answered, positives=truth.positives.counts)
    return pd.concat([first, scores, conditions_of(truth.queries)], axis=1)


def _score_block(
    truth: RetrievalTruth,
    rows: Ints,
    ranking: Ranking,
    settings: TileScoring | ImageScoring,
    jobs: int,
) -> pd.DataFrame:
    right, tiles, n_tiles = truth.positives.take(rows), ranking.tiles, len(truth.tiles)
    hits = metrics.hit_matrix(tiles, right.offsets, right.tiles, n_tiles)
    kept, length = tiles[:, : settings.ranks_kept], (tiles >= 0).sum(axis=1)
    whole, aps, ndcg_at = n_tiles, dict[int, Any](), tuple[int, ...]()
    if isinstance(settings, TileScoring):
        whole, ndcg_at = min(n_tiles, settings.ranks_kept), settings.ndcg_at
        aps = {settings.ap_at: get_args(ApVariant)}
    columns: dict[str, Any] = {
        "tie_dependent": ranking.tie_dependent,
        "first_hit_rank": metrics.first_hit_rank(hits[:, : settings.ranks_kept]),
        "ranked": (kept >= 0).sum(axis=1),
        _CUT_SHORT: length * ((length < whole) & (hits.sum(axis=1) < right.counts)),
    }
    ids = pd.array([*truth.tiles["id"], ""], dtype="str")
    for k in range(max(settings.recall_at)):
        ranked = tiles[:, k] if k < tiles.shape[1] else np.full(len(rows), -1)
        columns[f"{RANKED_TILE}{k + 1}"] = ids.take(ranked)
    columns |= hit_columns(hits, right.counts, settings.recall_at, aps, ndcg_at)
    if isinstance(settings, TileScoring):
        return pd.DataFrame(columns | _tile_distance_scores(truth, rows, tiles, settings, jobs))
    last = metrics.rank_of_share(n_tiles, settings.recall_at_share)
    columns[share_name(settings.recall_at_share)] = metrics.recall_at(hits, last)
    columns["ap/trapezoid"] = metrics.trapezoid_precision(hits, right.counts)
    if settings.distances is not None:
        columns |= _image_distance_scores(truth, rows, tiles, settings.distances)
    return pd.DataFrame(columns)


def hit_columns(
    hits: Bools,
    n_positives: Ints,
    recall_at: Sequence[int],
    ap_at: Mapping[int, Sequence[ApVariant]],
    ndcg_at: Sequence[int],
) -> dict[str, Floats]:
    """Return the columns of the records that depend on ranks of hits, averaged by their mean."""
    columns = {f"recall@{k}": metrics.recall_at(hits, k) for k in recall_at}
    for k, variants in ap_at.items():
        for one in variants:
            columns[ap_name(k, one)] = metrics.average_precision_at(hits, n_positives, k, one)
    columns["map"] = metrics.average_precision(hits, n_positives)
    columns["mrr"] = metrics.reciprocal_rank(hits)
    return columns | {f"ndcg@{k}": metrics.ndcg_at(hits, n_positives, k) for k in ndcg_at}


def _tile_distance_scores(
    truth: RetrievalTruth, rows: Ints, ranked: NDArray[np.int32], settings: TileScoring, jobs: int
) -> dict[str, Floats]:
    """Score the metres from the footprint's centre to the centres of the first tiles."""
    tiles = ranked[:, : max(1, *settings.sdm_at, *settings.pdm_at)]
    measure = partial(geodesic_distance_m, jobs=jobs)
    centres = truth.tile_centres
    metres = _distances(truth.footprint_centres[rows], centres, tiles, measure)
    sizes = np.where(tiles >= 0, truth.tiles["size_m"].to_numpy(np.float64)[tiles], 1.0)
    first, sdm_scale = metres[:, 0], settings.sdm_scale_per_m
    sigmoid = settings.pdm_steepness, settings.pdm_tolerance_tiles
    return {
        "distance_m": first,
        **{f"distance<{m:g}m": (first < m).astype(float) for m in settings.distance_below_m},
        **{f"sdm@{k}": metrics.sdm_at(metres, k, sdm_scale) for k in settings.sdm_at},
        **{f"pdm@{k}": metrics.pdm_at(metres, k, sizes, *sigmoid) for k in settings.pdm_at},
    }


def _image_distance_scores(
    truth: RetrievalTruth, rows: Ints, ranked: NDArray[np.int32], settings: DistanceScoring
) -> dict[str, Floats]:
    """Score the distances between positions that a benchmark states, by its own formulas."""
    asked, images = truth.positions
    queries, measure = asked[rows], _MEASURES[settings.metres]
    tiles = ranked[:, : max(*settings.sdm_at, *settings.dis_at)]
    metres = apart = _distances(queries, images, tiles, measure)
    if settings.sdm_unit == "degree":
        # DenseUAV's: of longitude and latitude alike, from float32.
        asked, given = (one.astype(np.float32).astype(np.float64) for one in (queries, images))
        apart = _distances(asked, given, tiles, _MEASURES["plane"])
    worst = measure(queries[:, None], images[None]).max(axis=1)
    return {
        **{f"sdm@{k}": metrics.sdm_at(apart, k, settings.sdm_scale) for k in settings.sdm_at},
        **{f"ma@{m:g}m": (metres[:, 0] < m).astype(float) for m in settings.ma_below_m},
        **{f"dis@{k}": metrics.dis_at(metres, k, worst) for k in settings.dis_at},
    }


def _distances(
    queries: Floats, places: Floats, tiles: NDArray[np.int32], measure: Measure
) -> Floats:
    """Return the distances (Q, K) of queries from the places of their tiles, infinite without."""
    pairs = np.broadcast_to(queries[:, None], (*tiles.shape, 2))
    known = (tiles >= 0) & np.isfinite(pairs).all(axis=-1)
    distances = np.full(tiles.shape, np.inf)
    distances[known] = measure(pairs[known], places[tiles[known]])
    return distances


_MEASURES: dict[str, Measure] = {
    "sphere": great_circle_m,
    "ellipsoid": geodesic_distance_m,
    "plane": lambda a, b: np.asarray(np.hypot(*np.moveaxis(b - a, -1, 0))),
}

TRACK = RetrievalTrack()

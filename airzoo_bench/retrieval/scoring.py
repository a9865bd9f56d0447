"""The scores that protocols ask for, and the records of a scene: a row a query."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score, concatenate, summarise
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.metrics import ap_name, share_name
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.settings import ApVariant, DistanceScores, ImageScores, TileScores
from airzoo_bench.retrieval.truth import RetrievalTruth

RANKED_TILE = "tile@"
"""How the columns begin that name the first tiles of each list."""

RECORDED = frozenset(
    (
        *("scene", "query", "answered", "positives", "tie_dependent", "first_hit_rank", "ranked"),
        f"{RANKED_TILE}*",
    )
)
"""Columns of the records that are neither scores nor conditions of the queries."""

AP_VARIANTS: tuple[ApVariant, ...] = ("precision", "min", "trec", "hits")

_EQUATOR_M = 6378137.0
_CELLS = 1 << 20  # distances at a time

Between = Callable[[Floats, Floats], Floats]
"""Takes positions (..., 2) of queries and of images, and returns distances (...)."""


def list_scores(settings: TileScores | ImageScores) -> list[Score]:
    """Return the scores that a protocol asks for, the paper's first."""
    share = Score.share
    headline = [share(f"recall@{k}", f"R@{k}", headline=True) for k in settings.recall_at]
    if isinstance(settings, ImageScores):
        return headline + _image_scores(settings)
    ap = ap_name(settings.ap_at, settings.ap)
    others = [ap_name(settings.ap_at, variant) for variant in AP_VARIANTS]
    return [
        *headline,
        share(ap, ap.replace("ap", "AP"), headline=True),
        *(share(name, name.replace("ap", "AP")) for name in others if name != ap),
        *(share("map", "mAP"), share("mrr", "MRR")),
        *(share(f"ndcg@{k}", f"nDCG@{k}") for k in settings.ndcg_at),
        Score("distance_m", "Distance", "m", higher_is_better=False, average="median"),
        *(share(f"distance<{m:g}m", f"D<{m:g}m") for m in settings.distance_below_m),
        *(share(f"sdm@{k}", f"SDM@{k}") for k in settings.sdm_at),
        *(share(f"pdm@{k}", f"PDM@{k}") for k in settings.pdm_at),
    ]


def _image_scores(settings: ImageScores) -> list[Score]:
    ap, other, beyond = "map", "ap/trapezoid", "AP/trapezoid"
    if settings.ap == "trapezoid":
        ap, other, beyond = "ap/trapezoid", "map", "mAP"
    share, near = share_name(settings.recall_at_share), settings.distances
    scores = [Score.share(share, share.replace("recall", "R"), headline=True)]
    scores.append(Score.share(ap, "AP", headline=True))
    if near is not None:
        scores += [Score.share(f"sdm@{k}", f"SDM@{k}", headline=True) for k in near.sdm_at]
        scores += [
            Score(f"dis@{k}", f"Dis@{k}", "m", False, "mean", headline=True) for k in near.dis_at
        ]
        scores += [Score.share(f"ma@{m:g}m", f"MA@{m:g}m") for m in near.ma_below_m]
    return [*scores, Score.share(other, beyond), Score.share("mrr", "MRR")]


def chance_level(truths: Sequence[RetrievalTruth], settings: TileScores | ImageScores) -> Reference:
    """Return what tiles in random order score, by scene; see `chance_scores`."""
    tables = []
    for truth in truths:
        found = metrics.chance_scores(truth.positives.counts, len(truth.tiles), settings)
        tables.append(pd.DataFrame(found).assign(scene=truth.scene))
    records = concatenate(tables)
    scores = [score for score in list_scores(settings) if score.column in records]
    summary = summarise(records, scores, [truth.scene for truth in truths])
    return Reference(
        meaning="what tiles in random order score on average, computed exactly", **asdict(summary)
    )


def score_scene(
    truth: RetrievalTruth,
    ranking: Ranking,
    answered: Bools,
    settings: TileScores | ImageScores,
    *,
    jobs: int = 1,
) -> pd.DataFrame:
    """Score every query of a scene."""
    positives, n_tiles = truth.positives, len(truth.tiles)
    hits = metrics.hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
    columns: dict[str, Any] = {
        "scene": truth.scene,
        "query": truth.queries["id"].array,
        "answered": answered,
        "positives": positives.counts,
        "tie_dependent": ranking.tie_dependent,
        "first_hit_rank": metrics.first_hit_rank(hits),
        "ranked": (ranking.tiles >= 0).sum(axis=1),
        **_ranked_tiles(truth, ranking.tiles, max(settings.recall_at)),
    }
    if isinstance(settings, ImageScores):
        columns |= {f"recall@{k}": metrics.recall_at(hits, k) for k in settings.recall_at}
        columns |= _list_columns(truth, ranking, settings)
        if settings.distances is not None:
            columns |= _image_distances(truth, ranking.tiles, settings.distances)
    else:
        aps = {settings.ap_at: AP_VARIANTS}
        columns |= hit_columns(hits, positives.counts, settings.recall_at, aps, settings.ndcg_at)
        columns |= _tile_distances(truth, ranking.tiles, settings, jobs)
    return pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)


def _ranked_tiles(truth: RetrievalTruth, ranked: NDArray[np.int32], depth: int) -> dict[str, Any]:
    """Return the ids of the first tiles, empty beyond the end of a list."""
    ids = pd.array([*truth.tiles["id"], ""], dtype="str")
    tiles = np.full((len(ranked), depth), -1, np.int32)
    first = ranked[:, :depth]
    tiles[:, : first.shape[1]] = first
    return {f"{RANKED_TILE}{k + 1}": ids.take(tiles[:, k]) for k in range(depth)}


def hit_columns(
    hits: Bools,
    n_positives: Ints,
    recall_at: Sequence[int],
    ap_at: Mapping[int, Sequence[ApVariant]],
    ndcg_at: Sequence[int],
) -> dict[str, Floats]:
    """Return the columns of the records that depend on the ranks of hits."""
    columns = {f"recall@{k}": metrics.recall_at(hits, k) for k in recall_at}
    for k, variants in ap_at.items():
        for variant in variants:
            found = metrics.average_precision_at(hits, n_positives, k, variant)
            columns[ap_name(k, variant)] = found
    columns["map"] = metrics.average_precision(hits, n_positives)
    columns["mrr"] = metrics.reciprocal_rank(hits)
    return columns | {f"ndcg@{k}": metrics.ndcg_at(hits, n_positives, k) for k in ndcg_at}


def _tile_distances(
    truth: RetrievalTruth, ranked: NDArray[np.int32], settings: TileScores, jobs: int
) -> dict[str, Floats]:
    """Score the metres from the footprint's centre to the centres of the first tiles."""
    tiles = ranked[:, : max(1, *settings.sdm_at, *settings.pdm_at)]
    centres = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2
    queries = np.repeat(truth.footprint_centres[:, None], tiles.shape[1], axis=1)
    there = (tiles >= 0) & np.isfinite(queries).all(axis=-1)
    metres = np.full(tiles.shape, np.inf)
    metres[there] = geodesic_distance_m(queries[there], centres[tiles[there]], jobs=jobs)
    sizes = np.where(tiles >= 0, truth.tiles["size_m"].to_numpy(np.float64)[tiles], 1.0)
    first = metres[:, 0]
    sigmoid = settings.pdm_steepness, settings.pdm_tolerance_tiles
    return {
        "distance_m": first,
        **{f"distance<{m:g}m": (first < m).astype(float) for m in settings.distance_below_m},
        **{
            f"sdm@{k}": metrics.sdm_at(metres, k, settings.sdm_scale_per_m) for k in settings.sdm_at
        },
        **{f"pdm@{k}": metrics.pdm_at(metres, k, sizes, *sigmoid) for k in settings.pdm_at},
    }


def _list_columns(
    truth: RetrievalTruth, ranking: Ranking, settings: ImageScores
) -> dict[str, Floats]:
    """Return the scores of a gallery of images that read whole lists."""
    positives, ranks = truth.positives, ranking.hit_ranks
    assert ranks is not None
    some, first = positives.counts > 0, np.zeros(positives.n_queries, np.int64)
    first[some] = ranks[positives.offsets[:-1][some]]
    last = metrics.rank_of_share(len(truth.tiles), settings.recall_at_share)
    plain, trapezoid = metrics.list_precisions(ranks, positives)
    return {
        share_name(settings.recall_at_share): ((first > 0) & (first <= last)).astype(float),
        "ap/trapezoid": trapezoid,
        "map": plain,
        "mrr": np.divide(1.0, first, out=np.zeros(len(first)), where=first > 0),
    }


def _image_distances(
    truth: RetrievalTruth, ranked: NDArray[np.int32], settings: DistanceScores
) -> dict[str, Floats]:
    """Score the distances between positions that a benchmark states, by its own formulas."""
    assert truth.positions is not None
    queries, images = truth.positions
    tiles = ranked[:, : max(*settings.sdm_at, *settings.dis_at)]
    between = _MEASURES[settings.metres]

    def distances(measure: Between) -> Floats:
        return np.where(tiles >= 0, measure(queries[:, None], images[tiles]), np.inf)

    metres = distances(between)
    apart = distances(_degrees_apart) if settings.sdm_unit == "degree" else metres
    step = max(1, _CELLS // len(images))
    blocks = (queries[start : start + step, None] for start in range(0, len(queries), step))
    worst = np.concatenate([between(block, images[None]).max(axis=1) for block in blocks])
    return {
        **{f"sdm@{k}": metrics.sdm_at(apart, k, settings.sdm_scale) for k in settings.sdm_at},
        **{f"ma@{m:g}m": (metres[:, 0] < m).astype(float) for m in settings.ma_below_m},
        **{f"dis@{k}": metrics.dis_at(metres, k, worst) for k in settings.dis_at},
    }


def _straight(queries: Floats, images: Floats) -> Floats:
    return np.asarray(np.hypot(*np.moveaxis(images - queries, -1, 0)))


def _degrees_apart(queries: Floats, images: Floats) -> Floats:
    """Return degrees as DenseUAV has them: of longitude and latitude alike, from float32."""
    single = (positions.astype(np.float32).astype(np.float64) for positions in (queries, images))
    return _straight(*single)


def _great_circle(queries: Floats, images: Floats) -> Floats:
    (lon_a, lat_a), (lon_b, lat_b) = (np.moveaxis(np.radians(p), -1, 0) for p in (queries, images))
    across = np.cos(lat_a) * np.cos(lat_b) * np.sin((lon_a - lon_b) / 2) ** 2
    haversine = np.sin((lat_a - lat_b) / 2) ** 2 + across
    return np.asarray(2 * _EQUATOR_M * np.arcsin(np.sqrt(np.minimum(haversine, 1.0))))


_MEASURES: dict[str, Between] = {
    "sphere": _great_circle,
    "ellipsoid": geodesic_distance_m,
    "plane": _straight,
}

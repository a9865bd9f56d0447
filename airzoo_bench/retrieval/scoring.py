"""Scoring one scene of the retrieval track: its rankings become records, a row a query."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.retrieval.distance_metrics import is_within, pdm_at, sdm_at, top1_distance
from airzoo_bench.retrieval.image_scores import image_columns
from airzoo_bench.retrieval.metrics import first_hit_rank, recall_at
from airzoo_bench.retrieval.pairs import hit_matrix
from airzoo_bench.retrieval.scores import AP_VARIANTS, hit_columns
from airzoo_bench.retrieval.settings import ImageScores, RetrievalScores
from airzoo_bench.retrieval.ties import Ranking
from airzoo_bench.retrieval.truth import RetrievalTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["score_scene"]


def score_scene(
    truth: RetrievalTruth,
    ranking: Ranking,
    answered: Bools,
    settings: RetrievalScores | ImageScores,
    *,
    jobs: int = 1,
) -> pd.DataFrame:
    """Score every query of a scene."""
    import pandas as pd

    hits = hit_matrix(
        ranking.tiles, truth.positives.offsets, truth.positives.tiles, len(truth.tiles)
    )
    columns: dict[str, Any] = {
        "scene": truth.scene,
        "query": truth.queries["id"].array,
        "answered": answered,
        "positives": truth.positives.counts,
        "tie_dependent": ranking.tie_dependent,
        "first_hit_rank": first_hit_rank(hits),
        **_ranked_tiles(truth, ranking, max(settings.recall_at)),
    }
    if isinstance(settings, ImageScores):
        columns |= {f"recall@{k}": recall_at(hits, k) for k in settings.recall_at}
        columns |= image_columns(truth, ranking, settings)
    else:
        columns |= hit_columns(
            hits,
            truth.positives.counts,
            recall_at=settings.recall_at,
            ap_at={settings.ap_at: AP_VARIANTS},
            ndcg_at=settings.ndcg_at,
        )
        columns |= _distance_scores(truth, ranking, settings, jobs)
    return pd.concat([pd.DataFrame(columns), truth.conditions], axis=1)


def _distance_scores(
    truth: RetrievalTruth, ranking: Ranking, settings: RetrievalScores, jobs: int
) -> dict[str, Floats]:
    depth = max(1, *settings.sdm_at, *settings.pdm_at)
    tiles = ranking.tiles[:, :depth]
    distances = _distances(truth, tiles, jobs)
    sizes = np.where(tiles >= 0, truth.tiles["size_m"].to_numpy(np.float64)[tiles], 1.0)
    first = top1_distance(distances)
    scores = {"distance_m": first}
    scores |= {f"distance<{m:g}m": is_within(first, m) for m in settings.distance_below_m}
    scores |= {f"sdm@{k}": sdm_at(distances, k, settings.sdm_scale_per_m) for k in settings.sdm_at}
    for k in settings.pdm_at:
        scores[f"pdm@{k}"] = pdm_at(
            distances,
            k,
            tile_size_m=sizes,
            steepness=settings.pdm_steepness,
            tolerance=settings.pdm_tolerance_tiles,
        )
    return scores


def _distances(truth: RetrievalTruth, tiles: NDArray[np.int32], jobs: int) -> Floats:
    """Return metres from footprint centre to tile centre; infinite where either is missing."""
    boxes = truth.boxes
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    queries = np.repeat(truth.footprint_centres[:, None], tiles.shape[1], axis=1)
    there = (tiles >= 0) & np.isfinite(queries).all(axis=-1)
    distances = np.full(tiles.shape, np.inf)
    distances[there] = geodesic_distance_m(queries[there], centres[tiles[there]], jobs=jobs)
    return distances


def _ranked_tiles(truth: RetrievalTruth, ranking: Ranking, depth: int) -> dict[str, Any]:
    """Return how many tiles each list has, and the ids of the first, empty beyond its end."""
    import pandas as pd

    ids = pd.array([*truth.tiles["id"], ""], dtype="str")
    tiles = np.full((len(ranking.tiles), depth), -1, np.int32)
    given = ranking.tiles[:, :depth]
    tiles[:, : given.shape[1]] = given
    ranked = (ranking.tiles >= 0).sum(axis=1)
    return {"ranked": ranked} | {f"tile@{k + 1}": ids.take(tiles[:, k]) for k in range(depth)}

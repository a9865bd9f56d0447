"""Scoring a scene: a claim is aligned, made a cloud, prepared like the truth, and compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.alignment.cameras import Alignment
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.curves import Curve, curve, even_thresholds
from airzoo_bench.reconstruction.distances.both_ways import CloudDistances, cloud_distances
from airzoo_bench.reconstruction.metrics import CloudScores, score_distances
from airzoo_bench.reconstruction.placing import (
    AlignedScene,
    BlockWork,
    MatchedPrediction,
    ScoringSettings,
)
from airzoo_bench.reconstruction.pose_scores import pose_scores
from airzoo_bench.reconstruction.prepared import PreparedCloud, finite_pieces
from airzoo_bench.reconstruction.scores import f1_column, share_column
from airzoo_bench.reconstruction.settings import ReconstructionScores

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ScoredScene", "score_missing", "score_scene"]


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """What came of a scene.

    Attributes
    ----------
    record : dict
        One row of the records.
    counts : dict of str to int
        What a result states of the scene.
    curve : Curve or None
        None where there is no prediction.
    alignment : Alignment or None
    clouds : tuple of PreparedCloud, or None
        Prediction and truth as they were compared.
    distances : CloudDistances or None
    kind : str or None
        What the prediction holds: ``cloud``, ``mesh``, ``depth`` or ``points``.
    notes : tuple of str
        What there is to say about the scene.
    """

    record: dict[str, Any]
    counts: dict[str, int]
    curve: Curve | None = None
    alignment: Alignment | None = None
    clouds: tuple[PreparedCloud, PreparedCloud] | None = None
    distances: CloudDistances | None = field(default=None, repr=False)
    kind: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def records(self) -> pd.DataFrame:
        """The record, as a table of one row."""
        import pandas as pd

        return pd.DataFrame([self.record])


def score_scene(
    claim: MatchedPrediction,
    placed: AlignedScene,
    cameras: PosedCameras,
    rules: ScoringSettings,
    work: BlockWork,
) -> ScoredScene:
    """Score the claim of one scene.

    Parameters
    ----------
    claim : MatchedPrediction
    placed : AlignedScene
        What `placing.place_claim` makes of it.
    cameras : PosedCameras
        All true cameras.
    rules : ScoringSettings
    work : BlockWork

    Raises
    ------
    BenchmarkError
        The protocol's crop leaves no point of the truth.
    UserError
        Temporary files of large clouds cannot be written.
    """
    alignment, predicted, true = placed.alignment, placed.cloud, placed.truth
    distances = cloud_distances(
        predicted.source,
        true.source,
        block_points=work.block_points,
        threads=work.threads,
        folder=None,
        progress=work.progress,
    )
    recalled = _recalled(distances, placed, work)
    scores = _scores(distances.to_truth, recalled, rules.scores)
    poses = pose_scores(claim.cameras, alignment.transform, cameras, rules.scores)
    steps = even_thresholds(rules.scores.curve_up_to_m, rules.scores.curve_steps)
    counts = {
        "queries": 1,
        "missing": 0,
        "points": len(distances.to_truth),
        "truth_points": len(distances.to_prediction),
        "truth_unseen": len(distances.to_prediction) - len(recalled),
        "distrusted": placed.distrusted,
        "not_finite": predicted.not_finite,
        "outside": predicted.outside,
        "thinned": predicted.thinned,
        "truth_outside": true.outside,
        "truth_thinned": true.thinned,
        "cameras": alignment.cameras,
        "cameras_missing": alignment.missing,
        "inlier_cameras": alignment.inliers,
    }
    record = {"scene": claim.scene, "answered": True, **_without(counts, "queries", "missing")}
    return ScoredScene(
        record | _alignment_columns(alignment) | _columns(scores, rules.scores) | poses,
        counts,
        curve(distances.to_truth, recalled, steps),
        alignment,
        (predicted, true),
        distances,
    )


def score_missing(scene: str, scores: ReconstructionScores) -> ScoredScene:
    """Score a scene that the prediction lacks: 0, and infinite distances."""
    worst = score_distances(
        np.zeros(0),
        np.full(1, np.inf),
        thresholds=_thresholds(scores),
        percentiles=(),
        max_distance=scores.clip_m,
    )
    record = {"scene": scene, "answered": False, "points": 0, **_columns(worst, scores)}
    return ScoredScene(record, {"queries": 1, "missing": 1, "points": 0})


def _thresholds(settings: ReconstructionScores) -> list[float]:
    return sorted({*settings.f1_below_m, settings.headline_below_m})


def _recalled(distances: CloudDistances, placed: AlignedScene, work: BlockWork) -> Floats:
    """Distances of the true points that recall and completeness are over."""
    if placed.observed is None:
        return distances.to_prediction
    pieces = finite_pieces(placed.truth.source, work.block_points)
    seen = [placed.observed.holds(points) for points in pieces]
    return distances.to_prediction[np.concatenate(seen)]


def _scores(to_truth: Floats, to_prediction: Floats, settings: ReconstructionScores) -> CloudScores:
    return score_distances(
        to_truth,
        to_prediction,
        thresholds=_thresholds(settings),
        percentiles=(),
        max_distance=settings.clip_m,
    )


def _columns(scores: CloudScores, settings: ReconstructionScores) -> dict[str, float]:
    columns = {
        "chamfer_m": scores.chamfer,
        "accuracy_m": scores.accuracy,
        "completeness_m": scores.completeness,
        "accuracy_median_m": scores.to_truth.median,
        "completeness_median_m": scores.to_prediction.median,
    }
    for limit, at in zip(_thresholds(settings), scores.at, strict=True):
        columns[share_column("precision", limit)] = at.precision
        columns[share_column("recall", limit)] = at.recall
        columns[f1_column(limit)] = at.f1
    return columns


def _alignment_columns(alignment: Alignment) -> dict[str, Any]:
    centres, turns = alignment.centres, alignment.rotations_deg
    return {
        "alignment": alignment.method,
        "scale": alignment.transform.scale,
        "centres_rms_m": np.nan if centres is None else centres.rms,
        "centres_median_m": np.nan if centres is None else centres.median,
        "rotations_median_deg": np.nan if turns is None else turns.median,
    }


def _without(counts: dict[str, int], *names: str) -> dict[str, int]:
    return {name: count for name, count in counts.items() if name not in names}

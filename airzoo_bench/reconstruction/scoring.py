"""The record of a scene: scores of the cloud by distances, and of the camera poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.camera_sets import LEAST_CAMERAS, PosedCameras
from airzoo_bench.reconstruction.alignment.cameras import Alignment
from airzoo_bench.reconstruction.alignment.similarity import Similarity, fit_many
from airzoo_bench.reconstruction.distances import CloudDistances
from airzoo_bench.reconstruction.metrics import (
    CloudScores,
    Curve,
    curve,
    even_thresholds,
    score_distances,
)
from airzoo_bench.reconstruction.pose_metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    pair_errors,
    pose_auc,
    rms_of_placed,
    step_errors,
)
from airzoo_bench.reconstruction.prepared import PreparedCloud
from airzoo_bench.reconstruction.scores import f1_column, pose_auc_column, share_column
from airzoo_bench.reconstruction.settings import ReconstructionScores

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ScoredScene",
    "pose_scores",
    "record_scene",
    "score_failed",
    "score_missing",
    "worst_poses",
]


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """What came of a scene; all but `record` and `counts` is None where no clouds are compared.

    Attributes
    ----------
    record : dict
        One row of the records.
    counts : dict of str to int
        What a result states of the scene.
    clouds : (PreparedCloud, PreparedCloud) or None
        Prediction and truth as they were compared.
    kind : str or None
        See `ScenePrediction.kind`.
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


def record_scene(
    scene: str,
    alignment: Alignment,
    clouds: tuple[PreparedCloud, PreparedCloud],
    distances: CloudDistances,
    recalled: Floats,
    distrusted: int,
    poses: dict[str, float],
    settings: ReconstructionScores,
) -> ScoredScene:
    """Score what was measured between the prepared clouds of a scene, prediction and truth."""
    predicted, true = clouds
    counts = {
        "points": len(distances.to_truth),
        "truth_points": len(distances.to_prediction),
        "truth_unseen": len(distances.to_prediction) - len(recalled),
        "distrusted": distrusted,
        "not_finite": predicted.not_finite,
        "outside": predicted.outside,
        "thinned": predicted.thinned,
        "truth_outside": true.outside,
        "truth_thinned": true.thinned,
        "cameras": alignment.cameras,
        "cameras_missing": alignment.missing,
        "inlier_cameras": alignment.inliers,
    }
    scores = _cloud_columns(distances.to_truth, recalled, settings)
    record = {"scene": scene, "answered": True, **counts, **_alignment_columns(alignment)}
    steps = even_thresholds(settings.curve_up_to_m, settings.curve_steps)
    return ScoredScene(
        record | scores | poses,
        {"queries": 1, "missing": 0, **counts},
        curve(distances.to_truth, recalled, steps),
        alignment,
        clouds,
        distances,
    )


def score_missing(scene: str, settings: ReconstructionScores) -> ScoredScene:
    """Score a scene that the prediction lacks: 0, and infinite distances."""
    worst = _cloud_columns(np.zeros(0), np.full(1, np.inf), settings)
    record = {"scene": scene, "answered": False, "points": 0, **worst}
    return ScoredScene(record, {"queries": 1, "missing": 1, "points": 0})


def score_failed(scene: str, settings: ReconstructionScores) -> ScoredScene:
    """Score a scene whose prediction cannot be aligned: as a missing one, with failed poses."""
    record = score_missing(scene, settings).record | {"answered": True} | worst_poses(settings)
    return ScoredScene(record, {"queries": 1, "missing": 0, "failed": 1, "points": 0})


def _cloud_columns(
    to_truth: Floats, to_prediction: Floats, settings: ReconstructionScores
) -> dict[str, float]:
    limits = np.array(sorted({*settings.f1_below_m, settings.headline_below_m}))
    scores: CloudScores = score_distances(
        to_truth, to_prediction, thresholds=limits, max_distance=settings.clip_m
    )
    columns = {
        "chamfer_m": scores.chamfer,
        "accuracy_m": scores.accuracy,
        "completeness_m": scores.completeness,
        "accuracy_median_m": scores.accuracy_median,
        "completeness_median_m": scores.completeness_median,
    }
    shares = scores.curve.precision, scores.curve.recall, scores.curve.f1
    for limit, *at in zip(*(values.tolist() for values in (limits, *shares)), strict=True):
        names = share_column("precision", limit), share_column("recall", limit), f1_column(limit)
        columns |= dict(zip(names, at, strict=True))
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


def pose_scores(
    predicted: PosedCameras | None,
    transform: Similarity,
    truth: PosedCameras,
    settings: ReconstructionScores,
) -> dict[str, float]:
    """Score camera poses against those of all true cameras."""
    if predicted is None or predicted.rotation is None or truth.rotation is None:
        return {}
    if len(truth.names) < 2:
        return worst_poses(settings)
    true = Poses(rotation=truth.rotation, centres=truth.centres)
    given = _by_truth(predicted, predicted.rotation, truth)
    placed = np.isfinite(given.centres).all(axis=1)
    if settings.trajectory_alignment == "umeyama":
        transform = _umeyama(given.centres[placed], true.centres[placed])
    scores = worst_poses(settings) | _aucs(given, true, settings)
    scores["cameras_placed"] = float(placed.mean())
    if placed.sum() < LEAST_CAMERAS:
        # A similarity brings two cameras to any other two.
        return scores
    aligned = transform.apply_poses(given)
    translation, rotation_deg = step_errors(aligned, true)
    scores["ate_m"] = rms_of_placed(centre_errors(aligned, true))
    scores["rpe_m"] = rms_of_placed(translation)
    scores["rpe_deg"] = rms_of_placed(rotation_deg)
    return scores


def worst_poses(settings: ReconstructionScores) -> dict[str, float]:
    """Return the pose scores of a prediction whose poses have failed."""
    aucs = {pose_auc_column(a): 0.0 for a in settings.pose_auc_below_deg}
    failed = {"ate_m": np.inf, "rpe_m": np.inf, "rpe_deg": np.inf}
    return {**aucs, "cameras_placed": 0.0, **failed}


def _aucs(given: Poses, true: Poses, settings: ReconstructionScores) -> dict[str, float]:
    limits = settings.pose_auc_below_deg
    if settings.pose_auc_rule == "depth-anything-3":
        values = auc_of_depth_anything_3(given, true, [int(limit) for limit in limits])
    else:
        errors = pair_errors(given, true, least_baseline=settings.least_baseline_m)
        values = [pose_auc(errors, limit) for limit in limits]
    return {pose_auc_column(limit): value for limit, value in zip(limits, values, strict=True)}


def _umeyama(centres: Floats, true: Floats) -> Similarity:
    """Bring all predicted cameras nearest to the true ones, as evo does."""
    if not len(centres):
        return Similarity.identity()
    (fit,), _ = fit_many(centres[None], true[None], with_scale=True)
    return fit


def _by_truth(cameras: PosedCameras, rotation: Floats, truth: PosedCameras) -> Poses:
    """Put the predicted poses in the order of the true ones, NaN where there is none."""
    rows = {name: row for row, name in enumerate(cameras.names)}
    turned = np.full((len(truth.names), 3, 3), np.nan)
    centres = np.full((len(truth.names), 3), np.nan)
    for place, name in enumerate(truth.names):
        if name in rows:
            turned[place], centres[place] = rotation[rows[name]], cameras.centres[rows[name]]
    return Poses(rotation=turned, centres=centres)

"""Scores of the camera poses of a scene, those that the prediction lacks among them."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.consensus import LEAST_CAMERAS, PosedCameras
from airzoo_bench.reconstruction.alignment.similarity import Similarity, fit_many
from airzoo_bench.reconstruction.pose_metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    pair_errors,
    pose_auc,
    rms_of_placed,
    step_errors,
)
from airzoo_bench.reconstruction.scores import pose_auc_column
from airzoo_bench.reconstruction.settings import ReconstructionScores

__all__ = ["pose_scores", "worst_poses"]


def pose_scores(
    predicted: PosedCameras | None,
    transform: Similarity,
    truth: PosedCameras,
    settings: ReconstructionScores,
) -> dict[str, float]:
    """Score camera poses against those of all true cameras.

    Parameters
    ----------
    predicted : PosedCameras or None
        By the names that the truth has, in any order.
    transform : Similarity
        Of the cloud into the frame of the truth; ATE and RPE take it where the protocol says so.
    truth : PosedCameras
        All of the scene's, in the order that RPE steps through.
    settings : ReconstructionScores

    Returns
    -------
    dict of str to float
        By column; nothing where either side has no orientations.
    """
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
    steps = step_errors(aligned, true)
    scores["ate_m"] = rms_of_placed(centre_errors(aligned, true))
    scores["rpe_m"] = rms_of_placed(steps.translation)
    scores["rpe_deg"] = rms_of_placed(steps.rotation_deg)
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
    """Bring all predicted cameras nearest to the true ones, as evo does.

    Where centres lie on a line the turn about it is free, and changes neither error.
    """
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

"""Scores of the camera poses of a scene, those that the prediction lacks among them."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.pose_metrics import (
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
        Into the frame of the truth, for ATE and RPE.
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
    errors = pair_errors(given, true, least_baseline=settings.least_baseline_m)
    aligned = transform.apply_poses(given)
    steps = step_errors(aligned, true)
    scores = {pose_auc_column(a): pose_auc(errors, a) for a in settings.pose_auc_below_deg}
    scores["ate_m"] = rms_of_placed(centre_errors(aligned, true))
    scores["rpe_m"] = rms_of_placed(steps.translation)
    scores["rpe_deg"] = rms_of_placed(steps.rotation_deg)
    return scores


def worst_poses(settings: ReconstructionScores) -> dict[str, float]:
    """Return the pose scores of a prediction whose poses have failed."""
    aucs = {pose_auc_column(a): 0.0 for a in settings.pose_auc_below_deg}
    return aucs | {"ate_m": np.inf, "rpe_m": np.inf, "rpe_deg": np.inf}


def _by_truth(cameras: PosedCameras, rotation: Floats, truth: PosedCameras) -> Poses:
    """Put the predicted poses in the order of the true ones, NaN where there is none."""
    rows = {name: row for row, name in enumerate(cameras.names)}
    turned = np.full((len(truth.names), 3, 3), np.nan)
    centres = np.full((len(truth.names), 3), np.nan)
    for place, name in enumerate(truth.names):
        if name in rows:
            turned[place], centres[place] = rotation[rows[name]], cameras.centres[rows[name]]
    return Poses(rotation=turned, centres=centres)

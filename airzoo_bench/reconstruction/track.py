"""Scoring a scene: a claim is aligned, made a cloud, prepared like the truth, and compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from airzoo_bench.errors import PredictionError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.progress import Progress, silent
from airzoo_bench.reconstruction.alignment import Alignment, align
from airzoo_bench.reconstruction.clouds import CloudSource
from airzoo_bench.reconstruction.consensus import PosedCameras
from airzoo_bench.reconstruction.curves import Curve, curve, even_thresholds
from airzoo_bench.reconstruction.distances import CloudDistances, cloud_distances
from airzoo_bench.reconstruction.fusion import DepthCloud, DepthMaps, PointCloudOfMaps, PointMaps
from airzoo_bench.reconstruction.metrics import CloudScores, score_distances
from airzoo_bench.reconstruction.pose_metrics import (
    centre_errors,
    pair_errors,
    pose_auc,
    rms_of_placed,
)
from airzoo_bench.reconstruction.prepared import Held, Moved, PreparedCloud, box_of, prepared
from airzoo_bench.reconstruction.scores import f1_column, pose_auc_column, share_column
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.settings import Fusion, Preparation, ReconstructionScores
from airzoo_bench.reconstruction.similarity import Similarity
from airzoo_bench.reconstruction.tsdf import fuse

__all__ = ["Claim", "Rules", "ScoredScene", "Work", "score_missing", "score_scene", "worst_poses"]

_ICP_READS = 1 << 20


@dataclass(frozen=True)
class Rules:
    """What a protocol states, by section."""

    alignment: AlignmentSettings
    fusion: Fusion
    preparation: Preparation
    scores: ReconstructionScores


@dataclass(frozen=True)
class Work:
    """How the work is done; no number depends on it.

    Attributes
    ----------
    block_points : int
        Clouds of more points are worked in blocks on disk.
    threads : int
    progress : Progress
    """

    block_points: int
    threads: int
    progress: Progress = silent


@dataclass(frozen=True, eq=False)
class Claim:
    """What a method claims of a scene.

    Attributes
    ----------
    scene : str
    geometry : CloudSource, DepthMaps or PointMaps
    cameras : PosedCameras or None
        By the names that the truth has; None where the prediction holds none.
    """

    scene: str
    geometry: CloudSource | DepthMaps | PointMaps
    cameras: PosedCameras | None


@dataclass(frozen=True, eq=False)
class ScoredScene:
    """What came of a scene.

    Attributes
    ----------
    record : dict
        One row of the records.
    counts : dict of str to int
    curve : Curve or None
        None where there is no prediction.
    alignment : Alignment or None
    clouds : tuple of PreparedCloud, or None
        Prediction and truth as they were compared.
    distances : CloudDistances or None
    """

    record: dict[str, Any]
    counts: dict[str, int]
    curve: Curve | None = None
    alignment: Alignment | None = None
    clouds: tuple[PreparedCloud, PreparedCloud] | None = None
    distances: CloudDistances | None = field(default=None, repr=False)


def score_scene(
    claim: Claim, truth: CloudSource, cameras: PosedCameras, rules: Rules, work: Work
) -> ScoredScene:
    """Score the claim of one scene.

    Parameters
    ----------
    claim : Claim
    truth : CloudSource
        The true cloud.
    cameras : PosedCameras
        All true cameras.
    rules : Rules
    work : Work

    Raises
    ------
    PredictionError
        It cannot be aligned (see `alignment.align`), or all of its points are NaN or infinite.
    BenchmarkError
        The true cloud has no point.
    """
    alignment = _aligned(claim, truth, cameras, rules)
    source = _in_frame(claim, alignment.transform, rules.fusion)
    box = box_of(truth)
    predicted = prepared(source, rules.preparation, box, work.block_points)
    true = prepared(truth, rules.preparation, box, work.block_points)
    _refuse_nothing_finite(claim, predicted)
    distances = cloud_distances(
        predicted.source,
        true.source,
        block_points=work.block_points,
        threads=work.threads,
        folder=None,
        progress=work.progress,
    )
    scores = _scores(distances, rules.scores)
    poses = _pose_scores(claim, alignment, cameras, rules.scores)
    steps = even_thresholds(rules.scores.curve_up_to_m, rules.scores.curve_steps)
    counts = {
        "queries": 1,
        "missing": 0,
        "points": len(distances.to_truth),
        "truth_points": len(distances.to_prediction),
        "not_finite": predicted.not_finite,
        "outside": predicted.outside,
        "thinned": predicted.thinned,
    }
    record = {"scene": claim.scene, "answered": True, **_without(counts, "queries", "missing")}
    return ScoredScene(
        record | _alignment_columns(alignment) | _columns(scores, rules.scores) | poses,
        counts,
        curve(distances.to_truth, distances.to_prediction, steps),
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
        max_distance=None,
    )
    record = {"scene": scene, "answered": False, **_columns(worst, scores)}
    return ScoredScene(record, {"queries": 1, "missing": 1, "points": 0})


def _aligned(claim: Claim, truth: CloudSource, cameras: PosedCameras, rules: Rules) -> Alignment:
    settings = rules.alignment
    if claim.cameras is None or settings.method == "none":
        return align("none", claim.cameras, cameras, ransac=None, icp=None)
    clouds = None
    if settings.method == "sim3+icp":
        unmoved = _in_frame(claim, Similarity.identity(), rules.fusion)
        clouds = _points(unmoved), _points(truth)
    return align(
        settings.method,
        claim.cameras,
        cameras,
        ransac=settings.ransac(),
        icp=settings.icp(),
        clouds=clouds,
    )


def _points(source: CloudSource) -> Floats:
    return np.concatenate(
        [np.zeros((0, 3)), *(piece.points for piece in source.pieces(_ICP_READS))]
    )


def _in_frame(claim: Claim, transform: Similarity, fusion: Fusion) -> CloudSource:
    geometry, least = claim.geometry, fusion.least_confidence
    if isinstance(geometry, PointMaps):
        return PointCloudOfMaps(geometry, transform, least)
    if not isinstance(geometry, DepthMaps):
        return Moved(geometry, transform, least)
    if fusion.method == "tsdf":
        return Held(fuse(geometry, transform, fusion.tsdf(), confidence_above=least))
    return DepthCloud(geometry, transform, fusion.max_depth_m, least)


def _refuse_nothing_finite(claim: Claim, cloud: PreparedCloud) -> None:
    if cloud.not_finite and not (cloud.source.count or cloud.outside):
        raise PredictionError(
            f"all {cloud.not_finite:,} points have a coordinate that is NaN or infinite",
            where=f"scene {claim.scene}",
            expected="finite coordinates",
            mend="write the cloud again, without points that were not reconstructed",
        )


def _thresholds(settings: ReconstructionScores) -> list[float]:
    return sorted({*settings.f1_below_m, settings.headline_below_m})


def _scores(distances: CloudDistances, settings: ReconstructionScores) -> CloudScores:
    return score_distances(
        distances.to_truth,
        distances.to_prediction,
        thresholds=_thresholds(settings),
        percentiles=(),
        max_distance=None,
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
        "cameras": alignment.cameras,
        "inlier_cameras": alignment.inliers,
        "centres_rms_m": np.nan if centres is None else centres.rms,
        "centres_median_m": np.nan if centres is None else centres.median,
        "rotations_median_deg": np.nan if turns is None else turns.median,
    }


def _pose_scores(
    claim: Claim, alignment: Alignment, truth: PosedCameras, settings: ReconstructionScores
) -> dict[str, float]:
    if claim.cameras is None or claim.cameras.rotation is None or truth.rotation is None:
        return {}
    if len(truth.names) < 2:
        return worst_poses(settings)
    true = Poses(rotation=truth.rotation, centres=truth.centres)
    given = _by_truth(claim.cameras, claim.cameras.rotation, truth)
    errors = pair_errors(given, true, least_baseline=settings.least_baseline_m)
    aligned = alignment.transform.apply_poses(given)
    aucs = {pose_auc_column(a): pose_auc(errors, a) for a in settings.pose_auc_below_deg}
    return aucs | {"ate_m": rms_of_placed(centre_errors(aligned, true))}


def _by_truth(cameras: PosedCameras, rotation: Floats, truth: PosedCameras) -> Poses:
    """Put the predicted poses in the order of the true ones, NaN where there is none."""
    rows = {name: row for row, name in enumerate(cameras.names)}
    turned = np.full((len(truth.names), 3, 3), np.nan)
    centres = np.full((len(truth.names), 3), np.nan)
    for place, name in enumerate(truth.names):
        if name in rows:
            turned[place], centres[place] = rotation[rows[name]], cameras.centres[rows[name]]
    return Poses(rotation=turned, centres=centres)


def worst_poses(settings: ReconstructionScores) -> dict[str, float]:
    """Return the pose scores of a prediction whose poses have failed."""
    return {pose_auc_column(a): 0.0 for a in settings.pose_auc_below_deg} | {"ate_m": np.inf}


def _without(counts: dict[str, int], *names: str) -> dict[str, int]:
    return {name: count for name, count in counts.items() if name not in names}

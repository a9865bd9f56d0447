"""From the prediction of a scene to its scores: open, align, prepare, measure distances, score."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import PART
from airzoo_bench.core.progress import Headed, with_progress
from airzoo_bench.evaluation.track import Run, ScenePredictions, Scored
from airzoo_bench.formats.clouds.cloud import CloudSource, FileCloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction import clouds, fusion, metrics
from airzoo_bench.reconstruction.alignment import (
    LEAST_CAMERAS,
    Alignment,
    AlignmentError,
    PosedCameras,
    Similarity,
    align,
    fit_many,
    partners,
    with_residuals,
)
from airzoo_bench.reconstruction.checks import match_cameras, scene_notes
from airzoo_bench.reconstruction.distances import CloudDistances, cloud_distances
from airzoo_bench.reconstruction.icp import refine
from airzoo_bench.reconstruction.predictions import ScenePrediction
from airzoo_bench.reconstruction.settings import ReconstructionProtocol, ReconstructionScores
from airzoo_bench.reconstruction.truth import ReconstructionTruth, open_true_cloud
from airzoo_bench.results.scores import Score

Geometry = CloudSource | fusion.DepthMaps | fusion.PointMaps

# The bytes of a point while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000

RECORDED = frozenset(
    (
        *("scene", "query", "answered", "points", "distrusted", "not_finite", "outside", "thinned"),
        *("truth_points", "truth_unseen", "truth_outside", "truth_thinned"),
        *("cameras", "cameras_missing", "inlier_cameras", "alignment", "scale"),
        *("centres_rms_m", "centres_median_m", "rotations_median_deg"),
    )
)
"""Columns of the records that are neither scores nor conditions of the scenes."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A prediction compared with the truth of its scene, both clouds as they were compared.

    `recalled` are the distances of the true points that recall is over.
    """

    alignment: Alignment
    clouds: tuple[clouds.PreparedCloud, clouds.PreparedCloud]
    distances: CloudDistances
    recalled: Floats
    curve: metrics.Curve


def score_scene(
    predictions: ScenePredictions,
    truth: ReconstructionTruth,
    protocol: ReconstructionProtocol,
    run: Run,
) -> Scored:
    """Read a scene's prediction and score it; an error names the scene."""
    place, found = f"{predictions.path}, scene {truth.scene}", None
    with open_scene(predictions, truth.scene, protocol, run.memory_bytes) as prediction:
        true_cloud = open_true_cloud(truth.cloud, run.memory_bytes, protocol.meshes.sampling)
        geometry, images = prediction.geometry, prediction.images
        if isinstance(geometry, fusion.DepthMaps) and images and not images.found.all():
            geometry = geometry.take(np.flatnonzero(images.found))  # others are nowhere
        try:
            cameras, doubts = match_cameras(images, truth, place)
            found = compare(geometry, cameras, truth, true_cloud, protocol, run)
        except AlignmentError as error:
            # The method failed here; its file is not to blame.
            worst = _worst_cloud(protocol.scores) | _worst_poses(protocol.scores)
            scored = _scored(truth.scene, worst, {"failed": 1, "points": 0})
            notes = [*prediction.notes, f"failed, scored at its worst: {error.what}"]
        else:
            poses = pose_scores(cameras, found.alignment.transform, truth.posed, protocol.scores)
            scored = score_comparison(truth.scene, found, poses, protocol.scores)
            notes = [*scene_notes(prediction, found, protocol), *doubts]
            if run.keep and (run.limits is not None or not predictions.path.is_dir()):
                # Once the predictions are closed, their files are gone.
                found = replace(found, clouds=(found.clouds[0].in_memory(), found.clouds[1]))
        named = tuple(f"scene {truth.scene}: {note}" for note in notes)
        details = found if run.keep else None
        return replace(scored, kind=prediction.kind, notes=named, details=details)


@contextmanager
def open_scene(
    predictions: ScenePredictions, scene: str, protocol: ReconstructionProtocol, memory_bytes: int
) -> Iterator[ScenePrediction]:
    """Open a scene's entry; an error that is raised meanwhile says where it is."""
    place, sampling = f"{predictions.path}, scene {scene}", protocol.meshes.sampling
    try:
        with predictions.opened(scene, limit_bytes=memory_bytes, sampling=sampling) as found:
            yield found
    except PredictionError as error:
        if error.where is None:
            raise error.inside(place) from error
        unpacked = error.where.partition(f"{PART}/")[2]
        if not unpacked or predictions.path.is_dir():
            raise
        # A file of an archive lies somewhere else while it is read.
        texts = {"expected": error.expected, "fix": error.fix}
        raise PredictionError(error.what, where=f"{place}, {unpacked}", **texts) from error


def read_through(
    predictions: ScenePredictions, scene: str, protocol: ReconstructionProtocol, memory_bytes: int
) -> tuple[str, ...]:
    """Read a scene's prediction without a truth, and return notes on it."""
    with open_scene(predictions, scene, protocol, memory_bytes) as prediction:
        if isinstance(prediction.geometry, FileCloud):
            for _piece in prediction.geometry.pieces(_LEAST_BLOCK):
                pass  # a file that is cut off is found out where it is read
        return tuple(f"scene {scene}: {note}" for note in prediction.notes)


def compare(
    geometry: Geometry,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    true_cloud: CloudSource,
    protocol: ReconstructionProtocol,
    run: Run,
) -> Comparison:
    """Align, fuse and prepare a cloud or maps as the protocol says, and measure distances."""
    if protocol.alignment.cameras == "required" and cameras is None:
        raise PredictionError(
            "holds no cameras, and the protocol requires them",
            fix="add SCENE.cameras.npz, or choose a protocol whose cameras are optional",
        )
    settings, scores = protocol.preparation, protocol.scores
    block = max(run.memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK)
    progress = Headed(truth.scene, run.progress)
    box = clouds.box_of(true_cloud)
    cloud, alignment = _aligned(geometry, cameras, truth, true_cloud, protocol, block)
    region = clouds.cropped_region(true_cloud, box, settings, block)
    predicted, true = (
        with_progress(partial(clouds.prepare_cloud, one, settings, region, block), what, progress)
        for one, what in (
            (cloud, "preparing the prediction"),
            (true_cloud, "preparing the true cloud"),
        )
    )
    distances = cloud_distances(
        predicted.source, true.source, block_points=block, jobs=run.jobs, progress=progress
    )
    recalled = distances.to_prediction
    if settings.region == "observed":
        seen = clouds.observed_cells(true.source, box, truth.cameras, truth.poses, settings, block)
        rows = [seen.holds(points) for points in clouds.finite_pieces(true.source, block)]
        recalled = recalled[np.concatenate([np.zeros(0, np.bool_), *rows])]
    steps = scores.curve_up_to_m * np.arange(1, scores.curve_steps + 1) / scores.curve_steps
    found = metrics.curve(distances.to_truth, recalled, steps)
    return Comparison(alignment, (predicted, true), distances, recalled, found)


def _aligned(
    geometry: Geometry,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    true_cloud: CloudSource,
    protocol: ReconstructionProtocol,
    block: int,
) -> tuple[CloudSource, Alignment]:
    """Bring a prediction into the frame of the truth, by cameras and perhaps by ICP."""
    found, settings = align(cameras, truth.posed, protocol.alignment), protocol.fusion
    cloud: CloudSource
    if isinstance(geometry, fusion.PointMaps):
        cloud = fusion.point_map_cloud(geometry, found.transform, settings)
    elif isinstance(geometry, fusion.DepthMaps):
        make = fusion.fuse if settings.method == "tsdf" else fusion.depth_cloud
        cloud = make(geometry, found.transform, settings)
    else:
        cloud = clouds.transform_cloud(geometry, found.transform, settings.least_confidence)
    if found.method != "sim3+icp" or cameras is None:
        return cloud, found
    try:
        step, report = refine(cloud, true_cloud, protocol.alignment, memory_points=block)
    except AlignmentError as error:
        return cloud, replace(found, icp_failure=error.what)
    moved = replace(found, transform=step.after(found.transform), icp=report)
    return clouds.transform_cloud(cloud, step), with_residuals(moved, cameras, truth.posed)


# --- records ---


def score_comparison(
    scene: str, found: Comparison, poses: dict[str, float], settings: ReconstructionScores
) -> Scored:
    """Put the scores of a cloud and of its cameras into a scene's record."""
    (predicted, true), distances, alignment = found.clouds, found.distances, found.alignment
    counts = {
        "points": len(distances.to_truth),
        "truth_points": len(distances.to_prediction),
        "truth_unseen": len(distances.to_prediction) - len(found.recalled),
        "distrusted": predicted.distrusted,
        "not_finite": predicted.not_finite,
        "outside": predicted.outside,
        "thinned": predicted.thinned,
        "truth_outside": true.outside,
        "truth_thinned": true.thinned,
        "cameras": alignment.cameras,
        "cameras_missing": alignment.cameras_missing,
        "inlier_cameras": alignment.inliers,
    }
    centres, turns = alignment.centres or {}, alignment.rotations_deg or {}
    columns = {
        "alignment": alignment.method,
        "scale": alignment.transform.scale,
        "centres_rms_m": centres.get("rms", np.nan),
        "centres_median_m": centres.get("median", np.nan),
        "rotations_median_deg": turns.get("median", np.nan),
    }
    columns |= _cloud_columns(distances.to_truth, found.recalled, settings) | poses
    return replace(_scored(scene, columns, counts), facts={"alignment": alignment.values})


def score_missing(scene: str, settings: ReconstructionScores) -> Scored:
    """Score a scene that the prediction lacks: 0, and infinite distances."""
    return _scored(scene, _worst_cloud(settings), {"missing": 1, "points": 0}, answered=False)


def _scored(
    scene: str, columns: dict[str, Any], counts: dict[str, int], answered: bool = True
) -> Scored:
    whole = {name: counts[name] for name in counts if name not in ("missing", "failed")}
    records = pd.DataFrame([{"scene": scene, "answered": answered, **whole, **columns}])
    kinds = dict.fromkeys(sorted(whole), "Int64")
    return Scored(records.astype(kinds), {"queries": 1, "missing": 0, **counts})


def _cloud_columns(
    to_truth: Floats, to_prediction: Floats, settings: ReconstructionScores
) -> dict[str, float]:
    limits = np.array(sorted({*settings.f1_below_m, settings.headline_below_m}))
    most = None if isinstance(settings.max_distance_m, str) else settings.max_distance_m
    found = metrics.score_distances(to_truth, to_prediction, thresholds=limits, max_distance=most)
    means = ("chamfer", "accuracy", "completeness", "accuracy_median", "completeness_median")
    columns = {f"{name}_m": getattr(found, name) for name in means}
    for row, limit in enumerate(limits.tolist()):
        for share in ("precision", "recall", "f1"):
            columns[f"{share}_{limit:g}m"] = float(getattr(found.curve, share)[row])
    return columns


def _worst_cloud(settings: ReconstructionScores) -> dict[str, float]:
    """Return the scores of a cloud without points."""
    return _cloud_columns(np.zeros(0), np.full(1, np.inf), settings)


def _worst_poses(settings: ReconstructionScores) -> dict[str, float]:
    """Return the scores of poses that have all failed."""
    aucs = {f"pose_auc_{limit:g}deg": 0.0 for limit in settings.pose_auc_below_deg}
    return {**aucs, "cameras_placed": 0.0, "ate_m": np.inf, "rpe_m": np.inf, "rpe_deg": np.inf}


def pose_scores(
    predicted: PosedCameras | None,
    transform: Similarity,
    truth: PosedCameras,
    settings: ReconstructionScores,
) -> dict[str, float]:
    """Score predicted camera poses against all true cameras."""
    if predicted is None or predicted.rotation is None or truth.rotation is None:
        return {}
    scores = _worst_poses(settings)
    if len(truth.names) < 2:
        return scores
    true = Poses(rotation=truth.rotation, centres=truth.centres)
    rows, true_rows = partners(predicted, truth)
    given = Poses(rotation=np.full_like(true.rotation, np.nan), centres=true.centres * np.nan)
    given.rotation[true_rows] = predicted.rotation[rows]
    given.centres[true_rows] = predicted.centres[rows]
    limits = settings.pose_auc_below_deg
    if settings.pose_auc_rule == "depth-anything-3":
        aucs = metrics.auc_of_depth_anything_3(given, true, [int(limit) for limit in limits])
    else:
        errors = metrics.pair_errors(given, true, least_baseline=settings.least_baseline_m)
        aucs = [metrics.pose_auc(*errors, limit) for limit in limits]
    scores |= {f"pose_auc_{limit:g}deg": auc for limit, auc in zip(limits, aucs, strict=True)}
    placed = np.isfinite(given.centres).all(axis=1)
    scores["cameras_placed"] = float(placed.mean())
    if placed.sum() < LEAST_CAMERAS:
        # A similarity brings two cameras to any other two.
        return scores
    if settings.trajectory_alignment == "umeyama":
        # All predicted cameras are brought nearest to the true ones, as evo does.
        ((transform,), _) = fit_many(given.centres[placed][None], true.centres[placed][None])
    aligned = transform.apply_poses(given)
    translation, rotation_deg = metrics.step_errors(aligned, true)
    scores["ate_m"] = metrics.rms_of_placed(metrics.centre_errors(aligned, true))
    scores["rpe_m"] = metrics.rms_of_placed(translation)
    scores["rpe_deg"] = metrics.rms_of_placed(rotation_deg)
    return scores


def reconstruction_scores(settings: ReconstructionScores) -> list[Score]:
    """Return the scores of a protocol; without cameras, records lack the pose scores."""

    def distance(column: str, title: str, *, headline: bool = False) -> Score:
        return Score(column, title, "m", higher_is_better=False, average="mean", headline=headline)

    main = settings.headline_below_m
    means = ("Chamfer", "Accuracy", "Completeness")
    scores = [distance(f"{title.lower()}_m", title, headline=True) for title in means]
    for limit in (main, *(other for other in settings.f1_below_m if other != main)):
        for share, title in (("precision", "P"), ("recall", "R"), ("f1", "F1")):
            headline = limit == main or share == "f1"
            column = f"{share}_{limit:g}m"
            scores.append(Score.share(column, f"{title}@{limit:g}m", headline=headline))
    scores += [distance(f"{title.lower()}_median_m", f"{title}, median") for title in means[1:]]
    for angle in settings.pose_auc_below_deg:
        scores.append(Score.share(f"pose_auc_{angle:g}deg", f"AUC@{angle:g}°"))
    scores += [Score.share("cameras_placed", "Cameras placed"), distance("ate_m", "ATE")]
    turn = replace(distance("rpe_deg", "RPE, rotation"), unit="deg")
    return [*scores, distance("rpe_m", "RPE"), turn]

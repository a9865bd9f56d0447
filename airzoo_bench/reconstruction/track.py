"""The reconstruction track: a scene is opened, aligned, fused, prepared, measured and scored."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import PART, atomic_write, write_npz
from airzoo_bench.core.progress import Headed
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.predictions import FIX_READER
from airzoo_bench.evaluation.track import Assignment, Run, ScenePredictions, SceneScores, Track
from airzoo_bench.formats.arrays import open_arrays, protocol_name
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
    fit_sim3,
    pair_cameras,
    with_residuals,
)
from airzoo_bench.reconstruction.checks import match_cameras, scene_notes, true_names
from airzoo_bench.reconstruction.distances import CloudDistances, cloud_distances
from airzoo_bench.reconstruction.icp import refine
from airzoo_bench.reconstruction.info import INFO
from airzoo_bench.reconstruction.predictions import ScenePrediction, open_reconstruction
from airzoo_bench.reconstruction.settings import ReconstructionProtocol, ReconstructionScores
from airzoo_bench.reconstruction.truth import ReconstructionTruth, open_true_cloud, read_truth
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn

Geometry = CloudSource | fusion.DepthMaps | fusion.PointMaps

# The bytes of a point while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000
_TEMPLATE_PX = 32  # the longer side of the maps of a template

_LEFT_OUT = ("distrusted", "not_finite", "outside", "thinned")


@dataclass(frozen=True, eq=False)
class CloudComparison:
    """Both clouds as they were compared; recall is measured on the distances `recalled`."""

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
) -> SceneScores:
    """Read a scene's prediction and score it; an error names the scene."""
    where, comparison = f"{predictions.path}, scene {truth.scene}", None
    with open_scene(predictions, truth.scene, protocol, run.memory_bytes) as prediction:
        true_cloud = open_true_cloud(truth.cloud, run.memory_bytes, protocol.meshes.sampling)
        geometry, images = prediction.geometry, prediction.images
        if isinstance(geometry, fusion.DepthMaps) and images and not images.posed.all():
            geometry = geometry.take(np.flatnonzero(images.posed))  # others are nowhere
        try:
            cameras, doubts = match_cameras(images, truth, where)
            comparison = compare(geometry, cameras, truth, true_cloud, protocol, run)
        except AlignmentError as error:
            # The method failed here; its file is not to blame.
            worst = _cloud_columns(np.zeros(0), np.full(1, np.inf), protocol.scores)
            worst |= _worst_poses(protocol.scores)
            scored = _make_scores(truth.scene, worst, {"failed": 1, "points": 0})
            notes = [*prediction.notes, f"failed, scored at its worst: {error.what}"]
        else:
            transform, (predicted, true) = comparison.alignment.transform, comparison.clouds
            poses = pose_scores(cameras, transform, truth.posed, protocol.scores)
            scored = score_comparison(truth.scene, comparison, poses, protocol.scores)
            notes = [*scene_notes(prediction, comparison, protocol), *doubts]
            if run.keep and (run.limits is not None or not predictions.path.is_dir()):
                # Once the predictions are closed, their files are gone.
                comparison = replace(comparison, clouds=(predicted.in_memory(), true))
        scored = replace(scored, kind=prediction.kind, details=comparison if run.keep else None)
        return replace(scored, notes=tuple(f"scene {truth.scene}: {note}" for note in notes))


@contextmanager
def open_scene(
    predictions: ScenePredictions, scene: str, protocol: ReconstructionProtocol, memory_bytes: int
) -> Iterator[ScenePrediction]:
    """Open a scene's entry; an error that is raised meanwhile says where it is."""
    where, sampling = f"{predictions.path}, scene {scene}", protocol.meshes.sampling
    try:
        with predictions.entries[scene](memory_bytes, sampling) as found:
            yield found
    except PredictionError as error:
        # A file of an archive lies somewhere else while it is read.
        unpacked = (error.where or "").partition(f"{PART}/")[2]
        if unpacked and not predictions.path.is_dir():
            error.where = unpacked
        elif error.where is not None:
            raise
        raise error.inside(where) from error


def compare(
    geometry: Geometry,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    true_cloud: CloudSource,
    protocol: ReconstructionProtocol,
    run: Run,
) -> CloudComparison:
    """Align, fuse and prepare a cloud or maps as the protocol says, and measure distances."""
    if protocol.alignment.cameras == "required" and cameras is None:
        what, fix = "holds no cameras, and the protocol requires them", "add SCENE.cameras.npz"
        raise PredictionError(what, fix=fix)
    settings, scores = protocol.preparation, protocol.scores
    block = max(run.memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK)
    progress = Headed(truth.scene, run.progress)
    box = clouds.bounding_box(true_cloud)
    cloud, alignment = _align_cloud(geometry, cameras, truth, true_cloud, protocol, block)
    crop = clouds.find_crop(true_cloud, box, settings, block)
    both = progress((cloud, true_cloud), "preparing clouds", 2)
    predicted, true = (clouds.prepare_cloud(one, settings, crop, block) for one in both)
    distances = cloud_distances(
        predicted.source, true.source, block_points=block, jobs=run.jobs, progress=progress
    )
    recalled = distances.to_prediction
    if settings.region == "observed":
        seen = clouds.observed_cells(true.source, box, truth.cameras, truth.poses, settings, block)
        rows = [seen.holds(points) for points in clouds.finite_pieces(true.source, block)]
        recalled = recalled[np.concatenate([np.zeros(0, np.bool_), *rows])]
    steps = scores.curve_up_to_m * np.arange(1, scores.curve_steps + 1) / scores.curve_steps
    shares = metrics.curve(distances.to_truth, recalled, steps)
    return CloudComparison(alignment, (predicted, true), distances, recalled, shares)


def _align_cloud(
    geometry: Geometry,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    true_cloud: CloudSource,
    protocol: ReconstructionProtocol,
    block: int,
) -> tuple[CloudSource, Alignment]:
    """Bring a prediction into the frame of the truth, by cameras and perhaps by ICP."""
    alignment, settings = align(cameras, truth.posed, protocol.alignment), protocol.fusion
    cloud: CloudSource
    if isinstance(geometry, fusion.PointMaps):
        cloud = fusion.point_map_cloud(geometry, alignment.transform, settings)
    elif isinstance(geometry, fusion.DepthMaps):
        make = fusion.fuse if settings.method == "tsdf" else fusion.depth_cloud
        cloud = make(geometry, alignment.transform, settings)
    else:
        cloud = clouds.transform_cloud(geometry, alignment.transform, settings.least_confidence)
    if alignment.method != "sim3+icp" or cameras is None:
        return cloud, alignment
    try:
        step, report = refine(cloud, true_cloud, protocol.alignment, memory_points=block)
    except AlignmentError as error:
        return cloud, replace(alignment, icp_failure=error.what)
    moved = replace(alignment, transform=step.after(alignment.transform), icp=report)
    return clouds.transform_cloud(cloud, step), with_residuals(moved, cameras, truth.posed)


# --- records ---


def score_comparison(
    scene: str, comparison: CloudComparison, poses: dict[str, float], settings: ReconstructionScores
) -> SceneScores:
    """Put the scores of a cloud and of its cameras into a scene's record."""
    distances, alignment = comparison.distances, comparison.alignment
    predicted, true = comparison.clouds
    counts = {
        "points": len(distances.to_truth),
        "truth_points": len(distances.to_prediction),
        "truth_unseen": len(distances.to_prediction) - len(comparison.recalled),
        **{name: getattr(predicted, name) for name in _LEFT_OUT},
        "truth_outside": true.outside,
        "truth_thinned": true.thinned,
        "cameras": alignment.cameras,
        "cameras_missing": alignment.cameras_missing,
        "inlier_cameras": alignment.inliers,
    }
    centres, turns = alignment.centres or {}, alignment.rotations_deg or {}
    columns: dict[str, Any] = {
        "alignment": alignment.method,
        "scale": alignment.transform.scale,
        "centres_rms_m": centres.get("rms", np.nan),
        "centres_median_m": centres.get("median", np.nan),
        "rotations_median_deg": turns.get("median", np.nan),
        **_cloud_columns(distances.to_truth, comparison.recalled, settings),
        **poses,
    }
    return replace(_make_scores(scene, columns, counts), facts={"alignment": alignment.values})


def _make_scores(
    scene: str, columns: dict[str, Any], counts: dict[str, int], answered: bool = True
) -> SceneScores:
    whole = {name: counts[name] for name in counts if name not in ("missing", "failed")}
    records = pd.DataFrame([{"scene": scene, "answered": answered, **whole, **columns}])
    kinds = dict.fromkeys(sorted(whole), "Int64")
    return SceneScores(records.astype(kinds), {"queries": 1, "missing": 0, **counts})


def _cloud_columns(
    to_truth: Floats, to_prediction: Floats, settings: ReconstructionScores
) -> dict[str, float]:
    limits = np.array(sorted({*settings.f1_below_m, settings.headline_below_m}))
    most = None if isinstance(settings.max_distance_m, str) else settings.max_distance_m
    means = metrics.mean_distances(to_truth, to_prediction, most)
    columns = {f"{name}_m": one for name, one in means.items()}
    shares = metrics.curve(to_truth, to_prediction, limits)
    for row, limit in enumerate(limits.tolist()):
        for share in ("precision", "recall", "f1"):
            columns[f"{share}_{limit:g}m"] = float(getattr(shares, share)[row])
    return columns


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
    rows, true_rows = pair_cameras(predicted, truth)
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
        return scores  # a similarity brings two cameras to any other two
    if settings.trajectory_alignment == "umeyama":
        # All predicted cameras are brought nearest to the true ones, as evo does.
        ((transform,), _) = fit_sim3(given.centres[placed][None], true.centres[placed][None])
    aligned = transform.apply_poses(given)
    translation, rotation_deg = metrics.step_errors(aligned, true)
    scores["ate_m"] = metrics.rms_of_placed(metrics.centre_errors(aligned, true))
    scores["rpe_m"] = metrics.rms_of_placed(translation)
    scores["rpe_deg"] = metrics.rms_of_placed(rotation_deg)
    return scores


def reconstruction_scores(settings: ReconstructionScores) -> list[ScoreColumn]:
    """Return the scores of a protocol; without cameras, records lack the pose scores."""
    distance = partial(ScoreColumn.error, unit="m", average="mean")
    main, means = settings.headline_below_m, ("Chamfer", "Accuracy", "Completeness")
    scores = [distance(f"{title.lower()}_m", title, headline=True) for title in means]
    for limit in (main, *(other for other in settings.f1_below_m if other != main)):
        for share, title in (("precision", "P"), ("recall", "R"), ("f1", "F1")):
            headline = limit == main or share == "f1"
            column = f"{share}_{limit:g}m"
            scores.append(ScoreColumn.share(column, f"{title}@{limit:g}m", headline=headline))
    scores += [distance(f"{title.lower()}_median_m", f"{title}, median") for title in means[1:]]
    for angle in settings.pose_auc_below_deg:
        scores.append(ScoreColumn.share(f"pose_auc_{angle:g}deg", f"AUC@{angle:g}°"))
    scores += [ScoreColumn.share("cameras_placed", "Cameras placed"), distance("ate_m", "ATE")]
    return [*scores, distance("rpe_m", "RPE"), distance("rpe_deg", "RPE, rotation", unit="deg")]


# --- the contract ---


class ReconstructionTrack(Track):
    """Multi-view reconstruction; a part is all predictions, listed, and the id of a scene."""

    info = INFO
    protocol = ReconstructionProtocol
    recorded = Track.recorded | {"points", *_LEFT_OUT, "truth_*", "cameras*", "inlier_cameras"}
    recorded |= {"alignment", "scale", "centres_*", "rotations_*"}

    def open(self, path: Path, memory_bytes: int) -> ScenePredictions:
        """List predictions; see `open_reconstruction`."""
        predictions = open_reconstruction(path)
        if path.is_file() and path.suffix == ".npz":
            return replace(predictions, protocol=protocol_name(open_arrays(path, memory_bytes)))
        return predictions

    def truth(self, benchmark: Benchmark, scene: str) -> ReconstructionTruth:
        """See `Track.truth`."""
        return read_truth(benchmark, scene)

    def assign(
        self,
        predictions: ScenePredictions,
        truths: Sequence[ReconstructionTruth],
        protocol: ReconstructionProtocol,
    ) -> Assignment:
        """See `Track.assign`."""
        known = [scene.id for scene in protocol.scenes]
        strange = [name[:80] for name in sorted(predictions.entries) if name not in known]
        missing = [name for name in known if name not in predictions.entries]
        if len(missing) == len(known):
            meant = nearest("".join(strange[:1]), known, 1)
            raise PredictionError(
                f"its clouds and maps are no scenes of {protocol.name}: {first_of(strange)}{meant}",
                where=predictions.path,
                expected=f"files of clouds or maps named by their scenes: {first_of(known)}",
                fix=FIX_READER,
            )
        others = [name + nearest(name, missing, 1) for name in strange]
        unknown = [name[:80] for name in predictions.extra_files]
        left_out = {
            "scenes that the predictions lack, scored at their worst": missing,
            "scenes that the protocol lacks, left aside": others,
            "files that belong to no scene, left aside": unknown,
        }
        notes = [f"{what}: {first_of(names)}" for what, names in left_out.items() if names]
        covered = f"{len(known) - len(missing):,} of {counted(len(known), 'scene')}"
        return Assignment([(predictions, scene) for scene in known], covered, notes, len(strange))

    def score(
        self,
        part: tuple[ScenePredictions, str],
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        run: Run,
    ) -> SceneScores:
        """See `Track.score`."""
        predictions, scene = part
        if scene not in predictions.entries:
            worst = _cloud_columns(np.zeros(0), np.full(1, np.inf), protocol.scores)
            return _make_scores(scene, worst, {"missing": 1, "points": 0}, answered=False)
        return score_scene(predictions, truth, protocol, run)

    def check(
        self,
        part: tuple[ScenePredictions, str],
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        run: Run,
    ) -> SceneScores:
        """Score the scene, which finds all errors; where its truth is sealed, only read it."""
        predictions, scene = part
        if not truth.is_sealed:
            return self.score(part, truth, protocol, run)
        if scene not in predictions.entries:
            return SceneScores()
        with open_scene(predictions, scene, protocol, run.memory_bytes) as prediction:
            if prediction.images is not None and prediction.images.has_names:
                true_names(prediction.images, truth, f"{predictions.path}, scene {scene}")
            if isinstance(prediction.geometry, FileCloud):
                for _piece in prediction.geometry.pieces(_LEAST_BLOCK):
                    pass  # a file that is cut off is found out where it is read
            return SceneScores(notes=tuple(f"scene {scene}: {note}" for note in prediction.notes))

    def scores(self, protocol: ReconstructionProtocol) -> list[ScoreColumn]:
        """See `Track.scores`."""
        return reconstruction_scores(protocol.scores)

    def template(
        self,
        out: Path,
        truths: Sequence[ReconstructionTruth],
        protocol: ReconstructionProtocol,
        kind: str,
    ) -> None:
        """Write a folder with random depth maps of each scene."""
        for number, truth in enumerate(truths):
            with atomic_write(out / f"{truth.scene}.npz") as stream:
                write_npz(stream, _random_views(truth, np.random.default_rng(number)))
        with atomic_write(out / "protocol.txt", "w") as text:
            text.write(protocol.name + "\n")


def _random_views(
    truth: ReconstructionTruth, random: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Make small random depth maps at random poses, one for each photo of a scene."""
    count = len(truth.photos)
    size = np.array([truth.cameras.width[0], truth.cameras.height[0]], dtype=np.float64)
    width, height = np.maximum(np.rint(size * _TEMPLATE_PX / size.max()), 1).astype(int)
    turned, _ = np.linalg.qr(random.normal(size=(count, 3, 3)))
    turned *= np.linalg.det(turned)[:, None, None]
    middle = np.zeros(3) if truth.is_sealed else truth.poses.centres.mean(axis=0)
    moved = -(turned @ (middle + random.normal(0.0, 50.0, (count, 3)))[..., None])
    matrix = [[_TEMPLATE_PX, 0, width / 2], [0, _TEMPLATE_PX, height / 2], [0, 0, 1]]
    return {
        "image_names": truth.photos["image"].to_numpy(str),
        "pixel_centres": np.array("half"),
        "depth": random.uniform(20.0, 120.0, (count, height, width)).astype(np.float32),
        "conf": random.uniform(0.0, 1.0, (count, height, width)).astype(np.float32),
        "intrinsics": np.tile(matrix, (count, 1, 1)),
        "extrinsics": np.concatenate([turned, moved], axis=2),
    }


def describe_alignments(method: Method | Evaluation) -> list[str]:
    """Describe the alignment of each scene: its cameras, scale, residual, least confidence."""
    above = method.result.protocol.settings.get("fusion", {}).get("confidence_above", "none")
    said = "scene {scene}: aligned by {inlier_cameras:g} of {cameras:g} cameras, scale {scale:.4g}"
    said += f", centres rms {{centres_rms_m:.2f}} m; confidence threshold: {above}"
    keys = ["scene", "inlier_cameras", "cameras", "scale", "centres_rms_m"]
    rows = method.records.reindex(columns=keys).query("scale * inlier_cameras > 0", engine="python")
    return [*map(said.format_map, rows.to_dict("records"))]


def write_alignments(evaluation: Evaluation, path: Path) -> None:
    """Write ``alignment.json``: how each scene was aligned, its scale and its residuals."""
    values = {name: one.facts["alignment"] for name, one in evaluation.scored.items() if one.facts}
    with atomic_write(path, "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


TRACK = ReconstructionTrack()

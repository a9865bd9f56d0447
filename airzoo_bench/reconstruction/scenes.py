"""From the prediction of a scene to its scores: align, fuse, refine, prepare, measure, score."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import PART
from airzoo_bench.core.progress import Headed, shown
from airzoo_bench.evaluation.track import Run, ScenePredictions
from airzoo_bench.formats.clouds.cloud import CloudSource, FileCloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.reconstruction.alignment.camera_sets import PosedCameras
from airzoo_bench.reconstruction.alignment.cameras import align, with_step
from airzoo_bench.reconstruction.alignment.icp import refine
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity
from airzoo_bench.reconstruction.camera_names import match_cameras
from airzoo_bench.reconstruction.cloud_sources import (
    DepthCloud,
    DepthMaps,
    InMemoryCloud,
    PointMapCloud,
    PointMaps,
    TransformedCloud,
    finite_pieces,
)
from airzoo_bench.reconstruction.depth_map_files import ScenePrediction
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.notes import scene_notes
from airzoo_bench.reconstruction.prepared import (
    PreparedCloud,
    cropped_region,
    prepared,
)
from airzoo_bench.reconstruction.regions import Box, box_of
from airzoo_bench.reconstruction.scoring import (
    ScoredScene,
    pose_scores,
    record_scene,
    score_failed,
)
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.settings import Fusion, Preparation, ReconstructionProtocol
from airzoo_bench.reconstruction.true_cloud import open_true_cloud
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.tsdf import fuse
from airzoo_bench.reconstruction.visibility import observed_cells

__all__ = ["read_through", "score_geometry", "scored_scene"]

Geometry = CloudSource | DepthMaps | PointMaps

# What a point takes in memory while distances are computed: both clouds, their order, the tree.
_BYTES_A_POINT = 128
_LEAST_BLOCK = 100_000


@contextmanager
def scored_scene(
    predictions: ScenePredictions,
    truth: ReconstructionTruth,
    protocol: ReconstructionProtocol,
    run: Run,
) -> Iterator[ScoredScene]:
    """Read a scene's prediction and score it; an error names the scene."""
    memory_bytes = run.memory_bytes
    with _opened(predictions, truth.scene, protocol, memory_bytes) as prediction:
        true_cloud = open_true_cloud(truth.cloud, memory_bytes, _sampling(protocol))
        try:
            cameras = match_cameras(prediction.images, truth, _place(predictions, truth.scene))
            geometry = prediction.posed_geometry
            scored = score_geometry(geometry, cameras, truth, true_cloud, protocol, run)
            notes = scene_notes(prediction, cameras, truth, scored, protocol)
        except AlignmentError as error:
            # The method failed here; its file is not to blame.
            scored = score_failed(truth.scene, protocol.scores)
            notes = [*prediction.notes, f"failed, scored at its worst: {error.what}"]
        told = tuple(f"scene {truth.scene}: {note}" for note in notes)
        yield replace(scored, kind=prediction.kind, notes=told)


def score_geometry(
    geometry: Geometry,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    true_cloud: CloudSource,
    protocol: ReconstructionProtocol,
    run: Run,
) -> ScoredScene:
    """Do with a cloud or maps all that the protocol says, and compare them with the true cloud."""
    settings, true_cameras = protocol.preparation, truth.posed
    block = max(run.memory_bytes // _BYTES_A_POINT, _LEAST_BLOCK)
    _require_cameras(cameras, protocol.alignment)
    progress = Headed(truth.scene, run.progress)
    box = box_of(true_cloud)
    method = protocol.alignment.method if cameras is not None else "none"
    alignment = align(method, cameras, true_cameras, protocol.alignment.ransac())
    cloud = _as_cloud(geometry, alignment.transform, protocol.fusion)
    if method == "sim3+icp" and cameras is not None:
        try:
            step, report = refine(cloud, true_cloud, protocol.alignment.icp(), memory_points=block)
            cloud = TransformedCloud(cloud, step, None)
            alignment = with_step(alignment, step, report, cameras, true_cameras)
        except AlignmentError as error:
            # A cloud that is nowhere near the truth has failed; its file is not to blame.
            alignment = replace(alignment, icp_failure=error.what)
    region = cropped_region(true_cloud, box, settings, block)
    prepare = partial(prepared, settings=settings, region=region, block_points=block)
    predicted = shown(partial(prepare, cloud), "preparing the prediction", progress)
    true = shown(partial(prepare, true_cloud), "preparing the true cloud", progress)
    rows = _observed_rows(true, box, truth, settings, block)
    distances = cloud_distances(
        predicted.source,
        true.source,
        block_points=block,
        jobs=run.jobs,
        progress=run.progress,
    )
    return record_scene(
        truth.scene,
        alignment,
        (predicted, true),
        distances,
        distances.to_prediction[rows],
        _distrusted(geometry, alignment.transform, protocol.fusion, block),
        pose_scores(cameras, alignment.transform, true_cameras, protocol.scores),
        protocol.scores,
    )


def _require_cameras(cameras: PosedCameras | None, settings: AlignmentSettings) -> None:
    if settings.cameras == "required" and cameras is None:
        raise PredictionError(
            "holds no cameras, and the protocol requires them",
            expected="cameras, by which all methods are aligned alike",
            fix="add SCENE.cameras.npz, or choose a protocol whose cameras are optional",
        )


def _as_cloud(geometry: Geometry, transform: Similarity, fusion: Fusion) -> CloudSource:
    """Bring a cloud into the frame of the truth, or make one of maps there."""
    least = fusion.least_confidence
    if isinstance(geometry, PointMaps):
        return PointMapCloud(geometry, transform, least)
    if not isinstance(geometry, DepthMaps):
        return TransformedCloud(geometry, transform, least)
    if fusion.method == "tsdf":
        return InMemoryCloud(fuse(geometry, transform, fusion.tsdf(), confidence_above=least))
    return DepthCloud(geometry, transform, fusion.max_depth_m, least)


def _distrusted(geometry: Geometry, transform: Similarity, fusion: Fusion, points: int) -> int:
    """Count the points whose confidence is not above the protocol's."""
    least = fusion.least_confidence
    if least is None:
        return 0
    if isinstance(geometry, PointMaps):
        found = [PointMapCloud(geometry, transform, above).count for above in (None, least)]
    elif isinstance(geometry, DepthMaps):
        depth = fusion.max_depth_m
        found = [DepthCloud(geometry, transform, depth, above).count for above in (None, least)]
    else:
        trusted = TransformedCloud(geometry, Similarity.identity(), least).pieces(points)
        found = [geometry.count, sum(len(piece) for piece in trusted)]
    return found[0] - found[1]


def _observed_rows(
    true: PreparedCloud,
    box: Box,
    truth: ReconstructionTruth,
    settings: Preparation,
    block: int,
) -> Bools | slice:
    """Return which points of the prepared true cloud recall and completeness are over."""
    if settings.region == "all":
        return slice(None)
    cells = observed_cells(true.source, box, truth.cameras, truth.poses, settings, block)
    seen = [cells.holds(points) for points in finite_pieces(true.source, block)]
    return np.concatenate([np.zeros(0, np.bool_), *seen])


def read_through(
    predictions: ScenePredictions,
    scene: str,
    protocol: ReconstructionProtocol,
    memory_bytes: int,
) -> list[str]:
    """Read a scene's prediction without a truth; returns what there is to say about it."""
    with _opened(predictions, scene, protocol, memory_bytes) as prediction:
        if isinstance(prediction.geometry, FileCloud):
            # A file that is cut off is found out where it is read.
            for _piece in prediction.geometry.pieces(_LEAST_BLOCK):
                pass
        return [f"scene {scene}: {note}" for note in prediction.notes]


@contextmanager
def _opened(
    predictions: ScenePredictions,
    scene: str,
    protocol: ReconstructionProtocol,
    memory_bytes: int,
) -> Iterator[ScenePrediction]:
    """Open a scene's entry; whatever is raised meanwhile says where it is."""
    place, sampling = _place(predictions, scene), _sampling(protocol)
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
        raise PredictionError(
            error.what, where=f"{place}, {unpacked}", expected=error.expected, fix=error.fix
        ) from error


def _place(predictions: ScenePredictions, scene: str) -> str:
    return f"{predictions.path}, scene {scene}"


def _sampling(protocol: ReconstructionProtocol) -> MeshSampling:
    meshes = protocol.meshes
    return MeshSampling(
        seed=meshes.seed, count=meshes.points, per_square_unit=None, max_points=meshes.points
    )

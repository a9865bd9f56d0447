"""From what a prediction holds of a scene to a claim, and what looks odd about it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from airzoo_bench.errors import PredictionError, first_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.readers.clouds.source import FileCloud
from airzoo_bench.readers.clouds.suspicions import suspicions
from airzoo_bench.readers.image_poses import ImagePoses
from airzoo_bench.readers.reconstruction import ScenePrediction
from airzoo_bench.readers.view_suspicions import suspect_camera_to_world, suspect_image_size
from airzoo_bench.readers.views import Views
from airzoo_bench.reconstruction.clouds import CloudSource
from airzoo_bench.reconstruction.consensus import PosedCameras
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps
from airzoo_bench.reconstruction.regions import finite_rows
from airzoo_bench.reconstruction.track import Claim
from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["claim_of_scene", "kind_of", "odd_place", "odd_views", "true_cameras"]

_SAMPLE = 100_000
_PIECE = 1 << 20
_ROBUST = (1.0, 99.0)


def true_cameras(truth: ReconstructionTruth) -> PosedCameras:
    """Return the true cameras by the names of their photos."""
    poses = truth.poses
    return PosedCameras(tuple(truth.photos["image"]), poses.centres, poses.rotation)


def kind_of(prediction: ScenePrediction) -> str:
    """Say what a prediction holds: ``cloud``, ``depth`` or ``points``."""
    if isinstance(prediction.geometry, FileCloud):
        return "cloud"
    return "depth" if prediction.geometry.depth is not None else "points"


def claim_of_scene(prediction: ScenePrediction, truth: ReconstructionTruth, place: str) -> Claim:
    """Turn a prediction into a claim, its cameras named as the truth names them.

    Parameters
    ----------
    prediction : ScenePrediction
    truth : ReconstructionTruth
    place : str
        The file, for messages.

    Raises
    ------
    PredictionError
        An image name that the truth lacks.
    """
    cameras = None
    if prediction.images is not None:
        names = _true_names(prediction.images.names.tolist(), truth, place)
        cameras = _posed(prediction.images, names)
    return Claim(truth.scene, _geometry(prediction), cameras)


def _geometry(prediction: ScenePrediction) -> CloudSource | DepthMaps | PointMaps:
    views = prediction.geometry
    if isinstance(views, FileCloud):
        return views
    if views.points is not None:
        return PointMaps(views.points, views.confidence, views.colours)
    if views.depth is None or views.cameras is None or views.images is None:
        raise ValueError("depth maps without cameras")
    poses = _without_unfound(views.images)
    return DepthMaps(views.depth, views.cameras, poses, views.confidence, views.colours)


def _without_unfound(images: ImagePoses) -> Poses:
    rotation = np.where(images.found[:, None, None], images.poses.rotation, np.nan)
    centres = np.where(images.found[:, None], images.poses.centres, np.nan)
    return Poses(rotation=rotation, centres=centres)


def _posed(images: ImagePoses, names: Sequence[str]) -> PosedCameras:
    poses = _without_unfound(images)
    return PosedCameras(tuple(names), poses.centres, poses.rotation)


def _true_names(names: list[str], truth: ReconstructionTruth, place: str) -> list[str]:
    """Return the truth's names of images; an ending may be left out."""
    known = {name: name for name in truth.photos["image"]}
    stems = {PurePosixPath(name).with_suffix("").as_posix(): name for name in known}
    found = [known.get(name) or stems.get(name) for name in names]
    odd = [repr(name) for name, true in zip(names, found, strict=True) if true is None]
    if odd:
        raise PredictionError(
            f"image names that the benchmark lacks: {first_of(odd, len(names))}",
            where=f"{place}, field 'image_names'",
            expected=f"names such as {next(iter(known))!r}",
            mend="name images as the photos of the scene are named, relative to their folder",
        )
    return [name for name in found if name is not None]


def odd_views(prediction: ScenePrediction, truth: ReconstructionTruth, claim: Claim) -> list[str]:
    """Say what looks odd about maps and poses and need not be wrong."""
    notes: list[str] = []
    if isinstance(prediction.geometry, Views):
        views = prediction.geometry
        widths, heights = truth.photos["width"], truth.photos["height"]
        odd = suspect_image_size(views.size, int(widths.median()), int(heights.median()))
        notes += [*views.notes, *([odd] if odd else [])]
    if claim.cameras is None or claim.cameras.rotation is None:
        return [*notes, "holds no cameras: taken as it stands, without alignment"]
    rows = {name: row for row, name in enumerate(truth.photos["image"])}
    there = np.flatnonzero(np.isfinite(claim.cameras.centres).all(axis=1))
    given = Poses(rotation=claim.cameras.rotation[there], centres=claim.cameras.centres[there])
    true = truth.poses.take(np.array([rows[claim.cameras.names[row]] for row in there], dtype=int))
    turned = suspect_camera_to_world(given, true)
    return [*notes, *([turned] if turned else [])]


def odd_place(cloud: CloudSource, truth: CloudSource) -> tuple[str, ...]:
    """Say where an aligned cloud looks as if it were in other units or elsewhere."""
    return suspicions(_robust_bounds(cloud), _robust_bounds(truth))


def _robust_bounds(source: CloudSource) -> Floats:
    """Return bounds (2, 3) that outliers do not move, from evenly spread points."""
    step = max(1, source.count // _SAMPLE)
    parts = [piece.points[::step] for piece in source.pieces(_PIECE)]
    points = np.concatenate([np.zeros((0, 3)), *parts])
    points = points[finite_rows(points)]
    if not len(points):
        return np.full((2, 3), np.nan)
    return np.asarray(np.percentile(points, _ROBUST, axis=0), dtype=np.float64)

"""From what a prediction holds of a scene to a claim, its cameras named as the truth names them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath

import numpy as np

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.validation import nearest
from airzoo_bench.formats.clouds.cloud import CloudSource, FileCloud
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps
from airzoo_bench.reconstruction.image_poses import ImagePoses
from airzoo_bench.reconstruction.placing import MatchedPrediction
from airzoo_bench.reconstruction.pose_metrics import pair_errors
from airzoo_bench.reconstruction.reading import ScenePrediction
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.view_plausibility import suspect_camera_to_world
from airzoo_bench.reconstruction.views import Views

__all__ = ["kind_of", "match_cameras", "true_cameras"]

_ORDER_FITS_DEG = 15.0
_MOST_CAMERAS = 64


def true_cameras(truth: ReconstructionTruth) -> PosedCameras:
    """Return the true cameras by the names of their photos."""
    poses = truth.poses
    return PosedCameras(tuple(truth.photos["image"]), poses.centres, poses.rotation)


def kind_of(prediction: ScenePrediction) -> str:
    """Say what a prediction holds: ``cloud``, ``mesh``, ``depth`` or ``points``."""
    if isinstance(prediction.geometry, FileCloud):
        return "mesh" if prediction.geometry.kind.endswith("mesh") else "cloud"
    return "depth" if prediction.geometry.depth is not None else "points"


def match_cameras(
    prediction: ScenePrediction, truth: ReconstructionTruth, place: str
) -> MatchedPrediction:
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
        An image name that the truth lacks, or that stands for two images; no names, where it is not
        clear which view is which photo's.
    """
    cameras, geometry = None, prediction.geometry
    if prediction.images is not None:
        if isinstance(geometry, Views) and not geometry.named:
            names = _names_by_order(prediction.images, truth, place)
        else:
            names = _true_names(prediction.images.names.tolist(), truth, place)
        cameras = _posed(prediction.images, names)
    return MatchedPrediction(truth.scene, _geometry(prediction), cameras)


def _geometry(prediction: ScenePrediction) -> CloudSource | DepthMaps | PointMaps:
    views = prediction.geometry
    if isinstance(views, FileCloud):
        return views
    if views.points is not None:
        return PointMaps(views.points, views.confidence, views.colours)
    if views.depth is None or views.cameras is None or views.images is None:
        raise ValueError("depth maps without cameras")
    maps = views.depth, views.cameras, views.images.poses, views.confidence, views.colours
    depth, cameras, poses, confidence, colours = maps
    if not views.images.found.all():
        # Depth of a view without a pose is nowhere.
        rows = np.flatnonzero(views.images.found)
        depth, cameras, poses = depth[rows], cameras.take(rows), poses.take(rows)
        confidence = None if confidence is None else confidence[rows]
        colours = None if colours is None else colours[rows]
    return DepthMaps(depth, cameras, poses, confidence, colours)


def _without_unfound(images: ImagePoses) -> Poses:
    rotation = np.where(images.found[:, None, None], images.poses.rotation, np.nan)
    centres = np.where(images.found[:, None], images.poses.centres, np.nan)
    return Poses(rotation=rotation, centres=centres)


def _posed(images: ImagePoses, names: Sequence[str]) -> PosedCameras:
    poses = _without_unfound(images)
    return PosedCameras(tuple(names), poses.centres, poses.rotation)


def _names_by_order(images: ImagePoses, truth: ReconstructionTruth, place: str) -> list[str]:
    """Take views without names for the photos in the order of their names, where cameras agree.

    Compared is what no choice of the world changes; a wrong order would else be scored as a bad
    method.
    """
    photos = sorted(truth.photos["image"])
    if len(images.names) != len(photos):
        raise _nameless(
            f"has no image_names, and {counted(len(images.names), 'view')} for "
            f"{counted(len(photos), 'photo')} of the scene",
            place,
        )
    rows = np.flatnonzero(images.found)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST_CAMERAS).astype(int))]
    if len(rows) < 2:
        raise _nameless("has no image_names, and too few poses to tell which view is which", place)
    places = {name: row for row, name in enumerate(truth.photos["image"])}
    true = truth.poses.take(np.array([places[photos[row]] for row in rows]))
    given = images.poses.take(rows)
    off = float(np.median(pair_errors(given, true, least_baseline=0.0).worse_deg))
    if off > _ORDER_FITS_DEG:
        turned = suspect_camera_to_world(given, true)
        raise _nameless(
            "has no image_names, and its cameras do not fit the photos in the order of their "
            f"names: between two cameras they are {off:.0f} degrees off"
            + (f"; {turned}" if turned else ""),
            place,
        )
    return photos


def _nameless(what: str, place: str) -> PredictionError:
    return PredictionError(
        what,
        where=place,
        expected="a field image_names (N,) that says which photo each view is of",
        fix="np.savez('SCENE.npz', **np.load('results.npz'), image_names=names), with the names "
        "of the photos in the order in which the method was given them",
    )


def _true_names(names: list[str], truth: ReconstructionTruth, place: str) -> list[str]:
    """Return the truth's names of images; an ending may be left out."""
    photos = truth.photos["image"].tolist()
    stems = [PurePosixPath(name).with_suffix("").as_posix() for name in photos]
    times = Counter(stems)
    known = {stem: name for stem, name in zip(stems, photos, strict=True) if times[stem] == 1}
    known |= {name: name for name in photos}
    odd = [name for name in names if name not in known]
    if odd:
        # What a mistyped name means is no image that is there already.
        open_names = sorted(set(photos) - {known[name] for name in names if name in known})
        shown = [repr(name[:80]) + nearest(name, open_names, 1) for name in odd[:3]]
        raise PredictionError(
            f"image names that the benchmark lacks: {first_of([*shown, *odd[3:]], len(names))}",
            where=f"{place}, field 'image_names'",
            expected=f"names such as {photos[0]!r}, with or without their ending",
            fix="name images as the photos of the scene are named, relative to their folder",
        )
    found = [known[name] for name in names]
    twice = [repr(name) for name, uses in Counter(found).items() if uses > 1]
    if twice:
        raise PredictionError(
            f"images that are named with their ending and without: {first_of(twice, len(names))}",
            where=f"{place}, field 'image_names'",
            expected="each image once",
        )
    return found

"""What a reader of a reconstruction's numbers must know, in sentences."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.camera_sets import PosedCameras
from airzoo_bench.reconstruction.alignment.cameras import Alignment
from airzoo_bench.reconstruction.cloud_plausibility import (
    lost_digits,
    mirror_warning,
    plausibility_warnings,
)
from airzoo_bench.reconstruction.cloud_sources import DepthMaps, PointMaps
from airzoo_bench.reconstruction.depth_map_files import ScenePrediction
from airzoo_bench.reconstruction.image_poses import ImagePoses
from airzoo_bench.reconstruction.prepared import PreparedCloud
from airzoo_bench.reconstruction.scoring import ScoredScene
from airzoo_bench.reconstruction.settings import (
    Fusion,
    ReconstructionProtocol,
    ReconstructionScores,
)
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.view_plausibility import (
    suspect_camera_to_world,
    suspect_image_size,
    suspect_names,
)

__all__ = ["scene_notes"]

_PIECE = 1 << 14
_FEW, _LEAST, _SHARE = 1000, 20, 0.5
_HALF_TURN_DEG = 150.0
_LEAST_OUTSIDE = 0.005  # less is 0 %
_LOOKED_AT = 1 << 22


def scene_notes(
    prediction: ScenePrediction,
    cameras: PosedCameras | None,
    truth: ReconstructionTruth,
    scored: ScoredScene,
    protocol: ReconstructionProtocol,
) -> list[str]:
    """Say what looks odd about a prediction, what was left out of it, and how it was aligned."""
    scale = 1.0 if scored.alignment is None else scored.alignment.transform.scale
    return [
        *prediction.notes,
        *_odd_views(prediction, truth, protocol.fusion, scale),
        *_odd_cameras(cameras, truth, protocol),
        *_notes_of_digits(prediction, scored, protocol.scores),
        *_alignment_notes(scored.alignment),
        *_cloud_notes(scored, protocol.scores),
        *_mean_notes(scored, protocol.scores),
    ]


def _notes_of_digits(
    prediction: ScenePrediction, scored: ScoredScene, scores: ReconstructionScores
) -> list[str]:
    """Say where coordinates lost digits, or K may be half a pixel off, by how many metres."""
    geometry, finest = prediction.geometry, min(scores.finest_m / 20.0, 0.01)
    scale = 1.0 if scored.alignment is None else scored.alignment.transform.scale
    found = [_digits_of_cameras(prediction.images, scale, finest)]
    if isinstance(geometry, FileCloud):
        some = next(iter(geometry.pieces(_PIECE)), None)
        if some is not None:
            found.append(lost_digits(some.points, geometry.precision, scale, finest))
    elif isinstance(geometry, PointMaps):
        some_points = geometry.points[0].reshape(-1, 3)[:_PIECE].astype(np.float64)
        found.append(lost_digits(some_points, geometry.points.dtype, scale, finest))
    else:
        found.append(_half_a_pixel(prediction, geometry, scale, scores))
    return [note for note in found if note]


def _digits_of_cameras(images: ImagePoses | None, scale: float, tolerance: float) -> str | None:
    if images is None or not images.found.any():
        return None
    error = float(np.median(images.errors[images.found])) * scale
    if not (error > tolerance and np.isfinite(error)):
        return None
    return (
        f"extrinsics lost digits: an error of {error:.2g} m is to be expected in the cameras "
        "(C = -R^T t, and t is long); store float64, or subtract an origin first"
    )


def _half_a_pixel(
    prediction: ScenePrediction, maps: DepthMaps, scale: float, scores: ReconstructionScores
) -> str | None:
    """Ask for the field `pixel_centres` where it is absent and would move points."""
    if prediction.pixel_centres is not None or prediction.images is None:
        return None
    seen = _some_depths(maps)
    if not seen.size:
        return None
    off = float(np.hypot(*(0.5 / np.median(maps.cameras.focal, axis=0))))
    error = off * float(np.median(seen)) * scale
    if not error > scores.finest_m / 20.0:
        return None
    named = prediction.images.named
    taken = "half (the first pixel's is 0.5, 0.5)" if named else "integer (Depth Anything 3)"
    return (
        f"does not say where K has its pixel centres, taken as {taken}: if that is wrong, points "
        f"are {error:.2g} m off; add pixel_centres = 'integer' (Depth Anything 3, VGGT, CUT3R, "
        "MapAnything, DUSt3R) or 'half'"
    )


def _mean_notes(scored: ScoredScene, scores: ReconstructionScores) -> list[str]:
    """Name the few points that decide a mean distance by themselves."""
    if scored.distances is None:
        return []
    notes = []
    for distances, whose, mean in (
        (scored.distances.to_truth, "predicted", "Accuracy"),
        (scored.distances.to_prediction, "true", "Completeness"),
    ):
        few = max(1, len(distances) // _FEW)
        clipped = np.minimum(distances, scores.clip_m or np.inf)
        if len(distances) < _LEAST or not np.isfinite(clipped).all():
            continue
        far = np.partition(clipped, -few)[-few:]
        far = far[far > scores.headline_below_m]
        share = float(far.sum() / max(clipped.sum(), 1e-300))
        if share > _SHARE:
            notes.append(
                f"{len(far):,} of {len(distances):,} {whose} points, up to {distances.max():.4g} m "
                f"away, {agreeing(len(far), 'makes', 'make')} {share:.0%} of the mean distance: "
                f"{mean} and Chamfer tell of {agreeing(len(far), 'it', 'them')} alone"
            )
    return notes


def _cloud_notes(scored: ScoredScene, scores: ReconstructionScores) -> list[str]:
    """Say what was left out of a cloud, and where it seems to lie elsewhere."""
    if scored.clouds is None or scored.alignment is None:
        return []
    (cloud, true), distrusted = scored.clouds, scored.counts["distrusted"]
    notes = []
    for count, what in (
        (distrusted, "of too little confidence"),
        (cloud.not_finite, "with coordinates that are NaN, infinite or too large to compute with"),
    ):
        if count:
            notes.append(f"left out: {counted(count, 'point')} {what}")
    odd = plausibility_warnings(cloud.bounds, true.bounds)
    transform = scored.alignment.transform
    mirrored = mirror_warning(cloud.sample, true.sample, transform, scores.f1_below_m)
    notes += odd or ([mirrored] if mirrored else [])
    notes += _outside_note(cloud)
    if not cloud.source.count:
        if not cloud.outside and not cloud.not_finite and not distrusted:
            notes.append("the prediction holds no point, or no depth within the protocol's range")
        notes.append("no point is left to compare: it scores 0 and infinite distances")
    return notes


def _outside_note(cloud: PreparedCloud) -> list[str]:
    """Say which share of a prediction no score counts, and where that is more than half of it."""
    share = cloud.outside / max(cloud.source.count + cloud.thinned + cloud.outside, 1)
    if share < _LEAST_OUTSIDE:
        return []
    mostly = ": precision and F1 tell of the smaller part" if share > _SHARE else ""
    return [f"{share:.0%} of the prediction lies outside the scored region, uncounted{mostly}"]


def _odd_views(
    prediction: ScenePrediction, truth: ReconstructionTruth, fusion: Fusion, scale: float
) -> list[str]:
    maps, images = prediction.geometry, prediction.images
    if isinstance(maps, FileCloud):
        return []
    height, width = (maps.depth if isinstance(maps, DepthMaps) else maps.points).shape[1:3]
    widths, heights = truth.photos["width"], truth.photos["height"]
    odd = suspect_image_size((width, height), int(widths.median()), int(heights.median()))
    notes = [odd] if odd else []
    if images is not None and not images.named:
        notes.append(
            "has no image_names: its views were taken for the photos in the order of their names, "
            "which their poses fit"
        )
    if isinstance(maps, DepthMaps):
        notes += _odd_depth(maps, images, fusion, scale)
    if fusion.least_confidence is not None and maps.confidence is None:
        notes.append("has no confidence: all of it was taken")
    return notes


def _odd_depth(
    maps: DepthMaps, images: ImagePoses | None, fusion: Fusion, scale: float
) -> list[str]:
    """Say where depths, once aligned, are all beyond what the protocol looks at, or lack a pose."""
    notes, seen = [], _some_depths(maps).astype(np.float64) * scale
    if seen.size and (seen > fusion.max_depth_m).mean() > 0.5:
        notes.append(
            f"depths are {float(np.median(seen)):g} m as aligned (median), beyond the protocol's "
            f"{fusion.max_depth_m:g} m: are they in millimetres?"
        )
    if images is not None and not images.found.all():
        lost = int(np.count_nonzero(~images.found))
        all_maps = counted(len(images.found), "depth map")
        notes.append(f"{lost} of {all_maps} {agreeing(lost, 'has', 'have')} no pose: left out")
    return notes


def _some_depths(maps: DepthMaps) -> NDArray[Any]:
    """Return the depths of surfaces in the first views."""
    views = range(min(len(maps.depth), max(1, _LOOKED_AT // max(maps.depth[0].size, 1))))
    some = np.stack([maps.depth[row] for row in views])
    seen: NDArray[Any] = some[np.isfinite(some) & (some > 0)]
    return seen


def _odd_cameras(
    cameras: PosedCameras | None, truth: ReconstructionTruth, protocol: ReconstructionProtocol
) -> list[str]:
    method = protocol.alignment.method
    if cameras is None:
        found = f"holds no cameras: taken as it stands, without alignment by {method}"
        return [found] if method != "none" else []
    if cameras.rotation is None:
        return []
    rows = {name: row for row, name in enumerate(truth.photos["image"])}
    there = np.flatnonzero(np.isfinite(cameras.centres).all(axis=1))
    given = Poses(rotation=cameras.rotation[there], centres=cameras.centres[there])
    true = truth.poses.take(np.array([rows[cameras.names[row]] for row in there], dtype=int))
    odd = (suspect_camera_to_world(given, true), suspect_names(cameras, truth.posed, truth.scene))
    return [one for one in odd if one]


def _alignment_notes(alignment: Alignment | None) -> list[str]:
    if alignment is None:
        return []
    notes = []
    if alignment.used_orientations:
        notes.append("camera centres lie on a line: aligned by the cameras' orientations too")
    turns, apart = alignment.rotations_deg, alignment.centres
    agree = 2 * alignment.inliers >= alignment.cameras
    if turns is not None and apart is not None and agree and turns.median > _HALF_TURN_DEG:
        notes.append(
            f"cameras are turned by {turns.median:.0f} degrees (median), though their centres fit: "
            "are the extrinsics in OpenGL axes (y up, z back) instead of OpenCV's, or, along a "
            "straight strip, the image names in reverse order?"
        )
    if not alignment.robust:
        notes.append("fewer than 3 cameras agree: aligned to all of them")
    elif alignment.method != "none" and not agree:
        notes.append(
            f"only {alignment.inliers} of {counted(alignment.cameras, 'camera')} "
            f"{agreeing(alignment.inliers, 'agrees', 'agree')} within "
            f"{alignment.inlier_limit:.3g} m: the alignment may be that of a part"
        )
    if alignment.icp_failure is not None:
        notes.append(f"{alignment.icp_failure}: aligned by cameras only")
    if alignment.method != "none" and alignment.missing:
        photos = counted(alignment.cameras + alignment.missing, "photo")
        have = agreeing(alignment.missing, "has", "have")
        notes.append(f"{alignment.missing} of {photos} {have} no pose in the prediction")
    return notes

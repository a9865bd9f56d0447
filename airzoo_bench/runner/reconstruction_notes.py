"""What a reader of a reconstruction's numbers must know, in sentences."""

from __future__ import annotations

import numpy as np

from airzoo_bench.errors import first_of
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.readers.clouds.source import FileCloud
from airzoo_bench.readers.clouds.suspicions import precision_suspicion, suspicions
from airzoo_bench.readers.reconstruction import ReconstructionPredictions, ScenePrediction
from airzoo_bench.readers.view_suspicions import suspect_camera_to_world, suspect_image_size
from airzoo_bench.readers.views import Views
from airzoo_bench.reconstruction.alignment.cameras import Alignment
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.placing import Claim, PlacedClaim
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.settings import Fusion
from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["listing_notes", "notes_of_placed", "notes_of_reading"]

_PIECE = 1 << 20
_HALF_TURN_DEG = 150.0
_LOOKED_AT = 1 << 22


def listing_notes(predictions: ReconstructionPredictions, known: list[str]) -> list[str]:
    """Name the scenes and files that are not what they might be meant to be."""
    missing, unknown = predictions.missing(known), predictions.unknown(known)
    notes = []
    if missing:
        notes.append(f"scenes that the predictions lack, scored at their worst: {_named(missing)}")
    if unknown:
        notes.append(f"scenes that the protocol lacks, left aside: {_named(unknown)}")
    if predictions.extra:
        notes.append(f"files that belong to no scene, left aside: {_named(predictions.extra)}")
    return notes


def notes_of_reading(
    prediction: ScenePrediction,
    truth: ReconstructionTruth,
    claim: Claim,
    alignment: AlignmentSettings,
    fusion: Fusion,
) -> list[str]:
    """Say what looks odd about a prediction as it was read, and what was left open by it."""
    geometry = prediction.geometry
    if isinstance(geometry, FileCloud):
        notes = [*geometry.notes, *_coarse(geometry)]
    else:
        notes = [*geometry.notes, *_odd_views(geometry, truth, fusion)]
    if claim.cameras is not None:
        return [*notes, *_odd_cameras(claim.cameras, truth)]
    if alignment.method != "none":
        notes.append(
            f"holds no cameras: taken as it stands, without alignment by {alignment.method}"
        )
    return notes


def notes_of_placed(placed: PlacedClaim) -> list[str]:
    """Say what was left out of a claim, how it was aligned, and where it seems to be elsewhere."""
    cloud = placed.cloud
    notes = _alignment_notes(placed.alignment)
    for count, what in (
        (placed.distrusted, "of too little confidence"),
        (cloud.not_finite, "with NaN or infinite coordinates"),
    ):
        if count:
            notes.append(f"left out: {_points(count)} {what}")
    notes += suspicions(cloud.bounds, placed.truth.bounds)
    if not cloud.source.count:
        if not cloud.outside and not cloud.not_finite and not placed.distrusted:
            notes.append("the prediction holds no point, or no depth within the protocol's range")
        cropped = f" ({_points(cloud.outside)} outside the crop)" if cloud.outside else ""
        notes.append(f"no point is left to compare{cropped}: it scores 0 and infinite distances")
    return notes


def _points(count: int) -> str:
    return f"{count:,} point{'s' * (count != 1)}"


def _named(names: tuple[str, ...]) -> str:
    return first_of([name[:80] for name in names])


def _coarse(cloud: FileCloud) -> list[str]:
    if cloud.precision.kind != "f" or cloud.precision.itemsize >= 8:
        return []
    largest = 0.0
    for piece in cloud.pieces(_PIECE):
        finite = piece.points[np.isfinite(piece.points)]
        largest = max(largest, float(np.abs(finite).max(initial=0.0)))
    odd = precision_suspicion(np.full((2, 3), largest), cloud.precision)
    return [odd] if odd else []


def _odd_views(views: Views, truth: ReconstructionTruth, fusion: Fusion) -> list[str]:
    widths, heights = truth.photos["width"], truth.photos["height"]
    odd = suspect_image_size(views.size, int(widths.median()), int(heights.median()))
    notes = [odd] if odd else []
    if views.images is not None and not views.named:
        notes.append(
            "has no image_names: its views were taken for the photos in the order of their names, "
            "which their poses fit"
        )
    notes += _far_depth(views, fusion)
    if views.depth is not None and views.images is not None and not views.images.found.all():
        lost = int(np.count_nonzero(~views.images.found))
        notes.append(f"{lost} of {len(views.images.found)} depth maps have no pose: left out")
    if fusion.least_confidence is not None and views.confidence is None:
        notes.append("has no confidence: all of it was taken")
    return notes


def _far_depth(views: Views, fusion: Fusion) -> list[str]:
    """Say where depth maps hold nothing nearer than the protocol looks."""
    if views.depth is None or views.depth.size == 0:
        return []
    some = views.depth[: max(1, _LOOKED_AT // max(views.depth[0].size, 1))]
    seen = some[np.isfinite(some) & (some > 0)]
    if seen.size and (seen > fusion.max_depth_m).mean() > 0.5:
        return [
            f"depths are {float(np.median(seen)):g} m (median), beyond the protocol's "
            f"{fusion.max_depth_m:g} m: are they in millimetres?"
        ]
    return []


def _odd_cameras(cameras: PosedCameras, truth: ReconstructionTruth) -> list[str]:
    if cameras.rotation is None:
        return []
    rows = {name: row for row, name in enumerate(truth.photos["image"])}
    there = np.flatnonzero(np.isfinite(cameras.centres).all(axis=1))
    given = Poses(rotation=cameras.rotation[there], centres=cameras.centres[there])
    true = truth.poses.take(np.array([rows[cameras.names[row]] for row in there], dtype=int))
    turned = suspect_camera_to_world(given, true)
    return [turned] if turned else []


def _alignment_notes(alignment: Alignment) -> list[str]:
    notes = []
    if alignment.used_orientations:
        notes.append("camera centres lie on a line: aligned by the cameras' orientations too")
    turns, apart = alignment.rotations_deg, alignment.centres
    if turns is not None and apart is not None and turns.median > _HALF_TURN_DEG:
        notes.append(
            f"cameras look the other way, {turns.median:.0f} degrees off (median), though their "
            "centres fit: are the extrinsics in OpenGL axes (y up, z back) instead of OpenCV's?"
        )
    if not alignment.robust:
        notes.append("fewer than 3 cameras agree: aligned to all of them")
    if alignment.method != "none" and alignment.missing:
        total = alignment.cameras + alignment.missing
        notes.append(f"{alignment.missing} of {total} photos have no pose in the prediction")
    return notes

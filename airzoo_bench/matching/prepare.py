"""Making the truth of one scene for matching: which photos have a prior, and their crops."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import (
    POSE_COLUMNS,
    PRIOR_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    with_unposed,
)
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.crops import CropStatus, crop_windows
from airzoo_bench.matching.maps import ReferenceMap, own_map
from airzoo_bench.matching.settings import Crop, Prior
from airzoo_bench.matching.truth import MatchingTruth, with_truth_as_prior

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["build_truth", "given_truth"]

# No GPS and no gimbal is as good as this in half of the photos. A truth that went through EXIF and
# XMP comes back with the rounding of their digits: 3 mm, and up to 0.09 degrees where each of three
# angles has one decimal.
_SAME_M, _SAME_DEG = 0.02, 0.1
_NO_PRIOR = "no GPS position or gimbal angles in the metadata"
_NO_CROP = {
    CropStatus.OFF_MAP: "by the prior pose, it does not see the map",
    CropStatus.NO_RAY: "by the prior pose, no corner of the image has a ray",
}


def given_truth(inputs: SceneInputs, maps: Path) -> MatchingTruth:
    """Match each photo to the whole of its own map; those without one are left out."""
    photos = inputs.photos
    files = [own_map(maps, photo) for photo in photos["id"]]
    there = np.array([dom.is_file() and dsm.is_file() for dom, dsm in files], np.bool_)
    kept = [pair for pair, found in zip(files, there, strict=True) if found]
    found = tuple(ReferenceMap(open_info(dom), dsm, raster_sha256(dsm)) for dom, dsm in kept)
    windows = np.array([(0, 0, one.dom.width, one.dom.height) for one in found], np.int64)
    reasons = np.full(len(photos), "no map of its own", dtype=object)
    return MatchingTruth(
        inputs.scene,
        with_truth_as_prior(photos[there].reset_index(drop=True)),
        windows.reshape(-1, 4),
        found,
        with_unposed(_excluded(inputs, ~there, reasons), inputs),
        own_maps=True,
    )


def build_truth(inputs: SceneInputs, crop: Crop, prior: Prior) -> MatchingTruth:
    """Find the crop of each photo that has a prior; the others are left out, with the reason."""
    photos = inputs.photos
    dom = needed(inputs.dom, "map", inputs.scene)
    dsm = needed(inputs.dsm, "surface model", inputs.scene)
    columns = PRIOR_COLUMNS if prior.is_measured else POSE_COLUMNS
    there = np.isfinite(photos[list(columns)].to_numpy(np.float64)).all(axis=1)
    asked = photos[there].reset_index(drop=True)
    if prior.is_measured:
        _refuse_truth_as_prior(asked)
    else:
        asked = with_truth_as_prior(asked)
    found = crop_windows(
        cameras_of(asked),
        poses_of(asked, PRIOR_COLUMNS),
        dom,
        dsm,
        crop=crop,
        plane_height_m=needed(inputs.plane_height_m, "height of the ground", inputs.scene),
    )
    kept = found.status == CropStatus.CROPPED
    reasons = np.full(len(photos), _NO_PRIOR, dtype=object)
    reasons[there] = [_NO_CROP.get(CropStatus(status), "") for status in found.status]
    left_out = ~there
    left_out[there] = ~kept
    return MatchingTruth(
        inputs.scene,
        asked[kept].reset_index(drop=True),
        found.windows[kept],
        (ReferenceMap(dom, dsm, raster_sha256(dsm)),),
        with_unposed(_excluded(inputs, left_out, reasons), inputs),
    )


def _refuse_truth_as_prior(photos: pd.DataFrame) -> None:
    # Not number by number: a pose has two quaternions, and metadata are rounded. Not every photo:
    # one that was moved would hide all the others.
    priors, poses = poses_of(photos, PRIOR_COLUMNS), poses_of(photos)
    apart = np.linalg.norm(priors.centres - poses.centres, axis=1)
    turned = rotation_angle_deg(priors.rotation, poses.rotation)
    same = int(((apart < _SAME_M) & (turned < _SAME_DEG)).sum())
    if 2 * same > len(photos):
        raise BenchmarkError(
            f"the prior poses equal the ground truth in {same} of {len(photos)} photos "
            f"(to {_SAME_M * 100:g} cm and {_SAME_DEG:g} degrees)",
            expected="priors from the photos' own metadata",
            fix="a protocol that means this says prior.source = 'truth'",
        )


def _excluded(inputs: SceneInputs, left_out: Bools, reasons: NDArray[np.object_]) -> pd.DataFrame:
    photos = inputs.photos[left_out][["id", "image"]].reset_index(drop=True)
    return photos.assign(reason=reasons[left_out])

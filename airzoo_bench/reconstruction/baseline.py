"""A reconstruction baseline that needs no weights: structure from motion over SIFT features.

Features and matches come from processes, the model from pycolmap. What a step has made is kept in
a folder under a name that says what it was made from, so that a run that was interrupted goes on
where it was, and one with other photos or settings does not take what is not its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import UsageError, first_of
from airzoo_bench.core.parallel import parallel_map
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.cameras import Alignment, align
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras, RansacSettings
from airzoo_bench.reconstruction.sfm.model import (
    Lens,
    Model,
    assumed_lenses,
    empty_model,
    known_lenses,
)
from airzoo_bench.reconstruction.sfm.steps import (
    Reader,
    SfmSettings,
    build_models,
    extract_features,
    focal_from_exif,
    list_photo,
    match_batch,
    plan_batches,
)

__all__ = ["Reader", "SfmResult", "SfmSettings", "photo_pairs", "sparse_reconstruction"]

_LEAST_PHOTOS = 3


@dataclass(frozen=True, eq=False)
class SfmResult:
    """A sparse model of the photos that could be placed.

    Attributes
    ----------
    cloud : Cloud
        With colours; empty where nothing could be placed.
    names : tuple of str
        File names of the photos that were placed.
    cameras, poses : Cameras, Poses
        Of these.
    photos : int
        Photos that there were.
    reprojection_px : float
        Mean error in pixels of the photos at full size; NaN where there are no points.
    alignment : Alignment or None
        To the priors; None where the frame is COLMAP's own.
    """

    cloud: Cloud
    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    photos: int
    reprojection_px: float
    alignment: Alignment | None

    @property
    def posed(self) -> PosedCameras:
        """The placed cameras by name, as alignment takes them."""
        return PosedCameras(self.names, self.poses.centres, self.poses.rotation)


def sparse_reconstruction(
    photos: Sequence[Path],
    sizes: Ints,
    read: Reader,
    settings: SfmSettings,
    folder: Path,
    *,
    cameras: Cameras | None,
    priors: PosedCameras | None,
    alignment: RansacSettings | None,
    workers: int,
    progress: Progress = silent,
) -> SfmResult:
    """Reconstruct photos by structure from motion.

    Parameters
    ----------
    photos : sequence of N Path
        No two of one file name.
    sizes : (N, 2) int64 array
        Width and height of the photos, as stored.
    read : Reader
        Such as `airzoo_bench.benchmark.images.read_rgb_photo`; must be picklable.
    settings : SfmSettings
    folder : Path
        Keeps what steps have made; a second run takes it up.
    cameras : Cameras or None
        N known cameras, which stay as they are. None: one for each size and focal length of
        photos is estimated, with one coefficient of distortion. A focal length that EXIF states
        is kept; where any photo states none, all are estimated.
    priors : PosedCameras or None
        Positions of photos by file name, such as GPS, for finding neighbours and for the frame.
    alignment : RansacSettings or None
        How the result is brought into the frame of the priors; None leaves it in COLMAP's.
    workers : int
        Processes; the result does not depend on it.
    progress : Progress

    Returns
    -------
    SfmResult

    Raises
    ------
    UsageError
        Fewer than 3 photos, two of one name, or an alignment is asked for without priors.
    AlignmentError
        The cameras cannot be aligned to the priors; see `alignment.align`.
    UserError
        A photo is not readable, or the folder cannot be written to.
    """
    names = tuple(path.name for path in photos)
    _check(names, priors, alignment)
    lenses = _guessed(photos, sizes) if cameras is None else known_lenses(cameras)
    listed = [
        list_photo(path, size, settings, folder) for path, size in zip(photos, sizes, strict=True)
    ]
    missing = [photo for photo in listed if not photo.features.is_file()]
    extracted = parallel_map(partial(extract_features, settings, read), missing, workers)
    for _ in progress(extracted, "features", len(missing)):
        pass
    pairs = photo_pairs(len(photos), _positions(names, priors), settings.neighbours)
    batches = plan_batches(listed, lenses, pairs, settings, folder)
    unmatched = [batch for batch in batches if not batch.matches.is_file()]
    matched = parallel_map(partial(match_batch, settings, listed, lenses), unmatched, workers)
    for _ in progress(matched, "matches", len(unmatched)):
        pass
    (model,) = progress(build_models(listed, lenses, batches, settings, folder), "model", 1)
    return _result(names, model, priors, alignment)


def photo_pairs(count: int, positions: Floats | None, neighbours: int | None) -> Ints:
    """List pairs of photos to match.

    Parameters
    ----------
    count : int
    positions : (count, 3) array or None
        NaN where not known: such a photo is paired with all.
    neighbours : int or None
        See `SfmSettings`.

    Returns
    -------
    (P, 2) int64 array
        The first below the second; sorted.
    """
    first, second = np.triu_indices(count, k=1)
    if positions is None or neighbours is None or neighbours >= count - 1:
        return np.stack((first, second), axis=1)
    from scipy.spatial import cKDTree

    known = np.isfinite(positions).all(axis=1)
    wanted = np.zeros((count, count), np.bool_)
    wanted[~known] = True
    rows = np.flatnonzero(known)
    if len(rows):
        local = positions[rows] - positions[rows[0]]
        _, near = cKDTree(local).query(local, k=min(neighbours + 1, len(rows)))
        wanted[rows[:, None], rows[near.reshape(len(rows), -1)]] = True
    chosen = (wanted | wanted.T)[first, second]
    return np.stack((first[chosen], second[chosen]), axis=1)


def _check(
    names: tuple[str, ...], priors: PosedCameras | None, alignment: RansacSettings | None
) -> None:
    if len(names) < _LEAST_PHOTOS:
        raise UsageError(
            f"structure from motion needs {_LEAST_PHOTOS} photos, not {len(names)}",
            fix="name a folder with photos that overlap",
        )
    repeated = sorted(name for name, times in Counter(names).items() if times > 1)
    if repeated:
        raise UsageError(
            f"photos of one name: {first_of(repeated)}", expected="file names that differ"
        )
    if alignment is not None and priors is None:
        raise UsageError(
            "there are no positions to align to", fix="give positions, or take the frame as it is"
        )


def _guessed(photos: Sequence[Path], sizes: Ints) -> list[Lens]:
    given = [focal_from_exif(path, size) for path, size in zip(photos, sizes, strict=True)]
    return assumed_lenses(sizes, np.array(given, np.float64))


def _positions(names: tuple[str, ...], priors: PosedCameras | None) -> Floats | None:
    if priors is None:
        return None
    place = dict(zip(priors.names, priors.centres, strict=True))
    return np.array([place.get(name, np.full(3, np.nan)) for name in names]).reshape(-1, 3)


def _result(
    names: tuple[str, ...],
    model: Model | None,
    priors: PosedCameras | None,
    alignment: RansacSettings | None,
) -> SfmResult:
    found = empty_model() if model is None else model
    result = SfmResult(
        cloud=Cloud(found.points, found.colours),
        names=tuple(names[row] for row in found.rows),
        cameras=found.cameras,
        poses=found.poses,
        photos=len(names),
        reprojection_px=found.reprojection_px,
        alignment=None,
    )
    if model is None or priors is None or alignment is None:
        return result
    # Photos without a prior are placed by the others.
    rows = [row for row, name in enumerate(result.names) if name in priors.names]
    known = result.posed.take(np.array(rows, np.int64))
    aligned = align("sim3", known, priors, ransac=alignment)
    return replace(
        result,
        cloud=Cloud(aligned.transform.apply(found.points), found.colours),
        poses=aligned.transform.apply_poses(found.poses),
        alignment=aligned,
    )

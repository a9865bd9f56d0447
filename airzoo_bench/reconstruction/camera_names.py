"""Which photo each camera of a prediction is of: by its name, or by the order of all."""

from __future__ import annotations

from collections import Counter
from pathlib import PurePosixPath

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.reconstruction.alignment.camera_sets import LEAST_CAMERAS, PosedCameras
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError
from airzoo_bench.reconstruction.image_poses import ImagePoses
from airzoo_bench.reconstruction.pose_metrics import pair_errors
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.view_plausibility import (
    refuse_camera_to_world,
    suspect_camera_to_world,
    suspect_names,
)

__all__ = ["match_cameras"]

_ORDER_FITS_DEG = 15.0
_MOST_CAMERAS = 64
_LIST = (
    "list the photos in the order in which the method was given them, a line each, and give the "
    "list with --reader NAME --names LIST; or np.savez('SCENE.npz', **np.load('results.npz'), "
    "image_names=names)"
)
_INVERT = f"invert the extrinsics: R.T and -R.T @ t; or, if they are right, {_LIST}"
_OTHER_PHOTOS = (
    "give the method the photos of scenes/SCENE/reconstruction/photos.csv, and no others"
)


def match_cameras(
    images: ImagePoses | None, truth: ReconstructionTruth, place: str
) -> PosedCameras | None:
    """Name the cameras of a prediction as the truth does; NaN where a pose is missing."""
    if images is None:
        return None
    names = _true_names(images, truth, place) if images.named else _by_order(images, truth, place)
    found = np.flatnonzero(images.found)
    true = truth.poses.take(_true_rows([names[row] for row in found], truth))
    refuse_camera_to_world(images.poses.take(found), true, place)
    rotation = np.where(images.found[:, None, None], images.poses.rotation, np.nan)
    centres = np.where(images.found[:, None], images.poses.centres, np.nan)
    cameras = PosedCameras(tuple(names), centres, rotation)
    suspect_names(cameras, truth.posed, place)
    return cameras


def _by_order(images: ImagePoses, truth: ReconstructionTruth, place: str) -> list[str]:
    """Take views without names for the photos in the order of their names, where cameras agree."""
    photos = sorted(truth.photos["image"])
    if len(images.names) != len(photos):
        more = len(images.names) == len(photos) + len(truth.excluded) > len(photos)
        raise _nameless(
            f"has no image_names, and {counted(len(images.names), 'view')} for "
            f"{counted(len(photos), 'photo')} of the scene",
            place,
            _OTHER_PHOTOS if more else _LIST,
        )
    rows = np.flatnonzero(images.found)
    if len(rows) < LEAST_CAMERAS:
        raise AlignmentError("has no image_names, and too few poses to tell which view is which")
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST_CAMERAS).astype(int))]
    true = truth.poses.take(_true_rows([photos[row] for row in rows], truth))
    given = images.poses.take(rows)
    off = float(np.median(pair_errors(given, true, least_baseline=0.0).worse_deg))
    if off > _ORDER_FITS_DEG:
        turned = suspect_camera_to_world(given, true)
        raise _nameless(
            "has no image_names, and its cameras do not fit the photos in the order of their "
            f"names: between two cameras they are {off:.0f} degrees off"
            + (f"; {turned}" if turned else ""),
            place,
            _INVERT if turned else _LIST,
        )
    return photos


def _true_rows(names: list[str], truth: ReconstructionTruth) -> Ints:
    rows = {name: row for row, name in enumerate(truth.photos["image"])}
    return np.array([rows[name] for name in names], dtype=int)


def _nameless(what: str, place: str, fix: str = _LIST) -> PredictionError:
    return PredictionError(
        what,
        where=place,
        expected="a field image_names (N,) that says which photo each view is of",
        fix=fix,
    )


def _true_names(images: ImagePoses, truth: ReconstructionTruth, place: str) -> list[str]:
    """Return the truth's names of images; an ending may be left out."""
    names = images.names.tolist()
    photos = truth.photos["image"].tolist()
    stems = list(map(_stem, photos))
    times = Counter(stems)
    known = {stem: name for stem, name in zip(stems, photos, strict=True) if times[stem] == 1}
    known |= {name: name for name in photos}
    odd = [name for name in names if name not in known]
    others = {*truth.excluded["image"], *map(_stem, truth.excluded["image"])}
    if odd and others.issuperset(odd):
        raise PredictionError(
            "views of photos that the reconstruction leaves out (excluded.csv): "
            f"{first_of(odd, len(names))}",
            where=f"{place}, field 'image_names'",
            expected=f"the {len(photos):,} photos that all methods are given, as {photos[0]!r}",
            fix=_OTHER_PHOTOS,
        )
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


def _stem(name: str) -> str:
    return PurePosixPath(name).with_suffix("").as_posix()

"""Cameras of a prediction: poses by image from npz files, matched to the photos of the truth."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.formats.arrays import Arrays, check_fields, numbers, open_arrays, texts
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import pose_errors_m
from airzoo_bench.reconstruction.alignment import LEAST_CAMERAS, PosedCameras, partners
from airzoo_bench.reconstruction.checks import (
    check_inversion,
    check_names,
    relative_misfit_deg,
)
from airzoo_bench.reconstruction.similarity import AlignmentError
from airzoo_bench.reconstruction.truth import ReconstructionTruth

CAMERA_FIELDS = ("intrinsics", "extrinsics", "image_names")
_EXPECTED = "image_names (N,) and extrinsics (N, 3, 4) or (N, 4, 4), world-to-camera"
_ROW_TOLERANCE = 1e-6
_ORDER_FITS_DEG = 15.0
_LIST = (
    "list the photos in the order in which the method was given them, a line each, and give the "
    "list with --reader NAME --names LIST; or np.savez('SCENE.npz', **np.load('results.npz'), "
    "image_names=names); if the order is right, check that extrinsics are world-to-camera"
)
_OTHER_PHOTOS = (
    "give the method the photos of scenes/SCENE/reconstruction/photos.csv, and no others"
)


@dataclass(frozen=True, eq=False)
class ImagePoses:
    """Poses of N images by their names, which are numbers where the file has none (not `named`).

    Where the method `found` no pose (NaN in all of it, or a place beyond all measure) `poses` are
    meaningless. `errors` estimate by how much digits that the file lacks have moved each camera, in
    the unit of its translation.
    """

    names: NDArray[np.str_]
    found: Bools
    poses: Poses
    errors: Floats
    named: bool = True


def read_image_poses(path: Path, limit_bytes: int) -> ImagePoses:
    """Read the cameras that go with a cloud: ``image_names`` and ``extrinsics``."""
    arrays = open_arrays(path, limit_bytes)
    check_fields(arrays, ("image_names", "extrinsics"), ("protocol", *CAMERA_FIELDS), _EXPECTED)
    return image_poses(arrays, len(texts(arrays, "image_names", 1)))


def image_poses(arrays: Arrays, count: int) -> ImagePoses:
    """Read ``extrinsics`` and, where there are any, ``image_names`` of `count` images."""
    named = "image_names" in arrays.names()
    names = np.array([f"view {row}" for row in range(count)])

    def refuse(field: str, what: str, odd: list[str]) -> None:
        if odd:
            raise fault(arrays, f"{what}: {first_of(odd, count)}", _EXPECTED, field=field)

    if named:
        names = texts(arrays, "image_names", 1)
        check_count(arrays, "image_names", len(names), count)
        wrong = [
            repr(name) for name, uses in Counter(names.tolist()).items() if uses > 1 or not name
        ]
        refuse("image_names", "names that are empty or not unique", wrong)
    values = arrays.read("extrinsics")
    rows = 4 if values.ndim == 3 and values.shape[1] == 4 else 3
    matrices = numbers(arrays, "extrinsics", (None, rows, 4)).astype(np.float64)
    check_count(arrays, "extrinsics", len(matrices), count)
    found = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    half = names[~found & ~np.isnan(matrices).all(axis=(1, 2))]
    refuse("extrinsics", "poses that are NaN or infinite in part", half.tolist())
    rotation = np.tile(np.eye(3), (count, 1, 1))
    try:
        rotation[found] = check_rotations(matrices[found, :3, :3], names[found].tolist())
    except CameraError as error:
        raise fault(
            arrays, error.what, error.expected, field="extrinsics", fix=error.fix
        ) from error
    last = np.abs(matrices[found, 3:] - (0.0, 0.0, 0.0, 1.0)) <= _ROW_TOLERANCE
    odd = names[found][~last.all(axis=(1, 2))].tolist()
    refuse("extrinsics", "a last row other than 0 0 0 1 (transposed matrices have t there)", odd)
    found &= (np.abs(matrices[:, :3, 3]) <= FARTHEST).all(axis=1)
    translation = np.where(found[:, None], matrices[:, :3, 3], 0.0)
    errors = np.zeros(count)
    errors[found] = pose_errors_m(matrices[found, :3, :3], translation[found], None)
    return ImagePoses(names, found, Poses.from_translations(rotation, translation), errors, named)


def check_count(arrays: Arrays, name: str, rows: int, count: int) -> None:
    """Refuse a field that does not have a row for each image."""
    if rows != count:
        what = f"field '{name}' has {rows:,} rows for {count:,} images"
        raise fault(arrays, what, "a row an image")


def fault(
    arrays: Arrays,
    what: str,
    expected: str | None,
    *,
    field: str | None = None,
    fix: str | None = None,
) -> PredictionError:
    """Make the error of a file, or of a field in it."""
    where = arrays.path if field is None else f"{arrays.path}, field '{field}'"
    return PredictionError(what, where=where, expected=expected, fix=fix)


# --- photos ---


def match_cameras(
    images: ImagePoses | None, truth: ReconstructionTruth, place: str
) -> tuple[PosedCameras | None, list[str]]:
    """Name the cameras of a prediction as the truth does, NaN without a pose; return notes too."""
    if images is None:
        return None, []
    names = _true_names(images, truth, place) if images.named else _by_order(images, truth, place)
    rotation = np.where(images.found[:, None, None], images.poses.rotation, np.nan)
    centres = np.where(images.found[:, None], images.poses.centres, np.nan)
    cameras = PosedCameras(tuple(names), centres, rotation)
    rows, true_rows = partners(cameras, truth.posed)
    note = check_inversion(images.poses.take(rows), truth.poses.take(true_rows), place)
    check_names(cameras, truth.posed, place)
    return cameras, [note] if note else []


def _by_order(images: ImagePoses, truth: ReconstructionTruth, place: str) -> list[str]:
    """Take views without names for the photos in the order of their names, where cameras agree."""
    photos, views = sorted(truth.photos["image"]), len(images.names)
    rows, why, fix = np.flatnonzero(images.found), "", _LIST
    if views != len(photos):
        why = f"{counted(views, 'view')} for {counted(len(photos), 'photo')} of the scene"
        fix = _OTHER_PHOTOS if views == len(photos) + len(truth.excluded) else _LIST
    elif len(rows) < LEAST_CAMERAS:
        raise AlignmentError("has no image_names, and too few poses to tell which view is which")
    else:
        order = np.argsort(truth.photos["image"].to_numpy(str))
        off = relative_misfit_deg(images.poses.take(rows), truth.poses.take(order[rows]))
        if off > _ORDER_FITS_DEG:
            why = (
                "cameras that do not fit the photos in the order of their names: between two they "
                f"are {off:.0f} degrees off"
            )
    if why:
        expected = "a field image_names (N,) that says which photo each view is of"
        raise PredictionError(
            f"has no image_names, and {why}", where=place, expected=expected, fix=fix
        )
    return photos


def _true_names(images: ImagePoses, truth: ReconstructionTruth, place: str) -> list[str]:
    """Return the truth's names of images; an ending may be left out."""
    names, photos = images.names.tolist(), truth.photos["image"].tolist()
    times = Counter(map(_stem, photos))
    known = {_stem(name): name for name in photos if times[_stem(name)] == 1}
    known |= {name: name for name in photos}
    odd = [name for name in names if name not in known]
    if odd:
        left_out = truth.excluded["image"].tolist()
        is_left_out = {*left_out, *map(_stem, left_out)}.issuperset(odd)
        # A mistyped name means no image that is there already.
        missing = sorted(set(photos) - {known[name] for name in names if name in known})
        shown = [repr(name[:80]) + nearest(name, missing, 1) for name in odd[:3]]
        what = "that the reconstruction leaves out" if is_left_out else "that the benchmark lacks"
        raise PredictionError(
            f"image names {what}: {first_of([*shown, *odd[3:]], len(names))}",
            where=f"{place}, field 'image_names'",
            expected=f"names such as {photos[0]!r}, with or without their ending",
            fix=_OTHER_PHOTOS
            if is_left_out
            else "name images as the photos of the scene are named, relative to their folder",
        )
    return [known[name] for name in names]


def _stem(name: str) -> str:
    return PurePosixPath(name).with_suffix("").as_posix()

"""Cameras of a prediction: poses by image, read from npz files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError, first_of
from airzoo_bench.formats.arrays import Arrays, check_fields, numbers, open_arrays, texts
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import pose_errors_m

__all__ = [
    "BYTES_A_CAMERA",
    "CAMERA_FIELDS",
    "ImagePoses",
    "camera_fault",
    "check_count",
    "field_fault",
    "image_poses",
    "read_image_poses",
]

BYTES_A_CAMERA = 1200
"""What a camera takes while poses are checked and compared: matrices, names, dictionaries."""

CAMERA_FIELDS = ("intrinsics", "extrinsics", "image_names")
_EXPECTED = "image_names (N,) and extrinsics (N, 3, 4) or (N, 4, 4), world-to-camera"
_LAST_ROW = (0.0, 0.0, 0.0, 1.0)
_ROW_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class ImagePoses:
    """Poses of N named images.

    Attributes
    ----------
    names : (N,) str
        As the file writes them; numbers where it does not.
    found : (N,) bool
        False where the method found no pose: NaN in all of it, or a place beyond all measure.
    poses : Poses
        World-to-camera; meaningless where there is none.
    errors : (N,) float64
        By how much digits that the file lacks have moved each camera, in the unit of its
        translation, as `pose_errors_m` estimates; 0 where there is no pose.
    named : bool
        False where the file does not name its images, as Depth Anything 3 writes it.
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
    arrays.budget.hold(arrays.path, f"the cameras of {count:,} views", count * BYTES_A_CAMERA)
    named = "image_names" in arrays.names()
    names = np.array([f"view {row}" for row in range(count)])
    if named:
        names = texts(arrays, "image_names", 1)
        _check_names(arrays, names, count)
    values = arrays.read("extrinsics")
    rows = 4 if values.ndim == 3 and values.shape[1] == 4 else 3
    matrices = numbers(arrays, "extrinsics", (None, rows, 4)).astype(np.float64)
    check_count(arrays, "extrinsics", len(matrices), count)
    found = _found(arrays, matrices[:, :3], names)
    rotation = np.tile(np.eye(3), (count, 1, 1))
    try:
        rotation[found] = check_rotations(matrices[found, :3, :3], names[found].tolist())
    except CameraError as error:
        raise camera_fault(arrays, "extrinsics", error) from error
    _check_last_row(arrays, matrices[found], names[found])
    found &= (np.abs(matrices[:, :3, 3]) <= FARTHEST).all(axis=1)
    translation = np.where(found[:, None], matrices[:, :3, 3], 0.0)
    errors = np.zeros(count)
    errors[found] = pose_errors_m(matrices[found, :3, :3], translation[found], None)
    poses = Poses.from_translations(rotation, translation)
    return ImagePoses(names, found, poses, errors, named)


def _check_names(arrays: Arrays, names: NDArray[np.str_], count: int) -> None:
    check_count(arrays, "image_names", len(names), count)
    unique, counts = np.unique(names, return_counts=True)
    wrong = [f"{name!r}" for name in unique[(counts > 1) | (unique == "")].tolist()]
    if wrong:
        raise field_fault(
            arrays,
            f"names that are empty or stand more than once: {first_of(wrong, count)}",
            "each image once, by its file name",
            "image_names",
        )


def _found(arrays: Arrays, matrices: Floats, names: NDArray[np.str_]) -> Bools:
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    half = ~finite & ~np.isnan(matrices).all(axis=(1, 2))
    if half.any():
        raise field_fault(
            arrays,
            f"poses that are NaN or infinite in part: {first_of(names[half], len(names))}",
            "a whole pose, or NaN in all of it where there is none",
            "extrinsics",
        )
    return finite


def _check_last_row(arrays: Arrays, matrices: Floats, names: NDArray[np.str_]) -> None:
    if matrices.shape[1] != 4:
        return
    wrong = ~(np.abs(matrices[:, 3] - _LAST_ROW) <= _ROW_TOLERANCE).all(axis=1)
    if wrong.any():
        raise field_fault(
            arrays,
            f"a last row other than 0 0 0 1: {first_of(names[wrong], len(names))}",
            "[R | t] above 0 0 0 1; a transposed matrix has t in its last row",
            "extrinsics",
        )


def check_count(arrays: Arrays, name: str, rows: int, count: int) -> None:
    """Refuse a field that does not have a row for each image."""
    if rows != count:
        raise field_fault(
            arrays, f"field '{name}' has {rows:,} rows for {count:,} images", "a row an image"
        )


def camera_fault(arrays: Arrays, name: str, error: CameraError) -> PredictionError:
    """Say in which field of a file a camera is wrong."""
    return PredictionError(
        error.what,
        where=f"{arrays.path}, field '{name}'",
        expected=error.expected,
        fix=error.fix,
    )


def field_fault(
    arrays: Arrays, what: str, expected: str, name: str | None = None
) -> PredictionError:
    """Make the error of a file, or of a field in it."""
    where = arrays.path if name is None else f"{arrays.path}, field '{name}'"
    return PredictionError(what, where=where, expected=expected)

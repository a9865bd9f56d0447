"""Reading ``name qw qx qy qz tx ty tz``, as hloc and AerialExtreMatch write poses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError, UnreadableError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.formats.budget import Budget
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.precision import pose_errors_m
from airzoo_bench.matching.predictions import GivenPoses, MatchingPredictions

__all__ = ["NO_POSE", "read_pose_list", "refused_in"]

NO_POSE = "write NaN in all of a pose that was not found"

_COLUMNS = 8
_LIMIT_BYTES = 1 << 27
_LONGEST_NAME = 256
_BYTES_A_BYTE = 32  # of memory, while the words of a line are texts and numbers of Python
_UNIT_TOLERANCE = 1e-3
_OTHERS = "trajectories of TUM and KITTI are read with --reader tum or kitti, and --names"


def read_pose_list(path: Path, limit_bytes: int) -> MatchingPredictions:
    """Read world-to-camera poses, a line each."""
    size = path.stat().st_size if path.is_file() else 0
    Budget(limit_bytes).hold(path, "its text", size * _BYTES_A_BYTE)
    lines = read_text(path, UnreadableError, "pose file", _LIMIT_BYTES).splitlines()
    rows = [_columns(line) for line in lines if line.strip() and line.lstrip()[0] != "#"]
    _check_rows(rows, path)
    names = np.array([_without_ending(row[0]) for row in rows], dtype=str)
    values = np.array([_floats(row, path) for row in rows], dtype=np.float64)
    found: Bools = np.asarray(np.isfinite(values).all(axis=1))
    _check_whole(values, found, names, path)
    found &= ~(values == (1, 0, 0, 0, 0, 0, 0)).all(axis=1)
    _check_unit(values[found, :4], names[found], path)
    quaternion = np.where(found[:, None], values[:, :4], (1.0, 0.0, 0.0, 0.0))
    translation = np.where(found[:, None], values[:, 4:], 0.0)
    with refused_in(path, NO_POSE):
        poses = Poses.from_quaternions(quaternion, translation, names.tolist())
    errors = np.zeros(len(found))
    errors[found] = pose_errors_m(poses.rotation[found], translation[found], quaternion[found])
    given = GivenPoses(found, poses, errors, quaternions=True)
    return MatchingPredictions(path, None, names, given)


@contextmanager
def refused_in(where: object, fix: str) -> Iterator[None]:
    """Say of cameras that cannot be which file they stand in, and how to mend it."""
    try:
        yield
    except CameraError as error:
        raise PredictionError(
            error.what, where=where, expected=error.expected, fix=error.fix or fix
        ) from error


def _columns(line: str) -> list[str]:
    """Split a line, but not a name whose parts are no numbers: ``DJI 0001.JPG``."""
    row = line.split()
    more = row[1 : 1 - _COLUMNS]
    if more and not any(map(_is_number, more)):
        return line.strip().rsplit(None, _COLUMNS - 1)
    return row


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_rows(rows: list[list[str]], path: Path) -> None:
    if not rows:
        raise PredictionError("holds no pose", where=path, expected=_expected())
    wrong = [number for number, row in enumerate(rows) if len(row) != _COLUMNS]
    if wrong:
        named = first_of([f"row {number + 1}" for number in wrong], len(rows))
        raise PredictionError(
            f"rows without {_COLUMNS} columns: {named}",
            where=path,
            expected=_expected(),
            fix=_OTHERS,
        )
    odd = [
        n for n, row in enumerate(rows) if len(row[0]) > _LONGEST_NAME or not row[0].isprintable()
    ]
    if odd:
        raise PredictionError(
            f"names that cannot be ids in {first_of([f'row {n + 1}' for n in odd], len(rows))}",
            where=path,
            expected="printable ids such as city/DJI_0001",
        )


def _without_ending(name: str) -> str:
    """Take off what ends a photo's name, and nothing else that follows a dot."""
    stem, dot, ending = name.rpartition(".")
    return stem if dot + ending.lower() in PHOTO_SUFFIXES else name


def _check_whole(values: Floats, found: Bools, names: NDArray[np.str_], path: Path) -> None:
    half = np.flatnonzero(~found & ~np.isnan(values).all(axis=1))
    if half.size:
        raise PredictionError(
            f"poses that are NaN or infinite in part: {first_of(names[half], len(names))}",
            where=path,
            expected="a whole pose, or nan in all seven columns where there is none",
        )


def _floats(row: list[str], path: Path) -> list[float]:
    try:
        return [float(text) for text in row[1:]]
    except ValueError as error:
        raise PredictionError(
            f"not numbers in the row of {row[0]}", where=path, expected=_expected()
        ) from error


def _check_unit(quaternions: Floats, names: NDArray[np.str_], path: Path) -> None:
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternions, axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > _UNIT_TOLERANCE)
    if bad.size:
        raise PredictionError(
            f"quaternions that are not of unit length: {first_of(names[bad], len(names))}; the "
            f"first has length {length[bad[0]]:.4g}",
            where=path,
            expected=_expected(),
            fix="normalise them (q / |q|), or put the columns into this order; " + _OTHERS,
        )


def _expected() -> str:
    return "name qw qx qy qz tx ty tz, world-to-camera"

"""Poses in files: lines of numbers, and COLMAP models, read without libraries.

Pixels of models that networks export are of no use: VGGT's are of two frames mixed up. So cameras
are read only to tell who wrote the model.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import CameraError, PredictionError, UnreadableError
from airzoo_bench.core.files import first_bytes, read_text
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.npz import Budget
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import quaternion_to_matrix

_FILES = ("cameras.bin", "images.bin", "points3D.bin")
_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_POINT = struct.Struct("<Q3d3BdQ")
_BYTES_A_PIXEL, _BYTES_A_TRACK_ELEMENT = 24, 8
_LONGEST_NAME = 1024
_BYTES_AN_IMAGE = 2400  # in memory, while names and poses are checked
_PARAMETERS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8, 6: 12, 7: 5, 8: 4, 9: 5, 10: 12}
_LOOKED_AT = 64


TUM, KITTI = 8, 12
"""Columns of a row: number, place and quaternion, or a matrix of 3 x 4."""

_TEXTS = ("", ".txt", ".tum", ".kitti", ".log")
_LIMIT_BYTES = 1 << 27
_HEAD_BYTES, _HEAD_ROWS = 1 << 16, 50
_BYTES_A_BYTE = 32  # of memory, while the words of a line are texts and numbers of Python
_UNIT_TOLERANCE = 1e-3


def first_rows(path: Path) -> list[list[str]]:
    """Return the first rows of a text, split at blanks; none if it is no text."""
    if not path.is_file() or path.suffix.lower() not in _TEXTS:
        return []
    head = first_bytes(path, _HEAD_BYTES)
    whole = head[: head.rfind(b"\n")] if len(head) == _HEAD_BYTES else head
    return _rows(whole.decode("utf-8", "replace"))[:_HEAD_ROWS]


def _rows(text: str) -> list[list[str]]:
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.split() for line in lines if line.strip() and line.lstrip()[0] != "#"]


def numbers_of(rows: list[list[str]], start: int) -> Floats | None:
    """Return the numbers of rows from a column on; None where some are none, or rows differ."""
    if len({len(row) for row in rows}) != 1:
        return None
    try:
        return np.array([[float(word) for word in row[start:]] for row in rows], dtype=np.float64)
    except ValueError:
        return None


def unit_share(values: Floats) -> float:
    """Return the share of rows (N, 4) of length 1; rows that are not finite are not counted."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(values, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    return float((np.abs(lengths - 1) <= _UNIT_TOLERANCE).mean()) if len(lengths) else 0.0


def read_rows(path: Path, columns: int, named: bool, memory: int) -> tuple[list[str], Floats]:
    """Read all rows of a text: the names before the numbers, none if not `named`, and these."""
    Budget(memory).hold(path, "its text", path.stat().st_size * _BYTES_A_BYTE)
    rows = _rows(read_text(path, UnreadableError, "text of poses", _LIMIT_BYTES))
    wrong = [number for number, row in enumerate(rows, 1) if len(row) != columns + named]
    values = None if wrong else numbers_of(rows, int(named))
    if values is None:
        what = "holds words where numbers should be" if rows else "holds no pose"
        if wrong:
            what = f"row {wrong[0]} has {len(rows[wrong[0] - 1])} columns"
        expected = f"{'a name and ' if named else ''}{columns} numbers in each row"
        raise PredictionError(what, where=path, expected=expected)
    return [row[0] for row in rows] if named else [], values


def trajectory_columns(path: Path) -> int | None:
    """Return how many numbers a row has, where rows are poses of TUM's or KITTI's layout."""
    rows = first_rows(path)
    count = len(rows[0]) if rows else 0
    alike = [row for row in rows if len(row) == count and numbers_of([row], 0) is not None]
    values = numbers_of(alike, 0) if count in (TUM, KITTI) and alike else None
    if values is None:
        return None
    return count if unit_share(values[:, 4:] if count == TUM else values[:, :3]) > 0.5 else None


def rotations_of(path: Path, wxyz: Floats, names: Sequence[str] | None = None) -> Floats:
    """Turn the quaternions of a file into rotations (N, 3, 3)."""
    try:
        return quaternion_to_matrix(wxyz, names)
    except CameraError as error:
        raise PredictionError(error.what, where=path, expected=error.expected) from error


def read_trajectory(
    path: Path, columns: int, memory: int, *, w_first: bool = False
) -> tuple[list[float], Floats]:
    """Return the first entries of a text's rows, and their camera-to-world poses (N, 4, 4).

    Quaternions are x y z w unless `w_first`.
    """
    _, values = read_rows(path, columns, named=False, memory=memory)
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if wrong.size:
        what = f"row {wrong[0] + 1} has a number that is not finite"
        fix = "leave the row out, and list the photos of the others with --names"
        raise PredictionError(what, where=path, expected="a pose of each photo", fix=fix)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    if columns == KITTI:
        poses[:, :3] = values.reshape(-1, 3, 4)
    else:
        poses[:, :3, :3] = rotations_of(path, values[:, 4:] if w_first else values[:, [7, 4, 5, 6]])
        poses[:, :3, 3] = values[:, 1:4]
    return values[:, 0].tolist(), poses


# --- COLMAP models ---


def is_model(folder: Path) -> bool:
    """Whether a folder holds a binary model."""
    return all((folder / name).is_file() for name in _FILES)


def first_cameras(folder: Path) -> list[tuple[int, tuple[int, int], tuple[float, ...]]]:
    """Return COLMAP's number of the model, size and parameters of the first cameras of a model."""
    found = []
    with suppress(OSError, struct.error, KeyError), (folder / _FILES[0]).open("rb") as stream:
        (count,) = _COUNT.unpack(stream.read(_COUNT.size))
        for _ in range(min(count, _LOOKED_AT)):
            _, model, width, height = _CAMERA.unpack(stream.read(_CAMERA.size))
            numbers = struct.Struct(f"<{_PARAMETERS[model]}d")
            found.append((model, (width, height), numbers.unpack(stream.read(numbers.size))))
    return found


def read_images(path: Path, budget: Budget) -> tuple[list[str], Floats]:
    """Return names (N) and, for each (N, 7), w x y z and translation, world-to-camera."""
    found = list(_images(path, budget))
    if not found:
        raise PredictionError("has no image with a pose", where=path, fix="register images")
    return [name for name, _ in found], np.array([pose for _, pose in found], dtype=np.float64)


def _images(path: Path, budget: Budget) -> Iterator[tuple[str, list[float]]]:
    with _map_counted(path) as (data, count):
        budget.hold(path, f"{count:,} images", count * _BYTES_AN_IMAGE)
        at = _COUNT.size
        for number in range(count):
            _, *pose, _ = _IMAGE.unpack_from(data, at)
            at += _IMAGE.size
            end = data.find(b"\0", at, at + _LONGEST_NAME)
            name = data[at:end].decode(errors="replace") if end > 0 else ""
            if not (name and name.isprintable() and "\ufffd" not in name):
                raise _damage_error(path, f"the name of image {number + 1:,} is no printable text")
            yield name, pose
            (pixels,) = _COUNT.unpack_from(data, end + 1)
            at = end + 1 + _COUNT.size + pixels * _BYTES_A_PIXEL
        _check_end(path, at, len(data))


def count_points(path: Path) -> int:
    """Return the number of points of a model that is long enough for them."""
    with _map_counted(path) as (data, count):
        if count * _POINT.size > len(data):
            raise _damage_error(path, f"it states {count:,} points and has {len(data):,} bytes")
        return count


def read_points(path: Path, most: int) -> Iterator[Cloud]:
    """Yield the points of a model, at most that many at a time."""
    with _map_counted(path) as (data, count):
        at = _COUNT.size
        for start in range(0, count, most):
            rows = np.empty((min(most, count - start), 3))
            for row in rows:
                _, *row[:], _, _, _, _, track = _POINT.unpack_from(data, at)
                at += _POINT.size + track * _BYTES_A_TRACK_ELEMENT
            yield Cloud(rows)
        _check_end(path, at, len(data))


@contextmanager
def _map_counted(path: Path) -> Iterator[tuple[mmap.mmap, int]]:
    """Map a file, and read the number that it begins with."""
    if not path.is_file() or path.stat().st_size < _COUNT.size:
        raise _damage_error(path, "it is missing or empty")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            yield data, _COUNT.unpack_from(data)[0]
        except (struct.error, OverflowError) as error:
            raise _damage_error(path, "it ends before all that it states") from error


def _check_end(path: Path, at: int, size: int) -> None:
    if at != size:
        raise _damage_error(path, "it ends before all that it states, or goes on after it")


def _damage_error(path: Path, why: str) -> PredictionError:
    what = f"damaged, or no file of a COLMAP model: {why}"
    return PredictionError(what, where=path, fix="export or copy the model again")

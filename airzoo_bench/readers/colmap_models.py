"""COLMAP models as networks export them: poses and points of binary files, read without libraries.

Pixels of such models are of no use: VGGT's are of two frames mixed up. What is read is the poses of
images, their names, and the points; intrinsics only to tell who wrote the model.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import CameraError, PredictionError
from airzoo_bench.evaluation.reader import refuse_option
from airzoo_bench.readers.scene_folders import ScenePlaces

if TYPE_CHECKING:
    from airzoo_bench.formats.clouds.cloud import Cloud
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["ModelCamera", "first_cameras", "is_model", "model_scene"]

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


@dataclass(frozen=True)
class ModelCamera:
    """A camera of a model.

    Attributes
    ----------
    model : int
        COLMAP's number: 0 is SIMPLE_PINHOLE, 1 PINHOLE.
    size : (int, int)
        Width and height.
    parameters : tuple of float
        Focal lengths, principal point, distortion.
    """

    model: int
    size: tuple[int, int]
    parameters: tuple[float, ...]

    @property
    def is_centred(self) -> bool:
        """Whether its principal point is exactly in the middle."""
        first = 1 if self.model in (0, 2, 3) else 2
        return self.parameters[first : first + 2] == (self.size[0] / 2, self.size[1] / 2)


def is_model(folder: Path) -> bool:
    """Whether a folder holds a binary model."""
    return all((folder / name).is_file() for name in _FILES)


def first_cameras(folder: Path) -> tuple[int, list[ModelCamera]]:
    """Return how many cameras a model states, and the first of them; none where it is damaged."""
    found: list[ModelCamera] = []
    try:
        with (folder / _FILES[0]).open("rb") as stream:
            (count,) = _COUNT.unpack(stream.read(_COUNT.size))
            while len(found) < min(count, _LOOKED_AT):
                _, model, width, height = _CAMERA.unpack(stream.read(_CAMERA.size))
                numbers = struct.Struct(f"<{_PARAMETERS[model]}d")
                parameters = numbers.unpack(stream.read(numbers.size))
                found.append(ModelCamera(model, (width, height), parameters))
    except (OSError, struct.error, KeyError):
        return 0, []
    return count, found


def model_scene(scenes: ScenePlaces, place: Path, folder: Path, memory: int) -> ScenePrediction:
    """Read the points of a model, and the poses of its images."""
    import numpy as np

    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.formats.clouds.cloud import FileCloud
    from airzoo_bench.geometry.poses import quaternion_to_matrix
    from airzoo_bench.readers.view_files import GivenArrays
    from airzoo_bench.reconstruction.cameras import image_poses
    from airzoo_bench.reconstruction.predictions import ScenePrediction

    path, budget = folder / _FILES[1], Budget(memory)
    refuse_option("--names", scenes.reading.names, "a COLMAP model", path)
    names, poses = _images(path, budget)
    if not names:
        raise _damaged(path, "it holds no image with a pose")
    numbers = np.array(poses)
    try:
        rotation = quaternion_to_matrix(numbers[:, :4], names)
    except CameraError as error:
        raise PredictionError(error.what, where=path, expected=error.expected) from error
    matrices = np.concatenate([rotation, numbers[:, 4:, None]], axis=2)
    photos = np.array(scenes.photos(place, names), dtype=str)
    given = GivenArrays(
        path, budget, {"image_names": lambda: photos, "extrinsics": lambda: matrices}
    )
    images = image_poses(given, len(names))
    cloud = folder / _FILES[2]
    with _opened(cloud) as (_, count):
        if count * _POINT.size > cloud.stat().st_size:
            raise _damaged(
                cloud, f"it states {count:,} points and has {cloud.stat().st_size:,} bytes"
            )
    read = FileCloud(cloud, "COLMAP", count, lambda most: _points(cloud, most), np.dtype("f8"))
    return ScenePrediction(read, images)


def _images(path: Path, budget: Any) -> tuple[list[str], list[tuple[float, ...]]]:
    """Return names and, for each, w x y z and translation, world-to-camera."""
    names: list[str] = []
    poses: list[tuple[float, ...]] = []
    with _opened(path) as (data, count):
        least = _IMAGE.size + 1 + _COUNT.size
        if count * least > len(data):
            raise _damaged(path, f"it states {count:,} images and has {len(data):,} bytes")
        budget.hold(path, f"{count:,} images", count * _BYTES_AN_IMAGE)
        at = _COUNT.size
        for _ in range(count):
            _, *pose, _ = _IMAGE.unpack_from(data, at)
            at += _IMAGE.size
            end = data.find(b"\0", at, at + _LONGEST_NAME)
            if end < 0:
                raise _damaged(path, f"the name of image {len(names) + 1:,} has no end")
            names.append(_text(path, data[at:end]))
            poses.append(tuple(pose))
            (pixels,) = _COUNT.unpack_from(data, end + 1)
            at = end + 1 + _COUNT.size + pixels * _BYTES_A_PIXEL
        _check_end(path, at, len(data))
    return names, poses


def _points(path: Path, most: int) -> Iterator[Cloud]:
    """Yield the points of a model, at most that many at a time."""
    from airzoo_bench.formats.clouds.cloud import Cloud

    with _opened(path) as (data, count):
        at, done = _COUNT.size, 0
        while done < count:
            wanted = min(most, count - done)
            rows, at = _equal_rows(data, at, wanted) or _rows(data, at, wanted)
            done += wanted
            yield Cloud(rows)
        _check_end(path, at, len(data))


def _rows(data: mmap.mmap, at: int, wanted: int) -> tuple[Any, int]:
    """Read points (N, 3) from a place on, and return where the next one is."""
    import numpy as np

    rows = np.empty((wanted, 3))
    for row in rows:
        _, *row[:], _, _, _, _, track = _POINT.unpack_from(data, at)
        at += _POINT.size + track * _BYTES_A_TRACK_ELEMENT
    return rows, at


def _equal_rows(data: mmap.mmap, at: int, wanted: int) -> tuple[Any, int] | None:
    """Do the same at once, where all tracks are of one length, as networks write them."""
    import numpy as np

    track = _POINT.unpack_from(data, at)[-1]
    size = _POINT.size + track * _BYTES_A_TRACK_ELEMENT
    if at + wanted * size > len(data):
        return None
    fields: Any = {"names": ["xyz", "track"], "formats": ["3<f8", "<u8"], "offsets": [8, 43]}
    read: Any = np.frombuffer(data, np.dtype(fields | {"itemsize": size}), wanted, at)
    if (read["track"] != track).any():
        return None
    return read["xyz"].astype(np.float64), at + wanted * size


@contextmanager
def _opened(path: Path) -> Iterator[tuple[mmap.mmap, int]]:
    """Map a file, and read the number that it begins with."""
    if not path.is_file() or path.stat().st_size < _COUNT.size:
        raise _damaged(path, "it is missing or empty")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            yield data, _COUNT.unpack_from(data)[0]
        except (struct.error, OverflowError) as error:
            raise _damaged(path, "it ends before all that it states") from error


def _check_end(path: Path, at: int, size: int) -> None:
    if at != size:
        raise _damaged(path, "it ends before all that it states, or goes on after it")


def _text(path: Path, data: bytes) -> str:
    try:
        name = data.decode()
    except UnicodeDecodeError:
        name = ""
    if not (name and name.isprintable()):
        raise _damaged(path, f"an image has the name {data[:40]!r}, which is no printable text")
    return name


def _damaged(path: Path, why: str) -> PredictionError:
    return PredictionError(
        f"is no file of a COLMAP model: {why}",
        where=path,
        expected=f"a binary model: {', '.join(_FILES)}",
        fix="export or copy the model again",
    )

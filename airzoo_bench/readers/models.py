"""COLMAP models: poses and points of their files, read without libraries.

Pixels of models that networks export are of no use: VGGT's are of two frames mixed up. What is read
is the poses of images, their names, and the points; cameras only to tell who wrote the model.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import read_text
from airzoo_bench.evaluation.reader import refuse_option
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud
from airzoo_bench.formats.npz import Budget
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers.scenes import Layout, SceneOutput
from airzoo_bench.readers.trajectories import rotations_of
from airzoo_bench.readers.views import MadeArrays
from airzoo_bench.reconstruction.cameras import image_poses
from airzoo_bench.reconstruction.predictions import ScenePrediction

_FILES = ("cameras.bin", "images.bin", "points3D.bin")
_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_POINT = struct.Struct("<Q3d3BdQ")
_BYTES_A_PIXEL, _BYTES_A_TRACK_ELEMENT = 24, 8
_LONGEST_NAME = 1024
_BYTES_AN_IMAGE = 2400  # in memory, while names and poses are checked
_TEXT_BYTES = 1 << 30
_PARAMETERS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8, 6: 12, 7: 5, 8: 4, 9: 5, 10: 12}
_LOOKED_AT = 64
_LONG_SIDES = (504, 512, 518)  # of images as MapAnything sees them


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


def is_of_mapanything(folder: Path) -> bool:
    """Whether cameras are of images of the size that MapAnything sees, and points.ply is there."""
    sizes = {size for _, size, _ in first_cameras(folder)}
    has_points = (folder / "points.ply").is_file()
    return has_points and len(sizes) == 1 and max(sizes.pop()) in _LONG_SIDES


def is_of_vggt(folder: Path) -> bool:
    """Whether all principal points are in the middle, and points.ply is there."""
    cameras = first_cameras(folder)
    centred = bool(cameras)
    for model, (width, height), parameters in cameras:
        first = 1 if model in (0, 2, 3) else 2
        centred &= parameters[first : first + 2] == (width / 2, height / 2)
    return centred and (folder / "points.ply").is_file() and not is_of_mapanything(folder)


def is_of_depth_anything_3(folder: Path) -> bool:
    """Whether there is a pinhole camera an image, with the files of newer versions of COLMAP."""
    cameras = first_cameras(folder)
    new = all((folder / name).is_file() for name in ("rigs.bin", "frames.bin"))
    return new and len(cameras) > 1 and all(model == 1 for model, _, _ in cameras)


@dataclass(frozen=True)
class Model(Layout):
    """A binary model, `below` a scene's folder; `any_other` is read too once it is asked for."""

    knows: Callable[[Path], bool]
    below: str = "sparse"
    any_other: bool = False
    said = (
        "poses world-to-camera, quaternions w x y z, axes of OpenCV",
        "points of points3D.bin; 2D points and intrinsics are not read",
    )

    def sure(self, place: Path) -> float:
        """See `Layout.sure`."""
        folder = place / self.below
        return 0.9 * (is_model(folder) and self.knows(folder))

    def accepts(self, place: Path) -> bool:
        """See `Layout.accepts`."""
        folder = place / self.below
        return is_model(folder) and (self.any_other or self.knows(folder))

    def order(self, output: SceneOutput) -> str:
        """See `Layout.order`."""
        return "images by their names in the model"

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`."""
        path, cloud = (output.place / self.below / name for name in _FILES[1:])
        budget = Budget(memory)
        refuse_option("--names", output.reading.names, "a COLMAP model", path)
        names, poses = read_images(path, budget)
        rotation = rotations_of(path, poses[:, :4], names)
        fields = {
            "image_names": np.array(output.photos(names), dtype=str),
            "extrinsics": np.concatenate([rotation, poses[:, 4:, None]], axis=2),
        }
        images = image_poses(MadeArrays(path, budget, fields), len(names))
        with _opened(cloud) as (data, count):
            if count * _POINT.size > len(data):
                raise _damaged(cloud, f"it states {count:,} points and has {len(data):,} bytes")
        points = FileCloud(
            cloud, "COLMAP", count, lambda most: read_points(cloud, most), np.dtype(np.float64)
        )
        return ScenePrediction(points, images)


def images_file(folder: Path) -> Path | None:
    """Return the file of images of a model; COLMAP reads .bin where text is there too."""
    for suffix in (".bin", ".txt"):
        images, cameras = (folder / f"{name}{suffix}" for name in ("images", "cameras"))
        if images.is_file() and cameras.is_file():
            return images
    return None


def read_images(path: Path, budget: Budget) -> tuple[list[str], Floats]:
    """Return names (N) and, for each (N, 7), w x y z and translation, world-to-camera."""
    found = list((_binary_images if path.suffix == ".bin" else _text_images)(path, budget))
    if not found:
        raise PredictionError("has no image with a pose", where=path, fix="register images")
    return [name for name, _ in found], np.array([pose for _, pose in found], dtype=np.float64)


def _binary_images(path: Path, budget: Budget) -> Iterator[tuple[str, list[float]]]:
    with _opened(path) as (data, count):
        budget.hold(path, f"{count:,} images", count * _BYTES_AN_IMAGE)
        at = _COUNT.size
        for number in range(count):
            _, *pose, _ = _IMAGE.unpack_from(data, at)
            at += _IMAGE.size
            end = data.find(b"\0", at, at + _LONGEST_NAME)
            name = data[at:end].decode(errors="replace") if end > 0 else ""
            if not (name and name.isprintable() and "\ufffd" not in name):
                raise _damaged(path, f"the name of image {number + 1:,} is no printable text")
            yield name, pose
            (pixels,) = _COUNT.unpack_from(data, end + 1)
            at = end + 1 + _COUNT.size + pixels * _BYTES_A_PIXEL
        _check_end(path, at, len(data))


def _text_images(path: Path, budget: Budget) -> Iterator[tuple[str, list[float]]]:
    """Yield the images of images.txt: two lines each; the second may be empty."""
    budget.hold(path, "its text", path.stat().st_size * 3)
    text = read_text(path, UnreadableError, "images.txt", _TEXT_BYTES)
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    for line in lines:
        if not line.strip():
            continue
        words = line.split(maxsplit=9)  # id, quaternion, translation, camera, name
        try:
            yield words[9].strip(), [float(word) for word in words[1:8]]
        except (ValueError, IndexError) as error:
            raise _damaged(path, f"a line that is no image: {line[:80]!r}") from error
        next(lines, None)


def read_points(path: Path, most: int) -> Iterator[Cloud]:
    """Yield the points of a model, at most that many at a time."""
    with _opened(path) as (data, count):
        at = _COUNT.size
        for start in range(0, count, most):
            rows = np.empty((min(most, count - start), 3))
            for row in rows:
                _, *row[:], _, _, _, _, track = _POINT.unpack_from(data, at)
                at += _POINT.size + track * _BYTES_A_TRACK_ELEMENT
            yield Cloud(rows)
        _check_end(path, at, len(data))


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


def _damaged(path: Path, why: str) -> PredictionError:
    what = f"damaged, or no file of a COLMAP model: {why}"
    return PredictionError(what, where=path, fix="export or copy the model again")

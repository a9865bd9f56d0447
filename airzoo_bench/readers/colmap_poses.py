"""Queries registered in a COLMAP model: the poses of its images, and nothing else of it."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, UnreadableError, counted
from airzoo_bench.core.files import read_text
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions

if TYPE_CHECKING:
    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.geometry.arrays import Bools

__all__ = ["COLMAP"]

_SURE_ENOUGH = 0.4  # reconstructions are such folders, too: it must be known that matching is meant
_BELOW = ("", "sparse/0", "sparse")
_TEXT_BYTES = 1 << 30
_BYTES_OF_IMAGE = 1500  # of memory, for its name and numbers
_BYTES_A_BYTE = 3  # a text and its lines
_RECORD, _COUNT = struct.Struct("<I7dI"), struct.Struct("<Q")
_POINT_BYTES = 24
_LONGEST_NAME = 4096
_FIRST_OF_POINTS = 9  # columns of a text line: id, q, t, camera, name

_Image = tuple[str, tuple[float, ...]]


class _Colmap(Reader):
    track = "matching"
    title = "photos registered in a COLMAP model"
    layout = "a folder with cameras and images, .bin or .txt, whose world is the scene's CRS"
    methods = ("COLMAP", "hloc", "pycolmap")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        return _SURE_ENOUGH * (_images_file(path) is not None)

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        import numpy as np

        from airzoo_bench.formats.budget import Budget
        from airzoo_bench.readers.matching import NamedPoses, posed, refuse_other_world, scenes_of

        file = _images_file(path)
        if file is None:
            raise UnreadableError("no COLMAP model", where=path, expected="images.bin or .txt")
        budget = Budget(reading.memory_bytes)
        names, values = [], []
        for name, pose in _from_bin(file) if file.suffix == ".bin" else _from_text(file, budget):
            names.append(name)
            values.append(pose)
            budget.hold(file, "its images", len(names) * _BYTES_OF_IMAGE)
        if not names:
            raise PredictionError("has no image with a pose", where=file, fix="register images")
        array = np.array(values, dtype=np.float64)
        found: Bools = np.asarray(np.isfinite(array).all(axis=1))
        given = NamedPoses(names, array[:, :4], array[:, 4:], found)
        predictions, strange = posed(given, reading, file)
        refuse_other_world(predictions.content, scenes_of(reading, file), file)
        left = f"{counted(strange, 'image')} of the model that are no queries left out"
        return ReadPredictions(
            predictions,
            (
                "poses are world-to-camera, quaternions w x y z, in the scene's CRS",
                "cameras of the model are not read: those of the benchmark count",
            ),
            (left,) if strange else (),
        )


def _images_file(path: Path) -> Path | None:
    """Return the file of images; COLMAP reads .bin where both are there."""
    for below in _BELOW:
        for suffix in (".bin", ".txt"):
            images, cameras = (path / below / f"{name}{suffix}" for name in ("images", "cameras"))
            if images.is_file() and cameras.is_file():
                return images
    return None


def _from_text(path: Path, budget: Budget) -> Iterator[_Image]:
    """Yield the images of images.txt: two lines each, the second of which may be empty."""
    budget.hold(path, "its text", path.stat().st_size * _BYTES_A_BYTE)
    text = read_text(path, UnreadableError, "images.txt", _TEXT_BYTES)
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    for line in lines:
        if not line.strip():
            continue
        words = line.split(maxsplit=_FIRST_OF_POINTS)
        try:
            pose = tuple(float(word) for word in words[1:8])
            name = words[_FIRST_OF_POINTS].strip()
        except (ValueError, IndexError) as error:
            raise _damaged(path, f"a line that is no image: {line[:80]!r}") from error
        yield name, pose
        next(lines, None)


def _from_bin(path: Path) -> Iterator[_Image]:
    """Yield the images of images.bin, whose points are passed over."""
    with path.open("rb") as stream:
        if path.stat().st_size < _COUNT.size:
            raise _damaged(path, "it ends before it begins")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
            (count,) = _COUNT.unpack_from(content)
            at = _COUNT.size
            for _ in range(count):
                try:
                    name, pose, at = _record(content, at)
                except (struct.error, UnicodeDecodeError, ValueError) as error:
                    raise _damaged(path, f"{error} at byte {at:,}") from error
                yield name, pose


def _record(content: mmap.mmap, at: int) -> tuple[str, tuple[float, ...], int]:
    _, *pose, _ = _RECORD.unpack_from(content, at)
    start = at + _RECORD.size
    end = content.find(b"\0", start, start + _LONGEST_NAME)
    if end < 0:
        raise ValueError("a name without end")
    name = content[start:end].decode()
    (points,) = _COUNT.unpack_from(content, end + 1)
    following = end + 1 + _COUNT.size + points * _POINT_BYTES
    if following > len(content):
        raise ValueError("the points of an image are cut off")
    return name, tuple(pose), following


def _damaged(path: Path, reason: str) -> PredictionError:
    return PredictionError(
        f"damaged or cut off: {reason}",
        where=path,
        expected="images.bin or images.txt as COLMAP writes them",
        fix="export the model again",
    )


COLMAP = _Colmap()
"""Registered as ``colmap-poses``."""

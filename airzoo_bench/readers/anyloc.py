"""What AnyLoc's own demo writes: a file for each image, ``DJI_0001.jpg.npy`` of shape (1, D)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.formats.budget import Budget

__all__ = ["ANYLOC", "AnyLocReader"]

_ENDINGS = tuple(f"{suffix}.npy" for suffix in PHOTO_SUFFIXES)
_TRIED = 4
_LEAST_LENGTH = 16  # a shorter row is a match or a pose, and no descriptor
_MOST_FILES = 4_000_000


class AnyLocReader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "a folder of descriptors by image"
    layout = "files IMAGE.jpg.npy of shape (1, D), in one folder or several below it"
    methods = ("AnyLoc",)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        if not path.is_dir():
            return 0.0
        # A run that broke off may have left a file without content.
        shapes = [shape for shape in map(_shape, islice(_files(path), _TRIED)) if shape]
        return 0.9 if shapes and all(map(_is_descriptor, shapes)) else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        from airzoo_bench.formats.npz import map_numbers
        from airzoo_bench.readers.image_bag import read_bag
        from airzoo_bench.readers.lengths import compared
        from airzoo_bench.readers.retrieval import SceneImages

        def descriptor(number: int) -> Any:
            rows = map_numbers(files[number])
            if rows.ndim != 2 or len(rows) != 1:
                raise PredictionError(
                    f"has shape {rows.shape}", where=files[number], expected="shape (1, D)"
                )
            return rows

        files = sorted(islice(_files(path), _MOST_FILES))
        names = [file.relative_to(path).as_posix().removesuffix(".npy") for file in files]
        images = SceneImages.of(reading, path)
        predictions, notes = read_bag(path, names, descriptor, images, Budget(reading.memory_bytes))
        said, more = compared("l2", reading.protocol, predictions)
        return ReadPredictions(
            predictions, ("images are named by their files, without .npy", *said), (*notes, *more)
        )


ANYLOC = AnyLocReader()


def _files(path: Path) -> Iterator[Path]:
    for home, folders, files in os.walk(path):
        folders.sort()
        for name in sorted(files):
            if name.lower().endswith(_ENDINGS):
                yield Path(home) / name


def _shape(path: Path) -> tuple[int, ...]:
    """Return the shape of a file's numbers; none where it is no such file, or damaged."""
    from airzoo_bench.formats.npz import map_numbers

    try:
        shape: tuple[int, ...] = map_numbers(path).shape if path.is_file() else ()
    except PredictionError:
        return ()
    return shape


def _is_descriptor(shape: tuple[int, ...]) -> bool:
    return len(shape) == 2 and shape[0] == 1 and shape[1] >= _LEAST_LENGTH

"""Pictures of a benchmark: photos and tiles, read small enough to work with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL.Image import Resampling

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.photos import open_photo
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.storage.urls import ensure_file

_ORIENTATION_TAG = 0x0112
_FIX = "put the photos back where benchmark.toml says, or prepare with --copy"


def photo_size(path: Path) -> tuple[int, int]:
    """Read width and height in pixels, as stored, from a photo's header."""
    with open_photo(ensure_file(path)) as image:
        orientation = image.getexif().get(_ORIENTATION_TAG)
        size = image.size
    if orientation in range(2, 9):  # other values mean nothing, and some cameras write 0
        raise BenchmarkError(
            f"is to be shown turned (EXIF orientation {orientation})",
            where=path,
            expected="orientation 1: a camera matrix belongs to the pixels as they are stored",
            fix="turn the pixels (jpegtran) or clear the tag (exiftool -Orientation=1 -n)",
        )
    return size


def read_grey(path: Path, long_side: int) -> NDArray[np.uint8]:
    """Read a photo as grey (height, width), made smaller so that its long side fits."""
    return _read(path, long_side, "L")


def read_rgb_photo(path: Path, long_side: int) -> NDArray[np.uint8]:
    """Read a photo in colour (height, width, 3), made smaller so that its long side fits."""
    return _read(path, long_side, "RGB")


def _read(path: Path, long_side: int, mode: str) -> NDArray[np.uint8]:
    with open_photo(ensure_file(path), _FIX) as image:
        scale = min(1.0, long_side / max(image.size))
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        # libjpeg skips what is thrown away. It rounds sizes up, so that the last row and
        # column may reach beyond the photo: the box is the photo's part of what it gives.
        reduced = image.draft(mode, size)
        box = reduced[1] if reduced else None
        return np.asarray(image.convert(mode).resize(size, Resampling.LANCZOS, box))


def read_tile(dom: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    """Read one tile (height, width, 3) from its window of the map."""
    window = (int(tile["x"]), int(tile["y"]), int(tile["width"]), int(tile["height"]))
    return read_rgb(dom, window)

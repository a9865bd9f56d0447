"""Height fields larger than memory, read by blocks as they are needed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.windows import Window

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.heightfield import HeightField, Heights, read_metres
from airzoo_bench.geometry.rasters import open_info, opened

__all__ = ["HeightSurvey", "blocked_heights", "small_cache", "survey_heights", "window_shape"]

_SIDE = 256
_SLOTS = 1024
_SCAN_PIXELS = 1 << 20
_CACHE_BYTES = 64 << 20


def small_cache() -> rasterio.Env:
    """Return a context in which GDAL keeps few blocks: by default it takes 5 % of the memory."""
    return rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES)


def window_shape(dataset: Any, pixels: int) -> tuple[int, int]:
    """Width and height of windows of whole blocks of the file, of about so many pixels.

    Windows are nearly square where the file has tiles, and as wide as the raster where it has
    strips; one block of the file at least.
    """
    high, wide = dataset.block_shapes[0]
    width = min(wide * max(int(pixels**0.5) // wide, 1), dataset.width)
    height = min(high * max(pixels // width // high, 1), dataset.height)
    return width, height


@dataclass(frozen=True)
class HeightSurvey:
    """What one pass over a raster's heights finds, in metres.

    Attributes
    ----------
    pixels, valid : int
        All, and those that have a height.
    low, high : float
        Lowest and highest height; NaN where there is none.
    at_low : int
        Pixels that have the lowest height to the last bit.
    beyond : int
        Pixels lower or higher than what was asked for.
    """

    pixels: int
    valid: int
    low: float
    high: float
    at_low: int
    beyond: int

    @property
    def valid_share(self) -> float:
        """Share of pixels that have a height."""
        return self.valid / self.pixels


def survey_heights(path: str | Path, lowest: float, highest: float) -> HeightSurvey:
    """Pass once over a raster's heights, in bounded memory.

    Parameters
    ----------
    path : str or Path
    lowest, highest : float
        Heights outside are counted as `beyond`.

    Raises
    ------
    RasterError
        See `opened` and `units.height_unit_m`.
    """
    pixels = valid = at_low = beyond = 0
    low = high = np.nan
    with small_cache(), opened(path) as dataset:
        for heights in _windows_of_heights(dataset):
            there = heights[~np.isnan(heights)].astype(np.float64)
            pixels, valid = pixels + heights.size, valid + there.size
            least = there.min(initial=np.inf)
            if there.size and not low <= least:
                low, at_low = least, 0
            at_low += int((there == low).sum())
            high = np.fmax(high, there.max()) if there.size else high
            beyond += int(((there < lowest) | (there > highest)).sum())
    return HeightSurvey(pixels, valid, float(low), float(high), at_low, beyond)


def _windows_of_heights(dataset: Any) -> Iterator[Heights]:
    width, height = window_shape(dataset, _SCAN_PIXELS)
    for row in range(0, dataset.height, height):
        for column in range(0, dataset.width, width):
            right, below = dataset.width - column, dataset.height - row
            yield read_metres(dataset, Window(column, row, min(width, right), min(height, below)))


@contextmanager
def blocked_heights(path: str | Path) -> Iterator[HeightField]:
    """Open a raster's first band as a height field that reads blocks when they are asked for.

    It answers as `HeightField.read(path)` does, to the last bit, in at most 256 MiB (512 MiB where
    heights need float64), however large the raster. Not for several threads at a time.

    Raises
    ------
    RasterError
        See `open_info`.
    """
    info = open_info(path)
    with small_cache(), opened(path) as dataset:
        blocks = _Blocks(dataset)
        nothing = np.broadcast_to(blocks.dtype.type(np.nan), (info.height, info.width))
        yield _BlockedHeightField(nothing, info.transform, info.crs, blocks)


@dataclass(frozen=True, eq=False)
class _BlockedHeightField(HeightField):
    """A height field whose `heights` have a shape only."""

    blocks: _Blocks

    @cached_property
    def height_range(self) -> tuple[float, float]:
        return self.blocks.height_range()

    def heights_at(self, column: Ints, row: Ints) -> Floats:
        picked = np.empty(column.shape)
        flat, columns, rows = picked.reshape(-1), column.reshape(-1), row.reshape(-1)
        for start in range(0, flat.size, _SLOTS):
            part = slice(start, start + _SLOTS)
            flat[part] = self.blocks.take(columns[part], rows[part])
        return picked


class _Blocks:
    """Square blocks of a raster, kept in slots until these are used up."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset
        self._across = -(-dataset.width // _SIDE)
        self._slot = np.full(self._across * -(-dataset.height // _SIDE), -1)
        self._used = 0
        self.dtype: np.dtype[Any] = read_metres(dataset, Window(0, 0, 1, 1)).dtype
        self._heights = np.empty((_SLOTS, _SIDE, _SIDE), self.dtype)

    def take(self, column: Ints, row: Ints) -> NDArray[Any]:
        """Heights (P,) of at most _SLOTS pixels."""
        block = row // _SIDE * self._across + column // _SIDE
        self._load(block)
        picked: NDArray[Any] = self._heights[self._slot[block], row % _SIDE, column % _SIDE]
        return picked

    def height_range(self) -> tuple[float, float]:
        low = high = np.nan
        for heights in _windows_of_heights(self._dataset):
            low = np.fmin(low, np.fmin.reduce(heights, axis=None))
            high = np.fmax(high, np.fmax.reduce(heights, axis=None))
        return float(low), float(high)

    def _load(self, block: Ints) -> None:
        missing = np.unique(block[self._slot[block] < 0])
        if self._used + missing.size > _SLOTS:
            self._slot[:] = -1
            self._used = 0
            missing = np.unique(block)
        for one in missing.tolist():
            down, across = divmod(one, self._across)
            heights = self._read(across * _SIDE, down * _SIDE, _SIDE, _SIDE)
            self._heights[self._used, : heights.shape[0], : heights.shape[1]] = heights
            self._slot[one] = self._used
            self._used += 1

    def _read(self, column: int, row: int, width: int, height: int) -> NDArray[Any]:
        right, below = self._dataset.width - column, self._dataset.height - row
        return read_metres(
            self._dataset, Window(column, row, min(width, right), min(height, below))
        )

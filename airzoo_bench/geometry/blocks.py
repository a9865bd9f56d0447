"""Heights of rasters larger than memory: read by blocks, surveyed, and their exact median."""

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

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.heightfield import (
    HeightField,
    Heights,
    height_type,
    metres_of,
    read_heights,
    read_metres,
)
from airzoo_bench.geometry.rasters import open_info, opened

__all__ = [
    "HeightSurvey",
    "blocked_heights",
    "median_height",
    "small_cache",
    "survey_heights",
    "window_shape",
]

_SIDE = 256
_SLOTS = 1024
_SCAN_PIXELS = 1 << 20
_CACHE_BYTES = 64 << 20
_DIGIT_BITS = 16


def small_cache() -> rasterio.Env:
    """Return a context in which GDAL keeps few blocks: by default it takes 5 % of the memory."""
    return rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES)


def window_shape(dataset: Any, pixels: int) -> tuple[int, int]:
    """Width and height of windows of whole blocks of the file, of about so many pixels."""
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
    next_low : float
        Lowest height above `low`; NaN where all are the same.
    beyond : int
        Pixels lower or higher than what was asked for.
    """

    pixels: int
    valid: int
    low: float
    high: float
    at_low: int
    next_low: float
    beyond: int

    @property
    def valid_share(self) -> float:
        """Share of pixels that have a height."""
        return self.valid / self.pixels


def survey_heights(path: str | Path, lowest: float, highest: float) -> HeightSurvey:
    """Pass once over a raster's heights, in bounded memory; counts those outside two as `beyond`.

    Raises
    ------
    RasterError
        See `opened` and `units.height_unit_m`.
    """
    pixels = valid = at_low = beyond = 0
    low = high = next_low = np.nan
    with small_cache(), opened(path) as dataset:
        for window in _windows(dataset):
            heights = read_metres(dataset, window)
            there = heights[~np.isnan(heights)].astype(np.float64)
            pixels, valid = pixels + heights.size, valid + there.size
            least = there.min(initial=np.inf)
            if there.size and not low <= least:
                low, next_low, at_low = least, low, 0
            at_low += int((there == low).sum())
            above = there.min(initial=np.inf, where=there > low)
            next_low = np.fmin(next_low, above) if above < np.inf else next_low
            high = np.fmax(high, there.max()) if there.size else high
            beyond += int(((there < lowest) | (there > highest)).sum())
    return HeightSurvey(pixels, valid, float(low), float(high), at_low, float(next_low), beyond)


def _windows(dataset: Any) -> Iterator[Window]:
    width, height = window_shape(dataset, _SCAN_PIXELS)
    for row in range(0, dataset.height, height):
        for column in range(0, dataset.width, width):
            yield _clipped(dataset, column, row, width, height)


def _clipped(dataset: Any, column: int, row: int, width: int, height: int) -> Window:
    right, below = dataset.width - column, dataset.height - row
    return Window(column, row, min(width, right), min(height, below))


def median_height(path: str | Path) -> float:
    """Median of all valid heights of a raster's first band, in metres."""
    with opened(path) as dataset:
        dtype = np.dtype(height_type(dataset.dtypes[0]))
        lower, upper = _middle(dataset, dtype, path)
        scale, offset = metres_of(dataset)
        return (lower + upper) / 2.0 * scale + offset


def _middle(dataset: Any, dtype: np.dtype[Any], path: str | Path) -> tuple[float, float]:
    """Return the two middle heights, alike when their number is odd."""
    bits = dtype.itemsize * 8
    prefixes, ranks = [0, 0], [0, 0]
    for shift in range(bits - _DIGIT_BITS, -1, -_DIGIT_BITS):
        counts = _digit_counts(dataset, dtype, shift, prefixes)
        if shift == bits - _DIGIT_BITS:
            total = int(counts[0].sum())
            if not total:
                raise RasterError("no valid height", where=path, fix="check its nodata value")
            ranks = [(total - 1) // 2, total // 2]
        for which, count in enumerate(counts):
            below = np.cumsum(count)
            digit = int(np.searchsorted(below, ranks[which], side="right"))
            ranks[which] -= int(below[digit] - count[digit])
            prefixes[which] = (prefixes[which] << _DIGIT_BITS) | digit
    lower, upper = (_height(prefix, dtype) for prefix in prefixes)
    return lower, upper


def _digit_counts(
    dataset: Any, dtype: np.dtype[Any], shift: int, prefixes: list[int]
) -> list[NDArray[np.int64]]:
    """Count, for each prefix, the 16 bits at `shift` of the keys that begin with it."""
    counts = {prefix: np.zeros(1 << _DIGIT_BITS, dtype=np.int64) for prefix in prefixes}
    for window in _windows(dataset):
        heights = read_heights(dataset, window, dtype)
        keys = _keys(heights[~np.isnan(heights)]) >> np.uint64(shift)
        for prefix, count in counts.items():
            digits = keys[keys >> np.uint64(_DIGIT_BITS) == np.uint64(prefix)]
            digits &= np.uint64((1 << _DIGIT_BITS) - 1)
            count += np.bincount(digits.astype(np.int64), minlength=len(count))
    return [counts[prefix] for prefix in prefixes]


def _keys(heights: Heights) -> NDArray[np.uint64]:
    """Unsigned integers in the heights' order: flip the sign bit, or all bits of negatives."""
    bits = heights.dtype.itemsize * 8
    raw = heights.view(f"u{heights.dtype.itemsize}").astype(np.uint64)
    sign = np.uint64(1 << (bits - 1))
    return np.where(raw & sign, np.uint64((1 << bits) - 1) ^ raw, raw | sign)


def _height(key: int, dtype: np.dtype[Any]) -> float:
    """Inverse of `_keys` for one key."""
    bits = dtype.itemsize * 8
    sign = 1 << (bits - 1)
    raw = key ^ sign if key & sign else key ^ ((1 << bits) - 1)
    return float(np.array(raw, dtype=f"u{dtype.itemsize}").view(dtype))


@contextmanager
def blocked_heights(path: str | Path) -> Iterator[HeightField]:
    """Open a raster's first band as a height field that reads blocks when they are asked for."""
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
        for window in _windows(self._dataset):
            heights = read_metres(self._dataset, window)
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
            window = _clipped(self._dataset, across * _SIDE, down * _SIDE, _SIDE, _SIDE)
            heights = read_metres(self._dataset, window)
            self._heights[self._used, : heights.shape[0], : heights.shape[1]] = heights
            self._slot[one] = self._used
            self._used += 1

"""Exact median height of a raster of any size, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.heightfield import Heights, metres_of, read_heights
from airzoo_bench.geometry.rasters import opened

__all__ = ["median_height"]

_DIGIT_BITS = 16
_WINDOW_PIXELS = 1 << 22
_NARROW = ("float32", "int8", "int16", "uint8", "uint16")


def median_height(path: str | Path) -> float:
    """Median of all valid heights of a raster's first band, in metres.

    Radix selection: heights become unsigned integers of the same order, and each pass over the file
    counts 16 bits of those that share the bits found so far: two passes for float32 and narrow
    integers, four for all else (64-bit integers beyond 2^53 are rounded). The result is exact;
    for an even count it is the mean of the two middle heights. Memory holds some windows of 4
    million pixels (or one block of the file where that is larger) beside GDAL's block cache.

    Parameters
    ----------
    path : str or Path
        A GeoTIFF.

    Returns
    -------
    float
        Metres.

    Raises
    ------
    RasterError
        No valid height; see also `rasters.opened`.
    """
    with opened(path) as dataset:
        dtype = np.dtype(np.float32 if dataset.dtypes[0] in _NARROW else np.float64)
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


def _windows(dataset: Any) -> Iterator[Window]:
    """Cut the raster into windows of whole blocks, about _WINDOW_PIXELS each."""
    block_height, block_width = dataset.block_shapes[0]
    across = max(_WINDOW_PIXELS // (block_height * block_width), 1)
    width = min(across * block_width, dataset.width)
    down = max(_WINDOW_PIXELS // (block_height * width), 1)
    height = min(down * block_height, dataset.height)
    for row in range(0, dataset.height, height):
        for column in range(0, dataset.width, width):
            yield Window(
                column,
                row,
                min(width, dataset.width - column),
                min(height, dataset.height - row),
            )

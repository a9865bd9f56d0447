"""How much of each tile of a map holds pictures, and not nodata."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.geometry.rasters import opened

__all__ = ["valid_shares"]

Ints = NDArray[np.int64]

_SIDE_PX = 4096  # of the part of a mask that is read at a time


def valid_shares(path: Path, windows: Ints) -> NDArray[np.float64]:
    """Share of valid pixels of windows of a raster, exactly.

    A pixel is valid by the file's own word: its alpha band (above 0), else its mask, else its
    nodata value (valid where any band differs from it). A file that has none of them is valid
    throughout, whatever its colours. Every pixel of the mask is read once, in parts.

    Parameters
    ----------
    path : Path
    windows : (G, 4) int
        Left, top, right, bottom in pixels, each with an area and inside the raster.

    Returns
    -------
    (G,) float64
        0 to 1.

    Raises
    ------
    RasterError
        The raster cannot be read.
    """
    left, top, right, bottom = windows.T
    with opened(path) as dataset:
        if all(flags == [MaskFlags.all_valid] for flags in dataset.mask_flag_enums):
            return np.ones(len(windows))
        columns = np.unique(np.concatenate([left, right, [0, dataset.width]]))
        rows = np.unique(np.concatenate([top, bottom, [0, dataset.height]]))
        cells = np.zeros((len(rows), len(columns)), np.int64)
        for column, row, mask in _masks(dataset):
            _count_into(cells, mask, row - rows, column - columns)
    # The cells between cuts, summed up to each cut: four look-ups then count any window.
    sums = np.zeros((len(rows) + 1, len(columns) + 1), np.int64)
    sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    x0, x1 = np.searchsorted(columns, left), np.searchsorted(columns, right)
    y0, y1 = np.searchsorted(rows, top), np.searchsorted(rows, bottom)
    valid = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
    shares: NDArray[np.float64] = valid / ((right - left) * (bottom - top))
    return shares


def _masks(dataset: Any) -> Iterator[tuple[int, int, NDArray[np.bool_]]]:
    """Give (column, row, validity) of parts that together are the raster."""
    for row in range(0, dataset.height, _SIDE_PX):
        for column in range(0, dataset.width, _SIDE_PX):
            width = min(_SIDE_PX, dataset.width - column)
            height = min(_SIDE_PX, dataset.height - row)
            mask = dataset.dataset_mask(window=Window(column, row, width, height))
            yield column, row, mask > 0


def _count_into(cells: Ints, mask: NDArray[np.bool_], below: Ints, right_of: Ints) -> None:
    """Add the valid pixels of a part to the cells that it meets.

    `below` and `right_of` say by how much the part's corner lies beyond each cut.
    """
    y, starts = _cuts(below, mask.shape[0])
    counts = np.add.reduceat(mask, starts, axis=0, dtype=np.int64)
    x, starts = _cuts(right_of, mask.shape[1])
    cells[np.ix_(y, x)] += np.add.reduceat(counts, starts, axis=1)


def _cuts(beyond: Ints, length: int) -> tuple[Ints, Ints]:
    """Return the cells that a stretch of so many pixels meets, and where in it each begins."""
    first = int(np.searchsorted(-beyond, 0, side="right")) - 1
    cells = np.arange(first, int(np.searchsorted(-beyond, length, side="left")))
    return cells, np.maximum(-beyond[cells], 0)

"""Lifting matches: from pixels of the map to points on the surface model.

The height is that of `HeightField.sample`, to the last bit. Points are sorted by blocks of the
raster, so that each block is read once and the raster is never whole in memory.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rasterio.windows import Window

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.heightfield import HeightField, read_metres, small_cache, window_shape
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    opened,
    pixel_to_world,
    world_to_pixel,
)

__all__ = ["LiftStatus", "Lifted", "lift"]

_BLOCK_PIXELS = 1 << 18
# Points handled at a time; bounds the memory of each worker.
_POINTS = 1 << 16


class LiftStatus(IntEnum):
    """What became of a match; the names are those of reports."""

    LIFTED = 0
    OUTSIDE_MAP = 1
    OUTSIDE_DSM = 2
    """Off the surface model, or beyond the domain of one of the two CRS."""
    NO_HEIGHT = 3
    """No neighbour nearer than a pixel has a height, or one is not above `heights_above_m`."""
    NOT_FINITE = 4


class Lifted(NamedTuple):
    """Points on the ground.

    Parameters
    ----------
    points : (M, 3) array
        X, Y, Z in the surface model's CRS; NaN where the match is dropped.
    status : (M,) uint8 array
        LiftStatus of each match; all but LIFTED are dropped.
    """

    points: Floats
    status: NDArray[np.uint8]

    @property
    def valid(self) -> Bools:
        """Matches (M,) that are lifted."""
        lifted: Bools = self.status == LiftStatus.LIFTED
        return lifted


def lift(
    map_xy: ArrayLike,
    dom: RasterInfo,
    dsm: RasterInfo | str | Path,
    *,
    heights_above_m: float | None = None,
    jobs: int,
) -> Lifted:
    """Lift matches onto the surface model."""
    xy = np.asarray(map_xy, dtype=np.float64)
    if xy.ndim != 2 or xy.shape[1] != 2:
        raise PredictionError(f"map pixels have shape {xy.shape}", expected="shape (M, 2)")
    ground = dsm if isinstance(dsm, RasterInfo) else open_info(dsm)
    with ExitStack() as stack:
        stack.enter_context(small_cache())
        datasets = [stack.enter_context(opened(ground.path))]
        task = _Task.of(xy, dom, ground, window_shape(datasets[0], _BLOCK_PIXELS), heights_above_m)
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(task.locate, range(0, len(xy), _POINTS)))
        order, runs = task.runs()
        shares = [share for share in np.array_split(runs, jobs) if share.size]
        # Opened here and not by the jobs: `opened` sets warnings, which threads share.
        datasets += [stack.enter_context(opened(ground.path)) for _ in shares[1:]]
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(partial(task.sample, order), datasets, shares))
    return Lifted(task.points, task.status)


@dataclass(frozen=True, eq=False)
class _Task:
    """What the jobs share; each writes to rows of its own."""

    xy: Floats
    dom: RasterInfo
    dsm: RasterInfo
    to_dsm: Callable[[Floats], Floats]
    shape: tuple[int, int]
    heights_above_m: float | None
    across: int
    blocks: int
    points: Floats
    status: NDArray[np.uint8]
    key: NDArray[Any]

    @classmethod
    def of(
        cls,
        xy: Floats,
        dom: RasterInfo,
        dsm: RasterInfo,
        shape: tuple[int, int],
        heights_above_m: float | None,
    ) -> _Task:
        across, down = -(-dsm.width // shape[0]), -(-dsm.height // shape[1])
        return cls(
            xy,
            dom,
            dsm,
            change_of_plane(dom.crs, dsm.crs),
            shape,
            heights_above_m,
            across,
            across * down,
            points=np.empty((len(xy), 3)),
            status=np.empty(len(xy), np.uint8),
            # numpy sorts keys of 16 bits by counting.
            key=np.empty(len(xy), np.min_scalar_type(across * down)),
        )

    def locate(self, start: int) -> None:
        """Find X and Y, the status but for the height, and the block of the raster."""
        part = slice(start, start + _POINTS)
        xy = self.xy[part]
        on_map = _inside(xy, self.dom)
        usable = xy if on_map.all() else np.where(on_map[:, None], xy, np.nan)
        world = self.to_dsm(pixel_to_world(self.dom.transform, usable))
        pixel = world_to_pixel(self.dsm.transform, world)
        on_dsm = _inside(pixel, self.dsm)
        self.points[part, :2] = world
        self.points[part, 2] = np.nan
        self.status[part] = LiftStatus.LIFTED
        if not on_dsm.all():
            self._drop(part, np.flatnonzero(~on_dsm), on_map)
            pixel[~on_dsm] = 0.0
        column, row = _cells(pixel)
        key = row // self.shape[1] * self.across + column // self.shape[0]
        self.key[part] = np.where(on_dsm, key, self.blocks)

    def _drop(self, part: slice, rows: Ints, on_map: Bools) -> None:
        self.points[part][rows] = np.nan
        finite = np.isfinite(self.xy[part][rows]).all(axis=1)
        self.status[part][rows] = np.select(
            (~finite, ~on_map[rows]),
            (LiftStatus.NOT_FINITE, LiftStatus.OUTSIDE_MAP),
            LiftStatus.OUTSIDE_DSM,
        )

    def runs(self) -> tuple[Ints, Ints]:
        """Rows of the matches in the order of blocks, and runs (R, 2) in it, each in one block."""
        order = np.argsort(self.key, kind="stable")
        blocks = np.arange(self.blocks + 1, dtype=self.key.dtype)
        border = np.searchsorted(self.key, blocks, sorter=order)
        start = np.union1d(border, np.arange(0, border[-1] + 1, _POINTS))
        return order, np.stack((start[:-1], start[1:]), axis=-1)

    def sample(self, order: Ints, dataset: Any, runs: Ints) -> None:
        """Find the heights of some runs."""
        for start, stop in runs.tolist():
            rows = order[start:stop]
            # take() on rows is some times faster than an index.
            world = self.points.take(rows, axis=0)[:, :2]
            height = self._heights(dataset, world_to_pixel(self.dsm.transform, world))
            self.points.reshape(-1)[3 * rows + 2] = height
            lost = rows[np.isnan(height)]
            self.status[lost] = LiftStatus.NO_HEIGHT
            self.points[lost] = np.nan

    def _heights(self, dataset: Any, pixel: Floats) -> Floats:
        """Heights at pixel coordinates that lie in one block."""
        column, row = _cells(pixel)
        left, top = int(column.min()), int(row.min())
        # The neighbours of the last cell, where the raster has them.
        right = min(int(column.max()) + 2, self.dsm.width)
        bottom = min(int(row.max()) + 2, self.dsm.height)
        heights = read_metres(dataset, Window(left, top, right - left, bottom - top))
        # Whole pixels are taken off without rounding.
        local = np.stack((pixel[:, 0] - left, pixel[:, 1] - top), axis=-1)
        field = HeightField(heights, self.dsm.transform, self.dsm.crs)
        sampled = field.sample_pixels(local)
        if self.heights_above_m is not None:
            sampled[~_all_above(field, local - 0.5, self.heights_above_m)] = np.nan
        return sampled


def _all_above(field: HeightField, grid: Floats, limit: float) -> Bools:
    """Tell where all neighbours that have a weight have a height above the limit."""
    last = np.array(field.heights.shape[::-1]) - 1
    low = np.clip(np.floor(grid), 0, last).astype(np.int64)
    high = np.clip(np.ceil(grid), 0, last).astype(np.int64)
    above = np.ones(len(grid), np.bool_)
    for column in (low[:, 0], high[:, 0]):
        for row in (low[:, 1], high[:, 1]):
            above &= field.heights_at(column, row) > limit
    return above


def _cells(pixel: Floats) -> tuple[Ints, Ints]:
    """Column and row (P,) of the first of the four neighbours of each point."""
    column, row = (np.maximum(axis - 0.5, 0.0).astype(np.int64) for axis in pixel.T)
    return column, row


def _inside(pixel: Floats, raster: RasterInfo) -> Bools:
    # By columns: numpy reduces an axis of two some ten times slower.
    column, row = pixel.T
    inside: Bools = column >= 0.0
    for condition in (column <= raster.width, row >= 0.0, row <= raster.height):
        inside &= condition
    return inside

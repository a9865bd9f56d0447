"""Lifting matches: from pixels of the map to points on the surface model.

A height is that of `HeightField.sample`, to the last bit. Points are sorted by blocks of the
raster, so that each block is read once and the raster is never whole in memory.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rasterio.windows import Window

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

_BLOCK_PIXELS = 1 << 18
_POINTS = 1 << 16  # that a thread handles at a time, which bounds its memory


class LiftStatus(IntEnum):
    """The end of a match; its name in lower case is a column of the records.

    OUTSIDE_DSM is off the surface model, or beyond the domain of one of the two CRS. NO_HEIGHT:
    no neighbour nearer than a pixel has a height, or one is not above `heights_above_m`.
    """

    LIFTED = 0
    OUTSIDE_MAP = 1
    OUTSIDE_DSM = 2
    NO_HEIGHT = 3


class Lifted(NamedTuple):
    """Points (M, 3) in the surface model's CRS, NaN where a match is dropped, and a LiftStatus."""

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
    """Lift pixels (M, 2) of the map onto the surface model in `jobs` threads."""
    ground = dsm if isinstance(dsm, RasterInfo) else open_info(dsm)
    task = _Task(np.asarray(map_xy, dtype=np.float64), dom, ground, heights_above_m)
    with ExitStack() as stack, ThreadPoolExecutor(jobs) as pool:
        stack.enter_context(small_cache())
        datasets = [stack.enter_context(opened(ground.path))]
        task.choose_blocks(datasets[0])
        list(pool.map(task.locate, range(0, len(task.xy), _POINTS)))
        order, runs = task.sort_by_block()
        shares = [share for share in np.array_split(runs, jobs) if share.size]
        # Opened here and not by the threads, which share the warnings that `opened` sets.
        datasets += [stack.enter_context(opened(ground.path)) for _ in shares[1:]]
        list(pool.map(partial(task.sample, order), datasets, shares))
    return Lifted(task.points, task.status)


class _Task:
    """The arrays that threads fill, each in rows of its own."""

    def __init__(
        self, xy: Floats, dom: RasterInfo, dsm: RasterInfo, heights_above_m: float | None
    ) -> None:
        self.xy, self.dom, self.dsm, self.heights_above_m = xy, dom, dsm, heights_above_m
        self.to_dsm = change_of_plane(dom.crs, dsm.crs)
        self.points = np.empty((len(xy), 3))
        self.status = np.empty(len(xy), np.uint8)

    def choose_blocks(self, dataset: Any) -> None:
        """Cut the raster into whole blocks of its file."""
        self.block = window_shape(dataset, _BLOCK_PIXELS)
        self.blocks_across = -(-self.dsm.width // self.block[0])
        self.blocks = self.blocks_across * -(-self.dsm.height // self.block[1])
        # NumPy sorts keys of 16 bits by counting.
        self.key = np.empty(len(self.xy), np.min_scalar_type(self.blocks))

    def locate(self, start: int) -> None:
        """Find X and Y, the status except for the height, and the block of the raster."""
        part = slice(start, start + _POINTS)
        xy, points, status = self.xy[part], self.points[part], self.status[part]
        on_map = _inside(xy, self.dom)
        usable = xy if on_map.all() else np.where(on_map[:, None], xy, np.nan)
        world = self.to_dsm(pixel_to_world(self.dom.transform, usable))
        pixel = world_to_pixel(self.dsm.transform, world)
        on_dsm = _inside(pixel, self.dsm)
        points[:, :2], points[:, 2] = world, np.nan
        status[:] = LiftStatus.LIFTED
        if not on_dsm.all():
            points[~on_dsm], pixel[~on_dsm] = np.nan, 0.0
            status[~on_dsm] = LiftStatus.OUTSIDE_DSM
            status[~on_map] = LiftStatus.OUTSIDE_MAP
        column, row = _first_neighbour(pixel)
        key = row // self.block[1] * self.blocks_across + column // self.block[0]
        self.key[part] = np.where(on_dsm, key, self.blocks)

    def sort_by_block(self) -> tuple[Ints, Ints]:
        """Return the matches in the order of blocks, and runs (R, 2) in it, each in one block."""
        order = np.argsort(self.key, kind="stable")
        blocks = np.arange(self.blocks + 1, dtype=self.key.dtype)
        borders = np.searchsorted(self.key, blocks, sorter=order)
        starts = np.union1d(borders, np.arange(0, borders[-1] + 1, _POINTS))
        return order, np.stack((starts[:-1], starts[1:]), axis=-1)

    def sample(self, order: Ints, dataset: Any, runs: Ints) -> None:
        """Find the heights of some runs."""
        for start, stop in runs.tolist():
            rows = order[start:stop]
            # take() on rows is some times faster than an index.
            world = self.points.take(rows, axis=0)[:, :2]
            height = self._heights(dataset, world_to_pixel(self.dsm.transform, world))
            self.points.reshape(-1)[3 * rows + 2] = height
            lost = rows[np.isnan(height)]
            self.status[lost], self.points[lost] = LiftStatus.NO_HEIGHT, np.nan

    def _heights(self, dataset: Any, pixel: Floats) -> Floats:
        """Return heights at pixel coordinates that lie in one block."""
        column, row = _first_neighbour(pixel)
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


def _first_neighbour(pixel: Floats) -> tuple[Ints, Ints]:
    """Return column and row (P,) of the first of the four neighbours of each point."""
    column, row = (np.maximum(axis - 0.5, 0.0).astype(np.int64) for axis in pixel.T)
    return column, row


def _inside(pixel: Floats, raster: RasterInfo) -> Bools:
    # By columns: NumPy reduces an axis of two some ten times slower.
    column, row = pixel.T
    inside: Bools = column >= 0.0
    for condition in (column <= raster.width, row >= 0.0, row <= raster.height):
        inside &= condition
    return inside

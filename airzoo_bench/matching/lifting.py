"""Lifting matches: from pixels of the map to points on the surface model, block by block."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from enum import IntEnum
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
    """The end of a match; its name in lower case is a column of the records."""

    LIFTED = 0
    OUTSIDE_MAP = 1
    OUTSIDE_DSM = 2  # or beyond the domain of one of the two CRS
    NO_HEIGHT = 3  # of a neighbour nearer than a pixel, or one not above `heights_above_m`


class Lifted(NamedTuple):
    """Points (M, 3) in the surface model's CRS, NaN where a match is dropped, and a LiftStatus."""

    points: Floats
    status: NDArray[np.uint8]


def lift(
    map_xy: ArrayLike,
    dom: RasterInfo,
    dsm: RasterInfo | str | Path,
    *,
    heights_above_m: float | None = None,
    jobs: int,
) -> Lifted:
    """Lift pixels (M, 2) of the map onto the surface model in `jobs` threads.

    A height is that of `HeightField.sample`, to the last bit. Points are sorted by blocks of the
    raster, so that each block is read once and the raster is never whole in memory.
    """
    ground = dsm if isinstance(dsm, RasterInfo) else open_info(dsm)
    xy, to_dsm = np.asarray(map_xy, dtype=np.float64), change_of_plane(dom.crs, ground.crs)
    points, status = np.empty((len(xy), 3)), np.empty(len(xy), np.uint8)

    # Threads fill rows of their own.
    def locate(start: int) -> None:
        """Find X and Y, the status except for the height, and the block of the raster."""
        part = slice(start, start + _POINTS)
        on_map = _inside(xy[part], dom)
        usable = xy[part] if on_map.all() else np.where(on_map[:, None], xy[part], np.nan)
        world = to_dsm(pixel_to_world(dom.transform, usable))
        pixel = world_to_pixel(ground.transform, world)
        on_dsm = _inside(pixel, ground)
        points[part, :2], points[part, 2], status[part] = world, np.nan, LiftStatus.LIFTED
        if not on_dsm.all():
            points[part][~on_dsm], pixel[~on_dsm] = np.nan, 0.0
            status[part][~on_dsm] = LiftStatus.OUTSIDE_DSM
            status[part][~on_map] = LiftStatus.OUTSIDE_MAP
        column, row = _first_neighbour(pixel)
        block[part] = np.where(on_dsm, row // height * across + column // width, blocks)

    def sample(dataset: Any, runs: Ints) -> None:
        """Find the heights of runs of points, each in one block."""
        for start, stop in runs.tolist():
            rows = order[start:stop]
            world = points.take(rows, axis=0)[:, :2]  # some times faster than an index
            pixel = world_to_pixel(ground.transform, world)
            found = _sample_block(dataset, ground, pixel, heights_above_m)
            points.reshape(-1)[3 * rows + 2] = found
            lost = rows[np.isnan(found)]
            status[lost], points[lost] = LiftStatus.NO_HEIGHT, np.nan

    with ExitStack() as stack, ThreadPoolExecutor(jobs) as pool:
        stack.enter_context(small_cache())
        datasets = [stack.enter_context(opened(ground.path))]
        width, height = window_shape(datasets[0], _BLOCK_PIXELS)
        across = -(-ground.width // width)
        blocks = across * -(-ground.height // height)
        block = np.empty(len(xy), np.min_scalar_type(blocks))  # 16 bits are sorted by counting
        list(pool.map(locate, range(0, len(xy), _POINTS)))
        order = np.argsort(block, kind="stable")
        every = np.arange(blocks + 1, dtype=block.dtype)
        borders = np.searchsorted(block, every, sorter=order)
        starts = np.union1d(borders, np.arange(0, borders[-1] + 1, _POINTS))
        runs = np.stack((starts[:-1], starts[1:]), axis=-1)
        shares = [share for share in np.array_split(runs, jobs) if share.size]
        # Opened here and not by the threads, which share the warnings that `opened` sets.
        datasets += [stack.enter_context(opened(ground.path)) for _ in shares[1:]]
        list(pool.map(sample, datasets, shares))
    return Lifted(points, status)


def _sample_block(
    dataset: Any, ground: RasterInfo, pixel: Floats, heights_above_m: float | None
) -> Floats:
    """Return heights at pixel coordinates that lie in one block."""
    column, row = _first_neighbour(pixel)
    left, top = int(column.min()), int(row.min())
    # The neighbours of the last cell, where the raster has them.
    right, bottom = min(int(column.max()) + 2, ground.width), min(int(row.max()) + 2, ground.height)
    heights = read_metres(dataset, Window(left, top, right - left, bottom - top))
    field, local = HeightField(heights, ground.transform, ground.crs), pixel - (left, top)
    sampled = field.sample_pixels(local)
    if heights_above_m is not None:
        last = np.array(heights.shape[::-1]) - 1
        ends = [np.clip(end(local - 0.5), 0, last).astype(np.int64) for end in (np.floor, np.ceil)]
        # All neighbours that have a weight.
        for columns, rows in ((x[:, 0], y[:, 1]) for x in ends for y in ends):
            sampled[~(field.heights_at(columns, rows) > heights_above_m)] = np.nan
    return sampled


def _first_neighbour(pixel: Floats) -> tuple[Ints, Ints]:
    """Return column and row (P,) of the first of the four neighbours of each point."""
    column, row = (np.maximum(axis - 0.5, 0.0).astype(np.int64) for axis in pixel.T)
    return column, row


def _inside(pixel: Floats, raster: RasterInfo) -> Bools:
    # By columns: NumPy reduces an axis of two some ten times slower.
    column, row = pixel.T
    inside = (column >= 0.0) & (column <= raster.width) & (row >= 0.0)
    return np.asarray(inside & (row <= raster.height))

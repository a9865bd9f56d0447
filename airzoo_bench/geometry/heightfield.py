"""Heights on a grid (DSM, DTM), in memory or read by blocks, and the surface between them.

The surface is bilinear between pixel centres. Where one of the four neighbours has no height it is
the height of the nearest neighbour that has one and is nearer than a pixel; else there is none.
From the outermost pixel centres to the raster's border it is level.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import ArrayLike, NDArray
from rasterio import Affine
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import height_unit_m
from airzoo_bench.geometry.rasters import open_info, open_raster, pixel_to_world, world_to_pixel

Heights = NDArray[np.float32] | NDArray[np.float64]

# Column and row of the four neighbours, relative to the first.
CORNERS: Ints = np.array(((0, 0), (1, 0), (0, 1), (1, 1)))

# Points sampled at a time: few enough for the processor's cache.
_BLOCK = 1 << 14
_MOST_BYTES = 2 << 30
# Kinds of file whose heights float32 holds without loss.
_NARROW = ("float32", "int8", "int16", "uint8", "uint16")
# GDAL takes numbers this near to the nodata value (relative) for nodata, or some of them.
_NEAR_NODATA = 1e-5
# Blocks of a raster larger than memory: pixels a side, how many are kept, pixels of a scan.
_SIDE = 256
_BLOCKS = 1024
_SCAN_PIXELS = 1 << 20
_CACHE_BYTES = 64 << 20
_BINS = 1 << 16  # of which the median is in one or two


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights (H, W) of a grid, NaN where there is none; never infinite.

    The transform takes pixels (column, row; corner at 0, 0) to coordinates of the CRS.
    """

    heights: Heights
    transform: Any
    crs: Any

    @classmethod
    def read(
        cls, path: str | Path, bounds: tuple[float, float, float, float] | None = None
    ) -> HeightField:
        """Read a raster's first band, or what lies in bounds (left, bottom, right, top) of it."""
        info = open_info(path)
        window = Window(0, 0, info.width, info.height)
        if bounds is not None:
            left, bottom, right, top = bounds
            box = np.array(((left, bottom), (left, top), (right, bottom), (right, top)))
            pixels, last = world_to_pixel(info.transform, box), (info.width, info.height)
            low = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, last)
            high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, last)
            if not (high > low).all():
                raise RasterError(f"does not meet {bounds} (left, bottom, right, top)", where=path)
            window = Window(*low.astype(int).tolist(), *(high - low).astype(int).tolist())
        size = window.width * window.height * np.dtype(height_type(info.dtype)).itemsize
        if size > _MOST_BYTES:
            raise RasterError(
                f"heights of {window.width} x {window.height} px need {size / 1e9:.1f} GB",
                where=path,
                expected=f"at most {_MOST_BYTES / 1e9:.1f} GB",
                fix="cut it to the photos (gdal_translate -projwin), or resample it (gdalwarp -tr)",
            )
        with open_raster(path) as dataset:
            heights = read_metres(dataset, window)
        a, b, _, d, e, _ = info.transform[:6]
        c, f = pixel_to_world(info.transform, (window.col_off, window.row_off)).tolist()
        return cls(heights=heights, transform=Affine(a, b, c, d, e, f), crs=info.crs)

    @cached_property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest height; NaN where there is none at all."""
        low = np.fmin.reduce(self.heights, axis=None)
        high = np.fmax.reduce(self.heights, axis=None)
        return float(low), float(high)

    def sample(self, xy: ArrayLike) -> Floats:
        """Return the surface's heights (...) at world coordinates (..., 2) in the field's CRS."""
        return self.sample_pixels(world_to_pixel(self.transform, xy))

    def sample_pixels(self, colrow: ArrayLike) -> Floats:
        """Return the surface's heights (...) at pixel coordinates (..., 2)."""
        points = np.asarray(colrow, dtype=np.float64)
        flat = points.reshape(-1, 2)
        sampled = np.full(len(flat), np.nan)
        for start in range(0, len(flat), _BLOCK):
            part, there = flat[start : start + _BLOCK], sampled[start : start + _BLOCK]
            inside = are_inside(part, *self.heights.shape[::-1])
            if inside.all():
                there[:] = self._surface(part)
            else:
                there[inside] = self._surface(part[inside])
        return sampled.reshape(points.shape[:-1])

    def corner_heights(self, cell: Ints) -> Floats:
        """Return heights (P, 4) at the corners of cells (P, 2) of the grid of pixel centres."""
        last = np.array(self.heights.shape[::-1]) - 1
        column, row = np.moveaxis(np.clip(cell[:, None] + CORNERS, 0, last), -1, 0)
        return self.heights_at(column, row)

    def heights_at(self, column: Ints, row: Ints) -> Floats:
        """Return heights (...) of pixels of the raster; NaN where there is none."""
        flat = self.heights.reshape(-1)
        with np.errstate(invalid="ignore"):  # of a signalling NaN
            return np.asarray(flat.take(row * self.heights.shape[1] + column), np.float64)

    def _surface(self, pixel: Floats) -> Floats:
        """Return heights at pixel coordinates (P, 2) on the raster."""
        (column, right, a), (row, below, b) = map(_neighbours, pixel.T, self.heights.shape[::-1])
        corners = [self.heights_at(x, y) for y in (row, below) for x in (column, right)]
        surface = (1.0 - a) * (1.0 - b) * corners[0] + a * (1.0 - b) * corners[1]
        surface += (1.0 - a) * b * corners[2]
        surface += a * b * corners[3]
        gap = np.flatnonzero(np.isnan(surface))
        if gap.size:
            heights = np.stack([corner[gap] for corner in corners], axis=-1)
            some = ~np.isnan(heights).all(axis=-1)
            gap, heights = gap[some], heights[some]
            surface[gap] = _with_gaps(heights, np.stack((a[gap], b[gap]), axis=-1))
        return surface


def are_inside(pixel: Floats, width: int, height: int) -> Bools:
    """Tell which pixel coordinates (P, 2) are on a raster or its border."""
    column, row = pixel.T  # NumPy reduces an axis of two some ten times slower
    return np.asarray((column >= 0.0) & (column <= width) & (row >= 0.0) & (row <= height))


def _neighbours(position: Floats, size: int) -> tuple[Ints, Ints, Floats]:
    """Return the pixels with centres before and behind positions, and the share of the way."""
    clamped = np.clip(position - 0.5, 0.0, size - 1.0)
    floor = np.floor(clamped)
    before = floor.astype(np.int64)
    return before, np.minimum(before + 1, size - 1), clamped - floor


def _with_gaps(heights: Floats, local: Floats) -> Floats:
    """Return heights at points (P, 2) of cells with missing corners (P, 4)."""
    weights = np.abs(1.0 - CORNERS - local[:, None]).prod(axis=-1)
    # A neighbour of no weight is no neighbour: on the line between two pixels only they count.
    complete = ~(np.isnan(heights) & (weights > 0.0)).any(axis=-1)
    bilinear = (weights * np.where(weights > 0.0, heights, 0.0)).sum(axis=-1)
    # The nearest corner that has a height, nearer than a pixel; the first of equals.
    away = ((local[:, None] - CORNERS) ** 2).sum(axis=-1)
    away = np.where(np.isnan(heights) | (away >= 1.0), np.inf, away)
    pick = np.argmin(away, axis=-1)[:, None]
    found = np.isfinite(np.take_along_axis(away, pick, axis=-1))
    nearest = np.where(found, np.take_along_axis(heights, pick, axis=-1), np.nan)[:, 0]
    return np.where(complete, bilinear, nearest)


def height_type(stored: str) -> type[np.float32] | type[np.float64]:
    """Return the narrowest type that holds heights stored in another without loss."""
    return np.float32 if stored in _NARROW else np.float64


@lru_cache(maxsize=8)  # a file is read in many windows
def metres_of(dataset: Any) -> tuple[float, float]:
    """Return scale and offset that make metres of stored numbers: the file's, times its unit's."""
    unit = height_unit_m(dataset)
    return float(dataset.scales[0]) * unit, float(dataset.offsets[0]) * unit


def read_metres(dataset: Any, window: Window) -> Heights:
    """Read heights of band 1 in metres; NaN where there is none."""
    heights = read_heights(dataset, window, height_type(dataset.dtypes[0]))
    scale, offset = metres_of(dataset)
    if (scale, offset) == (1.0, 0.0):
        return heights
    scaled: Floats = heights.astype(np.float64) * scale + offset
    return scaled


def read_heights(dataset: Any, window: Window, dtype: Any) -> Heights:
    """Read band 1 as stored, with NaN where the file (nodata, mask) or the number has no height."""
    heights: Heights | None = _read_plain(dataset, window, np.dtype(dtype))
    if heights is None:
        band = dataset.read(1, window=window, masked=True)
        heights = band.data.astype(dtype)
        heights[np.ma.getmaskarray(band) | ~np.isfinite(heights)] = np.nan
    return heights


def _read_plain(dataset: Any, window: Window, dtype: np.dtype[Any]) -> Heights | None:
    """Read floats marked by a nodata value alone, three times as fast as through GDAL's mask.

    None where that mask is needed.
    """
    plain = dataset.mask_flag_enums[0] in ([MaskFlags.all_valid], [MaskFlags.nodata])
    if not plain or np.dtype(dataset.dtypes[0]) != dtype:
        return None
    heights: NDArray[Any] = dataset.read(1, window=window)
    nodata = np.nan if dataset.nodata is None else dataset.nodata
    np.copyto(heights, np.nan, where=heights == dtype.type(nodata))
    low, high = (float(end.reduce(heights, axis=None)) for end in (np.fmin, np.fmax))
    least, most = nodata - abs(nodata) * _NEAR_NODATA, nodata + abs(nodata) * _NEAR_NODATA
    if low <= most and high >= least and ((heights >= least) & (heights <= most)).any():
        return None
    if np.isinf((low, high)).any():
        np.copyto(heights, np.nan, where=np.isinf(heights))
    return heights


def small_cache() -> rasterio.Env:
    """Return a context in which GDAL keeps few blocks: by default it takes 5 % of the memory."""
    return rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES)


def window_shape(dataset: Any, pixels: int) -> tuple[int, int]:
    """Return width and height of windows of whole blocks of the file, near a number of pixels."""
    high, wide = dataset.block_shapes[0]
    width = min(wide * max(int(pixels**0.5) // wide, 1), dataset.width)
    height = min(high * max(pixels // width // high, 1), dataset.height)
    return width, height


def _windows(dataset: Any) -> Iterator[Window]:
    width, height = window_shape(dataset, _SCAN_PIXELS)
    for row in range(0, dataset.height, height):
        for column in range(0, dataset.width, width):
            yield _clipped(dataset, column, row, width, height)


def _clipped(dataset: Any, column: int, row: int, width: int, height: int) -> Window:
    right, below = dataset.width - column, dataset.height - row
    return Window(column, row, min(width, right), min(height, below))


@dataclass(frozen=True)
class HeightSurvey:
    """Heights of a raster in metres, by one pass over it; NaN where there is none.

    `at_low` pixels have the lowest height to the last bit, `next_low` is the lowest above it, and
    `beyond` pixels lie outside the limits that were asked for.
    """

    pixels: int
    valid: int
    low: float
    high: float
    at_low: int
    next_low: float
    beyond: int


def survey_heights(path: str | Path, lowest: float, highest: float) -> HeightSurvey:
    """Pass once over a raster's heights, in bounded memory; count those outside two limits."""
    pixels = valid = at_low = beyond = 0
    low = high = next_low = np.nan
    with small_cache(), open_raster(path) as dataset:
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


def median_height(path: str | Path) -> float:
    """Return the exact median of all valid heights of a raster, in metres and bounded memory."""
    with small_cache(), open_raster(path) as dataset:
        low, high, total = np.inf, -np.inf, 0
        for heights in _valid_heights(dataset):
            low, high = min(low, heights.min()), max(high, heights.max())
            total += heights.size
        if not total:
            raise RasterError("no valid height", where=path, fix="check its nodata value")
        edges, ranks = np.linspace(low, high, _BINS + 1), ((total - 1) // 2, total // 2)
        counts = np.zeros(_BINS, np.int64)
        for heights in _valid_heights(dataset):
            counts += np.histogram(heights, edges)[0]
        first, last = np.searchsorted(np.cumsum(counts), ranks, side="right").tolist()
        beyond = np.inf if last == _BINS - 1 else edges[last + 1]
        middle: Counter[float] = Counter()  # of the different heights in these bins, which are few
        for heights in _valid_heights(dataset):
            inside = heights[(heights >= edges[first]) & (heights < beyond)]
            values, times = np.unique(inside, return_counts=True)
            middle.update(dict(zip(values.tolist(), times.tolist(), strict=True)))
        values = np.array(sorted(middle))
        ends = counts[:first].sum() + np.cumsum([middle[value] for value in values.tolist()])
        lower, upper = values[np.searchsorted(ends, ranks, side="right")].tolist()
        scale, offset = metres_of(dataset)
        return float((lower + upper) / 2.0 * scale + offset)


def _valid_heights(dataset: Any) -> Iterator[Floats]:
    """Yield the heights as stored of windows that have some."""
    for window in _windows(dataset):
        heights = read_heights(dataset, window, height_type(dataset.dtypes[0]))
        there = heights[~np.isnan(heights)].astype(np.float64)
        if there.size:
            yield there


@contextmanager
def blocked_heights(path: str | Path) -> Iterator[HeightField]:
    """Open a raster's first band as a height field that reads blocks when they are asked for."""
    info = open_info(path)
    with small_cache(), open_raster(path) as dataset:
        dtype: Any = read_metres(dataset, Window(0, 0, 1, 1)).dtype
        nothing = np.broadcast_to(dtype.type(np.nan), (info.height, info.width))
        yield _BlockedHeightField(nothing, info.transform, info.crs, dataset)


@dataclass(frozen=True, eq=False)
class _BlockedHeightField(HeightField):
    """A height field that is read by blocks; `heights` has their shape only."""

    dataset: Any

    @cached_property
    def height_range(self) -> tuple[float, float]:
        low = high = np.nan
        for window in _windows(self.dataset):
            heights = read_metres(self.dataset, window)
            low = np.fmin(low, np.fmin.reduce(heights, axis=None))
            high = np.fmax(high, np.fmax.reduce(heights, axis=None))
        return float(low), float(high)

    def heights_at(self, column: Ints, row: Ints) -> Floats:
        picked = np.empty(column.shape)
        across = self.heights.shape[1] // _SIDE + 1
        blocks, which = np.unique(row // _SIDE * across + column // _SIDE, return_inverse=True)
        order = np.argsort(which, axis=None, kind="stable")
        ends = np.cumsum(np.bincount(which.ravel(), minlength=len(blocks)))
        for block, points in zip(blocks.tolist(), np.split(order, ends)[:-1], strict=True):
            heights = self._block(*divmod(block, across))
            inside = row.flat[points] % _SIDE, column.flat[points] % _SIDE
            picked.flat[points] = heights[inside]
        return picked

    @cached_property
    def _block(self) -> Callable[[int, int], Heights]:
        @lru_cache(maxsize=_BLOCKS)
        def read(down: int, across: int) -> Heights:
            window = _clipped(self.dataset, across * _SIDE, down * _SIDE, _SIDE, _SIDE)
            return read_metres(self.dataset, window)

        return read

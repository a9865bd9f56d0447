"""Heights on a grid (DSM, DTM) and the surface between them.

The surface is bilinear between pixel centres. Where one of the four neighbours has no height it is
the height of the nearest neighbour that has one and is nearer than a pixel; else there is none.
From the outermost pixel centres to the raster's border it is level.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rasterio import Affine
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    opened,
    pixel_to_world,
    world_to_pixel,
)
from airzoo_bench.geometry.units import height_unit_m

__all__ = [
    "CORNERS",
    "HeightField",
    "Heights",
    "height_type",
    "metres_of",
    "read_heights",
    "read_metres",
]

Heights = NDArray[np.float32] | NDArray[np.float64]

# Column and row of the four neighbours, relative to the first.
CORNERS: Ints = np.array(((0, 0), (1, 0), (0, 1), (1, 1)))

# Points sampled at a time: few enough for the processor's cache.
_BLOCK = 1 << 14
_GIB = 1 << 30
# Kinds of file whose heights float32 holds without loss.
_NARROW = ("float32", "int8", "int16", "uint8", "uint16")
# GDAL takes numbers this near to the nodata value (relative) for nodata, or some of them.
_NEAR_NODATA = 1e-5


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights of a grid.

    Parameters
    ----------
    heights : (H, W) float32 or float64 array
        NaN where there is no height; never infinite.
    transform : affine.Affine or sequence of 6 float
        Pixel (column, row; corner at 0, 0) to coordinates of `crs`.
    crs : Any
        Anything pyproj takes.
    """

    heights: Heights
    transform: Any
    crs: Any

    def __post_init__(self) -> None:
        if self.heights.ndim != 2 or not self.heights.size:
            raise RasterError(f"heights have shape {self.heights.shape}", expected="shape (H, W)")

    @classmethod
    def read(
        cls,
        path: str | Path,
        bounds: tuple[float, float, float, float] | None = None,
        limit_bytes: int = 2 * _GIB,
    ) -> HeightField:
        """Read the heights of a raster's first band, or of a part of it."""
        info = open_info(path)
        window = _window(info, bounds)
        _check_size(info, window, np.dtype(height_type(info.dtype)).itemsize, limit_bytes)
        with opened(path) as dataset:
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
        """Height (...) of the surface at world coordinates (..., 2) in the field's CRS."""
        return self.sample_pixels(world_to_pixel(self.transform, xy))

    def sample_pixels(self, colrow: ArrayLike) -> Floats:
        """Height of the surface at pixel coordinates (..., 2); see `sample`."""
        points = np.asarray(colrow, dtype=np.float64)
        flat = points.reshape(-1, 2)
        sampled = np.full(len(flat), np.nan)
        for start in range(0, len(flat), _BLOCK):
            part = flat[start : start + _BLOCK]
            inside = self._inside(part)
            if inside.all():
                sampled[start : start + _BLOCK] = self._surface(part - 0.5)
            else:
                sampled[start + np.flatnonzero(inside)] = self._surface(part[inside] - 0.5)
        return sampled.reshape(points.shape[:-1])

    def _inside(self, pixel: Floats) -> Bools:
        # By columns: numpy reduces an axis of two some ten times slower.
        (column, row), (height, width) = pixel.T, self.heights.shape
        inside: Bools = column >= 0.0
        for condition in (column <= width, row >= 0.0, row <= height):
            inside &= condition
        return inside

    def corner_heights(self, cell: Ints) -> Floats:
        """Heights (P, 4) at the corners of cells of the grid of pixel centres."""
        last = np.array(self.heights.shape[::-1]) - 1
        column, row = np.moveaxis(np.clip(cell[:, None] + CORNERS, 0, last), -1, 0)
        return self.heights_at(column, row)

    def heights_at(self, column: Ints, row: Ints) -> Floats:
        """Heights (...) of pixels of the raster; NaN where there is none."""
        picked: Floats = self._flat.take(row * self.heights.shape[1] + column).astype(np.float64)
        return picked

    @cached_property
    def _flat(self) -> NDArray[np.floating[Any]]:
        flat: NDArray[np.floating[Any]] = self.heights.reshape(-1)
        return flat

    def _surface(self, grid: Floats) -> Floats:
        """Height at points (P, 2) of the grid of pixel centres (first centre = 0, 0)."""
        (column, right, a), (row, below, b) = map(_neighbours, grid.T, self.heights.shape[::-1])
        surface = (1.0 - a) * (1.0 - b) * self.heights_at(column, row)
        surface += a * (1.0 - b) * self.heights_at(right, row)
        surface += (1.0 - a) * b * self.heights_at(column, below)
        surface += a * b * self.heights_at(right, below)
        gap = np.flatnonzero(np.isnan(surface))
        if gap.size:
            heights = self.corner_heights(np.stack((column[gap], row[gap]), axis=-1))
            surface[gap] = _with_gaps(heights, np.stack((a[gap], b[gap]), axis=-1))
        return surface


def _neighbours(position: Floats, size: int) -> tuple[Ints, Ints, Floats]:
    """Pixels before and behind positions between pixel centres, and the share of the way."""
    clamped = np.clip(position, 0.0, size - 1.0)
    before = clamped.astype(np.int64)
    return before, np.minimum(before + 1, size - 1), clamped - before


def read_metres(dataset: Any, window: Window) -> Heights:
    """Read heights of band 1 in metres; NaN where there is none."""
    heights = read_heights(dataset, window, height_type(dataset.dtypes[0]))
    scale, offset = metres_of(dataset)
    if (scale, offset) == (1.0, 0.0):
        return heights
    scaled: Floats = heights.astype(np.float64) * scale + offset
    return scaled


def metres_of(dataset: Any) -> tuple[float, float]:
    """Scale and offset that make metres of stored numbers: the file's own, times its unit's."""
    unit = height_unit_m(dataset)
    return float(dataset.scales[0]) * unit, float(dataset.offsets[0]) * unit


def read_heights(dataset: Any, window: Window, dtype: Any) -> Heights:
    """Read band 1 with NaN where the file (nodata, mask) or the number (not finite) has no height.

    The values are as stored, without the file's scale and offset.
    """
    heights: Heights | None = _read_plain(dataset, window, np.dtype(dtype))
    if heights is None:
        band = dataset.read(1, window=window, masked=True)
        heights = band.data.astype(dtype)
        heights[np.ma.getmaskarray(band) | ~np.isfinite(heights)] = np.nan
    return heights


def _read_plain(dataset: Any, window: Window, dtype: np.dtype[Any]) -> Heights | None:
    """Read floats whose only mark is a nodata value; None where GDAL's own mask is needed."""
    plain = dataset.mask_flag_enums[0] in ([MaskFlags.all_valid], [MaskFlags.nodata])
    if not plain or dataset.dtypes[0] != dtype.name:
        return None
    heights: NDArray[Any] = dataset.read(1, window=window)
    missing = ~np.isfinite(heights)
    nodata = dataset.nodata
    if nodata is not None and np.isfinite(nodata):
        slack = abs(nodata) * _NEAR_NODATA
        near = (heights >= nodata - slack) & (heights <= nodata + slack)
        if np.count_nonzero(near) != np.count_nonzero(heights == dtype.type(nodata)):
            return None
        missing |= near
    np.copyto(heights, np.nan, where=missing)
    return heights


def height_type(stored: str) -> type[np.float32] | type[np.float64]:
    """Return the narrowest type that holds heights stored in another without loss."""
    return np.float32 if stored in _NARROW else np.float64


def _with_gaps(heights: Floats, local: Floats) -> Floats:
    """Height at points (P, 2) of cells some of whose corners (P, 4) have none."""
    weights = np.abs(1.0 - CORNERS - local[:, None]).prod(axis=-1)
    # A neighbour of no weight is no neighbour: on the line between two pixels only they count.
    complete = ~(np.isnan(heights) & (weights > 0.0)).any(axis=-1)
    bilinear = (weights * np.where(weights > 0.0, heights, 0.0)).sum(axis=-1)
    return np.where(complete, bilinear, _nearest(heights, local))


def _nearest(heights: Floats, local: Floats) -> Floats:
    """Height of the nearest corner that has one, nearer than a pixel; the first of equals."""
    away = ((local[:, None] - CORNERS) ** 2).sum(axis=-1)
    away = np.where(np.isnan(heights) | (away >= 1.0), np.inf, away)
    pick = np.argmin(away, axis=-1)[:, None]
    found = np.isfinite(np.take_along_axis(away, pick, axis=-1))
    nearest: Floats = np.where(found, np.take_along_axis(heights, pick, axis=-1), np.nan)[:, 0]
    return nearest


def _window(info: RasterInfo, bounds: tuple[float, float, float, float] | None) -> Window:
    if bounds is None:
        return Window(0, 0, info.width, info.height)
    left, bottom, right, top = bounds
    box = np.array(((left, bottom), (left, top), (right, bottom), (right, top)))
    pixels = world_to_pixel(info.transform, box)
    size = (info.width, info.height)
    low = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, size)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size)
    if not (high > low).all():
        corners = pixel_to_world(info.transform, np.array((0.0, 0.0)) + np.array(size) * CORNERS)
        extent = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
        raise RasterError(
            f"bounds {bounds} miss the raster",
            where=info.path,
            expected=f"left, bottom, right, top that meet {extent}",
            fix="check that the bounds are in the raster's CRS",
        )
    return Window(*low.astype(int).tolist(), *(high - low).astype(int).tolist())


def _check_size(info: RasterInfo, window: Window, itemsize: int, limit_bytes: int) -> None:
    size = window.width * window.height * itemsize
    if size > limit_bytes:
        raise RasterError(
            f"heights of {window.width} x {window.height} px need {size / _GIB:.2f} GiB",
            where=info.path,
            expected=f"at most {limit_bytes / _GIB:.2f} GiB",
            fix="cut it to the photos (gdal_translate -projwin), or resample it (gdalwarp -tr)",
        )

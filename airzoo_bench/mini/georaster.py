"""The rasters of a world as GeoTIFF: the same bytes for the same pixels, quick to read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.io import MemoryFile

from airzoo_bench.geometry.rasters import opened
from airzoo_bench.mini.world import CRS, Region

__all__ = ["NODATA", "read_colours", "read_heights", "write_raster"]

NODATA = -9999.0


def write_raster(path: Path, pixels: NDArray[Any], region: Region) -> None:
    """Write a region's heights or colours with their place in `CRS`.

    Parameters
    ----------
    path : Path
    pixels : (H, W) float32 or (H, W, 3) uint8 array
        Heights, NaN where there is none (`NODATA` in the file); or colours. They cover the region,
        the first row in the north.
    region : Region

    Raises
    ------
    OSError
        It cannot be written.
    """
    bands = pixels[None] if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)
    heights = pixels.ndim == 2
    count, height, width = bands.shape
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "dtype": pixels.dtype.name,
        "crs": CRS,
        "transform": Affine(
            region.side_m / width, 0.0, region.west, 0.0, -region.side_m / height, region.north
        ),
        "interleave": "pixel",
    }
    profile |= {"nodata": NODATA} if heights else {"photometric": "RGB"}
    whole = np.where(np.isnan(bands), np.float32(NODATA), bands) if heights else bands
    # By way of memory: GDAL only logs a full disk, Python raises.
    with MemoryFile() as memory:
        with memory.open(count=count, height=height, width=width, **profile) as dataset:
            dataset.write(whole)
        path.write_bytes(memory.getbuffer())


def read_heights(path: Path) -> NDArray[np.float32]:
    """Read heights (H, W) as `write_raster` wrote them."""
    with opened(path) as dataset:
        heights: NDArray[np.float32] = dataset.read(1)
    heights[heights == np.float32(NODATA)] = np.nan
    return heights


def read_colours(path: Path) -> NDArray[np.uint8]:
    """Read colours (H, W, 3) as `write_raster` wrote them."""
    with opened(path) as dataset:
        return np.ascontiguousarray(np.moveaxis(dataset.read(), 0, -1))

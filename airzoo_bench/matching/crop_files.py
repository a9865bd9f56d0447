"""Reference crops as files: windows of map and surface model with their own georeference."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio import Affine
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.io import MemoryFile
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.frames import change_of_plane
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    opened,
    pixel_to_world,
    world_to_pixel,
)
from airzoo_bench.matching.crops import PixelWindow

__all__ = ["write_crop"]

_SIDE_POINTS = 33


def write_crop(
    dom_path: str | Path, dsm_path: str | Path, window: PixelWindow, folder: Path, name: str
) -> tuple[Path, Path]:
    """Write the crop of map and surface model, ``<name>_dom.tif`` and ``<name>_dsm.tif``.

    Each keeps its file's bands, numbers, nodata, mask, scale and CRS, and has its own geotransform.
    The crop of the surface model covers that of the map with a pixel to spare, so that the surface
    inside is that of the whole raster. The same inputs give the same bytes.

    Parameters
    ----------
    dom_path, dsm_path : str or Path
    window : (x, y, width, height)
        In whole pixels of the map, inside it.
    folder : Path
        Made where it is missing.
    name : str

    Returns
    -------
    tuple of Path
        The two files; each appears when it is complete.

    Raises
    ------
    RasterError
        The window is empty or reaches outside the map; the surface model does not meet it.
    UserError
        The files cannot be written.
    """
    dom, dsm = open_info(dom_path), open_info(dsm_path)
    x, y, width, height = window
    if min(x, y, width - 1, height - 1) < 0 or x + width > dom.width or y + height > dom.height:
        raise RasterError(
            f"window {window} (x, y, width, height) is not inside the map",
            where=dom.path,
            expected=f"a part of {dom.width} x {dom.height} px",
        )
    below = _window_below(window, dom, dsm)
    targets = folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"
    for path, part, target in zip((dom_path, dsm_path), (window, below), targets, strict=True):
        _copy(path, part, target)
    return targets


def _window_below(window: PixelWindow, dom: RasterInfo, dsm: RasterInfo) -> PixelWindow:
    """Window of the surface model that covers a window of the map, with a pixel to spare."""
    x, y, width, height = window
    share = np.linspace(0.0, 1.0, _SIDE_POINTS)
    # Sides bend between two CRS: many points of each.
    column, row = np.meshgrid(x + width * share, y + height * share)
    world = pixel_to_world(dom.transform, np.stack((column, row), axis=-1).reshape(-1, 2))
    pixels = world_to_pixel(dsm.transform, change_of_plane(dom.crs, dsm.crs)(world))
    size = (dsm.width, dsm.height)
    low = np.clip(np.floor(np.fmin.reduce(pixels)) - 1, 0, size)
    high = np.clip(np.ceil(np.fmax.reduce(pixels)) + 1, 0, size)
    if not (high > low).all():
        raise RasterError(
            f"the surface model does not meet the window {window} of the map",
            where=dsm.path,
            expected=f"a raster that covers {dom.path}",
        )
    first, second, third, fourth = (int(value) for value in (*low, *(high - low)))
    return first, second, third, fourth


def _copy(source: str | Path, window: PixelWindow, target: Path) -> None:
    """Write a window of a GeoTIFF as one of its own, whole or not at all."""
    x, y, width, height = window
    part = Window(x, y, width, height)
    # The mask goes into the file: one beside it would not be moved with it.
    with opened(source) as dataset, rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
        a, b, _, d, e, _ = dataset.transform[:6]
        c, f = pixel_to_world(dataset.transform, (x, y)).tolist()
        profile = {
            "driver": "GTiff",
            "width": width,
            "height": height,
            "count": dataset.count,
            "dtype": dataset.dtypes[0],
            "crs": dataset.crs,
            "transform": Affine(a, b, c, d, e, f),
            "nodata": dataset.nodata,
            "tiled": True,
            "blockxsize": 256,
            "blockysize": 256,
            "compress": "deflate",
            "bigtiff": "if_safer",
        }
        with MemoryFile() as memory:
            with memory.open(**profile) as crop:
                _fill(crop, dataset, part)
            with atomic_write(target) as stream:
                stream.write(memory.getbuffer())


def _fill(crop: Any, dataset: Any, part: Window) -> None:
    crop.colorinterp = dataset.colorinterp
    crop.scales, crop.offsets, crop.units = dataset.scales, dataset.offsets, dataset.units
    if ColorInterp.palette in dataset.colorinterp:
        crop.write_colormap(1, dataset.colormap(1))
    crop.write(dataset.read(window=part))
    if dataset.mask_flag_enums[0] == [MaskFlags.per_dataset]:
        crop.write_mask(dataset.dataset_mask(window=part))

"""Reference crops: the part of the map that a query is matched to, and its files."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.enums import ColorInterp, MaskFlags
from rasterio.io import MemoryFile
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.heightfield import HeightField, blocked_heights
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    opened,
    pixel_to_world,
    to_map_pixels,
    world_to_pixel,
)
from airzoo_bench.geometry.rays import (
    HeightAt,
    intersect_heightfield,
    meet_missing,
    nearest_heights,
)
from airzoo_bench.matching.settings import Crop

__all__ = [
    "CropStatus",
    "CropWindows",
    "PixelWindow",
    "crop_windows",
    "write_crop",
]

# A few hundred rays at a time: what they need of the DSM fits into the blocks kept.
_CAMERAS = 64
# Pixels are rounded to this before they are made whole, so that two builds of PROJ give one crop.
_DECIMALS = 6
# Along each side of a window that is taken to another CRS, where sides bend.
_SIDE_POINTS = 33

PixelWindow = tuple[int, int, int, int]


class CropStatus(IntEnum):
    """What became of a crop; the names are those of reports."""

    CROPPED = 0
    OFF_MAP = 1
    """The box around the corners' ground points misses the map."""
    NO_RAY = 2
    """No corner of the image has a ray, or none ends within the domain of the map's CRS."""


@dataclass(frozen=True, eq=False)
class CropWindows:
    """Windows of N queries in whole pixels of the map.

    Attributes
    ----------
    windows : (N, 4) int64 array
        Column and row of the first pixel, width, height; all zero where there is no crop.
    status : (N,) uint8 array
        CropStatus of each query.
    rays : (N, 4) uint8 array
        RayStatus of the image's corners: top left, top right, bottom right, bottom left. All but
        HIT and NO_RAY met a stand-in for missing heights, or were cut at the range.
    """

    windows: Ints
    status: NDArray[np.uint8]
    rays: NDArray[np.uint8]


def crop_windows(
    cameras: Cameras,
    priors: Poses,
    dom: RasterInfo,
    dsm: HeightField | str | Path,
    *,
    crop: Crop,
    plane_height_m: float,
) -> CropWindows:
    """Find the reference crop of each query (PROTOCOLS.md, track 2, "Crop")."""
    corners = _cast_corners(cameras, priors, dsm, crop, plane_height_m)
    pixels = to_map_pixels(corners.crs, dom)(corners.xy)
    low, high = np.fmin.reduce(pixels, axis=1), np.fmax.reduce(pixels, axis=1)
    grown = crop.margin * (high - low)
    blind = np.isnan(grown).any(axis=1)
    size = (dom.width, dom.height)
    first = np.floor(np.round(low - grown, _DECIMALS))
    # Rays of a level camera, all cut, end on one line: it has a pixel nevertheless.
    last = np.maximum(np.ceil(np.round(high + grown, _DECIMALS)), first + 1)
    first, last = np.clip(first, 0, size), np.clip(last, 0, size)
    found = (last > first).all(axis=1)
    windows = np.where(found[:, None], np.hstack((first, last - first)), 0).astype(np.int64)
    status = np.select((found, blind), (CropStatus.CROPPED, CropStatus.NO_RAY), CropStatus.OFF_MAP)
    return CropWindows(windows, status.astype(np.uint8), corners.rays)


@dataclass(frozen=True, eq=False)
class _Corners:
    """Horizontal position (N, 4, 2) where corner rays end, NaN without a ray; their RayStatus."""

    xy: Floats
    rays: NDArray[np.uint8]
    crs: Any


def _cast_corners(
    cameras: Cameras,
    priors: Poses,
    dsm: HeightField | str | Path,
    crop: Crop,
    plane_height_m: float,
) -> _Corners:
    if not isinstance(dsm, HeightField):
        with blocked_heights(dsm) as field:
            return _cast_corners(cameras, priors, field, crop, plane_height_m)
    directions = rays_to_world(priors, back_project(cameras, anchor_pixels(cameras, 0.0)))
    centres, far = priors.centres, crop.max_range_m
    ends = centres[:, None] + far * directions
    rays = np.empty(ends.shape[:2], np.uint8)
    height_at = _missing_heights(dsm, crop, plane_height_m)
    for start in range(0, len(cameras), _CAMERAS):
        part = slice(start, start + _CAMERAS)
        hits = intersect_heightfield(centres[part], directions[part], dsm, far)
        points = hits.points
        if height_at is not None:
            points = meet_missing(centres[part], directions[part], hits, dsm, height_at, far)
        ends[part] = np.where(np.isnan(points), ends[part], points)
        rays[part] = hits.status
    return _Corners(ends[..., :2], rays, dsm.crs)


def _missing_heights(dsm: HeightField, crop: Crop, plane_height_m: float) -> HeightAt | None:
    """Return the heights that stand in for those that the surface model lacks, where any do."""
    match crop.missing_heights:
        case "nearest":
            return nearest_heights(dsm, crop.nearest_of_px)
        case "plane":
            return lambda places: np.full(places.shape[:-1], plane_height_m)
        case "cut":
            return None


def write_crop(
    dom_path: str | Path, dsm_path: str | Path, window: PixelWindow, folder: Path, name: str
) -> tuple[Path, Path]:
    """Write the crop of map and surface model, ``<name>_dom.tif`` and ``<name>_dsm.tif``."""
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
    """Return the window of the surface model that covers a window of the map and a pixel more."""
    x, y, width, height = window
    share = np.linspace(0.0, 1.0, _SIDE_POINTS)
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
    # The mask goes into the file: a separate one would not be moved with it.
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

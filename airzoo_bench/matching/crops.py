"""Reference crops: the part of the map that a query is matched to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.blocks import blocked_heights
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.frames import change_of_plane
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rasters import RasterInfo, world_to_pixel
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
    "crop_to_map",
    "crop_windows",
    "map_to_crop",
]

# A few hundred rays at a time: what they need of the DSM fits into the blocks kept.
_CAMERAS = 64
# Pixels are rounded to this before they are made whole, so that two builds of PROJ give one crop.
_DECIMALS = 6

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
    x, y, width, height : (N,) int64 array
        Column and row of the first pixel, and size; all zero where there is no crop.
    status : (N,) uint8 array
        CropStatus of each query.
    rays : (N, 4) uint8 array
        RayStatus of the image's corners: top left, top right, bottom right, bottom left. All but
        HIT and NO_RAY met a stand-in for missing heights, or were cut at the range.
    """

    x: Ints
    y: Ints
    width: Ints
    height: Ints
    status: NDArray[np.uint8]
    rays: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.x)

    def window(self, index: int) -> PixelWindow:
        """Window (x, y, width, height) of one query."""
        sides = (self.x, self.y, self.width, self.height)
        x, y, width, height = (int(side[index]) for side in sides)
        return x, y, width, height


def crop_windows(
    cameras: Cameras,
    priors: Poses,
    dom: RasterInfo,
    dsm: HeightField | str | Path,
    *,
    crop: Crop,
    plane_height_m: float,
) -> CropWindows:
    """Find the reference crop of each query (PROTOCOLS.md, track 2, "Crop").

    The image's four corners are cast onto the surface model. A corner whose ray comes down where
    the model has no height, or past its edge, is met with a level plane, as `missing_heights` says
    (see `rays.meet_missing`). Any other that misses (above the horizon, too far) is cut
    at `max_range_m` along its ray, and counts with the horizontal position of that end. The box
    around the four, in the map's pixels, grows on each of its sides by `margin` times its length
    along that axis, is widened to whole pixels and cut to the map.

    Parameters
    ----------
    cameras, priors : Cameras, Poses
        Of the N queries; prior poses in the surface model's CRS.
    dom : RasterInfo
        The map, in any CRS.
    dsm : HeightField, str or Path
        The surface model, in a projected CRS in metres; of a file only the blocks that rays cross
        are kept, after one pass for its lowest and highest height. Both give the same crops.
    crop : Crop
        The protocol's. A margin of 0.1 lets a box of 100 m become one of 120 m.
    plane_height_m : float
        Height of the plane that `missing_heights = "plane"` asks for.

    Returns
    -------
    CropWindows

    Raises
    ------
    RasterError
        The surface model is not in metres, or cannot be read.
    """
    corners = _cast_corners(cameras, priors, dsm, crop, plane_height_m)
    pixels = world_to_pixel(dom.transform, change_of_plane(corners.crs, dom.crs)(corners.xy))
    low, high = np.fmin.reduce(pixels, axis=1), np.fmax.reduce(pixels, axis=1)
    grown = crop.margin * (high - low)
    blind = np.isnan(grown).any(axis=1)
    size = (dom.width, dom.height)
    first = np.floor(np.round(low - grown, _DECIMALS))
    # Rays of a level camera, all cut, end on one line: it has a pixel nevertheless.
    last = np.maximum(np.ceil(np.round(high + grown, _DECIMALS)), first + 1)
    first, last = np.clip(first, 0, size), np.clip(last, 0, size)
    found = (last > first).all(axis=1)
    x, y = np.where(found[:, None], first, 0).astype(np.int64).T
    width, height = np.where(found[:, None], last - first, 0).astype(np.int64).T
    status = np.select((found, blind), (CropStatus.CROPPED, CropStatus.NO_RAY), CropStatus.OFF_MAP)
    return CropWindows(x, y, width, height, status.astype(np.uint8), corners.rays)


def crop_to_map(xy: ArrayLike, window: PixelWindow) -> Floats:
    """Take pixels (..., 2) of a crop to pixels of the whole map; corners are (0, 0) in both."""
    return np.asarray(xy, dtype=np.float64) + window[:2]


def map_to_crop(xy: ArrayLike, window: PixelWindow) -> Floats:
    """Take pixels (..., 2) of the whole map to pixels of a crop; the inverse of `crop_to_map`."""
    return np.asarray(xy, dtype=np.float64) - window[:2]


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
    for part in _parts(len(cameras)):
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


def _parts(count: int) -> Iterator[slice]:
    for start in range(0, count, _CAMERAS):
        yield slice(start, start + _CAMERAS)

"""Making the truth of a scene for matching: which photos have a crop of the map, and its files."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rasterio
import rasterio.shutil
from numpy.typing import NDArray
from rasterio.io import MemoryFile

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import (
    PRIOR_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    with_unposed,
)
from airzoo_bench.core.errors import BenchmarkError, RasterError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.heightfield import HeightField, blocked_heights
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    opened,
    pixel_to_world,
    to_map_pixels,
    world_to_pixel,
)
from airzoo_bench.geometry.rays import NearestHeights, intersect_heightfield, meet_missing
from airzoo_bench.matching.checks import count_near
from airzoo_bench.matching.settings import Crop, Prior
from airzoo_bench.matching.truth import MatchingTruth, ReferenceMap, own_map, with_truth_as_prior

# No GPS and no gimbal is as good as this in half of the photos. A truth that went through EXIF and
# XMP comes back with the rounding of their digits: 3 mm, and up to 0.09 degrees where each of three
# angles has one decimal.
_SAME_M, _SAME_DEG = 0.02, 0.1
# A few hundred rays at a time: what they need of the DSM fits into the blocks kept.
_CAMERAS = 64
# Pixels are rounded to this before they are made whole, so that two builds of PROJ give one crop.
_DECIMALS = 6
# Along each side of a window that is taken to another CRS, where sides bend.
_SIDE_POINTS = 33

PixelWindow = tuple[int, int, int, int]


class CropStatus(StrEnum):
    """The end of a crop; its text is the reason why a photo is left out.

    NO_RAY is also for rays that all end beyond the domain of the map's CRS.
    """

    CROPPED = "cropped"
    NO_PRIOR = "no GPS position or gimbal angles in the metadata"
    NO_MAP = "no map of its own"
    OFF_MAP = "by the prior pose, it does not see the map"
    NO_RAY = "by the prior pose, no corner of the image has a ray"


def given_truth(inputs: SceneInputs, maps: Path) -> MatchingTruth:
    """Match each photo to the whole of its own map; those without one are left out."""
    files = [own_map(maps, photo) for photo in inputs.photos["id"]]
    there = np.array([dom.is_file() and dsm.is_file() for dom, dsm in files], np.bool_)
    found = tuple(
        ReferenceMap(open_info(files[row][0]), files[row][1], raster_sha256(files[row][1]))
        for row in np.flatnonzero(there)
    )
    windows = np.array([(0, 0, *one.size) for one in found], np.int64).reshape(-1, 4)
    queries = with_truth_as_prior(inputs.photos[there].reset_index(drop=True))
    excluded = _excluded(inputs, np.where(there, CropStatus.CROPPED, CropStatus.NO_MAP))
    return MatchingTruth(inputs.scene, queries, windows, found, excluded, own_maps=True)


def build_truth(inputs: SceneInputs, crop: Crop, prior: Prior) -> MatchingTruth:
    """Find the crop of each photo that has a prior; the others are left out, with the reason."""
    photos, scene = inputs.photos, inputs.scene
    dom, dsm = needed(inputs.dom, "map", scene), needed(inputs.dsm, "surface model", scene)
    if not prior.is_measured:
        photos = with_truth_as_prior(photos)
    there = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    queries = photos[there].reset_index(drop=True)
    cameras, priors = cameras_of(queries), poses_of(queries, PRIOR_COLUMNS)
    # Not number by number: a pose has two quaternions, and metadata are rounded. Not every photo:
    # one that was moved would hide all the others.
    same = count_near(poses_of(queries), priors, _SAME_M, _SAME_DEG)
    if prior.is_measured and 2 * same > len(queries):
        raise BenchmarkError(
            f"the prior poses equal the ground truth in {same} of {len(queries)} photos "
            f"(to {_SAME_M * 100:g} cm and {_SAME_DEG:g} degrees)",
            expected="priors from the photos' own metadata",
            fix="a protocol that means this says prior.source = 'truth'",
        )
    with blocked_heights(dsm) as field:
        windows, of_queries = crop_windows(cameras, priors, dom, field, crop)
    status = np.full(len(photos), CropStatus.NO_PRIOR, object)
    status[there], kept = of_queries, of_queries == CropStatus.CROPPED
    excluded = _excluded(inputs, status)
    maps = (ReferenceMap(dom, dsm, raster_sha256(dsm)),)
    return MatchingTruth(scene, queries[kept].reset_index(drop=True), windows[kept], maps, excluded)


def _excluded(inputs: SceneInputs, status: NDArray[Any]) -> pd.DataFrame:
    photos = inputs.photos[["id", "image"]].assign(reason=[str(one) for one in status])
    left_out = photos[photos["reason"] != CropStatus.CROPPED].reset_index(drop=True)
    return with_unposed(left_out, inputs)


def crop_windows(
    cameras: Cameras, priors: Poses, dom: RasterInfo, field: HeightField, crop: Crop
) -> tuple[Ints, NDArray[np.str_]]:
    """Find the reference crops of N queries (docs/protocols.md, "Crop").

    Returns windows (N, 4) in whole pixels of the map, x, y, width and height, zero where there is
    no crop; and the CropStatus (N,) of each.
    """
    # Rays of the image's corners end on the ground, or at the range.
    directions = rays_to_world(priors, back_project(cameras, anchor_pixels(cameras, 0.0)))
    centres, far = priors.centres, crop.max_range_m
    ends = centres[:, None] + far * directions
    height_at = NearestHeights(field, crop.nearest_of_px)
    for start in range(0, len(cameras), _CAMERAS):
        part = slice(start, start + _CAMERAS)
        hits = intersect_heightfield(centres[part], directions[part], field, far)
        points = meet_missing(centres[part], directions[part], hits, field, height_at, far)
        ends[part] = np.where(np.isnan(points), ends[part], points)
    pixels = to_map_pixels(field.crs, dom)(ends[..., :2])
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
    return windows, status


def write_crop(
    dom_path: str | Path, dsm_path: str | Path, window: PixelWindow, folder: Path, name: str
) -> tuple[Path, Path]:
    """Write the crop of map and surface model, ``<name>_dom.tif`` and ``<name>_dsm.tif``."""
    dom, dsm = open_info(dom_path), open_info(dsm_path)
    targets = folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"
    below = _window_below(window, dom, dsm)
    layout = {"tiled": True, "blockxsize": 256, "blockysize": 256, "bigtiff": "if_safer"}
    for source, part, target in zip((dom, dsm), (window, below), targets, strict=True):
        # The mask goes into the file: a separate one would not be moved with it.
        internal = rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True)
        with opened(source.path) as dataset, internal, MemoryFile() as memory:
            cut = f"vrt://{dataset.name}?srcwin={','.join(map(str, part))}"
            rasterio.shutil.copy(cut, memory.name, driver="GTiff", compress="deflate", **layout)
            with atomic_write(target) as stream:
                stream.write(memory.getbuffer())
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
        what = f"the surface model does not meet the window {window} of the map"
        raise RasterError(what, where=dsm.path, expected=f"a raster that covers {dom.path}")
    first, second, third, fourth = (int(value) for value in (*low, *(high - low)))
    return first, second, third, fourth

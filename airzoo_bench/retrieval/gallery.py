"""Cutting a georeferenced map into the tiles of a gallery."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.crs import describe_crs, geodesic_distance_m, to_lonlat, unwrapped
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, opened, pixel_to_world
from airzoo_bench.retrieval.footprints import polygon_areas
from airzoo_bench.retrieval.settings import MapGallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS, LONLAT_DECIMALS, boxes_of

_STRIP = 1024  # rows of a mask that are read at a time, at most


def tile_starts(length: int, size: int, overlap: float) -> Ints:
    """Return where tiles begin along one axis of the map."""
    stride = max(1, math.floor(size * (1 - overlap) + 0.5))
    last = max(0, length - size)
    starts = np.arange(0, last + 1, stride)
    return starts if starts[-1] == last else np.append(starts, last)


def cut_gallery(info: RasterInfo, gallery: MapGallery, scene: str) -> pd.DataFrame:
    """Cut a map into tiles, as windows."""
    found = gsd_m(info)
    if gallery.gsd_m != "any":
        off = max(abs(axis / gallery.gsd_m - 1) for axis in found)
        if off > gallery.gsd_tolerance:
            raise RasterError(
                f"has {found[0]:.3f} x {found[1]:.3f} m per pixel on the ground",
                where=info.path,
                expected=f"{gallery.gsd_m} m, give or take {gallery.gsd_tolerance:.0%}",
                fix="resample the map (gdalwarp -tr), or choose a protocol of this resolution",
            )
    parts = [_cut_scale(info, size, gallery.overlap, scene) for size in gallery.tile_sizes_px]
    tiles = pd.concat(parts).sort_values("id", ignore_index=True)
    return tiles.assign(valid_share=valid_shares(info.path, windows_of(tiles)))


def windows_of(tiles: pd.DataFrame) -> Ints:
    """Return the windows (G, 4) of tiles in the map: left, top, right, bottom in pixels."""
    x, y, width, height = tiles[["x", "y", "width", "height"]].to_numpy(np.int64).T
    return np.stack([x, y, x + width, y + height], axis=1)


def middle_lon(info: RasterInfo) -> float:
    """Return the longitude of the map's middle, which longitudes are unwrapped about."""
    centre = np.array((info.width / 2.0, info.height / 2.0))
    return float(to_lonlat(info.crs, pixel_to_world(info.transform, centre))[0])


def box_growth(info: RasterInfo, tiles: pd.DataFrame) -> float:
    """Return by how much boxes are larger than their tiles, as a share of the tiles' area."""
    ring = _ring(info, windows_of(tiles))[:, [0, 2, 7, 5]]
    west, south, east, north = boxes_of(tiles).T
    areas = (east - west) * (north - south)
    return float(areas.sum() / polygon_areas(ring).sum() - 1)


def _cut_scale(info: RasterInfo, size: int, overlap: float, scene: str) -> pd.DataFrame:
    columns = tile_starts(info.width, size, overlap)
    rows = tile_starts(info.height, size, overlap)
    row, column = (index.ravel() for index in np.indices((len(rows), len(columns))))
    tiles = pd.DataFrame({"id": "", "size_px": size, "x": columns[column], "y": rows[row]})
    tiles["id"] = [f"{scene}/{size}_{r:05d}_{c:05d}" for r, c in zip(row, column, strict=True)]
    tiles["width"] = np.minimum(size, info.width - tiles["x"])
    tiles["height"] = np.minimum(size, info.height - tiles["y"])
    ring = _ring(info, windows_of(tiles))
    boxes = np.round(np.concatenate([ring.min(axis=1), ring.max(axis=1)], axis=1), LONLAT_DECIMALS)
    width = geodesic_distance_m(ring[:, 3], ring[:, 4])
    height = geodesic_distance_m(ring[:, 1], ring[:, 6])
    sides = np.round((width + height) / 2, 3)  # to the millimetre
    return tiles.assign(size_m=sides, **dict(zip(BOX_COLUMNS, boxes.T, strict=True)))


def _ring(info: RasterInfo, windows: Ints) -> Floats:
    """Return lon, lat (G, 8, 2) of the corners of tiles and of the middles of their sides."""
    right = np.array([0, 0.5, 1, 0, 1, 0, 0.5, 1])
    down = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1])
    x0, y0, x1, y1 = windows.T[:, :, None].astype(np.float64)
    pixels = np.stack([x0 + (x1 - x0) * right, y0 + (y1 - y0) * down], axis=-1)
    lonlat = to_lonlat(info.crs, pixel_to_world(info.transform, pixels))
    ring = unwrapped(lonlat, middle_lon(info))
    if not (np.abs(ring[..., 1]) <= 90).all():  # also tells NaN
        raise RasterError(
            "reaches places that are not on the earth",
            where=info.path,
            expected=f"coordinates that {describe_crs(info.crs)} is defined for",
            fix="look at the geotransform and the CRS of the map, or cut it",
        )
    return ring


def valid_shares(path: Path, windows: Ints) -> Floats:
    """Return the share of valid pixels of windows (n, 4) of a raster, exactly."""
    left, top, right, bottom = windows.T
    with opened(path) as dataset:
        if all(flags == [MaskFlags.all_valid] for flags in dataset.mask_flag_enums):
            return np.ones(len(windows))
        height, width = dataset.shape
        columns = np.unique(np.concatenate([left, right, [0, width]]))
        rows = np.unique(np.concatenate([top, bottom, np.arange(0, height, _STRIP), [height]]))
        # Pixels between two cuts, summed up to each cut: four look-ups then count any window.
        sums = np.zeros((len(rows), len(columns)), np.int64)
        for number, (start, stop) in enumerate(pairwise(rows.tolist()), start=1):
            mask = dataset.dataset_mask(window=Window(0, start, width, stop - start)) > 0
            counts = np.count_nonzero(mask, axis=0)
            sums[number, 1:] = np.add.reduceat(counts, columns[:-1])
    sums = sums.cumsum(axis=0).cumsum(axis=1)
    x0, x1 = np.searchsorted(columns, left), np.searchsorted(columns, right)
    y0, y1 = np.searchsorted(rows, top), np.searchsorted(rows, bottom)
    valid = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
    return np.asarray(valid / ((right - left) * (bottom - top)))

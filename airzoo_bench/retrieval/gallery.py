"""Cutting a georeferenced map into the tiles of a gallery."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import describe_crs, geodesic_distance_m, to_lonlat, unwrapped
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, opened, pixel_to_world
from airzoo_bench.retrieval.footprints import box_areas, polygon_areas
from airzoo_bench.retrieval.settings import Gallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS, LONLAT_DECIMALS

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "box_growth",
    "check_gsd",
    "cut_gallery",
    "middle_lon",
    "tile_starts",
    "valid_shares",
    "windows_of",
]

_SIDE_PX = 4096  # of the part of a mask that is read at a time


def tile_starts(length: int, size: int, overlap: float) -> Ints:
    """Return where tiles begin along one axis of the map."""
    stride = max(1, math.floor(size * (1 - overlap) + 0.5))
    last = max(0, length - size)
    starts = np.arange(0, last + 1, stride)
    return starts if starts[-1] == last else np.append(starts, last)


def cut_gallery(info: RasterInfo, gallery: Gallery, scene: str) -> pd.DataFrame:
    """Cut a map into tiles, as windows."""
    import pandas as pd

    check_gsd(info, gallery)
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
    boxes = tiles[list(BOX_COLUMNS)].to_numpy(np.float64)
    return float(box_areas(boxes).sum() / polygon_areas(ring).sum() - 1)


def check_gsd(info: RasterInfo, gallery: Gallery) -> None:
    """Compare the map's ground sampling distance with the protocol's, on both axes."""
    if gallery.gsd_m == "any":
        return
    found = gsd_m(info)
    off = max(abs(axis / gallery.gsd_m - 1) for axis in found)
    if off > gallery.gsd_tolerance:
        raise RasterError(
            f"has {found[0]:.3f} x {found[1]:.3f} m per pixel on the ground",
            where=info.path,
            expected=f"{gallery.gsd_m} m, give or take {gallery.gsd_tolerance:.0%}",
            fix="resample the map (gdalwarp -tr), or choose a protocol of this resolution",
        )


def _cut_scale(info: RasterInfo, size: int, overlap: float, scene: str) -> pd.DataFrame:
    import pandas as pd

    columns = tile_starts(info.width, size, overlap)
    rows = tile_starts(info.height, size, overlap)
    row, column = (index.ravel() for index in np.indices((len(rows), len(columns))))
    x, y = columns[column], rows[row]
    width, height = np.minimum(size, info.width - x), np.minimum(size, info.height - y)
    tiles = pd.DataFrame(
        {
            "id": [f"{scene}/{size}_{r:05d}_{c:05d}" for r, c in zip(row, column, strict=True)],
            "size_px": size,
            "x": x,
            "y": y,
            "width": width,
            "height": height,
        }
    )
    ring = _ring(info, windows_of(tiles))
    boxes = np.round(np.concatenate([ring.min(axis=1), ring.max(axis=1)], axis=1), LONLAT_DECIMALS)
    return tiles.assign(size_m=_sides(ring), **dict(zip(BOX_COLUMNS, boxes.T, strict=True)))


def _sides(ring: Floats) -> Floats:
    """Return the mean of a tile's width and height on the ground, to the millimetre."""
    width = geodesic_distance_m(ring[:, 3], ring[:, 4])
    height = geodesic_distance_m(ring[:, 1], ring[:, 6])
    return np.round((width + height) / 2, 3)


def _ring(info: RasterInfo, windows: Ints) -> Floats:
    """Return lon, lat (G, 8, 2) of the corners of tiles and of the middles of their sides."""
    right = np.array([0, 0.5, 1, 0, 1, 0, 0.5, 1])
    down = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1])
    x0, y0, x1, y1 = windows.T[:, :, None].astype(np.float64)
    pixels = np.stack([x0 + (x1 - x0) * right, y0 + (y1 - y0) * down], axis=-1)
    lonlat = to_lonlat(info.crs, pixel_to_world(info.transform, pixels))
    ring = unwrapped(lonlat, middle_lon(info))
    _check_on_earth(info, ring)
    return ring


def _check_on_earth(info: RasterInfo, ring: Floats) -> None:
    """Refuse maps that no box in degrees describes."""
    latitudes = ring[..., 1]
    if not (np.abs(latitudes) <= 90).all():  # also tells NaN
        raise RasterError(
            "reaches places that are not on the earth",
            where=info.path,
            expected=f"coordinates that {describe_crs(info.crs)} is defined for, latitudes from "
            "-90 to 90",
            fix="look at the geotransform and the CRS of the map, or cut it",
        )
    if (np.ptp(ring[..., 0], axis=1) >= 180).any():
        raise RasterError(
            "holds a pole, or tiles half as wide as the earth: no box in degrees describes them",
            where=info.path,
            expected="a map without a pole",
            fix="cut the map so that the pole is outside",
        )


def valid_shares(path: Path, windows: Ints) -> Floats:
    """Share of valid pixels of windows of a raster, exactly."""
    left, top, right, bottom = windows.T
    with opened(path) as dataset:
        if all(flags == [MaskFlags.all_valid] for flags in dataset.mask_flag_enums):
            return np.ones(len(windows))
        columns = np.unique(np.concatenate([left, right, [0, dataset.width]]))
        rows = np.unique(np.concatenate([top, bottom, [0, dataset.height]]))
        cells = np.zeros((len(rows), len(columns)), np.int64)
        for column, row, mask in _masks(dataset):
            _count_into(cells, mask, row - rows, column - columns)
    # The cells between cuts, summed up to each cut: four look-ups then count any window.
    sums = np.zeros((len(rows) + 1, len(columns) + 1), np.int64)
    sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    x0, x1 = np.searchsorted(columns, left), np.searchsorted(columns, right)
    y0, y1 = np.searchsorted(rows, top), np.searchsorted(rows, bottom)
    valid = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
    shares: Floats = valid / ((right - left) * (bottom - top))
    return shares


def _masks(dataset: Any) -> Iterator[tuple[int, int, Bools]]:
    """Give (column, row, validity) of parts that together are all of the raster that is stored."""
    stored, (block_height, block_width) = _stored_blocks(dataset), dataset.block_shapes[0]
    for row in range(0, dataset.height, _SIDE_PX):
        for column in range(0, dataset.width, _SIDE_PX):
            width = min(_SIDE_PX, dataset.width - column)
            height = min(_SIDE_PX, dataset.height - row)
            blocks = stored[
                row // block_height : -(-(row + height) // block_height),
                column // block_width : -(-(column + width) // block_width),
            ]
            if not blocks.any():
                continue
            mask = dataset.dataset_mask(window=Window(column, row, width, height))
            yield column, row, mask > 0


def _stored_blocks(dataset: Any) -> Bools:
    """Which blocks (rows, columns) may have a valid pixel: a sparse GeoTIFF leaves out empty ones.

    What is left out reads as the nodata value, without one as 0, also in an alpha band.
    """
    height, width = dataset.block_shapes[0]
    blocks = np.ones((-(-dataset.height // height), -(-dataset.width // width)), dtype=bool)
    flags = dataset.mask_flag_enums
    by_nodata = all(MaskFlags.nodata in band for band in flags)
    by_alpha = MaskFlags.alpha in flags[0] and not dataset.nodata
    if dataset.driver != "GTiff" or not (by_nodata or by_alpha):
        return blocks
    for (row, column), _ in np.ndenumerate(blocks):
        item = f"BLOCK_OFFSET_{column}_{row}"
        places = (dataset.get_tag_item(item, "TIFF", bidx=band) for band in dataset.indexes)
        blocks[row, column] = any(place is not None for place in places)
    return blocks


def _count_into(cells: Ints, mask: Bools, below: Ints, right_of: Ints) -> None:
    """Add the valid pixels of a part to the cells that it meets."""
    y, starts = _cuts(below, mask.shape[0])
    counts = np.add.reduceat(mask, starts, axis=0, dtype=np.int64)
    x, starts = _cuts(right_of, mask.shape[1])
    cells[np.ix_(y, x)] += np.add.reduceat(counts, starts, axis=1)


def _cuts(beyond: Ints, length: int) -> tuple[Ints, Ints]:
    """Return the cells that a run of `length` pixels meets, and where in it each begins."""
    first = int(np.searchsorted(-beyond, 0, side="right")) - 1
    cells = np.arange(first, int(np.searchsorted(-beyond, length, side="left")))
    return cells, np.maximum(-beyond[cells], 0)

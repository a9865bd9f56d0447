"""Cutting a georeferenced map into the tiles of a gallery."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import RasterError
from airzoo_bench.geometry.frames import geodesic_distance_m, to_lonlat
from airzoo_bench.geometry.grids import pixel_to_world
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m
from airzoo_bench.retrieval.settings import Gallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["LONLAT_DECIMALS", "check_gsd", "cut_gallery", "tile_starts"]

LONLAT_DECIMALS = 9
"""Degrees are kept to 0.1 mm, so that two builds of PROJ give the same truth."""


def tile_starts(length: int, size: int, overlap: float) -> NDArray[np.int64]:
    """Return where tiles begin along one axis of the map.

    Parameters
    ----------
    length : int
        Pixels of the map along the axis.
    size : int
        Pixels of a tile.
    overlap : float
        Share of a tile that the next one covers again, in [0, 1).

    Returns
    -------
    (n,) int64
        Ascending; the last tile is anchored to the map's edge. A map shorter than a tile gets one
        tile, which is then as short as the map.
    """
    stride = max(1, round(size * (1 - overlap)))
    last = max(0, length - size)
    starts = np.arange(0, last + 1, stride)
    return starts if starts[-1] == last else np.append(starts, last)


def cut_gallery(info: RasterInfo, gallery: Gallery, scene: str) -> pd.DataFrame:
    """Cut a map into tiles, as windows.

    Parameters
    ----------
    info : RasterInfo
        The map: projected, geographic or web-mercator.
    gallery : Gallery
        Tile sizes, overlap and the resolution that the map must have.
    scene : str
        The scene's id, which begins every tile's id.

    Returns
    -------
    DataFrame
        Sorted by ``id`` (``scene/size_row_column``), with the window in pixels (``x``, ``y``,
        ``width``, ``height``) and the box in degrees.

    Raises
    ------
    RasterError
        The map's resolution is not the protocol's.
    """
    import pandas as pd

    check_gsd(info, gallery)
    parts = [_cut_scale(info, size, gallery.overlap, scene) for size in gallery.tile_sizes_px]
    return pd.concat(parts).sort_values("id", ignore_index=True)


def check_gsd(info: RasterInfo, gallery: Gallery) -> None:
    """Hold the map's ground sampling distance to the protocol's, on both axes.

    Raises
    ------
    RasterError
        It is off by more than the protocol's tolerance.
    """
    if gallery.gsd_m == "any":
        return
    found = gsd_m(info)
    off = max(abs(axis / gallery.gsd_m - 1) for axis in found)
    if off > gallery.gsd_tolerance:
        raise RasterError(
            f"has {found[0]:.3f} x {found[1]:.3f} m per pixel on the ground",
            where=info.path,
            expected=f"{gallery.gsd_m} m, give or take {gallery.gsd_tolerance:.0%}",
            mend="resample the map (gdalwarp -tr), or choose a protocol of this resolution",
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
    boxes = _boxes(info, x, y, width, height)
    return tiles.assign(size_m=_sides(boxes), **dict(zip(BOX_COLUMNS, boxes.T, strict=True)))


def _sides(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of a box's width and height on the ground, to the millimetre."""
    west, east = boxes[:, [0, 1]], boxes[:, [2, 1]]
    north = boxes[:, [0, 3]]
    return np.round((geodesic_distance_m(west, east) + geodesic_distance_m(west, north)) / 2, 3)


def _boxes(
    info: RasterInfo,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
) -> NDArray[np.float64]:
    # Corners and the middles of the sides: a straight side in a projection bends in degrees.
    right = np.array([0, 0.5, 1, 0, 1, 0, 0.5, 1])
    down = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1])
    pixels = np.stack(
        [x[:, None] + width[:, None] * right, y[:, None] + height[:, None] * down], axis=-1
    )
    lonlat = to_lonlat(info.crs, pixel_to_world(info.transform, pixels))
    boxes = np.concatenate([lonlat.min(axis=1), lonlat.max(axis=1)], axis=1)
    return np.round(boxes, LONLAT_DECIMALS)

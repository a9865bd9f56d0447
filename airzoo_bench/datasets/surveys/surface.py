"""A surface model gridded from clouds, where a survey has no other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from rasterio import Affine

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import atomic_write, fingerprint, sha256_of
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.geometry.arrays import Floats

__all__ = ["GriddedSurface", "grid_surface"]

_NODATA = -9999.0
_MOST_CELLS = 1 << 27
_POINTS_A_TIME = 1 << 20
_MEMORY_BYTES = 1 << 30
_POINTS_A_CELL = 4
_STEP_M = 0.05
_VERSION = 1


class GriddedSurface(NamedTuple):
    """A surface model that was made.

    `disagreement_m` is the median difference of heights in cells that two clouds share.
    """

    path: Path
    cell_m: float
    disagreement_m: float | None


def grid_surface(
    clouds: Sequence[Path], crs: CRS, folder: Path, cell_m: float | None
) -> GriddedSurface:
    """Grid clouds: the highest point of each cell, nothing where a cell has none."""
    opened = [open_cloud(path, limit_bytes=_MEMORY_BYTES, sampling=None) for path in clouds]
    boxes = [_box(cloud) for cloud in opened]
    cell = cell_m or max(map(_cell, opened, boxes))
    low = np.floor(np.min([box[0] for box in boxes], axis=0) / cell)
    high = np.floor(np.max([box[1] for box in boxes], axis=0) / cell) + 1
    columns, rows = (high - low).astype(int).tolist()
    if columns * rows > _MOST_CELLS:
        raise BenchmarkError(
            f"a surface of {columns} x {rows} cells of {cell:g} m is too large",
            where=clouds[0],
            expected=f"at most {_MOST_CELLS:,} cells",
            fix="give a larger --surface-cell, or a surface model (--dsm)",
        )
    origin = np.array((low[0], high[1])) * cell
    surface = np.full((rows, columns), np.nan, np.float32)
    shared: list[NDArray[np.float32]] = []
    for cloud in opened:
        grid = _highest(cloud, origin, surface.shape, cell)
        both = np.isfinite(grid) & np.isfinite(surface)
        shared.append(np.abs(grid[both] - surface[both]))
        surface = np.fmax(surface, grid)
    key = fingerprint([[sha256_of(path) for path in clouds], cell, crs.to_wkt(), _VERSION])[:16]
    path = folder / f"surface-{key}.tif"
    if not path.is_file():
        _write(path, surface, Affine(cell, 0, origin[0], 0, -cell, origin[1]), crs)
    apart = np.concatenate(shared)
    return GriddedSurface(path, cell, float(np.median(apart)) if apart.size else None)


def _box(cloud: FileCloud) -> Floats:
    """Return (x, y) of the least and largest, (2, 2)."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for piece in cloud.pieces(_POINTS_A_TIME):
        xy = piece.points[np.isfinite(piece.points).all(axis=1), :2]
        low = np.minimum(low, xy.min(axis=0, initial=np.inf))
        high = np.maximum(high, xy.max(axis=0, initial=-np.inf))
    if not (high > low).all():
        raise BenchmarkError("has no points that span an area", where=cloud.path)
    return np.array((low, high))


def _cell(cloud: FileCloud, box: Floats) -> float:
    """Return the side of a cell that holds four points on average."""
    area = float(np.prod(box[1] - box[0]))
    return _STEP_M * math.ceil(math.sqrt(_POINTS_A_CELL * area / cloud.count) / _STEP_M)


def _highest(
    cloud: FileCloud, origin: Floats, shape: tuple[int, ...], cell: float
) -> NDArray[np.float32]:
    grid = np.full(shape, -np.inf, np.float32)
    for piece in cloud.pieces(_POINTS_A_TIME):
        points = piece.points[np.isfinite(piece.points).all(axis=1)]
        column = ((points[:, 0] - origin[0]) // cell).astype(np.int64)
        row = ((origin[1] - points[:, 1]) // cell).astype(np.int64)
        cells = np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)
        np.maximum.at(grid, cells, points[:, 2].astype(np.float32))
    grid[np.isneginf(grid)] = np.nan
    return grid


def _write(path: Path, grid: NDArray[np.float32], transform: Affine, crs: CRS) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        atomic_write(path) as stream,
        rasterio.open(
            stream,
            "w",
            driver="GTiff",
            dtype="float32",
            count=1,
            nodata=_NODATA,
            height=grid.shape[0],
            width=grid.shape[1],
            crs=crs.to_wkt(),
            transform=transform,
            compress="deflate",
            predictor=3,
            tiled=True,
            bigtiff="if_safer",
        ) as raster,
    ):
        raster.write(np.where(np.isnan(grid), np.float32(_NODATA), grid), 1)

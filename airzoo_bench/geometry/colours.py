"""Colours of rasters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import ColorInterp, Resampling
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.rasters import opened

__all__ = ["read_rgb"]


def read_rgb(
    path: str | Path,
    window: tuple[int, int, int, int] | None = None,
    *,
    long_side_px: int | None = None,
) -> NDArray[np.uint8]:
    """Read colours: grey is repeated, alpha dropped."""
    with opened(path) as dataset:
        column, row, width, height = window or (0, 0, dataset.width, dataset.height)
        inside = column >= 0 and row >= 0 and width > 0 and height > 0
        if not inside or column + width > dataset.width or row + height > dataset.height:
            raise RasterError(
                f"window {window} (column, row, width, height) is not inside the raster",
                where=path,
                expected=f"a part of {dataset.width} x {dataset.height} px",
            )
        bands = _rgb_bands(dataset, path)
        scale = min(1.0, (long_side_px or max(width, height)) / max(width, height))
        pixels = dataset.read(
            bands,
            window=Window(column, row, width, height),
            out_shape=(3, max(1, round(height * scale)), max(1, round(width * scale))),
            resampling=Resampling.average,
        )
    return np.ascontiguousarray(np.moveaxis(pixels, 0, -1))


def _rgb_bands(dataset: Any, path: str | Path) -> list[int]:
    kinds = list(dataset.colorinterp)
    rgb = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    if all(kind in kinds for kind in rgb):
        bands = [kinds.index(kind) + 1 for kind in rgb]
    elif len(kinds) <= 2 and ColorInterp.palette not in kinds:
        bands = [1, 1, 1]
    elif len(kinds) in (3, 4):
        bands = [1, 2, 3]
    else:
        raise RasterError(
            f"no colours: {len(kinds)} bands ({', '.join(kind.name for kind in kinds)})",
            where=path,
            expected="grey or RGB, with or without alpha",
            fix="gdal_translate -b for the bands, -expand rgb for a palette",
        )
    dtypes = {dataset.dtypes[band - 1] for band in bands}
    if dtypes != {"uint8"}:
        raise RasterError(
            f"colours are {', '.join(sorted(dtypes))}",
            where=path,
            expected="8 bit (uint8)",
            fix="gdal_translate -ot Byte -scale",
        )
    return bands

"""Georeferenced rasters: what a GeoTIFF says of itself, its grid, its colours.

In pixel coordinates column comes before row; the raster's corner is (0, 0), the centre of its
first pixel (0.5, 0.5). A transform is an affine.Affine or a sequence (a, b, c, d, e, f):
x = a column + b row + c, y = d column + e row + f.

What rasterio or GDAL makes of a bad file becomes one RasterError.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import (
    describe_crs,
    geodesic_distance_m,
    horizontal_crs,
    to_lonlat,
)

__all__ = [
    "RasterInfo",
    "gsd_m",
    "open_info",
    "opened",
    "pixel_to_world",
    "read_rgb",
    "world_to_pixel",
    "world_to_pixel_steps",
]


@dataclass(frozen=True)
class RasterInfo:
    """What a georeferenced raster says of itself.

    Attributes
    ----------
    width, height : int
        Pixels.
    transform : affine.Affine
        Pixel (column, row; corner at 0, 0) to coordinates of `crs`.
    nodata : float or None
        As the file says; may be NaN.
    bands : int
        How many.
    dtype : str
        Of the first band, such as ``"float32"``.
    """

    path: Path
    width: int
    height: int
    transform: Any
    crs: CRS
    nodata: float | None
    bands: int
    dtype: str


def open_info(path: str | Path) -> RasterInfo:
    """Read what a georeferenced raster says of itself.

    Raises
    ------
    RasterError
        The file is missing or not a raster, or has no CRS, no geotransform, or one that cannot be
        inverted. Rotated and sheared geotransforms are taken.
    """
    with opened(path) as dataset:
        return RasterInfo(
            path=Path(path),
            width=dataset.width,
            height=dataset.height,
            transform=_georeference(dataset, path),
            crs=_crs(dataset, path),
            nodata=dataset.nodata,
            bands=dataset.count,
            dtype=dataset.dtypes[0],
        )


@contextmanager
def opened(path: str | Path) -> Iterator[Any]:
    """Open a raster for reading; yields rasterio's dataset.

    Raises
    ------
    RasterError
        The file is missing, not a raster, or cannot be read (truncated); also inside the block.
    """
    if not Path(path).is_file():
        raise RasterError("no such file", where=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            dataset = rasterio.open(path)
        with dataset:
            yield dataset
    except (RasterioError, CRSError) as error:
        raise RasterError(
            f"cannot be read as a raster: {error}",
            where=path,
            expected="a complete file that GDAL reads, such as GeoTIFF",
        ) from error


def pixel_to_world(transform: Any, colrow: ArrayLike) -> Floats:
    """Take pixel coordinates to the raster's CRS.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    colrow : (..., 2) array
        Continuous; (0.5, 0.5) is the centre of the first pixel.

    Returns
    -------
    (..., 2) array
        x before y.
    """
    a, b, c, d, e, f = transform[:6]
    points = np.asarray(colrow, dtype=np.float64)
    column, row = points[..., 0], points[..., 1]
    return np.stack((a * column + b * row + c, d * column + e * row + f), axis=-1)


def world_to_pixel(transform: Any, xy: ArrayLike) -> Floats:
    """Take coordinates (..., 2) of the raster's CRS to pixels; the inverse of `pixel_to_world`.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    xy : (..., 2) array
        x before y.

    Returns
    -------
    (..., 2) array
        Column and row, continuous.
    """
    _, _, c, _, _, f = transform[:6]
    # The origin goes first: carried through the inverse, its millions of metres cost digits.
    return world_to_pixel_steps(transform, np.asarray(xy, dtype=np.float64) - (c, f))


def world_to_pixel_steps(transform: Any, steps: Floats) -> Floats:
    """Take differences (..., 2) of world coordinates to differences in pixels.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    steps : (..., 2) array
        x before y.

    Returns
    -------
    (..., 2) array
        Columns and rows.
    """
    a, b, _, d, e, _ = transform[:6]
    x, y = steps[..., 0], steps[..., 1]
    determinant = a * e - b * d
    return np.stack(((e * x - b * y) / determinant, (a * y - d * x) / determinant), axis=-1)


def gsd_m(info: RasterInfo) -> tuple[float, float]:
    """Ground sampling distance at the raster's centre, in metres: between columns, between rows.

    The geodesic on WGS84 across one column and one row: true ground metres, also where the CRS is
    in degrees or stretches the ground as web Mercator does.

    Raises
    ------
    RasterError
        The centre lies outside the domain of the CRS.
    """
    centre = np.array((info.width / 2.0, info.height / 2.0))
    steps = np.array(((-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5)))
    ends = to_lonlat(info.crs, pixel_to_world(info.transform, centre + steps))
    x, y = (float(value) for value in geodesic_distance_m(ends[::2], ends[1::2]))
    if not (x > 0.0 and y > 0.0):
        raise RasterError(
            f"its centre is no place on the earth in {describe_crs(info.crs)}",
            where=info.path,
            fix="check the geotransform and the CRS of the file",
        )
    return x, y


def read_rgb(
    path: str | Path,
    window: tuple[int, int, int, int] | None = None,
    *,
    long_side_px: int | None = None,
) -> NDArray[np.uint8]:
    """Read colours: grey is repeated, alpha dropped.

    Parameters
    ----------
    path : str or Path
    window : (column, row, width, height), optional
        In whole pixels; all of the raster where left out.
    long_side_px : int, optional
        Averaged down so far that the longer side is no longer than this.

    Returns
    -------
    (height, width, 3) uint8 array
        The bands that the file calls red, green and blue; otherwise the first three.

    Raises
    ------
    RasterError
        Not 8 bit; a palette; more than four bands of which none are called red, green and blue; a
        window that is empty or reaches outside; see also `opened`.
    """
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


def _georeference(dataset: Any, path: str | Path) -> Any:
    transform = dataset.transform
    if transform.is_identity or dataset.crs is None:
        missing = "no geotransform" if transform.is_identity else "no CRS"
        raise RasterError(
            f"no georeference: {missing}",
            where=path,
            expected="a raster with a CRS and a geotransform",
            fix="gdal_translate -a_srs and -a_ullr, or export it as GeoTIFF again",
        )
    if not (np.isfinite(transform[:6]).all() and transform.determinant != 0.0):
        raise RasterError(
            f"its geotransform {tuple(transform[:6])} cannot be inverted",
            where=path,
            expected="pixels with an area",
        )
    return transform


def _crs(dataset: Any, path: str | Path) -> CRS:
    wkt = dataset.crs.to_wkt()
    try:
        horizontal_crs(wkt)
    except UserError as error:
        raise RasterError(error.what, where=path, expected=error.expected) from error
    return CRS.from_wkt(wkt)

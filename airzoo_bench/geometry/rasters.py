"""Georeferenced rasters: what a GeoTIFF says of itself, and its grid.

In pixel coordinates column comes before row; the raster's corner is (0, 0), the centre of its
first pixel (0.5, 0.5). A transform is an affine.Affine or a sequence (a, b, c, d, e, f):
x = a column + b row + c, y = d column + e row + f.

What rasterio or GDAL makes of a bad file becomes one RasterError.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import ArrayLike
from pyproj import CRS
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.frames import geodesic_distance_m, to_lonlat
from airzoo_bench.storage.rasters import Pointer, pointed, pointer_at

__all__ = [
    "RasterInfo",
    "gsd_m",
    "open_info",
    "opened",
    "pixel_to_world",
    "world_to_pixel",
    "world_to_pixel_steps",
]


# What an environment may have set otherwise, and no checksum shows: where the pixels of a GeoTIFF
# lie, and whether damaged ones are zeros.
_FIXED = {
    "GTIFF_POINT_GEO_IGNORE": "FALSE",
    "GTIFF_HONOUR_NEGATIVE_SCALEY": "FALSE",
    "GTIFF_IGNORE_READ_ERRORS": "FALSE",
}


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
    """Read what a georeferenced raster says of itself."""
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
def opened(path: str | Path, **settings: str) -> Iterator[Any]:
    """Open a raster for reading; yields rasterio's dataset."""
    if not pointed(Path(path)).is_file():
        raise RasterError("no such file", where=path)
    pointer = pointer_at(Path(path))
    settings = _FIXED | ({} if pointer is None else pointer.settings()) | settings
    if pointer is not None:
        _forget_other_versions(pointer)
    try:
        with rasterio.Env(**settings):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotGeoreferencedWarning)
                dataset = rasterio.open(path if pointer is None else pointer.virtual)
            with dataset:
                yield dataset
    except (RasterioError, CRSError) as error:
        said = str(error) if pointer is None else pointer.without_secrets(str(error))
        raise RasterError(
            f"cannot be read as a raster: {said}",
            where=path,
            expected="a complete file that GDAL reads, such as GeoTIFF",
        ) from error


_versions: dict[str, str] = {}
"""Of the rasters at URLs that this process has opened: what GDAL may keep parts of."""


def _forget_other_versions(pointer: Pointer) -> None:
    """Have GDAL drop what it keeps of another version: it does not ask whether that still holds."""
    before = _versions.setdefault(pointer.virtual, pointer.version)
    if before == pointer.version != "":
        return
    _versions[pointer.virtual] = pointer.version
    settings = pointer.settings() | {"CPL_VSIL_CURL_NON_CACHED": pointer.virtual}
    with suppress(RasterioError), warnings.catch_warnings(), rasterio.Env(**settings):
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        rasterio.open(pointer.virtual).close()


def pixel_to_world(transform: Any, colrow: ArrayLike) -> Floats:
    """Take pixel coordinates to the raster's CRS."""
    a, b, c, d, e, f = transform[:6]
    points = np.asarray(colrow, dtype=np.float64)
    column, row = points[..., 0], points[..., 1]
    return np.stack((a * column + b * row + c, d * column + e * row + f), axis=-1)


def world_to_pixel(transform: Any, xy: ArrayLike) -> Floats:
    """Take coordinates (..., 2) of the raster's CRS to pixels; the inverse of `pixel_to_world`."""
    _, _, c, _, _, f = transform[:6]
    # The origin goes first: carried through the inverse, its millions of metres cost digits.
    return world_to_pixel_steps(transform, np.asarray(xy, dtype=np.float64) - (c, f))


def world_to_pixel_steps(transform: Any, steps: Floats) -> Floats:
    """Take differences (..., 2) of world coordinates to differences in pixels."""
    a, b, _, d, e, _ = transform[:6]
    x, y = steps[..., 0], steps[..., 1]
    determinant = a * e - b * d
    return np.stack(((e * x - b * y) / determinant, (a * y - d * x) / determinant), axis=-1)


def gsd_m(info: RasterInfo) -> tuple[float, float]:
    """Ground sampling distance at the raster's centre, in metres: between columns, between rows."""
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

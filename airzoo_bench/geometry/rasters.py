"""Georeferenced rasters: their size, grid, type and colours.

In pixel coordinates column comes before row; the raster's corner is (0, 0), the centre of its
first pixel (0.5, 0.5). A transform is an affine.Affine or a sequence (a, b, c, d, e, f):
x = a column + b row + c, y = d column + e row + f.

What rasterio or GDAL makes of a bad file becomes one RasterError.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import rasterio
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.core.files import atomic_write, fingerprint, sha256_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import (
    change_of_plane,
    describe_crs,
    geodesic_distance_m,
    horizontal_crs,
    to_lonlat,
    unwrap,
)
from airzoo_bench.storage.urls import ensure_file

# What an environment may have set otherwise, and no checksum shows: where the pixels of a GeoTIFF
# lie, and whether damaged ones are zeros.
_FIXED = {
    "GTIFF_POINT_GEO_IGNORE": "FALSE",
    "GTIFF_HONOUR_NEGATIVE_SCALEY": "FALSE",
    "GTIFF_IGNORE_READ_ERRORS": "FALSE",
}


@dataclass(frozen=True)
class RasterInfo:
    """Size, grid and type of a georeferenced raster; `nodata` may be NaN, `dtype` is band 1's."""

    path: Path
    width: int
    height: int
    transform: Any
    crs: CRS
    nodata: float | None
    bands: int
    dtype: str


def open_info(path: str | Path) -> RasterInfo:
    """Read size, grid and type of a raster; refuse one without a georeference."""
    with open_raster(path) as dataset:
        transform, crs = dataset.transform, dataset.crs
        has_area = np.isfinite(transform[:6]).all() and transform.determinant != 0.0
        if crs is None or transform.is_identity or not has_area:
            stated = "no CRS" if crs is None else f"the geotransform {tuple(transform[:6])}"
            raise RasterError(
                f"no georeference: {stated}",
                where=path,
                expected="a raster with a CRS and a geotransform",
                fix="gdal_translate -a_srs and -a_ullr, or export it as GeoTIFF again",
            )
        try:
            horizontal_crs(crs.to_wkt())
        except UserError as error:
            raise RasterError(error.what, where=path, expected=error.expected) from error
        return RasterInfo(
            path=Path(path),
            width=dataset.width,
            height=dataset.height,
            transform=transform,
            crs=CRS.from_wkt(crs.to_wkt()),
            nodata=dataset.nodata,
            bands=dataset.count,
            dtype=dataset.dtypes[0],
        )


@contextmanager
def open_raster(path: str | Path, **settings: str) -> Iterator[Any]:
    """Open a raster for reading; yields rasterio's dataset."""
    if not ensure_file(Path(path)).is_file():
        raise RasterError("no such file", where=path)
    try:
        with rasterio.Env(**_FIXED | settings):
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
    """Take pixel coordinates (..., 2) to the raster's CRS."""
    a, b, c, d, e, f = transform[:6]
    points = np.asarray(colrow, dtype=np.float64)
    column, row = points[..., 0], points[..., 1]
    return np.stack((a * column + b * row + c, d * column + e * row + f), axis=-1)


def world_to_pixel(transform: Any, xy: ArrayLike) -> Floats:
    """Take coordinates (..., 2) of the raster's CRS to pixels; the inverse of `pixel_to_world`."""
    points = np.asarray(xy, dtype=np.float64)
    # The origin goes first: carried through the inverse, its millions of metres cost digits.
    return steps_to_pixels(transform, points[..., 0] - transform[2], points[..., 1] - transform[5])


def steps_to_pixels(transform: Any, x: Floats, y: Floats) -> Floats:
    """Take differences of world coordinates (...) to differences in pixels (..., 2)."""
    a, b, _, d, e, _ = transform[:6]
    determinant = a * e - b * d
    return np.stack(((e * x - b * y) / determinant, (a * y - d * x) / determinant), axis=-1)


def to_map_pixels(source: Any, raster: RasterInfo) -> Callable[[Floats], Floats]:
    """Return a function that takes coordinates (..., 2) of a CRS to pixels of a raster.

    Longitudes take the turn that is nearest to the middle of a raster in degrees: PROJ gives them
    from -180 to 180, and a map may go from 179.9 to 180.1.
    """
    change = change_of_plane(source, raster.crs)
    middle = pixel_to_world(raster.transform, (raster.width / 2.0, raster.height / 2.0))

    def pixels(xy: Floats) -> Floats:
        world = change(xy)
        if raster.crs.is_geographic:
            world = unwrap(world, middle[0])
        return world_to_pixel(raster.transform, world)

    return pixels


def gsd_m(info: RasterInfo) -> tuple[float, float]:
    """Return the metres between columns and between rows on the ground at the raster's centre."""
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
    """Read colours (H, W, 3) of a window (column, row, width, height), shrunk to a longest side.

    Grey is repeated, alpha dropped.
    """
    with open_raster(path) as dataset:
        column, row, width, height = window or (0, 0, dataset.width, dataset.height)
        inside = column >= 0 and row >= 0 and width > 0 and height > 0
        if not inside or column + width > dataset.width or row + height > dataset.height:
            raise RasterError(
                f"window {window} (column, row, width, height) is not inside the raster",
                where=path,
                expected=f"a part of {dataset.width} x {dataset.height} px",
            )
        scale = min(1.0, (long_side_px or max(width, height)) / max(width, height))
        pixels = dataset.read(
            _rgb_bands(dataset, path),
            window=Window(column, row, width, height),
            out_shape=(3, max(1, round(height * scale)), max(1, round(width * scale))),
            resampling=Resampling.average,
        )
    return np.ascontiguousarray(np.moveaxis(pixels, 0, -1))


def write_geotiff(path: Path, bands: NDArray[Any], **layout: Any) -> None:
    """Write bands (B, H, W) by way of memory: GDAL only logs a full disk."""
    sizes = dict(zip(("count", "height", "width"), bands.shape, strict=True))
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", dtype=bands.dtype.name, **sizes, **layout) as dataset:
            dataset.write(bands)
        with atomic_write(path) as stream:
            stream.write(memory.getbuffer())


def _rgb_bands(dataset: Any, path: str | Path) -> list[int]:
    kinds = list(dataset.colorinterp)
    rgb = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
    bands: list[int] = []
    if all(kind in kinds for kind in rgb):
        bands = [kinds.index(kind) + 1 for kind in rgb]
    elif ColorInterp.palette not in kinds and len(kinds) <= 4:
        bands = [1, 1, 1] if len(kinds) <= 2 else [1, 2, 3]
    dtypes = {dataset.dtypes[band - 1] for band in bands}
    if dtypes != {"uint8"}:
        named = ", ".join(
            f"{kind.name} {one}" for kind, one in zip(kinds, dataset.dtypes, strict=True)
        )
        raise RasterError(
            f"no colours: its bands are {named[:200]}",
            where=path,
            expected="grey or RGB of 8 bits (uint8), with or without alpha",
            fix="gdal_translate -b for the bands, -expand rgb for a palette, -ot Byte -scale",
        )
    return bands


# --- the files of a raster, and the checksum of these ---

# A virtual raster (VRT) is XML that names the files it is made of. GDAL tells it by its content,
# whatever its ending, and reads names of elements and attributes in letters of either case.

# What GDAL lists next to a raster, and whose content shows in what the raster says of itself.
_SIDE_FILES = (".tfw", ".wld", ".prj", ".xml", ".ovr")
_WITHOUT_SIDE_FILES = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_GEOREF_SOURCES": "INTERNAL",
}
_SOURCES = ("sourcefilename", "sourcedataset")  # the latter of warped rasters
_RELATIVE = "relativeToVRT"


def raster_files(path: Path) -> list[Path]:
    """Return a raster's file, then its side files and those a virtual raster is made of, sorted."""
    found = [path]
    for part in found:  # grows: what a virtual raster names may be virtual
        with suppress(RasterError) if part != path else nullcontext(), open_raster(part) as dataset:
            listed = [Path(name).absolute() for name in dataset.files]
            found += [one for one in listed if one.is_file() and one not in found]
    return [path, *sorted(set(found) - {path, path.absolute()})]


def raster_sha256(path: Path) -> str:
    """Return the SHA-256 of all that the numbers of a raster's first band depend on.

    It is the same wherever the files stand: that of the raster's own file, unless others beside it
    change how this is read, such as a world file, a mask, or an ``.aux.xml`` with a nodata value,
    a scale or a grid. Then it is over the bytes of all that hold numbers, and what the raster says
    of itself because of the rest; statistics and overviews change nothing. That of a virtual
    raster is over its own text and the checksums of the rasters that this names.
    """
    with open_raster(path) as dataset:
        virtual, stated = dataset.driver == "VRT", _stated(dataset)
        files = [Path(name) for name in dataset.files[1:]]
    if virtual:
        files = [one for one in files if str(one).startswith(f"{path}.")]
    beside = [one for one in files if one.suffix.lower() not in _SIDE_FILES]
    own = fingerprint(_virtual_content(path)) if virtual else sha256_of(path)
    with suppress(RasterError), open_raster(path, **_WITHOUT_SIDE_FILES) as alone:
        if not beside and stated == _stated(alone):
            return own
    return fingerprint([stated, own, sorted(sha256_of(one) for one in beside)])


def _stated(dataset: Any) -> list[Any]:
    """Return what decides how the numbers of the first band are read, and where they lie."""
    flags = sorted(flag.name for flag in dataset.mask_flag_enums[0])
    crs = dataset.crs.to_string() if dataset.crs else ""
    grid = [dataset.width, dataset.height, *dataset.transform[:6], str(dataset.nodata)]
    scale = [str(dataset.scales[0]), str(dataset.offsets[0]), dataset.units[0] or ""]
    return [*grid, *scale, flags, crs]


def _virtual_content(path: Path) -> str:
    """Return a virtual raster's XML with checksums in place of the names of files."""
    try:
        tree = ET.parse(path)
    except ET.ParseError as error:
        raise RasterError(f"is no XML: {error}", where=path) from error
    found = dict[Path, str]()  # bands name one file each
    for element in source_elements(tree):
        source = source_of(element, path)
        _forget_folder(element)
        element.text = found[source] = found.get(source) or raster_sha256(source)
    return ET.canonicalize(ET.tostring(tree.getroot(), "unicode"), strip_text=True)


def source_elements(tree: ET.ElementTree[ET.Element]) -> Iterator[ET.Element]:
    """Yield the elements of a virtual raster that name files."""
    yield from (one for one in tree.iter() if one.tag.lower() in _SOURCES)


def source_of(element: ET.Element, path: Path) -> Path:
    """Return the file that an element of the virtual raster at `path` names."""
    return path.parent / (element.text or "")


def place_source(element: ET.Element, name: str) -> None:
    """Have an element name another file, relative to the folder of the virtual raster."""
    _forget_folder(element)
    element.text = name
    element.set(_RELATIVE, "1")


def _forget_folder(element: ET.Element) -> None:
    for name in [one for one in element.attrib if one.lower() == _RELATIVE.lower()]:
        del element.attrib[name]

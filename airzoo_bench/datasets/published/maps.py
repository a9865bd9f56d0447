"""Maps of published benchmarks: in tiles, with their CRS beside, or under unknown names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import rasterio
import rasterio.shutil
from affine import Affine
from pyproj import CRS
from pyproj.exceptions import CRSError

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import atomic_write, fingerprint, temporary_folder
from airzoo_bench.datasets.published.places import missing
from airzoo_bench.geometry.heightfield import height_type, read_heights, small_cache
from airzoo_bench.geometry.rasters import opened, pixel_to_world, world_to_pixel

__all__ = ["find_maps", "join_maps", "only_one", "with_georeference"]

_TYPES = {"uint8": "Byte", "uint16": "UInt16", "float32": "Float32"}
_OFF_GRID_PX = 0.1  # what rounding in a georeference may move a tile
_COLOUR_TYPES = ("uint8", "uint16")
_HEIGHT_TYPES = ("float32", "float64", "int16", "int32")


class _Tile(NamedTuple):
    """The header of a tile; `bands` are the types of pixels and their colours."""

    path: Path
    transform: Affine
    crs: str
    bands: tuple[tuple[str, str], ...]
    nodata: float | None
    size: tuple[int, int]


def _tile(path: Path) -> _Tile:
    with opened(path) as dataset:
        bands = zip(dataset.dtypes, (c.name for c in dataset.colorinterp), strict=True)
        crs = dataset.crs.to_wkt() if dataset.crs else ""
        size = dataset.width, dataset.height
        return _Tile(path, dataset.transform, crs, tuple(bands), dataset.nodata, size)


def join_maps(paths: Sequence[Path], target: Path) -> None:
    """Write a virtual raster (VRT) over the tiles of one grid; none of their pixels is copied."""
    tiles = [_tile(path) for path in paths]
    first = tiles[0]
    origins = np.array([(tile.transform.c, tile.transform.f) for tile in tiles])
    places = world_to_pixel(first.transform, origins)
    corners = np.rint(places).astype(np.int64)
    corners -= corners.min(axis=0)
    sizes = np.array([tile.size for tile in tiles], dtype=np.int64)
    width, height = (corners + sizes).max(axis=0).tolist()
    on_grid = np.abs(places - np.rint(places)).max() <= _OFF_GRID_PX
    alike = all(tile[2:5] == first[2:5] for tile in tiles)
    known = bool(first.crs) and {dtype for dtype, _ in first.bands} <= set(_TYPES)
    # Tiles of one grid that do not overlap fill their rectangle where their areas do.
    if not (on_grid and alike and known) or sizes.prod(axis=1).sum() < width * height:
        raise RasterError(
            "the tiles of the map lack a georeference, differ in CRS, bands or grid, or do not "
            f"fill its {width} x {height} px: {', '.join(path.name for path in paths)}",
            where=target.parent,
            expected=f"GeoTIFFs of {', '.join(_TYPES)}, of one grid, that fill a rectangle",
            fix="download the missing tile, or join the tiles with gdalwarp",
        )
    a, b, _, d, e, _ = first.transform[:6]
    left, top = pixel_to_world(first.transform, -corners[0]).tolist()
    root = ET.Element("VRTDataset", rasterXSize=str(width), rasterYSize=str(height))
    ET.SubElement(root, "SRS").text = CRS.from_user_input(first.crs).to_wkt()
    transform = Affine(a, b, left, d, e, top).to_gdal()
    ET.SubElement(root, "GeoTransform").text = ", ".join(map(repr, transform))
    for number, (dtype, colour) in enumerate(first.bands, start=1):
        of_band = {"dataType": _TYPES[dtype], "band": str(number)}
        band = ET.SubElement(root, "VRTRasterBand", of_band)
        ET.SubElement(band, "ColorInterp").text = colour.capitalize()
        if first.nodata is not None:
            ET.SubElement(band, "NoDataValue").text = repr(first.nodata)
        for tile, corner in zip(tiles, corners.tolist(), strict=True):
            _add_source(band, number, tile, corner, target.parent)
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8")
    if not (target.is_file() and target.read_bytes() == content):
        with atomic_write(target) as stream:
            stream.write(content)


def _add_source(
    band: ET.Element, number: int, tile: _Tile, corner: Sequence[int], home: Path
) -> None:
    source = ET.SubElement(band, "SimpleSource")
    inside = tile.path.resolve().parent == home.resolve()
    file = ET.SubElement(source, "SourceFilename", relativeToVRT=str(int(inside)))
    file.text = tile.path.name if inside else str(tile.path.resolve())
    ET.SubElement(source, "SourceBand").text = str(number)
    size = {"xSize": str(tile.size[0]), "ySize": str(tile.size[1])}
    ET.SubElement(source, "SrcRect", {"xOff": "0", "yOff": "0", **size})
    ET.SubElement(source, "DstRect", {"xOff": str(corner[0]), "yOff": str(corner[1]), **size})


def find_maps(folder: Path) -> tuple[list[Path], list[Path]]:
    """Sort the GeoTIFFs below a folder into maps and surface models by their bands."""
    found = (p for p in folder.rglob("*") if p.suffix.lower() in (".tif", ".tiff") and p.is_file())
    maps, surfaces = [], []
    for path in sorted(path for path in found if not path.name.startswith(".")):
        with opened(path) as dataset:
            bands, kind = dataset.count, dataset.dtypes[0]
        if bands in (3, 4) and kind in _COLOUR_TYPES:
            maps.append(path)
        elif bands <= 2 and kind in _HEIGHT_TYPES:
            surfaces.append(path)
    return maps, surfaces


def only_one(files: Sequence[Path], what: str, folder: Path, fix: str) -> Path:
    """Return the one file of a kind, or say which there are and how to name one."""
    if len(files) != 1:
        raise missing(f"{len(files)} files could be the {what}", folder, f"one {what}", fix)
    return files[0]


def with_georeference(path: Path, home: Path, *, heights: bool = False) -> tuple[Path, list[str]]:
    """Return a raster that states its CRS and, for heights, which number means none; and notes.

    Where the file does not, a virtual one over it does, written into `home`.
    """
    with opened(path) as dataset:
        crs, nodata, masked = dataset.crs, dataset.nodata, dataset.mask_flag_enums[0]
        placed = not dataset.transform.is_identity
    notes, wkt, empty = [], None, None
    if crs is None or not placed:
        wkt = _stated_next_to(path) if placed else None
        if wkt is None:
            raise RasterError(
                "no georeference: no CRS or no geotransform, and no .prj or .tfw next to it",
                where=path,
                expected="a GeoTIFF with a georeference, or with .prj and .tfw of the same name",
                fix=f"download these too, or: gdal_edit.py -a_srs EPSG:4547 {path.name}",
            )
        notes.append(f"{path.name}: its CRS is that of the .prj next to it")
    if heights and nodata is None and rasterio.enums.MaskFlags.all_valid in masked:
        low = _lowest_number(path)
        if low <= 0.0:
            empty = low
            notes.append(f"{path.name}: {low:g}, its lowest number, is taken for no height")
    if wkt is None and empty is None:
        return path, notes
    home.mkdir(parents=True, exist_ok=True)
    # Files of one name may stand in several folders.
    target = home / f"{path.stem}-{fingerprint(str(path.resolve()))[:8]}.vrt"
    # Scenes that are made at once may share a map: what they read of it is there whole.
    with temporary_folder(home, target.name) as temporary:
        made = temporary / target.name
        rasterio.shutil.copy(path.resolve(), made, driver="VRT")
        with rasterio.open(made, "r+") as dataset:
            dataset.crs = rasterio.CRS.from_wkt(wkt) if wkt is not None else crs
            if empty is not None:
                dataset.nodata = empty
        made.replace(target)
    return target, notes


def _lowest_number(path: Path) -> float:
    """Return the lowest number in a file, in its own unit; NaN if it has none."""
    with small_cache(), opened(path) as dataset:
        kind, windows = height_type(dataset.dtypes[0]), dataset.block_windows(1)
        blocks = (read_heights(dataset, window, kind) for _, window in windows)
        return float(np.fmin.reduce([np.fmin.reduce(block, axis=None) for block in blocks]))


def _stated_next_to(path: Path) -> str | None:
    """Return the CRS of the .prj next to a file; None where there is none."""
    beside = [p for p in path.parent.iterdir() if p.stem == path.stem]
    file = next((p for p in beside if p.suffix.lower() == ".prj"), None)
    if file is None:
        return None
    try:
        return str(CRS.from_user_input(file.read_text("utf-8-sig")).to_wkt())
    except (CRSError, UnicodeDecodeError) as error:
        raise RasterError("states no CRS that PROJ knows", where=file, expected="WKT") from error

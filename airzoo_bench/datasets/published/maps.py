"""Maps of published benchmarks: in tiles, without a georeference, or under unknown names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import rasterio
import rasterio.shutil
from affine import Affine
from pyproj import CRS
from pyproj.exceptions import CRSError

from airzoo_bench.core.errors import BenchmarkError, RasterError, first_of
from airzoo_bench.core.files import atomic_write, fingerprint, temporary_folder
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.heightfield import height_type, read_heights, small_cache
from airzoo_bench.geometry.rasters import opened, pixel_to_world, world_to_pixel

__all__ = [
    "Bounds",
    "MapTile",
    "find_maps",
    "join_maps",
    "map_tile",
    "only_one",
    "with_georeference",
]

Bounds = tuple[float, float, float, float]

_TYPES = {
    "uint8": "Byte",
    "uint16": "UInt16",
    "int16": "Int16",
    "uint32": "UInt32",
    "int32": "Int32",
    "float32": "Float32",
    "float64": "Float64",
}
_OFF_GRID_PX = 0.1  # what rounding in a georeference may move a tile
_COLOUR_TYPES = ("uint8", "uint16")
_HEIGHT_TYPES = ("float32", "float64", "int16", "int32")


@dataclass(frozen=True)
class MapTile:
    """The header of one of the files of a map.

    Without a georeference `transform` is None; `bands` are the types of pixels and their colours.
    """

    path: Path
    width: int
    height: int
    transform: Affine | None
    crs: str
    bands: tuple[tuple[str, str], ...]
    nodata: float | None
    block: tuple[int, int]


def map_tile(path: Path) -> MapTile:
    """Read the header of a map, which may lack a georeference."""
    with opened(path) as dataset:
        tile = MapTile(
            path,
            dataset.width,
            dataset.height,
            None if dataset.transform.is_identity else dataset.transform,
            dataset.crs.to_wkt() if dataset.crs else "",
            tuple(zip(dataset.dtypes, (c.name for c in dataset.colorinterp), strict=True)),
            dataset.nodata,
            dataset.block_shapes[0],
        )
    odd = [band for band in tile.bands if band[0] not in _TYPES or band[1] == "palette"]
    if odd:
        raise RasterError(
            f"has a band of {odd[0][1]} in {odd[0][0]}",
            where=path,
            expected="bands of colours or grey",
            fix="gdal_translate -expand rgb, or -ot Byte",
        )
    return tile


def join_maps(
    tiles: Mapping[tuple[int, int], MapTile],
    target: Path,
    bounds: Bounds | None = None,
    crs: str = "EPSG:4326",
) -> None:
    """Write a virtual raster (VRT) over the tiles of a map; none of their pixels is copied.

    Tiles come by row and column; `bounds` (left, top, right, bottom of the whole) and `crs` are for
    those without a georeference. Raise RasterError where they do not make one map.
    """
    ordered = [tiles[key] for key in sorted(tiles)]
    first = ordered[0]
    placed = [tile.transform is not None for tile in ordered]
    unlike = [tile for tile in ordered if _kind(tile) != _kind(first)]
    if unlike or any(placed) != all(placed) or (not placed[0] and bounds is None):
        raise RasterError(
            f"differs from {first.path.name} in bands, nodata value, CRS or size of a pixel"
            if unlike
            else "has no georeference",
            where=(unlike or [tile for tile in ordered if tile.transform is None])[0].path,
            expected="tiles of one map, with a georeference, or the bounds of the whole map",
            fix="download it again, or gdal_translate -a_srs EPSG:4326 -a_ullr LEFT TOP RIGHT "
            "BOTTOM",
        )
    sizes = np.array([(tile.width, tile.height) for tile in ordered], dtype=np.int64)
    corners = _by_georeference(ordered) if placed[0] else _by_rows_and_columns(tiles)
    width, height = (corners + sizes).max(axis=0).tolist()
    # Tiles of one grid that do not overlap fill their rectangle where their areas do.
    if sizes.prod(axis=1).sum() < width * height:
        raise RasterError(
            f"the tiles of the map do not fill its {width} x {height} px: "
            + ", ".join(f"{tile.path.name} ({tile.width} x {tile.height})" for tile in ordered),
            where=target,
            expected="tiles that fill a rectangle",
            fix="download the missing tile",
        )
    if first.transform is not None:
        a, b, _, d, e, _ = first.transform[:6]
        left, top = pixel_to_world(first.transform, -corners[0]).tolist()
        transform = Affine(a, b, left, d, e, top)
    else:
        left, top, right, bottom = bounds or (0.0, 0.0, 0.0, 0.0)
        transform = Affine((right - left) / width, 0.0, left, 0.0, (bottom - top) / height, top)
    root = ET.Element("VRTDataset", rasterXSize=str(width), rasterYSize=str(height))
    ET.SubElement(root, "SRS").text = CRS.from_user_input(first.crs or crs).to_wkt()
    ET.SubElement(root, "GeoTransform").text = ", ".join(map(repr, transform.to_gdal()))
    for band in range(len(first.bands)):
        _add_band(root, band, ordered, corners, target.parent)
    ET.indent(root)
    content: bytes = ET.tostring(root, encoding="utf-8")
    if not (target.is_file() and target.read_bytes() == content):
        with atomic_write(target) as stream:
            stream.write(content)


def _kind(tile: MapTile) -> tuple[object, ...]:
    """Return what tiles of one map have in common, digits that move no tile left out."""
    linear = () if tile.transform is None else tuple(tile.transform[i] for i in (0, 1, 3, 4))
    return tile.bands, repr(tile.nodata), tile.crs, *(f"{value:.8g}" for value in linear)


def _by_georeference(tiles: Sequence[MapTile]) -> Ints:
    """Return the corner (N, 2) of each tile in pixels of the whole."""
    transforms = [tile.transform for tile in tiles if tile.transform is not None]
    places = world_to_pixel(transforms[0], np.array([(t.c, t.f) for t in transforms]))
    corners: Ints = np.rint(places).astype(np.int64)
    off = np.abs(places - corners).max(axis=1)
    if off.max() > _OFF_GRID_PX:
        raise RasterError(
            f"begins {off.max():.2f} pixels off the grid of {tiles[0].path.name}",
            where=tiles[int(off.argmax())].path,
            expected="tiles of one grid",
            fix="download the tile again, or join the tiles with gdalwarp",
        )
    corners -= corners.min(axis=0)
    return corners


def _by_rows_and_columns(tiles: Mapping[tuple[int, int], MapTile]) -> Ints:
    """Return the corner (N, 2) of each tile where tiles stand side by side."""
    heights = {row: tile.height for (row, _), tile in tiles.items()}
    widths = {column: tile.width for (_, column), tile in tiles.items()}
    corners = [
        (
            sum(width for other, width in widths.items() if other < column),
            sum(height for other, height in heights.items() if other < row),
        )
        for row, column in sorted(tiles)
    ]
    return np.array(corners, dtype=np.int64)


def _add_band(
    root: ET.Element, band: int, tiles: Sequence[MapTile], corners: Ints, folder: Path
) -> None:
    dtype, colour = tiles[0].bands[band]
    element = ET.SubElement(root, "VRTRasterBand", dataType=_TYPES[dtype], band=str(band + 1))
    ET.SubElement(element, "ColorInterp").text = colour.capitalize()
    if tiles[0].nodata is not None:
        ET.SubElement(element, "NoDataValue").text = repr(tiles[0].nodata)
    for tile, (left, top) in zip(tiles, corners.tolist(), strict=True):
        source = ET.SubElement(element, "SimpleSource")
        inside = tile.path.resolve().parent == folder.resolve()
        file = ET.SubElement(source, "SourceFilename", relativeToVRT=str(int(inside)))
        file.text = tile.path.name if inside else str(tile.path.resolve())
        ET.SubElement(source, "SourceBand").text = str(band + 1)
        # With these GDAL opens a tile when it is read, not when the map is opened.
        properties = {
            "RasterXSize": str(tile.width),
            "RasterYSize": str(tile.height),
            "DataType": _TYPES[dtype],
            "BlockXSize": str(tile.block[1]),
            "BlockYSize": str(tile.block[0]),
        }
        ET.SubElement(source, "SourceProperties", properties)
        for name, (x, y) in {"SrcRect": (0, 0), "DstRect": (left, top)}.items():
            window = {"xOff": x, "yOff": y, "xSize": tile.width, "ySize": tile.height}
            ET.SubElement(source, name, {key: str(value) for key, value in window.items()})


def find_maps(folder: Path) -> tuple[list[Path], list[Path]]:
    """Sort the GeoTIFFs below a folder into maps and surface models, by what a pixel holds."""
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
    if len(files) == 1:
        return files[0]
    names = [file.name for file in files]
    found = first_of(names) if names else f"none; {folder_content(folder)}"
    raise BenchmarkError(
        f"which file is the {what} is not clear: {found}",
        where=folder,
        expected=f"one {what} as GeoTIFF",
        fix=fix,
    )


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
    """Return the lowest number of a file as it stands there, in whatever unit; NaN of none."""
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

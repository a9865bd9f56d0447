"""Maps that come in several tiles, or without a georeference: one virtual map (VRT) over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from affine import Affine
from pyproj import CRS
from rasterio.enums import ColorInterp

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.rasters import opened, pixel_to_world, world_to_pixel

__all__ = ["Bounds", "MapTile", "join_maps", "map_tile"]

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
_PALETTE = ColorInterp.palette.name
_OFF_GRID_PX = 0.1  # what rounding in a georeference may move a tile


@dataclass(frozen=True)
class MapTile:
    """What one of the files of a map says of itself.

    Attributes
    ----------
    transform : affine.Affine or None
        None without a georeference.
    crs : str
        WKT; empty where the file states none.
    bands : tuple of (str, str)
        Type of pixels and colour of each band.
    block : tuple of int
        Height and width of the file's blocks.
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
    odd = [band for band in tile.bands if band[0] not in _TYPES or band[1] == _PALETTE]
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
    """Write a virtual raster (VRT) over the tiles of a map; none of their pixels is copied."""
    ordered = [tiles[key] for key in sorted(tiles)]
    first = ordered[0]
    _check_alike(ordered)
    if first.transform is not None:
        corners, transform = _by_georeference(ordered)
    elif bounds is not None:
        corners = _by_rows_and_columns(tiles)
        transform = _spanned(corners, ordered, bounds)
    else:
        raise _without_georeference(first)
    width, height = _ends(corners, ordered).max(axis=0).tolist()
    _check_no_gap(corners, ordered, target)
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


def _check_alike(tiles: Sequence[MapTile]) -> None:
    first = tiles[0]
    for tile in tiles[1:]:
        if (tile.transform is None) != (first.transform is None):
            raise _without_georeference(tile if tile.transform is None else first)
        pairs = {
            "bands": (first.bands, tile.bands),
            "nodata value": (repr(first.nodata), repr(tile.nodata)),
            "CRS": (first.crs, tile.crs),
            "size of a pixel": (_pixel_size(first), _pixel_size(tile)),
        }
        for what, (ours, theirs) in pairs.items():
            if ours != theirs:
                raise RasterError(
                    f"its {what} is {str(theirs)[:200]}, that of {first.path.name} "
                    f"{str(ours)[:200]}",
                    where=tile.path,
                    expected="tiles of one map",
                    fix="download the tile again, or join the tiles with gdalwarp",
                )


def _pixel_size(tile: MapTile) -> tuple[str, ...]:
    """Return the linear part of the transform, to the digits that move no tile."""
    if tile.transform is None:
        return ()
    a, b, _, d, e, _ = tile.transform[:6]
    return tuple(f"{value:.8g}" for value in (a, b, d, e))


def _by_georeference(tiles: Sequence[MapTile]) -> tuple[Ints, Affine]:
    """Return the corner (N, 2) of each tile in pixels of the whole, and the whole's transform."""
    transforms = [tile.transform for tile in tiles if tile.transform is not None]
    base, origins = transforms[0], np.array([(t.c, t.f) for t in transforms])
    places = world_to_pixel(base, origins)
    corners = np.rint(places).astype(np.int64)
    off = np.abs(places - corners).max(axis=1)
    if off.max() > _OFF_GRID_PX:
        worst = int(off.argmax())
        raise RasterError(
            f"begins {off[worst]:.2f} pixels off the grid of {tiles[0].path.name}: at column "
            f"{places[worst, 0]:.2f}, row {places[worst, 1]:.2f}",
            where=tiles[worst].path,
            expected="tiles of one grid",
            fix="download the tile again, or join the tiles with gdalwarp",
        )
    corner = corners.min(axis=0)
    a, b, _, d, e, _ = base[:6]
    left, top = pixel_to_world(base, corner).tolist()
    return corners - corner, Affine(a, b, left, d, e, top)


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


def _spanned(corners: Ints, tiles: Sequence[MapTile], bounds: Bounds) -> Affine:
    left, top, right, bottom = bounds
    width, height = _ends(corners, tiles).max(axis=0).tolist()
    return Affine((right - left) / width, 0.0, left, 0.0, (bottom - top) / height, top)


def _ends(corners: Ints, tiles: Sequence[MapTile]) -> Ints:
    return corners + np.array([(tile.width, tile.height) for tile in tiles], dtype=np.int64)


def _check_no_gap(corners: Ints, tiles: Sequence[MapTile], target: Path) -> None:
    """Refuse tiles that do not fill their rectangle, by the cells between their edges."""
    ends = _ends(corners, tiles)
    x, y = (np.unique(np.concatenate([corners[:, i], ends[:, i]])) for i in (0, 1))
    filled = np.zeros((len(y) - 1, len(x) - 1), dtype=bool)
    for (left, top), (right, bottom) in zip(corners, ends, strict=True):
        filled |= ((y[:-1] >= top) & (y[1:] <= bottom))[:, None] & (
            (x[:-1] >= left) & (x[1:] <= right)
        )
    if filled.all():
        return
    row, column = np.argwhere(~filled)[0].tolist()
    raise RasterError(
        f"nothing covers columns {x[column]} to {x[column + 1]}, rows {y[row]} to {y[row + 1]} of "
        "the map, whose tiles are "
        + ", ".join(
            f"{tile.path.name} ({tile.width} x {tile.height} px at {left}, {top})"
            for tile, (left, top) in zip(tiles, corners.tolist(), strict=True)
        ),
        where=target,
        expected="tiles that fill a rectangle",
        fix="download the missing tile",
    )


def _without_georeference(tile: MapTile) -> RasterError:
    return RasterError(
        "has no georeference",
        where=tile.path,
        expected="a GeoTIFF, as all tiles of the map, or the bounds of the whole map",
        fix="download it again, or gdal_translate -a_srs EPSG:4326 -a_ullr LEFT TOP RIGHT BOTTOM",
    )


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

"""Maps of published benchmarks: in tiles, with their CRS beside, or under unknown names."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rasterio
import rasterio.merge
import rasterio.shutil
from pyproj import CRS

from airzoo_bench.core.errors import RasterError, readable
from airzoo_bench.core.files import fingerprint, temporary_folder
from airzoo_bench.datasets.published.places import missing
from airzoo_bench.geometry.heightfield import height_type, read_heights, small_cache
from airzoo_bench.geometry.rasters import opened

_COLOUR_TYPES = ("uint8", "uint16")
_HEIGHT_TYPES = ("float32", "float64", "int16", "int32")


def join_maps(paths: Sequence[Path], home: Path, name: str) -> Path:
    """Join the tiles of one grid, which fill a rectangle, into one map; return where it is."""
    stamps = [(str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns) for p in paths]
    target = home / f"{name}-{fingerprint(stamps)[:8]}.tif"
    if target.is_file():
        return target
    pixels, corners = 0, []
    for path in paths:
        with opened(path) as dataset:
            pixels += dataset.width * dataset.height
            size, bands, crs = dataset.res, dataset.count, dataset.crs
            corners.append(dataset.bounds)
    low, high = np.array(corners)[:, :2].min(axis=0), np.array(corners)[:, 2:].max(axis=0)
    width, height = np.rint((high - low) / size).astype(np.int64).tolist()
    if crs is None or pixels < width * height:
        raise RasterError(
            f"the tiles of the map lack a CRS, or do not fill its {width} x {height} px: "
            f"{', '.join(path.name for path in paths)}",
            where=paths[0].parent,
            fix="download the missing tile, or join the tiles with gdalwarp",
        )
    home.mkdir(parents=True, exist_ok=True)
    how = {"tiled": True, "compress": "deflate", "bigtiff": "if_safer"}
    with temporary_folder(home, target.name) as temporary, small_cache():
        made = temporary / target.name
        colours = {"photometric": "RGB"} if bands > 2 else {}
        with warnings.catch_warnings():  # of rasterio's own code
            warnings.simplefilter("ignore", PendingDeprecationWarning)
            rasterio.merge.merge(list(paths), dst_path=made, dst_kwds=how | colours)
        made.replace(target)
    return target


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
    with readable(file, "states no CRS that PROJ knows", kind=RasterError, expected="WKT"):
        return str(CRS.from_user_input(file.read_text("utf-8-sig")).to_wkt())

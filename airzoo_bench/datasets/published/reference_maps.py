"""Maps and surface models of a benchmark: found by what they hold, with their georeference.

File names of some benchmarks are not known, or differ from release to release: a raster of three
bytes a pixel or four is a map, one of a single wider number is a surface model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
import rasterio.shutil
from pyproj import CRS
from pyproj.exceptions import CRSError

from airzoo_bench.core.errors import BenchmarkError, RasterError, first_of
from airzoo_bench.core.files import fingerprint, temporary_folder
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.geometry.heightfield import height_type, read_heights, small_cache
from airzoo_bench.geometry.rasters import opened

__all__ = ["MapFiles", "find_maps", "only_one", "with_georeference"]

_SUFFIXES = (".tif", ".tiff")
_COLOURS = (3, 4)
_COLOUR_TYPES = ("uint8", "uint16")
_HEIGHT_TYPES = ("float32", "float64", "int16", "int32")


@dataclass(frozen=True)
class MapFiles:
    """Rasters of a folder by what they hold.

    Attributes
    ----------
    maps, surfaces : tuple of Path
        Of three colours or more; of one height.
    """

    maps: tuple[Path, ...]
    surfaces: tuple[Path, ...]


def find_maps(folder: Path) -> MapFiles:
    """Sort the GeoTIFFs below a folder into maps and surface models."""
    found = (p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES and p.is_file())
    maps, surfaces = [], []
    for path in sorted(path for path in found if not path.name.startswith(".")):
        with opened(path) as dataset:
            bands, kind = dataset.count, dataset.dtypes[0]
        if bands in _COLOURS and kind in _COLOUR_TYPES:
            maps.append(path)
        elif bands <= 2 and kind in _HEIGHT_TYPES:
            surfaces.append(path)
    return MapFiles(tuple(maps), tuple(surfaces))


def only_one(files: Sequence[Path], what: str, folder: Path, option: str) -> Path:
    """Return the one file of a kind, or say which there are and how to name one."""
    if len(files) == 1:
        return files[0]
    names = [file.relative_to(folder).as_posix() for file in files]
    found = f"{first_of(names)}" if names else f"none; {folder_content(folder)}"
    raise BenchmarkError(
        f"which file is the {what} is not clear: {found}",
        where=folder,
        expected=f"one {what} as GeoTIFF",
        fix=f"name it: {option}",
    )


def with_georeference(path: Path, home: Path, *, heights: bool = False) -> tuple[Path, list[str]]:
    """Return a raster that states its CRS and, for heights, which number means none."""
    with opened(path) as dataset:
        crs, nodata, masked = dataset.crs, dataset.nodata, dataset.mask_flag_enums[0]
        placed = not dataset.transform.is_identity
    if not placed:
        raise RasterError(
            "no georeference: no geotransform, and no .tfw next to it",
            where=path,
            expected="a GeoTIFF with a geotransform, or with a .tfw of the same name",
            fix="download the .tfw too",
        )
    notes, wkt, empty = [], None, None
    if crs is None:
        wkt = _stated_next_to(path)
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


def _stated_next_to(path: Path) -> str:
    beside = [p for p in path.parent.iterdir() if p.stem == path.stem]
    for file in beside:
        if file.suffix.lower() == ".prj" and file.stat().st_size < 1 << 16:
            try:
                return CRS.from_user_input(file.read_text("utf-8-sig")).to_wkt()
            except (CRSError, UnicodeDecodeError) as error:
                raise RasterError(
                    "states no CRS that PROJ knows", where=file, expected="a CRS as WKT"
                ) from error
    raise RasterError(
        "no georeference: no CRS, and no .prj next to it",
        where=path,
        expected="a GeoTIFF with a CRS, or with a .prj of the same name",
        fix=f"download the .prj too, or: gdal_edit.py -a_srs EPSG:4547 {path.name}",
    )

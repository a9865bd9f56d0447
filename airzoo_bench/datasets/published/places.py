"""Files of published benchmarks below the user's folder: photos, lines of poses, maps."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple, TypeVar

import numpy as np
import rasterio
import rasterio.merge
import rasterio.shutil
from pyproj import CRS

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, RasterError, first_of, readable
from airzoo_bench.core.files import fingerprint, temporary_folder
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.scenes import PosedPhotos
from airzoo_bench.datasets.tables import Table, read_lines
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import height_type, read_heights, small_cache
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m
from airzoo_bench.geometry.rasters import open_raster
from airzoo_bench.protocol.model import load_protocol, shipped_protocols

T = TypeVar("T")

_ENDING = re.compile("|".join(rf"\{suffix}$" for suffix in PHOTO_SUFFIXES), re.IGNORECASE)


def missing(what: str, folder: Path, layout: str, fix: str | None = None) -> BenchmarkError:
    """Make the error of a part that is not there, or there twice; it says what is there."""
    if not folder.is_dir():
        return BenchmarkError("no such folder", where=folder, expected=layout, fix=fix)
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir())
    there = f"there are {first_of(names, shown=6)}" if names else "it is empty"
    fix = fix or "download it again, unpack it whole, and name its folder as --source"
    return BenchmarkError(f"{what}: {there}", where=folder, expected=layout, fix=fix)


def folders_in(folder: Path) -> list[Path]:
    """Return the folders in a folder by name; none where it is none."""
    found = folder.iterdir() if folder.is_dir() else ()
    return sorted(path for path in found if path.is_dir())


def sub_path(folder: Path, *parts: str) -> Path | None:
    """Return an entry below a folder, or None."""
    path = folder.joinpath(*parts)
    return path if path.exists() else None


def needed_path(folder: Path, place: str, layout: str) -> Path:
    """Return a place below a folder."""
    if not (folder / place).exists():
        raise missing(f"lacks {place}", folder, layout)
    return folder / place


def find_home(source: Path, is_home: Callable[[Path], bool], layout: str) -> Path:
    """Return the folder that is a benchmark: the one named, or the only one in it."""
    if source.is_dir() and is_home(source):
        return source
    found = [folder for folder in folders_in(source) if is_home(folder)]
    if len(found) != 1:
        raise missing(f"holds {len(found)} folders that could be the benchmark", source, layout)
    return found[0]


def stem_key(name: str) -> str:
    """Return a file's name up to its first point, without the folders before it."""
    return PurePosixPath(name.replace("\\", "/")).name.split(".", 1)[0]


def stem_of(name: str) -> str:
    """Return a photo's name without its ending, with points for underscores."""
    return _ENDING.sub("", name.strip()).replace("_", ".")


def files_by_key(
    folder: Path, key: Callable[[str], str], layout: str, names: Iterable[str] | None = None
) -> dict[str, str]:
    """Return the photos of a folder, or those named, by the key of their names, in that order."""
    there = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    photos = [n for n in there if n.lower().endswith(PHOTO_SUFFIXES) and not n.startswith(".")]
    photos = list(photos if names is None else names)
    twice = [one for one, count in Counter(map(key, photos)).items() if count > 1]
    if twice or not photos:
        raise missing(f"holds no photo, or several each of {first_of(twice)}", folder, layout)
    return dict(sorted((key(name), name) for name in photos))


def published_scenes(protocol: str) -> list[str]:
    """Return the ids of all scenes of a shipped protocol, in its order."""
    return [scene.id for scene in load_protocol(shipped_protocols()[protocol]).scenes]


def chosen_photos(photos: Sequence[T], every: int) -> tuple[list[T], tuple[str, ...]]:
    """Choose every Nth photo, starting with the first, and say so."""
    chosen = list(photos[::every])
    said = f"one photo in {every} is taken, {len(chosen)} of {len(photos):,} (--every)"
    return chosen, (said,) if every > 1 else ()


_QUATERNION = ("qw", "qx", "qy", "qz")
_TRANSLATION = ("tx", "ty", "tz")
_SIZE, _LENS = ("width", "height"), ("fx", "fy", "cx", "cy")
_MOST_PX = 1e6
_MOST_ABSENT = 0.01  # of the poses may lack a photo; more is a download that is not complete

Key = Callable[[str], str]


class PosedLines(NamedTuple):
    """Photos with a camera and a pose each, names of photos without, and notes."""

    photos: PosedPhotos
    unposed: tuple[str, ...]
    notes: tuple[str, ...]


def read_posed_lines(
    images: Path,
    photos: Mapping[str, str],
    poses: Path,
    cameras: Path,
    key: Key,
    progress: Progress,
    *,
    crs: str,
    axes: Sequence[float] = (1.0, 1.0, 1.0),
    is_other: Callable[[str, set[str]], bool] = lambda name, known: False,
) -> PosedLines:
    """Read cameras and poses of the photos of a folder, as AerialExtreMatch and AirZoo-Real write.

    Their lines are ``name qw qx qy qz tx ty tz``, quaternion and translation of the world-to-camera
    pose, and ``name PINHOLE width height fx fy cx cy``. `photos` are file names by the key that
    `key` makes of a name in the two files. The camera's axes are multiplied by `axes` to be
    OpenCV's; `is_other` takes a key and all keys, and says whether it is of no photo.
    """
    table, keys = _read(poses, ("name", *_QUATERNION, *_TRANSLATION), key)
    wxyz, translation = table.columns(_QUATERNION, -2.0, 2.0), table.columns(_TRANSLATION)
    try:
        rotation = quaternion_to_matrix(wxyz, list(keys))
        rounding_m = pose_errors_m(rotation, translation, wxyz)
        signs = np.asarray(axes, dtype=np.float64)
        every = Poses.from_translations(signs[:, None] * rotation, signs * translation, list(keys))
    except CameraError as error:
        raise error.inside(poses) from error
    rows = {one: row for one, row in keys.items() if not is_other(one, set(keys))}
    posed = [one for one in photos if one in rows]
    absent = [one for one in rows if one not in photos]
    if not posed or len(absent) > _MOST_ABSENT * len(rows):
        what = f"photos of its poses are missing: {first_of(absent, len(rows))}"
        expected = f"a photo in {images} for each pose; there are {first_of(photos.values())}"
        raise BenchmarkError(what, where=poses, expected=expected, fix="download them again")
    names = tuple(photos[one] for one in posed)
    shown = progress(names, "photos", len(names))
    size = np.array([photo_size(images / name) for name in shown], np.float64)
    lenses, notes = _cameras(cameras, key, posed, size)
    if absent:
        notes.append(f"poses without a photo, left aside: {first_of(absent, len(rows))}")
    rounding = float(rounding_m[list(rows.values())].max())
    if rounding > COARSEST_M:
        notes.append(
            f"{poses.name}: its digits fix camera centres to about {rounding:.2g} m only, the "
            "accuracy of this truth at best"
        )
    taken = every.take(np.array([rows[one] for one in posed]))
    unposed = tuple(name for one, name in photos.items() if one not in rows)
    return PosedLines(PosedPhotos(names, lenses, taken, crs), unposed, tuple(notes))


def _read(path: Path, columns: Sequence[str], key: Key) -> tuple[Table, dict[str, int]]:
    """Return the table, and the row of each key."""
    table = read_lines(path, columns)
    table.require_unique("name")
    return table, {key(name): row for row, name in enumerate(table.texts("name"))}


def _cameras(
    path: Path, key: Key, photos: Sequence[str], size: Floats
) -> tuple[Cameras, list[str]]:
    """Return cameras scaled to the photos' size, and a note on that."""
    table, place = _read(path, ("name", "model", *_SIZE, *_LENS), key)
    rows = [place[one] for one in photos if one in place]
    scale, lens = np.full_like(size, np.nan), np.empty((0, 4))
    if len(rows) == len(photos):
        stated = table.columns(_SIZE, 1.0, _MOST_PX)[rows]
        lens, scale = table.columns(_LENS, 1e-3, _MOST_PX)[rows], size / stated
        # A side that was rounded to whole pixels is off by half a pixel at most.
        scale[np.abs(scale[:, :1] * stated - size).max(axis=1) > 1.0] = np.nan
    if np.isnan(scale).any() or set(table.texts("model")) != {"PINHOLE"}:
        what = "photos without a camera, of another shape than theirs, or with distortion"
        expected = "name PINHOLE width height fx fy cx cy, a line for each photo with a pose"
        raise CameraError(what, where=path, expected=expected)
    matrices = np.zeros((len(rows), 3, 3))
    matrices[:, [0, 1], [0, 1]] = lens[:, :2] * scale
    matrices[:, :2, 2] = lens[:, 2:] * scale
    matrices[:, 2, 2] = 1.0
    width, height = size.astype(np.int64).T
    cameras = Cameras.from_matrices(matrices, width, height, names=photos)
    scaled = bool((scale != 1.0).any())
    return cameras, ["cameras were scaled to the photos' size"] if scaled else []


# --- maps: in tiles, with their CRS beside, or under unknown names ---

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
        with open_raster(path) as dataset:
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
        with open_raster(path) as dataset:
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
    with open_raster(path) as dataset:
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
    with small_cache(), open_raster(path) as dataset:
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

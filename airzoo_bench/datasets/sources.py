"""The source files of a scene: where they are, and checks that they can be used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from pyproj import CRS

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    RasterError,
    UsageError,
    UserError,
    first_of,
)
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.progress import Progress
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import (
    check_true_metres,
    describe_crs,
    horizontal_crs,
    same_plane,
    to_lonlat,
)
from airzoo_bench.geometry.rasters import open_info, to_map_pixels
from airzoo_bench.geometry.vertical import vertical_m

__all__ = [
    "check_dsm_crs",
    "check_metres",
    "check_names",
    "check_target",
    "metric_crs",
    "photo_sizes",
    "vertical_unit_m",
]

_LONGEST_PATH = 180  # so that ids are no longer than prediction files may have them
_MOST_DSM_BANDS = 2  # heights, and perhaps a mask


def check_target(sources: Iterable[Path], folder: Path) -> None:
    """Refuse to make a folder that holds the sources."""
    target = folder.resolve()
    for source in sources:
        if target in (source.resolve(), *source.resolve().parents):
            raise UsageError(
                f"the folder to make holds {source}, which it is made from",
                where=folder,
                fix="name another --out",
            )


def photo_sizes(folder: Path, progress: Progress) -> dict[str, tuple[int, int]]:
    """Read width and height of every photo below a folder, by name relative to it."""
    if not folder.is_dir():
        raise UsageError("no such folder of photos", where=folder)
    named = (path for path in folder.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES)
    paths = sorted(path for path in named if not path.is_dir())
    special = [path.relative_to(folder).as_posix() for path in paths if not path.is_file()]
    if special:
        raise BenchmarkError(
            f"a pipe, a device or a link to nothing: {first_of(map(repr, special), len(paths))}",
            where=folder,
            expected="photos that are files",
            fix="remove them, or put the photos there",
        )
    if not paths:
        raise BenchmarkError(
            "holds no photo", where=folder, expected="files ending in " + ", ".join(PHOTO_SUFFIXES)
        )
    shown = progress(paths, "photos", len(paths))
    return {path.relative_to(folder).as_posix(): photo_size(path) for path in shown}


def check_names(names: tuple[str, ...], folder: Path) -> None:
    """Refuse photos whose names cannot become ids, or would become the same id."""
    odd = [repr(name) for name in names if not name.isprintable() or len(name) > _LONGEST_PATH]
    if odd:
        raise BenchmarkError(
            f"names that cannot become ids: {first_of(odd, len(names))}",
            where=folder,
            expected=f"printable characters, at most {_LONGEST_PATH}",
            fix="rename these photos",
        )
    stems = [Path(name).with_suffix("").as_posix() for name in names]
    twice = sorted(stem for stem, count in Counter(stems).items() if count > 1)
    if twice:
        raise BenchmarkError(
            f"photos that differ in their ending only: {first_of(twice, len(names))}",
            where=folder,
            fix="keep one of each; ids are names without the ending",
        )


def metric_crs(named: str, where: str) -> CRS:
    """Return the CRS of poses, which must be projected and in metres."""
    try:
        crs = horizontal_crs(named)
    except UserError as error:
        raise error.inside(where) from error
    if not crs.is_projected or any(axis.unit_conversion_factor != 1 for axis in crs.axis_info):
        raise CameraError(
            f"poses are in {describe_crs(crs)}, which is not in metres",
            where=where,
            expected="a projected CRS in metres, such as UTM",
            fix="transform the camera centres, rotations and the DSM to one",
        )
    return crs


def check_metres(crs: CRS, xy: Floats, where: str, poses: Path, dsm: Path | None) -> None:
    """Refuse poses at which their CRS is not true to scale, or that have x and y swapped."""
    try:
        check_true_metres(crs, to_lonlat(crs, xy), where)
    except CameraError as error:
        if dsm is None or not _lie_on(xy[:, ::-1], crs, dsm):
            raise
        error.fix = "swap x and y of the camera centres: these then lie on the surface model"
        raise error.inside(poses) from error


def _lie_on(xy: Floats, crs: CRS, dsm: Path) -> bool:
    """Whether most places lie within the rectangle of the surface model."""
    info = open_info(dsm)
    pixels = to_map_pixels(crs, info)(xy)
    within = ((pixels >= 0.0) & (pixels <= (info.width, info.height))).all(axis=1)
    return bool(within.mean() > 0.5)


def check_dsm_crs(crs: CRS, path: Path, poses: Path) -> None:
    """Refuse a surface model in another CRS than the poses, or that looks like a map."""
    dsm = open_info(path)
    if not same_plane(crs, dsm.crs):
        target = path.with_name(f"{path.stem}_warped.tif")
        raise RasterError(
            f"the poses ({poses}) and the DSM ({path}) differ in CRS: {describe_crs(crs)} and "
            f"{describe_crs(dsm.crs)}",
            expected="one CRS",
            fix=f"gdalwarp -t_srs '{crs.to_string()}' -r bilinear '{path}' '{target}' makes a DSM "
            "in the CRS of the poses; heights stay as they are",
        )
    if dsm.bands > _MOST_DSM_BANDS:
        raise RasterError(
            f"has {dsm.bands} bands",
            where=path,
            expected="one band of heights",
            fix="look whether --dom and --dsm are the wrong way round",
        )


def vertical_unit_m(crs: str) -> float:
    """Metres of the unit of the poses' heights: that of a compound CRS, else 1."""
    return vertical_m(CRS.from_user_input(crs)) or 1.0

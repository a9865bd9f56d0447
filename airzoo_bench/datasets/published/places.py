"""Find a benchmark's files below the user's folder, or name what is there; poses as lines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeVar

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.scenes import PosedPhotos
from airzoo_bench.datasets.tables import Table, read_lines
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m
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
    """Return the entry of a folder with one of these names in any case, or None."""
    for part in parts:
        inside = folder.iterdir() if folder.is_dir() else ()
        found = [path for path in inside if path.name.casefold() == part.casefold()]
        exact = [path for path in found if path.name == part] or found
        if len(exact) != 1:
            return None
        folder = exact[0]
    return folder


def needed_path(folder: Path, place: str, layout: str) -> Path:
    """Return the path below a folder whose parts match in any case."""
    found = sub_path(folder, *place.split("/"))
    if found is None:
        raise missing(f"lacks {place}", folder, layout)
    return found


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


@dataclass(frozen=True, eq=False)
class PosedLines:
    """Photos with a camera and a pose each, names of those without, and notes.

    AerialExtreMatch and the sites of AirZoo-Real write lines of text: ``name qw qx qy qz tx ty
    tz``, quaternion and translation of the world-to-camera pose in a projected CRS, and ``name
    PINHOLE width height fx fy cx cy``.
    """

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
    axes: Sequence[float] = (1.0, 1.0, 1.0),
    is_other: Callable[[str, set[str]], bool] = lambda name, known: False,
) -> PosedLines:
    """Read cameras and poses of the photos of a folder.

    `photos` are file names by the key that `key` makes of a name in the two files of lines. The
    camera's axes are multiplied by `axes` to be OpenCV's; `is_other` takes a key and all keys, and
    says whether it is of no photo.
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
        raise BenchmarkError(
            f"photos of its poses are missing: {first_of(absent, len(rows))}",
            where=poses,
            expected=f"a photo in {images} for each pose; there are {first_of(photos.values())}",
            fix="download the photos again; names agree up to their first point",
        )
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
    return PosedLines(PosedPhotos(names, lenses, taken), unposed, tuple(notes))


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
        raise CameraError(
            "photos without a camera, of another shape than theirs, or cameras with distortion",
            where=path,
            expected="name PINHOLE width height fx fy cx cy, a line for each photo with a pose",
            fix="use the images that belong to this file, or download it again",
        )
    matrices = np.zeros((len(rows), 3, 3))
    matrices[:, [0, 1], [0, 1]] = lens[:, :2] * scale
    matrices[:, :2, 2] = lens[:, 2:] * scale
    matrices[:, 2, 2] = 1.0
    width, height = size.astype(np.int64).T
    cameras = Cameras.from_matrices(matrices, width, height, names=photos)
    scaled = bool((scale != 1.0).any())
    return cameras, ["cameras were scaled to the photos' size"] if scaled else []

"""Photos whose cameras and poses are lines of text.

AerialExtreMatch and the reconstruction sites of AirZoo-Real are written so: ``name qw qx qy qz tx
ty tz``, quaternion and translation of the world-to-camera pose in a projected CRS, and ``name
PINHOLE width height fx fy cx cy``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.scenes import PosedPhotos
from airzoo_bench.datasets.tables import Table, read_lines
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m

_QUATERNION = ("qw", "qx", "qy", "qz")
_TRANSLATION = ("tx", "ty", "tz")
_SIZE, _LENS = ("width", "height"), ("fx", "fy", "cx", "cy")
_MOST_PX = 1e6
_MOST_ABSENT = 0.01  # of the poses may lack a photo; more is a download that is not complete

Key = Callable[[str], str]


@dataclass(frozen=True, eq=False)
class PosedLines:
    """Photos with a camera and a pose each, names of those without, and notes."""

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

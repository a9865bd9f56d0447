"""Photos whose cameras and poses are lines of text.

AerialExtreMatch and the reconstruction sites of AirZoo-Real are written so: ``name qw qx qy qz tx
ty tz``, quaternion and translation of the world-to-camera pose in a projected CRS, and ``name
PINHOLE width height fx fy cx cy``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_tables import NativeTable, read_lines
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m

__all__ = [
    "CameraLines",
    "PoseLines",
    "PosedFiles",
    "posed_files",
    "read_camera_lines",
    "read_pose_lines",
]

_QUATERNION = ("qw", "qx", "qy", "qz")
_TRANSLATION = ("tx", "ty", "tz")
_SIZE = ("width", "height")
_LENS = ("fx", "fy", "cx", "cy")
_MOST_PX = 1e6
_MOST_ABSENT = 0.01  # of the poses may lack a photo; more is a download that is not complete

Key = Callable[[str], str]


@dataclass(frozen=True, eq=False)
class PoseLines:
    """Poses of N images by the key of their names.

    Attributes
    ----------
    path : Path
    keys : tuple of N str
        Each once.
    poses : Poses
    rounding_m : (N,) array
        By how much the digits of the file may have moved each camera.
    """

    path: Path
    keys: tuple[str, ...]
    poses: Poses
    rounding_m: Floats

    @property
    def digits_note(self) -> tuple[str, ...]:
        """Say by how much the file's digits move cameras, where it is over a centimetre."""
        worst = float(self.rounding_m.max())
        if worst <= COARSEST_M:
            return ()
        return (
            f"{self.path.name}: its digits fix camera centres to about {worst:.2g} m only, the "
            "accuracy of this truth at best",
        )


@dataclass(frozen=True, eq=False)
class CameraLines:
    """Pinhole cameras of N images by the key of their names.

    Attributes
    ----------
    path : Path
    keys : tuple of N str
        Each once.
    size : (N, 2) array
        Width and height, as the file states them.
    lens : (N, 4) array
        fx fy cx cy in pixels of that size.
    """

    path: Path
    keys: tuple[str, ...]
    size: Floats
    lens: Floats

    def cameras(self, keys: Sequence[str], sizes: Sequence[tuple[int, int]]) -> Cameras:
        """Return the cameras of some images, scaled to the size that these have."""
        place = {key: row for row, key in enumerate(self.keys)}
        rows = [place[key] for key in keys]
        size = np.array(sizes, dtype=np.int64).reshape(-1, 2)
        scale = size / self.size[rows]
        # A side that was rounded to whole pixels is off by half a pixel at most.
        apart = np.abs(scale[:, :1] * self.size[rows] - size).max(axis=1)
        odd = [
            f"{keys[i]} is {size[i, 0]}x{size[i, 1]}, its camera {_whole(self.size[rows[i]])}"
            for i in np.flatnonzero(apart > 1.0).tolist()
        ]
        if odd:
            raise CameraError(
                f"cameras of another shape than the images: {first_of(odd, len(keys))}",
                where=self.path,
                expected="sides in the same ratio",
                fix="use the images that belong to this file",
            )
        focal, centre = np.split(self.lens[rows], 2, axis=1)
        matrices = np.zeros((len(rows), 3, 3))
        matrices[:, [0, 1], [0, 1]] = focal * scale
        matrices[:, :2, 2] = centre * scale
        matrices[:, 2, 2] = 1.0
        distortion = np.zeros((len(rows), 5))
        return Cameras.from_matrices(matrices, size[:, 0], size[:, 1], distortion, names=keys)


def read_pose_lines(path: Path, key: Key, axes: Sequence[float] = (1.0, 1.0, 1.0)) -> PoseLines:
    """Read ``name qw qx qy qz tx ty tz``, world-to-camera."""
    table = read_lines(path, ("name", *_QUATERNION, *_TRANSLATION))
    keys = _keys(table, key)
    wxyz = _columns(table, _QUATERNION, -2.0, 2.0)
    translation = _columns(table, _TRANSLATION)
    try:
        rotation = quaternion_to_matrix(wxyz, keys)
        rounding = pose_errors_m(rotation, translation, wxyz)
        signs = np.asarray(axes, dtype=np.float64)
        poses = Poses.from_translations(signs[:, None] * rotation, signs * translation, keys)
    except CameraError as error:
        raise error.inside(path) from error
    return PoseLines(path, keys, poses, rounding)


def read_camera_lines(path: Path, key: Key) -> CameraLines:
    """Read ``name PINHOLE width height fx fy cx cy``."""
    table = read_lines(path, ("name", "model", *_SIZE, *_LENS))
    other = sorted({model for model in table.texts("model") if model != "PINHOLE"})
    if other:
        raise CameraError(
            f"camera models: {first_of(other)}",
            where=path,
            expected="name PINHOLE width height fx fy cx cy in each line",
            fix="download the file again; cameras with distortion are not read from such a file",
        )
    size, lens = _columns(table, _SIZE, 1.0, _MOST_PX), _columns(table, _LENS, 1e-3, _MOST_PX)
    return CameraLines(path, _keys(table, key), size, lens)


@dataclass(frozen=True, eq=False)
class PosedFiles:
    """N photos with a camera and a pose each.

    Attributes
    ----------
    keys, names : tuple of N str
        `names` are those of the files.
    sizes : tuple of N (width, height)
    cameras : Cameras
        For these sizes.
    poses : Poses
    unposed : tuple of str
        Names of photos without a pose.
    notes : tuple of str
    """

    keys: tuple[str, ...]
    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    cameras: Cameras
    poses: Poses
    unposed: tuple[str, ...]
    notes: tuple[str, ...]


def posed_files(
    images: Path,
    photos: Mapping[str, str],
    lines: PoseLines,
    lenses: CameraLines,
    progress: Progress,
) -> PosedFiles:
    """Put photos, poses and cameras together by their keys."""
    row = {key: place for place, key in enumerate(lines.keys)}
    keys = tuple(key for key in photos if key in row)
    absent = [key for key in lines.keys if key not in photos]
    if not keys or len(absent) > _MOST_ABSENT * len(lines.keys):
        raise BenchmarkError(
            f"photos of its poses are missing: {first_of(absent, len(lines.keys))}",
            where=lines.path,
            expected=f"a photo in {images} for each pose; there are {first_of(photos.values())}",
            fix="download the photos again; names agree up to their first point",
        )
    lacking = [key for key in keys if key not in set(lenses.keys)]
    if lacking:
        raise CameraError(
            f"no camera for {first_of(lacking, len(keys))}",
            where=lenses.path,
            expected="a line for each photo with a pose",
            fix="download the file again",
        )
    names = tuple(photos[key] for key in keys)
    sizes = tuple(photo_size(images / name) for name in progress(names, "photos", len(names)))
    left = f"poses without a photo, left aside: {first_of(absent, len(lines.keys))}"
    return PosedFiles(
        keys,
        names,
        sizes,
        lenses.cameras(keys, sizes),
        lines.poses.take(np.array([row[key] for key in keys])),
        tuple(name for key, name in photos.items() if key not in row),
        (*([left] if absent else []), *lines.digits_note),
    )


def _columns(
    table: NativeTable, names: Sequence[str], least: float = -1e9, most: float = 1e9
) -> Floats:
    return np.stack([table.numbers(name, least, most) for name in names], axis=1)


def _keys(table: NativeTable, key: Key) -> tuple[str, ...]:
    keys = tuple(key(name) for name in table.texts("name"))
    twice = [name for name, count in Counter(keys).items() if count > 1]
    if twice:
        raise BenchmarkError(
            f"images with two lines: {first_of(map(repr, twice), len(keys))}",
            where=table.path,
            expected="a line an image",
            fix="download the file again",
        )
    return keys


def _whole(size: Floats) -> str:
    return "x".join(f"{side:g}" for side in size)

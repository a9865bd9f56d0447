"""Cameras and poses as Mega-NeRF publishes them: a file of tensors for each photo.

Its world has the axes down, right and back, less an origin and divided by a scale; its cameras
have NeRF's axes, right, up and back (scripts/colmap_to_mega_nerf.py in cmusatyalab/mega-nerf).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.posed_photos import PosedPhotos, check_centred
from airzoo_bench.datasets.published.places import folder_content
from airzoo_bench.datasets.published.reconstructions import photos_by_stem, stem_of
from airzoo_bench.formats.torch_files import read_tensors
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

__all__ = ["COORDINATES", "mega_nerf_photos", "read_mega_nerf"]

COORDINATES = "coordinates.pt"
_PARTS = ("train", "val")
_LAYOUT = "coordinates.pt, and metadata/*.pt with rgbs/* in train and val"
# The axes down, right and back become those of the COLMAP model; the matrix is its own inverse.
_TO_COLMAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_TO_OPENCV = np.array([1.0, -1.0, -1.0])


def mega_nerf_photos(folder: Path) -> dict[str, Path]:
    """Return the file of each photo, by the photo's path relative to the folder."""
    found: dict[str, Path] = {}
    for part in _PARTS:
        home = folder / part / "metadata"
        files = sorted(home.glob("*.pt")) if home.is_dir() else []
        if not files:
            raise BenchmarkError(
                f"holds no .pt file: {folder_content(home)}",
                where=home,
                expected=_LAYOUT,
                fix="unpack the archive of poses again",
            )
        photos = photos_by_stem(folder / part / "rgbs", f"{_LAYOUT}; copy_images.py makes them")
        missing = [file.name for file in files if stem_of(file.stem) not in photos]
        if missing:
            raise BenchmarkError(
                f"poses without a photo: {first_of(missing, len(files))}",
                where=folder / part / "rgbs",
                fix="let Mega-NeRF's copy_images.py finish",
            )
        found |= {f"{part}/rgbs/{photos[stem_of(file.stem)]}": file for file in files}
    return found


def read_mega_nerf(
    folder: Path, photos: dict[str, Path], names: Iterable[str], progress: Progress
) -> PosedPhotos:
    """Read the cameras and poses of some photos, in metres and the axes of the COLMAP model."""
    chosen = tuple(names)
    stated = read_tensors(folder / COORDINATES)
    where = folder / COORDINATES
    origin = _array(stated, "origin_drb", (3,), where)
    scale = float(_array(stated, "pose_scale_factor", (), where))
    if not 0.0 < scale < np.inf:
        raise BenchmarkError(f"pose_scale_factor is {scale:g}", where=where, expected="above 0")
    parts = [
        _photo(photos[name], photo_size(folder / name))
        for name in progress(chosen, folder.name, len(chosen))
    ]
    matrices, bent, sizes, to_world = (np.array(values) for values in zip(*parts, strict=True))
    centres: Floats = (to_world[:, :, 3] * scale + origin) @ _TO_COLMAP.T
    rotations: Floats = np.swapaxes(_TO_COLMAP @ to_world[:, :, :3] * _TO_OPENCV, 1, 2)
    try:
        width, height = sizes.T
        cameras = Cameras.from_matrices(matrices, width, height, bent, names=chosen)
        poses = Poses.from_centres(rotations, centres, chosen)
    except CameraError as error:
        raise error.inside(folder) from error
    photographed = PosedPhotos(chosen, cameras, poses, None)
    check_centred(photographed, folder)
    return photographed


def _photo(path: Path, size: tuple[int, int]) -> tuple[Any, ...]:
    """Return K, distortion, size and camera-to-world (3, 4) of a photo."""
    stated = read_tensors(path)
    width, height = (int(_array(stated, key, (), path)) for key in ("W", "H"))
    if (width, height) != size:
        raise CameraError(
            f"its photo is {size[0]}x{size[1]} px, not {width}x{height}",
            where=path,
            fix="use the photos that copy_images.py makes",
        )
    fx, fy, cx, cy = _array(stated, "intrinsics", (4,), path)
    matrix = ((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0))
    return matrix, (0.0,) * 5, size, _array(stated, "c2w", (3, 4), path)


def _array(
    stated: dict[str, Any], key: str, shape: tuple[int, ...], path: Path
) -> NDArray[np.float64]:
    """Return a value as numbers of a shape; a number in a row of one is a number."""
    if key not in stated:
        raise BenchmarkError(
            f"lacks {key!r}; it has {', '.join(map(str, stated))[:200]}",
            where=path,
            expected="what Mega-NeRF's README names",
        )
    value = np.asarray(stated[key])
    numeric = value.dtype.kind in "fiu"
    if numeric and shape == () and value.size == 1:
        value = value.reshape(())
    if not numeric or value.shape != shape or not np.isfinite(value).all():
        raise BenchmarkError(
            f"{key!r} is {value.dtype} of shape {value.shape}",
            where=path,
            expected=f"finite numbers of shape {shape}",
        )
    return value.astype(np.float64)

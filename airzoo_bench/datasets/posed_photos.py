"""Photos with cameras and poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

__all__ = ["PosedPhotos", "check_centred"]

_OFF_CENTRE = 0.2  # a matrix for photos of half the size has its principal point 0.25 off


@dataclass(frozen=True)
class PosedPhotos:
    """N photos with cameras and poses.

    Attributes
    ----------
    names : tuple of str
        File names, relative to the folder of the photos.
    cameras : Cameras
    poses : Poses
        In `crs`.
    crs : str or None
        Projected CRS in metres, where the file names it.
    """

    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str | None


def check_centred(photos: PosedPhotos, path: Path) -> None:
    """Refuse cameras whose principal point is far from the middle of the photo."""
    size = np.stack([photos.cameras.width, photos.cameras.height], axis=1)
    off: NDArray[np.float64] = np.abs(photos.cameras.principal_point / size - 0.5)
    bad = np.flatnonzero((off > _OFF_CENTRE).any(axis=1))
    if bad.size:
        row = bad[0]
        cx, cy = photos.cameras.principal_point[row]
        named = first_of([photos.names[i] for i in bad], len(photos.names))
        raise CameraError(
            f"camera matrices of another image size: {named}; "
            f"the first is {size[row, 0]}x{size[row, 1]} px, with the principal point at "
            f"({cx:.1f}, {cy:.1f})" + _sizes_of(photos, size),
            where=path,
            expected="a principal point near the middle of the photo",
            fix="scale K to the size of the photos; photos of several cameras need a K each (in "
            "their entry of 'images'), or a benchmark for each camera, from a folder of its own",
        )


def _sizes_of(photos: PosedPhotos, size: NDArray[np.int64]) -> str:
    """List the photos by size, where there are several sizes."""
    found = sorted({(int(width), int(height)) for width, height in size})
    groups = [
        f"{width}x{height} px: "
        + first_of(photos.names[i] for i in np.flatnonzero((size == (width, height)).all(axis=1)))
        for width, height in found
    ]
    return f"; photos of {len(found)} cameras: {', '.join(groups)}" if len(found) > 1 else ""

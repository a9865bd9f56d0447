"""The two files of a frame: its photo and its depth, each carrying what it was made from.

Photos are JPEG of quality 92 without chroma subsampling: what drones store, a fifth of the bytes
of PNG, which could not compress the sensor's noise, and some 20 times as fast to write. Depth is
TIFF of 32-bit floats, compressed without loss.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.files import atomic_write
from airzoo_bench.mini.render import Frame

__all__ = [
    "DEPTH_SUFFIX",
    "IMAGE_SUFFIX",
    "frame_paths",
    "is_complete",
    "read_depth",
    "write_frame",
]

IMAGE_SUFFIX = ".jpg"
DEPTH_SUFFIX = ".tif"

_QUALITY = 92
_END_OF_JPEG = b"\xff\xd9"
_DESCRIPTION_TAG = 270
_PREDICTOR_TAG = 317
_FLOATING_POINT = 3


def frame_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """Return where a frame's photo and depth stand."""
    image = folder / "images" / f"{name}{IMAGE_SUFFIX}"
    return image, folder / "depth" / f"{name}{DEPTH_SUFFIX}"


def write_frame(folder: Path, name: str, frame: Frame, fingerprint: str) -> None:
    """Write a frame's files, each whole or not at all.

    Parameters
    ----------
    folder : Path
    name : str
    frame : Frame
    fingerprint : str
        Of what the frame was made from; kept in the files themselves, as the JPEG's comment and
        the TIFF's description.

    Raises
    ------
    UserError
        A file cannot be written, or the disk is full.
    """
    from PIL import Image

    image, depth = frame_paths(folder, name)
    with atomic_write(depth) as stream:
        Image.fromarray(frame.depth).save(
            stream,
            format="TIFF",
            compression="tiff_adobe_deflate",
            tiffinfo={_PREDICTOR_TAG: _FLOATING_POINT, _DESCRIPTION_TAG: fingerprint},
        )
    with atomic_write(image) as stream:
        Image.fromarray(frame.rgb).save(
            stream, format="JPEG", quality=_QUALITY, subsampling=0, comment=fingerprint
        )


def is_complete(folder: Path, name: str, fingerprint: str) -> bool:
    """Say whether both files of a frame are there, whole, and made from the same as now."""
    image, depth = frame_paths(folder, name)
    return _image_mark(image) == fingerprint and _depth_mark(depth) == fingerprint


def _image_mark(path: Path) -> str | None:
    from PIL import Image

    try:
        with path.open("rb") as stream:
            stream.seek(-len(_END_OF_JPEG), 2)
            if stream.read() != _END_OF_JPEG:
                return None
        with Image.open(path) as image:
            comment = image.info.get("comment", b"")
    except OSError:
        return None
    return comment.decode("ascii", "replace") if isinstance(comment, bytes) else None


def _depth_mark(path: Path) -> str | None:
    from PIL import Image, TiffImagePlugin

    try:
        with Image.open(path, formats=["TIFF"]) as image:
            if not isinstance(image, TiffImagePlugin.TiffImageFile):
                return None
            described = image.tag_v2.get(_DESCRIPTION_TAG)
    except (OSError, SyntaxError):
        return None
    return str(described)


def read_depth(path: Path) -> NDArray[np.float32]:
    """Read a frame's depth, (H, W) metres along the optical axis, 0 where there is no surface."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image, np.float32)

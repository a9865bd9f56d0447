"""An image made smaller and turned by quarters, and the way back for its pixels."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.sift import Grey

__all__ = ["resample"]


def resample(grey: Grey, scale: float, turn_deg: float) -> tuple[Grey, Floats]:
    """Make an image smaller, then turn it so that what pointed to `turn_deg` points right.

    Parameters
    ----------
    grey : (H, W) uint8 array
    scale : float
        At most 1; width and height become whole numbers, each with its own scale.
    turn_deg : float
        Clockwise from the image's right; the nearest quarter turn is taken.

    Returns
    -------
    resampled : (h, w) uint8 array
    back : (2, 3) array
        Takes its pixels to those of `grey`; corners are (0, 0).
    """
    from PIL import Image

    full = np.array(grey.shape[::-1], dtype=np.float64)
    size = np.maximum(np.round(full * scale), 1.0)
    small = Image.fromarray(grey).resize((int(size[0]), int(size[1])), Image.Resampling.LANCZOS)
    quarters = round(turn_deg / 90.0) % 4
    cos, sin = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters]
    axes = np.array(((cos, -sin), (sin, cos)))
    back = np.column_stack((axes, size / 2.0 - axes @ (np.abs(axes).T @ size / 2.0)))
    turned = np.ascontiguousarray(np.rot90(np.asarray(small), quarters))
    return turned, back * (full / size)[:, None]

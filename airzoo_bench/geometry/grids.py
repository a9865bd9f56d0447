"""Pixel grids: continuous pixel coordinates to coordinates of a CRS and back.

Column comes before row; the raster's corner is (0, 0), the centre of its first pixel (0.5, 0.5).
A transform is an affine.Affine or a sequence (a, b, c, d, e, f):

    x = a column + b row + c,   y = d column + e row + f
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.geometry.arrays import Floats

__all__ = ["pixel_to_world", "world_to_pixel", "world_to_pixel_steps"]


def pixel_to_world(transform: Any, colrow: ArrayLike) -> Floats:
    """Take pixel coordinates to the raster's CRS.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    colrow : (..., 2) array
        Continuous; (0.5, 0.5) is the centre of the first pixel.

    Returns
    -------
    (..., 2) array
        x before y.
    """
    a, b, c, d, e, f = transform[:6]
    points = np.asarray(colrow, dtype=np.float64)
    column, row = points[..., 0], points[..., 1]
    return np.stack((a * column + b * row + c, d * column + e * row + f), axis=-1)


def world_to_pixel(transform: Any, xy: ArrayLike) -> Floats:
    """Take coordinates (..., 2) of the raster's CRS to pixels; the inverse of `pixel_to_world`.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    xy : (..., 2) array
        x before y.

    Returns
    -------
    (..., 2) array
        Column and row, continuous.
    """
    _, _, c, _, _, f = transform[:6]
    # The origin goes first: carried through the inverse, its millions of metres cost digits.
    return world_to_pixel_steps(transform, np.asarray(xy, dtype=np.float64) - (c, f))


def world_to_pixel_steps(transform: Any, steps: Floats) -> Floats:
    """Take differences (..., 2) of world coordinates to differences in pixels.

    Parameters
    ----------
    transform : affine.Affine or sequence of 6 float
        The raster's geotransform a b c d e f.
    steps : (..., 2) array
        x before y.

    Returns
    -------
    (..., 2) array
        Columns and rows.
    """
    a, b, _, d, e, _ = transform[:6]
    x, y = steps[..., 0], steps[..., 1]
    determinant = a * e - b * d
    return np.stack(((e * x - b * y) / determinant, (a * y - d * x) / determinant), axis=-1)

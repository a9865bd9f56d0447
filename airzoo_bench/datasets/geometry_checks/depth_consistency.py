"""Compares the depth of one frame with that of another: back-project, re-project, subtract.

A pixel of the source becomes a point by its depth, the point goes into the target's camera, and its
depth there, z_projected, is held against the depth z_depth of the target's surface at that pixel:

    error = (z_projected - z_depth) / z_depth

**z_depth between pixels.** On a plane 1/z, not z, is affine in pixels of a camera without
distortion; so 1/z is interpolated (bilinear over the four pixel centres around), which is exact on
planes at any slant. Where the pixels around are not one smooth surface there is nothing to compare
with: the second differences of 1/z along rows and columns, zero on any plane, must stay below
`EDGE` of it. This looks at the target's depth alone, never at the error, and so hides no fault.

**Occlusion.** A point *behind* the target's surface by more than `OCCLUSION` is hidden from the
target, and left out. A point in front is never left out: nothing can hide it. Hence what is wrong
in one direction beyond the tolerance is seen from the other: a map whose depths are too long throws
its points behind its neighbour's surface, but finds the neighbour's points in front of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.geometry_checks.depth_frames import Frame
from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import back_project, project

__all__ = ["EDGE", "OCCLUSION", "Comparison", "compare_depths"]

EDGE = 0.01
"""Where 1/z bends by more than this share of it from pixel to pixel, there is an edge."""

OCCLUSION = 0.01
"""A point that lies behind the surface by more than this share of its depth is hidden."""

_AROUND = np.arange(-1, 3)


@dataclass(frozen=True, eq=False)
class Comparison:
    """The points of a source frame in a target frame.

    Attributes
    ----------
    sampled : int
        Pixels of the source that have a depth. Each is one of the next four, or compared:
    outside : int
        Outside the target's image, or less than two pixels from its border.
    no_surface : int
        Where the target has no depth, or an edge.
    hidden : int
        Behind the target's surface.
    error : (M,) float64
        The signed relative error of those that are compared.
    """

    sampled: int
    outside: int
    no_surface: int
    hidden: int
    error: Floats


def compare_depths(source: Frame, target: Frame) -> Comparison:
    """Compare the sampled points of a source frame with the depth of a target frame."""
    turn = target.rotation @ source.rotation.T
    # Centres are subtracted first: they may be millions of metres, their difference is not.
    shift = apply_matrix(target.rotation, source.centre - target.centre)
    projected = apply_matrix(turn, source.points) + shift
    pixels = project(target.camera, projected[None])[0]
    inside = _inside(pixels, target.depth.shape)
    surface, on_surface = _surface_planes(target, pixels[inside], projected[inside])
    rows = np.flatnonzero(inside)[on_surface]
    surface = surface[on_surface]
    # The plane n of the surface holds n . X = 1 for its points X.
    error = (surface * projected[rows]).sum(axis=1) - 1.0
    seen = error <= OCCLUSION
    return Comparison(
        sampled=len(source.points),
        outside=int((~inside).sum()),
        no_surface=int((~on_surface).sum()),
        hidden=int((~seen).sum()),
        error=error[seen],
    )


def _inside(pixels: Floats, shape: tuple[int, ...]) -> Bools:
    """Tell pixels (S, 2) with a whole block of 4 x 4 pixel centres around them; NaN has none."""
    height, width = shape
    with np.errstate(invalid="ignore"):
        low = (pixels >= 1.5).all(axis=1)
        inside: Bools = low & (pixels[:, 0] < width - 1.5) & (pixels[:, 1] < height - 1.5)
    return inside


def _surface_planes(target: Frame, pixels: Floats, projected: Floats) -> tuple[Floats, Bools]:
    """Tangent planes (M, 3) of the target's surface at pixels (M, 2), and which are sound (M,)."""
    corner = np.floor(pixels - 0.5).astype(np.int64)
    inverse = _inverse_depths(target, corner)
    smooth = _smooth(inverse)
    a, b, c, d = np.moveaxis(inverse[:, 1:3, 1:3].reshape(-1, 4), 1, 0)
    x, y = (pixels - 0.5 - corner).T
    value = (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d)
    slope_x = ((1 - y) * (b - a) + y * (d - c)) * target.camera.focal[0, 0]
    slope_y = ((1 - x) * (c - a) + x * (d - b)) * target.camera.focal[0, 1]
    px, py = (projected[:, :2] / projected[:, 2:]).T
    planes = np.stack((slope_x, slope_y, value - slope_x * px - slope_y * py), axis=-1)
    return planes, smooth


def _inverse_depths(target: Frame, corner: Ints) -> Floats:
    """1/z of the 4 x 4 pixels around, (M, 4, 4); `corner` is the upper left of the inner four."""
    row = corner[:, 1, None, None] + _AROUND[:, None]
    column = corner[:, 0, None, None] + _AROUND
    depth: NDArray[np.float64] = target.depth[row, column].astype(np.float64)
    if target.kind is DepthKind.RAY:
        pixels = np.stack(np.broadcast_arrays(column, row), axis=-1).reshape(1, -1, 2) + 0.5
        depth *= back_project(target.camera, pixels)[0, :, 2].reshape(depth.shape)
    return 1.0 / depth


def _smooth(inverse: Floats) -> Bools:
    """Tell which blocks (M, 4, 4) of 1/z are one smooth surface; NaN is none."""
    along_rows = np.abs(np.diff(inverse[:, 1:3], n=2, axis=2)).max(axis=(1, 2))
    along_columns = np.abs(np.diff(inverse[:, :, 1:3], n=2, axis=1)).max(axis=(1, 2))
    level = inverse[:, 1:3, 1:3].mean(axis=(1, 2))
    smooth: Bools = np.maximum(along_rows, along_columns) <= EDGE * level
    return smooth

"""Which triangle is on top at each pixel, and how high."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.landscape.shapes import Raster
from airzoo_bench.mini.world import Mesh

__all__ = ["NOTHING", "Layer", "seen_from_above", "sun_cosine"]

NOTHING = -1_000.0
_BLOCK = 1 << 20


@dataclass(frozen=True, eq=False)
class Layer:
    """The top of a mesh.

    Attributes
    ----------
    height : (n, n) float64 or float32
        `NOTHING` where there is none.
    triangle : (n, n) int32
        -1 where there is none.
    """

    height: NDArray[np.floating]
    triangle: NDArray[np.int32]


def seen_from_above(mesh: Mesh, raster: Raster, chosen: Bools) -> Layer:
    """Find the highest of some triangles on the vertical line through each pixel centre.

    Of a closed mesh only triangles that face up can be on top; the others are passed over.

    Parameters
    ----------
    mesh : Mesh
    raster : Raster
    chosen : (T,) bool

    Returns
    -------
    Layer
    """
    numbers = np.flatnonzero(chosen)
    corners = mesh.vertices[mesh.triangles[numbers]]
    slope, up = _planes(corners)
    numbers, corners, slope = numbers[up], corners[up], slope[up]
    height = np.full(raster.size * raster.size, NOTHING)
    triangle = np.full(raster.size * raster.size, -1, np.int32)
    for which, pixel, x, y in _candidates(corners, raster):
        inside = _inside(corners[which], x, y)
        which, pixel, x, y = which[inside], pixel[inside], x[inside], y[inside]
        first = corners[which, 0]
        z = first[:, 2] + slope[which, 0] * (x - first[:, 0]) + slope[which, 1] * (y - first[:, 1])
        np.maximum.at(height, pixel, z)
        best = z == height[pixel]
        triangle[pixel[best]] = numbers[which[best]]
    shape = (raster.size, raster.size)
    return Layer(height.reshape(shape), triangle.reshape(shape))


def _planes(corners: Floats) -> tuple[Floats, Bools]:
    """Slopes east and north of triangles, and which of them face up."""
    normal = _normals(corners)
    up = normal[:, 2] > 1e-9
    safe = np.where(up, normal[:, 2], 1.0)
    return -normal[:, :2] / safe[:, None], up


def _normals(corners: Floats) -> Floats:
    # Not np.cross, whose order of operations is not promised.
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    return np.stack([x, y, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], 1)


def _candidates(
    corners: Floats, raster: Raster
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats, Floats]]:
    """Yield pairs of triangle and pixel whose boxes meet, in blocks of bounded size."""
    size, pixel = raster.size, raster.pixel_m
    low, high = corners[..., :2].min(axis=1) / pixel, corners[..., :2].max(axis=1) / pixel
    first = np.maximum(np.ceil(low - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(high - 0.5), size - 1).astype(np.int64)
    wide, tall = np.maximum(last - first + 1, 0).T
    counts = wide * tall
    ends = np.cumsum(counts)
    start = 0
    while start < len(counts):
        done = int(ends[start - 1]) if start else 0
        stop = max(int(np.searchsorted(ends, done + _BLOCK, side="right")), start + 1)
        which = np.repeat(np.arange(start, stop), counts[start:stop])
        place = np.arange(len(which)) - (ends[which] - counts[which] - done)
        north, east = np.divmod(place, np.maximum(wide[which], 1))
        column, row = first[which, 0] + east, first[which, 1] + north
        yield (
            which,
            (size - 1 - row) * size + column,
            (column + 0.5) * pixel,
            (row + 0.5) * pixel,
        )
        start = stop


def _inside(corners: Floats, x: Floats, y: Floats) -> Bools:
    inside = np.ones(x.shape, np.bool_)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        x0, y0 = corners[:, i, 0], corners[:, i, 1]
        x1, y1 = corners[:, j, 0], corners[:, j, 1]
        inside &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= -1e-9
    return inside


def sun_cosine(mesh: Mesh, sun: tuple[float, float, float]) -> NDArray[np.float32]:
    """Return the cosine between each triangle's normal and the sun, at least 0; (T,)."""
    normal = _normals(mesh.vertices[mesh.triangles])
    x, y, z = normal.T
    length = np.sqrt(x * x + y * y + z * z)
    along = x * sun[0] + y * sun[1] + z * sun[2]
    return np.asarray(np.maximum(along / np.maximum(length, 1e-12), 0.0).astype(np.float32))

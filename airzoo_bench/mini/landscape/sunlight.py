"""Cast shadows on a raster of heights, and the lighting of albedo."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.mini.light import Light

__all__ = ["lit", "sunlit"]

# Heights in integers of this many to the metre.
_UNITS = 1024
_BIAS, _SOFT = 200, 512
_FAR_STEPS = 512


def sunlit(heights: NDArray[np.floating], light: Light, pixel_m: float) -> NDArray[np.uint8]:
    """Return how much of the sun reaches each pixel, 0 to 255.

    Rows are shifted so that the sun lies straight along the columns; then the height of the shadow
    that all pixels within 1, 2, 4 ... steps cast is found by doubling, in integers throughout.

    Parameters
    ----------
    heights : (n, n) array
        Metres, first row in the north.
    light : Light
        The sun must lie nearer to north or south than to east or west, or just between.
    pixel_m : float
    """
    east, north, up = light.direction
    towards = 1 if north > 0 else -1
    drop = round(_UNITS * pixel_m * up / abs(north))
    # The map shear keeps `column + offset` while going one row towards the sun.
    offsets = _offsets(len(heights), towards * east / abs(north))
    low = np.floor(np.asarray(heights, np.float64) * _UNITS).astype(np.int32)
    shadow = _sheared(low, offsets)
    steps = 1
    while steps <= _FAR_STEPS:
        if towards > 0:
            np.maximum(shadow[steps:], shadow[:-steps] - drop * steps, out=shadow[steps:])
        else:
            np.maximum(shadow[:-steps], shadow[steps:] - drop * steps, out=shadow[:-steps])
        steps *= 2
    depth = _unsheared(shadow, offsets, len(heights)) - low - _BIAS
    dark = np.clip(depth * 255 // _SOFT, 0, 255)
    return np.asarray((255 - dark).astype(np.uint8))


def _offsets(size: int, slope: float) -> NDArray[np.int64]:
    rows = np.arange(size)
    offsets = np.floor(rows * slope + 0.5).astype(np.int64)
    return np.asarray(offsets - offsets.min())


def _sheared(low: NDArray[np.int32], offsets: NDArray[np.int64]) -> NDArray[np.int32]:
    size = len(low)
    wide = np.full((size, size + int(offsets.max())), -(1 << 29), np.int32)
    for row, offset in enumerate(offsets.tolist()):
        wide[row, offset : offset + size] = low[row]
    return wide


def _unsheared(wide: NDArray[np.int32], offsets: NDArray[np.int64], size: int) -> NDArray[np.int32]:
    rows = [wide[row, offset : offset + size] for row, offset in enumerate(offsets.tolist())]
    return np.stack(rows)


def lit(
    albedo: NDArray[np.uint8],
    cosine: NDArray[np.float32],
    visible: NDArray[np.uint8],
    light: Light,
) -> NDArray[np.uint8]:
    """Light a map: see `mini.light`.

    Parameters
    ----------
    albedo : (n, n, 3) uint8
    cosine : (n, n) float32
        Between the surface and the sun, at least 0.
    visible : (n, n) uint8
        From `sunlit`.
    light : Light
    """
    sun = cosine * (visible.astype(np.float32) * np.float32(1 / 255))
    result = np.empty_like(albedo)
    for channel in range(3):
        factor = sun * np.float32(light.sun[channel])
        factor += np.float32(light.sky[channel])
        factor *= albedo[..., channel]
        factor += np.float32(0.5)
        result[..., channel] = np.minimum(factor, np.float32(255)).astype(np.uint8)
    return result

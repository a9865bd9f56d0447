"""Colours of a square of land as a texture: filtered to the size of the pixel that sees it.

A texel is one 64-bit number of four 16-bit lanes (red, green, blue and one more). Weights of a
bilinear mean add up to 256, so that a lane never carries into the next and one multiplication
serves all four.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.mini.pixel_noise import Singles, floor_log2

__all__ = ["Texture", "mirrored"]

_LANE_SCALE = np.float32(1.0 / (255.0 * 256.0))
_MOST_LEVELS = 8


@dataclass(frozen=True, eq=False)
class Texture:
    """A square image and its halvings.

    Attributes
    ----------
    texels : (sum of level sizes,) uint64
    offsets, sizes : (levels,) int64
        Where each level starts, and how many texels a side it has.
    side_m : float
        Length of the square on the ground.
    gsd_m : float
        Size of a texel of the finest level.
    """

    texels: NDArray[np.uint64]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    side_m: float
    gsd_m: float

    @classmethod
    def of(cls, lanes: NDArray[np.uint8], side_m: float) -> Texture:
        """Make a texture.

        Parameters
        ----------
        lanes : (n, n, 4) uint8 array
            First row in the north.
        side_m : float
        """
        levels = [lanes]
        while len(levels) < _MOST_LEVELS and len(levels[-1]) > 4:
            levels.append(_halved(levels[-1]))
        sizes = np.array([len(level) for level in levels], np.int64)
        offsets = np.concatenate(([0], np.cumsum(sizes * sizes)[:-1])).astype(np.int64)
        texels = np.concatenate([_packed(level) for level in levels])
        return cls(texels, offsets, sizes, side_m, side_m / len(lanes))

    def sample(self, x: Singles, y: Singles, footprint_m: Singles, dither: Singles) -> Singles:
        """Return the colour at points of the square.

        Parameters
        ----------
        x, y : (N,) float32 arrays
            Metres east and north of the south-west corner; beyond it the border is repeated.
        footprint_m : (N,) float32 array
            Size of the pixel on the ground.
        dither : (N,) float32 array
            In [0, 1): which of the two nearest levels is taken, so that no line shows where
            one level meets the next.

        Returns
        -------
        (4, N) float32 array
            In 0 to 1.
        """
        level = floor_log2(footprint_m * (1.0 + dither) * np.float32(1.0 / self.gsd_m))
        np.clip(level, 0, len(self.sizes) - 1, out=level)
        size = self.sizes.take(level)
        start = self.offsets.take(level)
        # 256ths of a texel
        scale = (256.0 / self.gsd_m / (1 << np.arange(len(self.sizes)))).astype(np.float32)
        scales = scale.take(level)
        columns, share_x = _split(x * scales, size)
        rows, share_y = _split((np.float32(self.side_m) - y) * scales, size)
        return self._blend(columns, rows, share_x, share_y, size, start)

    def _blend(
        self,
        column: NDArray[np.int64],
        row: NDArray[np.int64],
        share_x: NDArray[np.int64],
        share_y: NDArray[np.int64],
        size: NDArray[np.int64],
        start: NDArray[np.int64],
    ) -> Singles:
        right = column < size - 1
        down = np.where(row < size - 1, size, 0)
        first = start + row * size + column
        both = (share_x * share_y) >> 8
        weights = (256 - share_x - share_y + both, share_x - both, share_y - both, both)
        places = (first, first + right, first + down, first + down + right)
        total = np.zeros(len(first), np.uint64)
        for place, weight in zip(places, weights, strict=True):
            total += self.texels.take(place) * weight.view(np.uint64)
        lanes = total.view(np.uint16).reshape(-1, 4).T
        return lanes.astype(np.float32, order="C") * _LANE_SCALE


def mirrored(x: Singles, side_m: float) -> Singles:
    """Fold coordinates beyond [0, side] back into it, as between two mirrors."""
    side = np.float32(side_m)
    period = 2 * side
    folded: Singles = side - np.abs(x - np.floor(x * (1 / period)) * period - side)
    return folded


def _split(
    position: Singles, size: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    fixed = position.astype(np.int64) - 128
    np.clip(fixed, 0, (size - 1) << 8, out=fixed)
    return fixed >> 8, fixed & 255


def _halved(level: NDArray[np.uint8]) -> NDArray[np.uint8]:
    odd = len(level) % 2
    even = np.pad(level, ((0, odd), (0, odd), (0, 0)), mode="edge").astype(np.uint16)
    total = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
    return ((total + 2) >> 2).astype(np.uint8)


def _packed(level: NDArray[np.uint8]) -> NDArray[np.uint64]:
    return np.ascontiguousarray(level, np.uint16).view(np.uint64).ravel()

"""Value noise in integers: random numbers on a lattice, joined smoothly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.mini.landscape.randomness import hash_of

__all__ = ["Textures", "octaves", "textures", "value_noise"]

_STREAM = 77


def value_noise(seed: int, stream: int, size: int, cell: int) -> NDArray[np.int32]:
    """Smooth noise on a square raster.

    Parameters
    ----------
    seed, stream : int
    size : int
        Pixels a side.
    cell : int
        Pixels between the lattice's points.

    Returns
    -------
    (size, size) int32
        From -2048 to 2047.
    """
    count = size // cell + 2
    index = np.arange(count)
    lattice = hash_of(seed, _STREAM, stream, index[:, None], index[None, :]) >> np.uint64(52)
    values = lattice.astype(np.int32) - 2048
    if cell == 1:
        return values[:size, :size]
    position = np.arange(size)
    low, weight = position // cell, _smoothstep(position % cell, cell)
    rows = _between(values[low], values[low + 1], weight[:, None])
    columns = np.ascontiguousarray(rows.T)
    return np.ascontiguousarray(_between(columns[low], columns[low + 1], weight[:, None]).T)


def _smoothstep(step: NDArray[np.int64], cell: int) -> NDArray[np.int32]:
    # 3t^2 - 2t^3 in units of 1/1024.
    return (1024 * step * step * (3 * cell - 2 * step) // cell**3).astype(np.int32)


def _between(
    low: NDArray[np.int32], high: NDArray[np.int32], weight: NDArray[np.int32]
) -> NDArray[np.int32]:
    high = high - low
    high *= weight
    high >>= 10
    high += low
    return high


def octaves(
    seed: int, stream: int, size: int, cells: dict[int, int], total: int = 16
) -> NDArray[np.int32]:
    """Noise of several scales, ``{cell: weight}`` with the weights over `total`; (size, size)."""
    result = np.zeros((size, size), np.int32)
    for cell, weight in cells.items():
        result += value_noise(seed, stream + cell, size, cell) * np.int32(weight)
    return result // np.int32(total)


@dataclass(frozen=True)
class Textures:
    """Noise that all painters share, each (size, size) int16, from -128 to 127.

    Attributes
    ----------
    fine, middle, coarse : arrays
        Structure of 1 to 3, of 6 to 24, and of 60 to 240 pixels.
    """

    fine: NDArray[np.int16]
    middle: NDArray[np.int16]
    coarse: NDArray[np.int16]


def textures(seed: int, size: int) -> Textures:
    """Make the noise of a raster of `size` pixels a side."""

    def made(stream: int, cells: dict[int, int]) -> NDArray[np.int16]:
        return (octaves(seed, stream, size, cells) >> 4).astype(np.int16)

    return Textures(
        made(1_000, {1: 7, 3: 9}),
        made(2_000, {6: 7, 13: 6, 24: 5}),
        made(3_000, {60: 7, 130: 6, 240: 5}),
    )

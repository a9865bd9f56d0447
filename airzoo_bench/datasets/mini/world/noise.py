"""Randomness by counting, and value noise from it: the same bits on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["GOLDEN", "Dice", "Textures", "direction", "hash_of", "mixed", "octaves", "textures"]

T = TypeVar("T")
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FACTORS = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_MASK = (1 << 64) - 1
_STREAM = 77


def mixed(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Apply the finaliser of SplitMix64 (Steele, Lea and Flood, 2014), in place."""
    for shift, factor in zip((30, 27), _FACTORS, strict=True):
        state ^= state >> np.uint64(shift)
        state *= factor
    state ^= state >> np.uint64(31)
    return state


def hash_of(seed: int, *keys: Any) -> NDArray[np.uint64]:
    """Hash integer keys, which broadcast, to 64 bits; at least one-dimensional."""
    state = np.full((1,), seed & _MASK, np.uint64)
    for key in keys:
        word = key & _MASK if isinstance(key, int) else np.asarray(key).astype(np.int64)
        state = mixed((state ^ np.asarray(word).view(np.uint64)) + GOLDEN)
    return state


def direction(step: int, turn: int = 256) -> tuple[float, float]:
    """Return cosine and sine of a step of the circle, counter-clockwise from east, without a sine.

    The steps are nearly, not exactly, of equal length; `turn` of them, a multiple of 4, go round.
    """
    quarter, rest = divmod(step % turn, turn // 4)
    # The tangent of the half angle runs from 0 to 1; a cubic keeps the steps nearly equal.
    share = rest / (turn // 4)
    tangent = share * (0.7854 + 0.2146 * share * share)
    square = 1.0 + tangent * tangent
    cosine, sine = (1.0 - tangent * tangent) / square, 2.0 * tangent / square
    for _ in range(quarter):
        cosine, sine = -sine, cosine
    return cosine, sine


class Dice:
    """A sequence of random choices, for the layout, where one follows another.

    Parameters
    ----------
    seed : int
    *keys : int
        Name the sequence: others with other keys are independent of it.
    """

    def __init__(self, seed: int, *keys: int) -> None:
        self._start = int(hash_of(seed, *keys)[0])
        self._drawn = 0

    def bits(self) -> int:
        """Return the next 64 bits."""
        self._drawn += 1
        return int(hash_of(self._start, self._drawn)[0])

    def integer(self, low: int, high: int) -> int:
        """Return an integer from low to high, both included."""
        return low + (self.bits() >> 11) % (high - low + 1)

    def real(self, low: float, high: float) -> float:
        """Return a number from low to high, on a grid of 2**-20 of the range."""
        return low + (high - low) * (self.bits() >> 44) / (1 << 20)

    def chance(self, percent: int) -> bool:
        """Return True that often."""
        return self.integer(0, 99) < percent

    def pick(self, items: Sequence[T]) -> T:
        """Return one of the items."""
        return items[self.integer(0, len(items) - 1)]


def value_noise(seed: int, stream: int, size: int, cell: int) -> NDArray[np.int32]:
    """Return smooth noise from -2048 to 2047, (size, size), on a lattice `cell` pixels apart."""
    index = np.arange(size // cell + 2)
    lattice = hash_of(seed, _STREAM, stream, index[:, None], index[None, :]) >> np.uint64(52)
    values = lattice.astype(np.int32) - 2048
    if cell == 1:
        return values[:size, :size]
    low, step = np.divmod(np.arange(size), cell)
    # 3t^2 - 2t^3 in units of 1/1024.
    weight = (1024 * step * step * (3 * cell - 2 * step) // cell**3).astype(np.int32)[:, None]
    rows = _between(values[low], values[low + 1], weight)
    columns = np.ascontiguousarray(rows.T)
    return np.ascontiguousarray(_between(columns[low], columns[low + 1], weight).T)


def _between(
    low: NDArray[np.int32], high: NDArray[np.int32], weight: NDArray[np.int32]
) -> NDArray[np.int32]:
    high = high - low
    high *= weight
    high >>= 10
    high += low
    return high


def octaves(seed: int, stream: int, size: int, cells: dict[int, int]) -> NDArray[np.int32]:
    """Return noise (size, size) of several scales, ``{cell: weight}`` with weights of 16 in all."""
    result = np.zeros((size, size), np.int32)
    for cell, weight in cells.items():
        result += value_noise(seed, stream + cell, size, cell) * np.int32(weight)
    return result // np.int32(16)


@dataclass(frozen=True)
class Textures:
    """Noise that all painters share, each (size, size) int16, from -128 to 127."""

    fine: NDArray[np.int16]  # structure of 1 to 3 pixels
    middle: NDArray[np.int16]  # of 6 to 24
    coarse: NDArray[np.int16]  # of 60 to 240


def textures(seed: int, size: int) -> Textures:
    """Make the noise of a raster of `size` pixels a side."""
    streams = {1_000: {1: 7, 3: 9}, 2_000: {6: 7, 13: 6, 24: 5}, 3_000: {60: 7, 130: 6, 240: 5}}
    return Textures(
        *((octaves(seed, stream, size, c) >> 4).astype(np.int16) for stream, c in streams.items())
    )

"""Randomness by counting, from nothing but a seed and a place, and noise made from it.

Worlds are the same bits on every machine, and no photo depends on the order of frames, the number
of jobs or the size of a block. Seeds are below 2**64, which somebody may try all. The seed of a
sealed edition is a key of more bits: each purpose has a seed of its own, made by SHA-256, which
leads neither to the key nor to the others.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Singles = NDArray[np.float32]
_GOLDEN = 0x9E3779B97F4A7C15
_ROUNDS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
_MASK = (1 << 64) - 1
_STREAM = 77
_VOLUME_BITS = 6


def seed_of(*parts: object) -> int:
    """Return a seed of 64 bits for values, by SHA-256 of their text."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def is_key(seed: int) -> bool:
    """Tell whether a seed is the key of a sealed edition."""
    return seed > _MASK


def hash_of(seed: Any, *keys: Any) -> Any:
    """Hash integers or arrays of them, which broadcast, to 64 bits.

    Each key goes through the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
    """
    for key in keys:
        word = key.astype(np.int64).view(np.uint64) if isinstance(key, np.ndarray) else key & _MASK
        seed = ((seed ^ word) + _GOLDEN) & _MASK
        for shift, factor in _ROUNDS:
            seed = (seed ^ seed >> shift) * factor & _MASK
    return seed


def direction(step: int) -> tuple[float, float]:
    """Return cosine and sine of a step of the circle, counter-clockwise from east, without a sine.

    The steps are nearly, not exactly, of equal length; 256 of them go round.
    """
    quarter, rest = divmod(step % 256, 64)
    # The tangent of the half angle runs from 0 to 1; a cubic keeps the steps nearly equal.
    share = rest / 64
    tangent = share * (0.7854 + 0.2146 * share * share)
    square = 1.0 + tangent * tangent
    cosine, sine = (1.0 - tangent * tangent) / square, 2.0 * tangent / square
    for _ in range(quarter):
        cosine, sine = -sine, cosine
    return cosine, sine


class Dice:
    """A sequence of random choices; sequences of other keys are independent of it."""

    def __init__(self, seed: int, *keys: int) -> None:
        self._start, self._drawn = hash_of(seed, *keys), 0

    def integer(self, low: int, high: int) -> int:
        """Return an integer from low to high, both included."""
        return low + (self._bits() >> 11) % (high - low + 1)

    def real(self, low: float, high: float) -> float:
        """Return a number from low to high, on a grid of 2**-20 of the range."""
        return low + (high - low) * (self._bits() >> 44) / (1 << 20)

    def chance(self, percent: int) -> bool:
        """Return True that often."""
        return self.integer(0, 99) < percent

    def pick(self, items: Sequence[T]) -> T:
        """Return one of the items."""
        return items[self.integer(0, len(items) - 1)]

    def _bits(self) -> int:
        self._drawn += 1
        return int(hash_of(self._start, self._drawn))


def octaves(seed: int, stream: int, size: int, cells: dict[int, int]) -> NDArray[np.int32]:
    """Return noise (size, size) of several scales, ``{cell: weight}`` with weights of 16 in all.

    Each is from -2048 to 2047 on a lattice `cell` pixels apart, and smooth between.
    """
    result = np.zeros((size, size), np.int32)
    for cell, share in cells.items():
        index = np.arange(size // cell + 2)
        lattice = hash_of(seed, _STREAM, stream + cell, index[:, None], index[None, :])
        values = (lattice >> 52).astype(np.int32) - 2048
        low, step = np.divmod(np.arange(size), cell)
        # 3t^2 - 2t^3 in units of 1/1024; 0 where cells are pixels.
        weight = (1024 * step * step * (3 * cell - 2 * step) // cell**3).astype(np.int32)[:, None]
        for _ in range(2):  # along rows, then columns
            values = (values[low] + ((values[low + 1] - values[low]) * weight >> 10)).T
        result += values * np.int32(share)
    return result // np.int32(16)


def uniforms(hashes: NDArray[np.uint64], lane: int = 0) -> Singles:
    """Turn hashes (N,) into numbers in [0, 1); lanes 0 to 3 are independent."""
    bits = (hashes >> np.uint64(16 * lane)) & np.uint64(0xFFFF)
    return bits.astype(np.float32) * np.float32(1.0 / 65536.0)


def floor_log2(values: Singles) -> NDArray[np.int32]:
    """Return the exponents floor(log2 v) of positive numbers, read from their bits."""
    exponents = np.ascontiguousarray(values, np.float32).view(np.int32) >> 23
    exponents -= 127
    return exponents


def volume_noise(xyz: Singles, voxel_m: float, footprint_m: Singles) -> Singles:
    """Return the noise (N,), which all surfaces share, at points (3, N) in metres."""
    inverse = np.float32(1.0 / voxel_m)
    level = floor_log2(footprint_m * inverse)
    np.minimum(np.maximum(level, 0, out=level), _VOLUME_BITS, out=level)
    x, y, z = (np.floor(xyz * inverse).astype(np.int32) & (1 << _VOLUME_BITS) - 1) >> level
    (volume, starts), bits = _volume(), _VOLUME_BITS - level
    return np.asarray(volume.take(((x << bits | y) << bits | z) + starts.take(level)))


@cache
def _volume() -> tuple[Singles, NDArray[np.int32]]:
    """Return three octaves of hashed voxels, then their means over 2, 4 ... 64; and the starts."""
    side = 1 << _VOLUME_BITS
    volume = np.zeros((side, side, side), np.float32)
    for octave, weight in enumerate((1.0, 0.9, 0.8)):
        grains = uniforms(hash_of(octave, np.arange((side >> octave) ** 3)))
        grains = grains.reshape((side >> octave,) * 3)
        for axis in range(3):
            grains = np.repeat(grains, 1 << octave, axis=axis)
            for _ in range(octave):
                grains = (grains + np.roll(grains, 1, axis=axis)) * np.float32(0.5)
        volume += np.float32(weight) * ((grains - grains.mean()) / grains.std())
    volume -= volume.mean()
    volume /= volume.std()
    levels, means = [volume.ravel()], volume
    for level in range(1, _VOLUME_BITS + 1):
        half = side >> level
        blocks = means.reshape(half, 2, half, 2, half, 2)
        means = blocks.mean(axis=(1, 3, 5), dtype=np.float32)
        levels.append(means.ravel())
    return np.concatenate(levels), np.cumsum([0, *map(len, levels[:-1])], dtype=np.int32)

"""Noise that depends on nothing but a seed and a place: hashes of counters, and tables of them.

No generator has a state here, so that neither the order of frames nor the number of workers nor
the size of a block changes a pixel.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Singles",
    "VolumeNoise",
    "floor_log2",
    "gaussians",
    "hash64",
    "seed_of",
    "uniforms",
    "volume_noise",
]

Singles = NDArray[np.float32]

_MASK = (1 << 64) - 1
_VOLUME_SIDE = 64
_GAUSSIAN_BITS = 16


def seed_of(*parts: object) -> int:
    """Return a seed of 64 bits for values, by SHA-256 of their text."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def hash64(counter: NDArray[np.uint64], seed: int) -> NDArray[np.uint64]:
    """Hash counters with the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).

    Parameters
    ----------
    counter : (N,) uint64 array
    seed : int
        Other seeds give other values; taken modulo 2^64.

    Returns
    -------
    (N,) uint64 array
    """
    mixed = counter * np.uint64(0x9E3779B97F4A7C15)
    mixed += np.uint64(seed & _MASK)
    mixed ^= mixed >> np.uint64(30)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(27)
    mixed *= np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    return mixed


def uniforms(hashes: NDArray[np.uint64], lane: int = 0) -> Singles:
    """Turn hashes (N,) into numbers in [0, 1); lanes 0 to 3 are independent."""
    bits = (hashes >> np.uint64(16 * lane)) & np.uint64(0xFFFF)
    return bits.astype(np.float32) * np.float32(1.0 / 65536.0)


def gaussians(hashes: NDArray[np.uint64]) -> Singles:
    """Turn hashes (N,) into four independent standard normal numbers each, (4, N)."""
    lanes = hashes.view(np.uint16).reshape(-1, 4).T
    return np.stack([_gaussian_table().take(lane) for lane in lanes])


def floor_log2(values: Singles) -> NDArray[np.int64]:
    """Return the exponents floor(log2 v) of positive numbers, read from their bits."""
    exponents = np.ascontiguousarray(values, np.float32).view(np.int32) >> 23
    return exponents.astype(np.int64) - 127


@dataclass(frozen=True, eq=False)
class VolumeNoise:
    """Noise in space that repeats every 64 voxels, with coarser levels for coarser pixels.

    Attributes
    ----------
    values : (sum of level sizes,) float32
        Level after level; mean 0, standard deviation 1 at the finest.
    offsets : (levels,) int64
        Where each level starts in `values`.
    """

    values: Singles
    offsets: NDArray[np.int64]

    def sample(
        self, xyz: tuple[Singles, Singles, Singles], voxel_m: float, footprint_m: Singles
    ) -> Singles:
        """Return the noise at points, averaged over about the size of their pixels.

        Parameters
        ----------
        xyz : three (N,) float32 arrays
            Metres.
        voxel_m : float
            The size of the smallest grain.
        footprint_m : (N,) float32 array
            The size of a pixel on the surface.

        Returns
        -------
        (N,) float32 array
        """
        level = floor_log2(footprint_m * np.float32(1.0 / voxel_m))
        np.clip(level, 0, len(self.offsets) - 1, out=level)
        bits = 6 - level
        mask = (1 << bits) - 1
        inverse = np.float32(1.0 / voxel_m)
        index = np.zeros(len(level), np.int64)
        for axis in xyz:
            cell = np.floor(axis * inverse).astype(np.int64)
            cell >>= level
            cell &= mask
            index <<= bits
            index |= cell
        index += self.offsets.take(level)
        return self.values.take(index)


@cache
def volume_noise() -> VolumeNoise:
    """Return the noise that all surfaces share; three octaves of hashed voxels."""
    side = _VOLUME_SIDE
    volume = np.zeros((side, side, side), np.float32)
    for octave, weight in enumerate((1.0, 0.9, 0.8)):
        volume += np.float32(weight) * _grains(side, octave)
    volume -= volume.mean()
    volume /= volume.std()
    levels = [volume]
    while len(levels[-1]) > 1:
        levels.append(_halved(levels[-1]))
    sizes = np.array([level.size for level in levels])
    offsets = np.concatenate(([0], np.cumsum(sizes)[:-1])).astype(np.int64)
    return VolumeNoise(np.concatenate([level.ravel() for level in levels]), offsets)


def _grains(side: int, octave: int) -> Singles:
    cells = side >> octave
    counters = np.arange(cells**3, dtype=np.uint64)
    grains = uniforms(hash64(counters, seed_of("grain", octave))).reshape((cells,) * 3)
    for axis in range(3):
        grains = np.repeat(grains, 1 << octave, axis=axis)
        for _ in range(octave):
            grains = (grains + np.roll(grains, 1, axis=axis)) * np.float32(0.5)
    centred: Singles = (grains - grains.mean()) / grains.std()
    return centred


def _halved(volume: Singles) -> Singles:
    half = len(volume) // 2
    blocks = volume.reshape(half, 2, half, 2, half, 2)
    return np.asarray(blocks.mean(axis=(1, 3, 5), dtype=np.float32), np.float32)


@cache
def _gaussian_table() -> Singles:
    from scipy.special import ndtri

    count = 1 << _GAUSSIAN_BITS
    return np.asarray(ndtri((np.arange(count) + 0.5) / count), np.float32)

"""Noise that depends on nothing but a seed and a place: hashes of counters, and tables of them.

No generator has a state here, so that neither the order of frames nor the number of workers nor
the size of a block changes a pixel.
"""

from __future__ import annotations

import hashlib
from functools import cache

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.world.noise import GOLDEN, mixed

__all__ = ["Singles", "floor_log2", "gaussians", "hash64", "seed_of", "uniforms", "volume_noise"]

Singles = NDArray[np.float32]

_MASK = (1 << 64) - 1
_VOLUME_SIDE = 64


def seed_of(*parts: object) -> int:
    """Return a seed of 64 bits for values, by SHA-256 of their text."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def hash64(counter: NDArray[np.uint64], seed: int) -> NDArray[np.uint64]:
    """Hash counters (N,) by SplitMix64; other seeds, modulo 2^64, give other values."""
    state = counter * GOLDEN
    state += np.uint64(seed & _MASK)
    return mixed(state)


def uniforms(hashes: NDArray[np.uint64], lane: int = 0) -> Singles:
    """Turn hashes (N,) into numbers in [0, 1); lanes 0 to 3 are independent."""
    bits = (hashes >> np.uint64(16 * lane)) & np.uint64(0xFFFF)
    return bits.astype(np.float32) * np.float32(1.0 / 65536.0)


def gaussians(hashes: NDArray[np.uint64]) -> Singles:
    """Turn hashes (N,) into four independent standard normal numbers each, (4, N)."""
    lanes = hashes.view(np.uint16).reshape(-1, 4).T
    return np.stack([_normal_quantiles().take(lane) for lane in lanes])


@cache
def _normal_quantiles() -> Singles:
    from scipy.special import ndtri

    return np.asarray(ndtri((np.arange(1 << 16) + 0.5) / (1 << 16)), np.float32)


def floor_log2(values: Singles) -> NDArray[np.int64]:
    """Return the exponents floor(log2 v) of positive numbers, read from their bits."""
    exponents = np.ascontiguousarray(values, np.float32).view(np.int32) >> 23
    return exponents.astype(np.int64) - 127


def volume_noise(
    xyz: tuple[Singles, Singles, Singles] | Singles, voxel_m: float, footprint_m: Singles
) -> Singles:
    """Return the noise (N,), which all surfaces share, at points (3, N) in metres.

    It is averaged over the pixels' size (N,); `voxel_m` is the size of the smallest grain.
    """
    values, offsets = _volume()
    inverse = np.float32(1.0 / voxel_m)
    level = floor_log2(footprint_m * inverse)
    np.clip(level, 0, len(offsets) - 1, out=level)
    bits = 6 - level
    mask = (1 << bits) - 1
    index = np.zeros(len(level), np.int64)
    for axis in xyz:
        cell = np.floor(axis * inverse).astype(np.int64)
        cell >>= level
        cell &= mask
        index <<= bits
        index |= cell
    index += offsets.take(level)
    return values.take(index)


@cache
def _volume() -> tuple[Singles, NDArray[np.int64]]:
    """Three octaves of hashed voxels and their halvings, level after level, and their offsets.

    The noise repeats every 64 voxels; its mean is 0, its standard deviation 1 at the finest.
    """
    side = _VOLUME_SIDE
    volume = np.zeros((side, side, side), np.float32)
    for octave, weight in enumerate((1.0, 0.9, 0.8)):
        volume += np.float32(weight) * _grains(side, octave)
    volume -= volume.mean()
    volume /= volume.std()
    levels = [volume]
    while (half := len(levels[-1]) // 2) > 0:
        blocks = levels[-1].reshape(half, 2, half, 2, half, 2)
        levels.append(blocks.mean(axis=(1, 3, 5), dtype=np.float32))
    offsets = np.cumsum([0, *(level.size for level in levels[:-1])], dtype=np.int64)
    return np.concatenate([level.ravel() for level in levels]), offsets


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

"""Keys of sealed editions: seeds of 128 bits from which nothing leads back."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["derived", "is_keyed", "keyed", "word_of", "words"]

_KEYED = 1 << 128


def keyed(key: bytes) -> int:
    """Return the seed of a sealed edition, of a key of 16 bytes."""
    return _KEYED | int.from_bytes(key, "big")


def is_keyed(seed: int) -> bool:
    """Tell whether a seed is a key."""
    return seed >= _KEYED


def derived(seed: int, purpose: str) -> int:
    """Return a key of its own for a purpose, which does not lead back; a seed stays as it is."""
    return _KEYED | int.from_bytes(_digest(seed, purpose, 16), "big") if is_keyed(seed) else seed


def words(seed: int, count: int) -> NDArray[np.uint64]:
    """Return numbers of 64 bits, the same whatever the version of NumPy."""
    if not is_keyed(seed):
        return np.random.PCG64(seed).random_raw(count)
    return np.array([word_of(seed, number) for number in range(count)], np.uint64)


def word_of(seed: int, *keys: int) -> int:
    """Return 64 bits for a few numbers under a key."""
    return int.from_bytes(_digest(seed, ",".join(map(str, keys)), 8), "little")


def _digest(seed: int, text: str, size: int) -> bytes:
    key = seed.to_bytes(17, "big")
    return hashlib.blake2b(text.encode(), digest_size=size, key=key).digest()

"""Random draws by counting: resample b is the same whatever was drawn before it, or beside it.

Only raw bits of Philox are used, a stream that NumPy never changes, while it may change how its
distributions are made of them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["blocks", "resample_counts", "sign_flips", "stream_key"]

_CELLS = 1 << 22
_WORDS_A_STEP = 4  # Philox-4x64 makes four words of 64 bits a step of its counter
_LOW_BITS, _HALF_WORD = np.uint64(0xFFFFFFFF), np.uint64(32)


def stream_key(seed: int, purpose: str, group: str) -> int:
    """Name a stream: the same for a group whatever other groups there are.

    Parameters
    ----------
    seed : int
        The user's.
    purpose : str
        Such as "bootstrap": different purposes have different streams.
    group : str
        Such as a scene.

    Returns
    -------
    int
        A key of the random generator, of 128 bits.
    """
    text = f"{seed}\n{purpose}\n{group}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big")


def blocks(units: int, resamples: int) -> Iterator[tuple[int, int]]:
    """Cut resamples into pieces of bounded memory: the first of each, and how many.

    Parameters
    ----------
    units : int
        What is resampled.
    resamples : int
        At least 1.

    Yields
    ------
    first, count : int
        The number of the first resample of a piece, and how many it has.
    """
    size = max(1, _CELLS // max(units, 1))
    for first in range(0, resamples, size):
        yield first, min(size, resamples - first)


def resample_counts(units: int, first: int, count: int, key: int) -> NDArray[np.int64]:
    """Count how often each unit is drawn, with replacement, in each resample.

    Parameters
    ----------
    units : int
        How many units there are, and how many are drawn: at most 2**32 - 1.
    first, count : int
        Which resamples: `first`, ..., `first + count - 1`.
    key : int
        Of the stream, from `stream_key`.

    Returns
    -------
    (units, count) int64
        Each column sums to `units`. A unit's chance is 1 / units to within 2**-32.
    """
    words = _words(-(-units // 2), first, count, key)
    draws = np.concatenate((words & _LOW_BITS, words >> _HALF_WORD), axis=1)[:, :units]
    picked = ((draws * np.uint64(units)) >> _HALF_WORD).astype(np.int64)
    cells = picked * count + np.arange(count)[:, None]
    return np.bincount(cells.ravel(), minlength=units * count).reshape(units, count)


def sign_flips(units: int, first: int, count: int, key: int) -> NDArray[np.uint8]:
    """Toss a fair coin for each unit: 1 keeps its sign, 0 turns it.

    Parameters
    ----------
    units, first, count, key : int
        See `resample_counts`.

    Returns
    -------
    (units, count) uint8
        1 or 0.
    """
    words = _words(-(-units // 64), first, count, key).astype("<u8")
    bits = np.unpackbits(words.view(np.uint8), axis=1, count=units, bitorder="little")
    return np.ascontiguousarray(bits.T)


def _words(needed: int, first: int, count: int, key: int) -> NDArray[np.uint64]:
    """Return raw bits, (count, at least `needed`); every resample begins on its own step."""
    steps = -(-needed // _WORDS_A_STEP)
    source = np.random.Philox(key=key, counter=first * steps)
    return source.random_raw(count * steps * _WORDS_A_STEP).reshape(count, -1)

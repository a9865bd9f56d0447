"""Randomness by counting: a hash of keys, the same on every machine and in any order of use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["Dice", "direction", "hash_of"]

T = TypeVar("T")
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_MASK = (1 << 64) - 1


def hash_of(seed: int, *keys: Any) -> NDArray[np.uint64]:
    """Hash integer keys to 64 bits, elementwise.

    The finaliser of splitmix64 (Steele, Lea and Flood, 2014) once for each key.

    Parameters
    ----------
    seed : int
    *keys : int or array of integers
        Broadcast against each other.

    Returns
    -------
    (...) uint64
    """
    state = np.full((1,), seed & _MASK, np.uint64)
    for key in keys:
        state = _mixed((state ^ _wrapped(key)) + _GOLDEN)
    return state.reshape(()) if state.shape == (1,) and _all_scalars(keys) else state


def _all_scalars(keys: Sequence[Any]) -> bool:
    return all(np.ndim(key) == 0 for key in keys)


def _wrapped(key: Any) -> NDArray[np.uint64]:
    if isinstance(key, int):
        return np.array([key & _MASK], np.uint64)
    array = np.asarray(key)
    return array if array.dtype == np.uint64 else array.astype(np.int64).view(np.uint64)


def _mixed(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    state = (state ^ (state >> np.uint64(30))) * _FIRST
    state = (state ^ (state >> np.uint64(27))) * _SECOND
    return np.asarray(state ^ (state >> np.uint64(31)), np.uint64)


def direction(step: int, turn: int = 256) -> tuple[float, float]:
    """Return a point of the unit circle without a sine.

    Parameters
    ----------
    step : int
        Position on the circle, counter-clockwise from east.
    turn : int
        Steps in a whole turn, a multiple of 4; they are nearly, not exactly, of equal length.

    Returns
    -------
    cosine, sine : float
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
        self._start = int(hash_of(seed, *keys)) if keys else seed
        self._drawn = 0

    def bits(self) -> int:
        """Return the next 64 bits."""
        self._drawn += 1
        return int(hash_of(self._start, self._drawn))

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

    def reals(self, low: float, high: float, count: int) -> Floats:
        """Return numbers from low to high, shape (count,)."""
        self._drawn += 1
        bits = hash_of(self._start, self._drawn, np.arange(count)) >> np.uint64(44)
        return low + (high - low) * (bits.astype(np.float64) / (1 << 20))

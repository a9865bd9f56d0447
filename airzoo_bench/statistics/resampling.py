"""Random draws of units by counting, and the averages of many such draws at once.

Resample b is the same whatever was drawn before it: only raw bits of Philox are used, a stream that
NumPy never changes, while it may change how its distributions are made of them.

Sums must not depend on the order in which a matrix product adds, which changes with the number of
threads and the processor. So values are put on a grid of binary fractions that is so coarse that
every sum is exact in float64, and fine beyond what matters: with n units, steps of less than
n * 2**-51 of the largest value.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = [
    "blocks",
    "exact_products",
    "leave_one_out",
    "resample_counts",
    "sign_flips",
    "stream_key",
    "weighted_averages",
]

_CELLS = 1 << 22
_WORDS_A_STEP = 4  # Philox-4x64 makes four words of 64 bits a step of its counter
_LOW_BITS, _HALF_WORD = np.uint64(0xFFFFFFFF), np.uint64(32)
Weights = NDArray[np.integer]
_EXACT_BITS = 52


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


def weighted_averages(values: Floats, medians: NDArray[np.bool_], weights: Weights) -> Floats:
    """Average values by integer weights.

    Parameters
    ----------
    values : (V, N) array
        V variables of N units; +inf is a value like any other.
    medians : (V,) bool
        Which variables are averaged by their median; the others by their mean.
    weights : (N, B) array of integers, at least 0
        How often each unit counts; all columns have the same sum.

    Returns
    -------
    (V, B) array
        The same to the last bit whatever the number of threads and columns.
    """
    total = int(weights[:, 0].sum())
    factors = weights.astype(np.float64)
    averages = np.empty((len(values), weights.shape[1]))
    averages[~medians] = _means(values[~medians], factors, total)
    if medians.any():
        averages[medians] = _medians(values[medians], factors, weights.astype(np.int32), total)
    return averages


def _means(values: Floats, factors: Floats, total: int) -> Floats:
    infinite = np.isinf(values)
    means = exact_products(np.where(infinite, 0.0, values), factors, total) / total
    failing = infinite.any(axis=1)
    drawn = infinite[failing].astype(np.float64) @ factors
    means[failing] = np.where(drawn > 0, np.inf, means[failing])
    return np.asarray(means)


def exact_products(values: Floats, factors: Floats, total: int) -> Floats:
    """Multiply matrices, with values rounded to a grid on which no sum is rounded.

    Parameters
    ----------
    values : (V, N) array
        Finite.
    factors : (N, B) array
        Whole numbers.
    total : int
        No column of `factors` has a larger sum of sizes.

    Returns
    -------
    (V, B) array
        A row is the same to the last bit whatever the number of threads, columns and other rows.
    """
    largest = np.maximum(np.abs(values).max(axis=1, initial=0.0), np.finfo(np.float64).tiny)
    exponents = _EXACT_BITS - np.ceil(np.log2(largest)) - np.ceil(np.log2(total))
    # Two steps: one power of two for tiny values would be infinite.
    halves = np.exp2(np.floor(exponents / 2)), np.exp2(np.ceil(exponents / 2))
    whole = np.rint(values * halves[0][:, None] * halves[1][:, None])
    return np.asarray((whole @ factors) / halves[0][:, None] / halves[1][:, None])


def _medians(values: Floats, factors: Floats, counts: Weights, total: int) -> Floats:
    """Median of each resample: only units near the middle are looked at one by one."""
    units = values.shape[1]
    order = np.argsort(values, axis=1, kind="stable")
    reach = int(2.5 * units**0.5) + 2  # five standard deviations of how many are drawn from a half
    first, last = max(0, units // 2 - reach), min(units, units // 2 + reach)
    below = np.zeros_like(values)
    np.put_along_axis(below, order[:, :first], 1.0, axis=1)
    bases = (below @ factors).astype(np.int32)
    found = np.empty((len(values), factors.shape[1]))
    for row, (places, base) in enumerate(zip(order, bases, strict=True)):
        start, sums = first, base + np.cumsum(counts[places[first:last]], axis=0, dtype=np.int32)
        if (base > (total - 1) // 2).any() or (sums[-1] <= total // 2).any():
            start, sums = 0, np.cumsum(counts[places], axis=0, dtype=np.int32)
        low, high = (start + (sums <= n).sum(axis=0) for n in ((total - 1) // 2, total // 2))
        found[row] = (values[row, places[low]] + values[row, places[high]]) / 2.0
    return found


def leave_one_out(values: Floats, medians: NDArray[np.bool_]) -> Floats:
    """Average all units but one, for each one: the jackknife.

    Parameters
    ----------
    values : (V, N) array
        With N at least 2; +inf where all that are left include it.
    medians : (V,) bool
        See `weighted_averages`.

    Returns
    -------
    (V, N) array
        The average without each unit.
    """
    averages = np.empty_like(values)
    means = values[~medians]
    failing = np.isinf(means)
    finite = np.where(failing, 0.0, means)
    rest = (finite.sum(axis=1, keepdims=True) - finite) / (values.shape[1] - 1)
    others_fail = failing.sum(axis=1, keepdims=True) - failing > 0
    averages[~medians] = np.where(others_fail, np.inf, rest)
    averages[medians] = _medians_without_one(values[medians])
    return averages


def _medians_without_one(values: Floats) -> Floats:
    order = np.argsort(values, axis=1, kind="stable")
    ranked = np.take_along_axis(values, order, axis=1)
    left = values.shape[1] - 1
    gone = np.arange(values.shape[1])
    low, high = (rank + (rank >= gone) for rank in ((left - 1) // 2, left // 2))
    without = np.empty_like(values)
    np.put_along_axis(without, order, (ranked[:, low] + ranked[:, high]) / 2.0, axis=1)
    return without

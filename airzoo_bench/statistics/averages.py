"""Means and medians of many resamples at once, by how often each unit was drawn.

Sums must not depend on the order in which a matrix product adds, which changes with the number of
threads and the processor. So values are put on a grid of binary fractions that is so coarse that
every sum is exact in float64, and fine beyond what matters: with n units, steps of less than
n * 2**-51 of the largest value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["leave_one_out", "weighted_averages"]

Weights = NDArray[np.integer]

_EXACT_BITS = 52


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
    finite = np.where(infinite, 0.0, values)
    largest = np.maximum(np.abs(finite).max(axis=1, initial=0.0), np.finfo(np.float64).tiny)
    exponents = _EXACT_BITS - np.ceil(np.log2(largest)) - np.ceil(np.log2(total))
    # Two steps: one power of two for tiny values would be infinite.
    halves = np.exp2(np.floor(exponents / 2)), np.exp2(np.ceil(exponents / 2))
    whole = np.rint(finite * halves[0][:, None] * halves[1][:, None])
    means = (whole @ factors) / total / halves[0][:, None] / halves[1][:, None]
    failing = infinite.any(axis=1)
    drawn = infinite[failing].astype(np.float64) @ factors
    means[failing] = np.where(drawn > 0, np.inf, means[failing])
    return np.asarray(means)


def _medians(values: Floats, factors: Floats, counts: Weights, total: int) -> Floats:
    """Median of each resample: only units near the middle are looked at one by one."""
    units = values.shape[1]
    order = np.argsort(values, axis=1, kind="stable")
    reach = 4 * int(units**0.5) + 2
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

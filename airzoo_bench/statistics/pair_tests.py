"""Every two of many variables compared, and the ranges of ranks that follow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import LEVEL, compare_pairs, holm, normal_tail

_FEW, _MANY, _MOST_METHODS = 2_000, 10_000, 224


def resamples_for(count: int) -> int:
    """Return a number of draws that takes all pairs of these variables some seconds."""
    return _MANY if count <= _MOST_METHODS else _FEW


def compare_all(
    sample: Sample, resampling: ResamplingConfig, wanted: Bools | None = None
) -> Floats:
    """Compare every two of V variables, or the `wanted` (V, V): low, high and p, (3, V, V).

    The limits are of row minus column, above the diagonal and NaN elsewhere; p is symmetric, and 1
    where there is none.
    """
    count = len(sample.medians)
    every = np.ones((count, count), np.bool_) if wanted is None else wanted
    pairs = np.argwhere(np.triu(every, 1))
    numbers = compare_pairs(sample, resampling, pairs, tails=True)
    found = np.full((3, count, count), np.nan)
    found[2] = 1.0
    one, other = pairs.T
    found[:2, one, other] = numbers.limits.T
    found[2, one, other] = found[2, other, one] = numbers.p_values
    return found


def correct_pairs(p_values: Floats) -> Floats:
    """Correct the tests (V, V) of every two variables for how many pairs there are, by Holm."""
    upper = np.triu_indices(len(p_values), 1)
    corrected = np.ones_like(p_values)
    corrected[upper] = holm(p_values[upper])
    return np.minimum(corrected, corrected.T)


def told_apart(values: Floats, corrected: Floats) -> Bools:
    """Return which two variables (V, V) differ significantly; equal values never do."""
    return np.asarray((corrected <= LEVEL) & (values[:, None] != values))


def rank_ranges(values: Floats, corrected: Floats, *, higher_is_better: bool) -> NDArray[np.int64]:
    """Return the range of ranks (V, 2) of variables, by values (V,) and corrected p (V, V).

    Those are 1 + the number of significantly better ones, and V - the number of worse ones. With a
    chance of at least 95 % all true ranks lie in their ranges, since differences that are all
    significant together give confidence sets of ranks (Mogstad, Romano, Shaikh and Wilhelm 2024).
    """
    signed = values if higher_is_better else -values
    apart = told_apart(signed, corrected)
    better, worse = apart & (signed > signed[:, None]), apart & (signed < signed[:, None])
    return np.stack([1 + better.sum(axis=1), len(signed) - worse.sum(axis=1)], axis=1)


def unpaired_p_values(values: Floats, errors: Floats) -> Floats:
    """Test every two variables by their values and standard errors (V,) alone, (V, V).

    p is that of a normal difference, and 1 of an infinite value or one without standard error. The
    errors are added: whatever the correlation of two variables, their difference varies no more.
    """
    known = np.isfinite(values) & np.isfinite(errors)
    centre, spread = np.where(known, values, 0.0), np.where(known, errors, 1.0)
    apart = np.abs(centre[:, None] - centre)
    scale = spread[:, None] + spread
    scores = np.divide(apart, scale, out=np.zeros_like(apart), where=scale > 0)
    return np.where(known & known[:, None], normal_tail(scores), 1.0)

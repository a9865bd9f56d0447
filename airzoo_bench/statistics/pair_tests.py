"""Tests, intervals and rank ranges of every two of many variables, from draws that all pairs share.

Tests are those of `significance.paired_tests`, intervals those of `sample_intervals`. A change of
places turns the sign of a unit's difference, and the sum of differences under given signs is the
difference of two sums, one of each variable; so the sums of N variables hold the draws of all
N (N - 1) / 2 pairs. Of medians the resamples of a difference are the differences of resamples.

Corrected for many pairs, p must be resolved far below one draw. Where fewer than 25 draws are as
extreme as what was observed, p of a mean is the normal tail with the exact variance of the signed
sum, which sums of random signs hardly exceed (Pinelis 1994, see docs/statistics.md); that of a
median, where no resample lies beyond 0, is the normal tail with the resamples' spread.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.intervals import FEWEST, percentile_p_values, quantiles, student
from airzoo_bench.statistics.samples import (
    EXACT_BITS,
    TIE,
    ResamplingConfig,
    Sample,
    difference,
    paired_difference,
    resampled_averages,
    without_infinite,
)
from airzoo_bench.statistics.shares import difference_limits
from airzoo_bench.statistics.significance import (
    LEVEL,
    exact_p_values,
    holm,
    mcnemar,
    p_floor,
    paired_permutation,
    signed_sums,
)

_FEW, _MANY, _MOST_METHODS = 2_000, 10_000, 224
_RESOLVED = 25
_SURE = 6.0  # standard deviations; Hoeffding: less than one of 10**7 draws is as extreme
_CANCELLED = 1e-3  # of two squares: what is left of their difference has few digits
_CELLS = 1 << 17

Places = NDArray[np.intp]
Tested = Iterator[tuple[int | Places, Places, Floats]]
"""A variable, those that it is paired with, and p of each."""


def resamples_for(count: int) -> int:
    """Return a number of draws that takes all pairs of these variables some seconds."""
    return _MANY if count <= _MOST_METHODS else _FEW


def pair_p_values(
    sample: Sample, resampling: ResamplingConfig, wanted: Bools | None = None
) -> Floats:
    """Test every two of V variables of one kind, all medians or none: two-sided p (V, V).

    The matrix is symmetric, with 1 on the diagonal. That of a pair is the same to the last bit
    whatever the other variables are. Of `wanted` (V, V) pairs alone, the rest stays 1.
    """
    found = np.ones((len(sample.medians),) * 2)
    tests = _test_scenes if sample.unit == "scene" else _test_means
    if sample.medians.any():
        tests = _test_medians
    upper = np.triu(found if wanted is None else wanted, 1) > 0
    for one, others, p_values in tests(sample, resampling, upper):
        found[one, others] = found[others, one] = p_values
    return found


def rows_of(wanted: Bools, width: int = 1) -> Iterator[tuple[int, Places]]:
    """Yield each wanted pair once: a variable, with so few others that memory is bounded."""
    step = max(1, _CELLS // max(width, 1))
    for one in np.flatnonzero(wanted.any(axis=1)).tolist():
        others = np.flatnonzero(wanted[one])
        yield from ((one, others[first : first + step]) for first in range(0, len(others), step))


def _pairs_of(wanted: Bools, width: int) -> Iterator[tuple[Places, Places]]:
    """Yield each wanted pair once, so many at a time that memory is bounded."""
    step, (firsts, others) = max(1, _CELLS // max(width, 1)), np.nonzero(wanted)
    for start in range(0, len(firsts), step):
        yield firsts[start : start + step], others[start : start + step]


def mean_draws(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Average the resamples of `intervals.bootstrap` over groups, (V, B)."""
    total = np.zeros((len(sample.medians), resampling.resamples))
    for group, values in zip(sample.groups, sample.values, strict=True):
        total += resampled_averages(values, sample.medians, group, resampling)
    return total / len(sample.groups)


def _test_scenes(sample: Sample, resampling: ResamplingConfig, wanted: Bools) -> Tested:
    [values] = sample.values
    for one, others in rows_of(wanted):
        gaps = paired_difference(values[others], values[one])
        _, p_values = student(gaps, np.zeros(len(others), np.bool_), resampling.confidence)
        without = np.isnan(p_values)
        p_values[without] = _permuted(sample, resampling, one, others[without])
        yield one, others, p_values


def _permuted(sample: Sample, resampling: ResamplingConfig, one: int, others: Places) -> Floats:
    tests = paired_permutation(sample, resampling, [(one, other) for other in others.tolist()])
    return np.array([test.p_value for test in tests])


def _test_means(sample: Sample, resampling: ResamplingConfig, wanted: Bools) -> Tested:
    failing = np.any([np.isinf(part).any(axis=1) for part in sample.values], axis=0)
    either = failing | failing[:, None]
    for one, others in rows_of(wanted & either, resampling.resamples >> 4):
        yield one, others, _permuted(sample, resampling, one, others)
    count, most = resampling.resamples + 1, int(np.log2(resampling.resamples))
    parts = [without_infinite(part) for part in sample.values]
    codes = tie_codes(np.concatenate(parts, axis=1))
    values = np.concatenate([part / part.shape[1] for part in parts], axis=1)
    sums, products = values.sum(axis=1), _exact_gram(values)
    tested, drawn = [], np.zeros(len(sums), np.bool_)
    for firsts, others in _pairs_of(wanted & ~either, resampling.resamples):
        spread = _spread(values, products, firsts, others)
        observed = np.abs(sums[others] - sums[firsts])
        scores = np.divide(observed, spread, out=np.zeros(len(others)), where=spread > 0)
        near = scores < _SURE
        drawn[others[near]] = drawn[firsts[near]] = True
        tested.append((firsts, others, scores, near, (observed - TIE * spread)[near, None]))
    draws, place = signed_sums(sample.take(drawn), resampling), np.cumsum(drawn) - 1
    for firsts, others, scores, near, least in tested:
        p_values = normal_tail(scores)
        gaps = draws[place[others[near]]] - draws[place[firsts[near]]]
        extreme = (np.abs(gaps) >= least).sum(axis=1)
        resolved, few = (extreme + 1) / count, (_RESOLVED + 1) / count
        tail = np.minimum(p_values[near], few)
        p_values[near] = np.where(extreme >= _RESOLVED, resolved, tail)
        # Of k differences the score is at most the root of k.
        close = np.flatnonzero(scores**2 <= most + 1)
        unlike = codes[others[close]] != codes[firsts[close]]
        differing = unlike.sum(axis=1)
        for number in np.unique(differing[differing <= most]).tolist():
            chosen = differing == number
            places = np.nonzero(unlike[chosen])[1].reshape(np.count_nonzero(chosen), number)
            first, second = firsts[close[chosen], None], others[close[chosen], None]
            gaps = values[second, places] - values[first, places]
            p_values[close[chosen]] = exact_p_values(gaps)
        yield firsts, others, p_values


def tie_codes(values: Floats) -> Floats:
    """Round values to 30 binary digits, as if they were at least 1: equal codes are ties."""
    sizes = np.frexp(np.maximum(1.0, np.abs(without_infinite(values))))[1]
    return np.asarray(np.ldexp(np.rint(np.ldexp(values, 31 - sizes)), sizes - 31))


def _exact_gram(values: Floats) -> Floats:
    """Multiply every two variables unit by unit, rounded to some 20 binary digits, and sum, (V, V).

    A product is the same to the last bit whatever the number of threads and the other variables.
    """
    largest = np.maximum(np.abs(values).max(axis=1, initial=0.0), np.finfo(np.float64).tiny)
    sizes = np.frexp(largest)[1].astype(np.int64)
    digits = (EXACT_BITS - int(values.shape[1]).bit_length()) // 2
    whole = np.rint(np.ldexp(values, (digits - sizes)[:, None]))
    return np.asarray(np.ldexp(whole @ whole.T, sizes[:, None] + sizes - 2 * digits))


def _spread(values: Floats, products: Floats, one: Places, others: Places) -> Floats:
    """Return the standard deviation of the signed sum of differences."""
    both = products[one, one] + products[others, others]
    squares = both - 2 * products[one, others]
    cancelled = squares < _CANCELLED * both
    squares[cancelled] = ((values[one[cancelled]] - values[others[cancelled]]) ** 2).sum(axis=1)
    return np.sqrt(np.where(squares <= TIE**2 * both, 0.0, squares))


def normal_tail(scores: Floats) -> Floats:
    """Return two-sided p of normal scores of at least 0, never 0."""
    return np.asarray(np.maximum(2 * ndtr(-scores), np.finfo(np.float64).tiny))


def _test_medians(sample: Sample, resampling: ResamplingConfig, wanted: Bools) -> Tested:
    """Take the bootstrap's p; where all resamples lie on one side of 0, less than one draw."""
    if sample.fewest[0] < FEWEST:  # no interval, and so no finding
        return
    draws = mean_draws(sample, resampling)
    codes = tie_codes(np.concatenate(sample.values, axis=1))
    floors = np.array([p_floor(unlike) for unlike in range(codes.shape[1] + 1)])
    for one, others in rows_of(wanted, resampling.resamples):
        found = difference(draws[others], draws[one])
        low, high = found.min(axis=1), found.max(axis=1)
        nearest = np.minimum(np.abs(low), np.abs(high))
        near = TIE * np.maximum(1.0, without_infinite(nearest))
        mixed = (low <= near) & (high >= -near)
        p_values = np.empty(len(others))
        p_values[mixed] = percentile_p_values(paired_difference(draws[others[mixed]], draws[one]))
        beyond = _beyond(sample, found[~mixed], one, others[~mixed])
        p_values[~mixed] = np.minimum(2 / (found.shape[1] + 1), beyond)
        least = floors[(codes[others] != codes[one]).sum(axis=1)]
        yield one, others, np.maximum(p_values, least)


def _beyond(sample: Sample, draws: Floats, one: int, others: Places) -> Floats:
    """Return the normal tail of resamples, or by wins and losses where they have no spread."""
    finite = np.isfinite(draws).all(axis=1, keepdims=True)
    known = np.where(finite, draws, 0.0)
    spread = known.std(axis=1)
    usual = spread > 0
    p_values = np.empty(len(others))
    p_values[usual] = normal_tail(np.abs(known[usual].mean(axis=1)) / spread[usual])
    wins, losses = np.zeros((2, np.count_nonzero(~usual)), np.int64)
    for part in sample.values:
        wins += (part[others[~usual]] < part[one]).sum(axis=1)
        losses += (part[others[~usual]] > part[one]).sum(axis=1)
    p_values[~usual] = mcnemar(wins, losses)
    return p_values


def pair_limits(
    sample: Sample, resampling: ResamplingConfig, wanted: Bools | None = None
) -> Floats:
    """Take the interval of every difference: over scenes by Student's t, shares MOVER, else drawn.

    Of V variables, all shares or none, return low and high of row minus column (2, V, V) above the
    diagonal; NaN elsewhere, and where a group has fewer than `FEWEST` units. Those of a pair are
    the same to the last bit whatever the other variables are; of `wanted` (V, V) pairs alone, the
    rest is NaN.
    """
    count, confidence = len(sample.medians), resampling.confidence
    limits = np.full((2, count, count), np.nan)
    if sample.fewest[0] < FEWEST:
        return limits
    every = np.ones((count, count), np.bool_) if wanted is None else wanted
    wanted, shares = np.triu(every, 1), sample.are_shares
    if sample.unit == "scene":
        [values] = sample.values
        for one, others in rows_of(wanted):
            gaps = paired_difference(values[one], values[others])
            limits[:, one, others] = student(gaps, shares[others], confidence)[0].T
    elif not shares.all():
        draws = mean_draws(sample, resampling)
        for one, others in rows_of(wanted, resampling.resamples):
            ranked = np.sort(paired_difference(draws[one], draws[others]), axis=1)
            levels = np.broadcast_to(resampling.tails, (len(ranked), 2))
            limits[:, one, others] = quantiles(ranked, levels).T
    else:
        for pairs in _pairs_of(wanted, sum(part.shape[1] for part in sample.values)):
            limits[:, *pairs] = difference_limits(sample.differences(*pairs), confidence).T
    return limits


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

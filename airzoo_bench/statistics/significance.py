"""Paired differences of methods on the same units: intervals, tests, corrections, ranks.

Means are tested by permutation, medians by the percentile interval of their bootstrap, and where
scenes are the units by Student's t. The sum of differences under given signs is the difference of
two sums; so the sums of N variables hold the draws of all their pairs, as their resamples do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtr

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.intervals import (
    Interval,
    difference_limits,
    few_units,
    percentile_p_values,
    quantiles,
    student,
)
from airzoo_bench.statistics.samples import (
    TIE,
    ResamplingConfig,
    Sample,
    paired_difference,
    resampled_averages,
    signed_sums,
)

LEVEL = 0.05
"""A p-value up to here is a finding."""

_RESOLVED = 25
_CELLS = 1 << 19

Pairs = NDArray[np.intp]


@dataclass(frozen=True)
class PairedTest:
    """A two-sided p-value, above 0 and at most 1, and how it was found."""

    p_value: float
    exact: bool  # every pattern was tried
    patterns: int  # or resamples, or scenes, that were tried; 0 where there were none, and p is 1
    kind: str = "permutation"  # or "bootstrap" or "student"


class PairNumbers(NamedTuple):
    """Of C differences: limits (C, 2), NaN where there are none, p, and how that was found (C,)."""

    limits: Floats
    p_values: Floats
    exact: Bools
    patterns: NDArray[np.int64]


def paired_tests(
    sample: Sample, resampling: ResamplingConfig, pairs: Sequence[tuple[int, int]] | Pairs
) -> tuple[list[Interval], list[PairedTest]]:
    """Take the interval of each pair's difference, the first minus the second, and test it.

    Where there is no interval, a median has no finding, and scenes are tested by permutation.
    """
    places = np.array(pairs, np.intp).reshape(-1, 2)
    found, intervals, tests = compare_pairs(sample, resampling, places), [], []
    few, by_scene = few_units(sample), sample.unit == "scene"
    for (one, other), (low, high), *numbers in zip(places, *found, strict=True):
        gaps, reason, method = sample.differences(one, other), few, "percentile"
        kind = "bootstrap" if sample.medians[one] else "permutation"
        if by_scene and np.isnan(low):
            reason = few or "a scene failed, or the differences of all are alike"
        elif by_scene:
            method = kind = "student"
        elif sample.are_shares[one]:
            method = "mover"
        elif not few and all((gap == gap[0]).all() for gap in gaps):
            reason = "the differences of all queries are alike: resamples cannot differ"
        known = Interval(float(low), float(high), method)
        intervals.append(Interval(reason=reason) if reason else known)
        p_value, exact, patterns = (number.item() for number in numbers)
        tests.append(PairedTest(p_value, exact, patterns, kind))
    return intervals, tests


@dataclass(frozen=True)
class _Draws:
    """The draws that all pairs of a sample share, made when they are first needed."""

    sample: Sample
    resampling: ResamplingConfig

    @cached_property
    def resampled(self) -> Floats:
        """Averages of resamples, over groups, (V, B); 0 of shares, which take none."""
        sample, chosen = self.sample, ~self.sample.are_shares
        found = np.zeros((len(chosen), self.resampling.resamples))
        for group, values in zip(sample.groups, sample.values, strict=True):
            medians = sample.medians[chosen]
            found[chosen] += resampled_averages(values[chosen], medians, group, self.resampling)
        return found / len(sample.groups)

    @cached_property
    def signed(self) -> Floats:
        """Sums of means under random signs, (V, B); 0 of medians and of failing ones."""
        chosen = ~(self.sample.medians | self.failing)
        found = np.zeros((len(chosen), self.resampling.resamples))
        parts = [part[chosen] for part in self.sample.values]
        found[chosen] = signed_sums(self.sample.groups, parts, self.resampling)
        return found

    @cached_property
    def failing(self) -> Bools:
        """Which variables have an infinite value (V,)."""
        return np.asarray(np.isinf(np.concatenate(self.sample.values, axis=1)).any(axis=1))


def compare_pairs(
    sample: Sample, resampling: ResamplingConfig, pairs: Pairs, *, tails: bool = False
) -> PairNumbers:
    """Compare pairs (C, 2) of variables, each independently of the others.

    With `tails`, p is resolved far below one draw. Where fewer than 25 draws are as extreme as what
    was observed, p of a mean is then the normal tail with the exact variance of the signed sum,
    which sums of random signs hardly exceed (Pinelis 1994); that of a median, where no resample
    lies beyond 0, is the normal tail with the resamples' spread.
    """
    draws = _Draws(sample, resampling)
    units = sum(part.shape[1] for part in sample.values)
    cells = max(1, units, 0 if sample.are_shares.all() else resampling.resamples)
    step = max(1, _CELLS // cells)
    blocks = (pairs[start : start + step] for start in range(0, max(1, len(pairs)), step))
    parts = [_compare(draws, block, tails) for block in blocks]
    return PairNumbers(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _compare(draws: _Draws, pairs: Pairs, tails: bool) -> PairNumbers:
    sample, plan, (one, other) = draws.sample, draws.resampling, pairs.T
    gaps = sample.differences(one, other)
    shares, medians = sample.are_shares[one], sample.medians[one]
    limits, p_values = np.full((len(pairs), 2), np.nan), np.full(len(pairs), np.nan)
    exact, patterns = ~medians, np.zeros(len(pairs), np.int64)
    if sample.unit == "scene":
        exact, (limits, p_values) = medians & ~medians, student(gaps[0], shares, plan.confidence)
        patterns[:] = gaps[0].shape[1]
    elif not few_units(sample):
        limits[shares] = difference_limits([gap[shares] for gap in gaps], plan.confidence)
        if not shares.all():
            # Pair by pair: two rows of draws stay in the processor's cache.
            drawn = (paired_difference(*draws.resampled[pair]) for pair in pairs[~shares])
            ranked = np.stack([*map(np.sort, drawn)])
            limits[~shares] = quantiles(ranked, np.broadcast_to(plan.tails, (len(ranked), 2)))
            tested = [gap[medians] for gap in gaps]
            p_values[medians] = _test_medians(ranked[medians[~shares]], tested, tails)
            patterns[medians] = plan.resamples
    permuted = np.isnan(p_values) & ~medians
    if permuted.any():
        parts = [gap[permuted] for gap in gaps]
        p_values[permuted], unlike = _permute(draws, parts, pairs[permuted], tails)
        exact[permuted] = few = unlike < plan.resamples.bit_length()
        patterns[permuted] = np.where(few, 1 << np.where(few, unlike, 0), plan.resamples)
    return PairNumbers(limits, np.where(np.isnan(p_values), 1.0, p_values), exact, patterns)


def _test_medians(ranked: Floats, gaps: Sequence[Floats], tails: bool) -> Floats:
    """Return the p of percentile intervals, never below the least that the units could show."""
    p_values = percentile_p_values(ranked)
    if tails:
        beyond = (ranked[:, 0] > 0) | (ranked[:, -1] < 0)
        mean, spread = np.zeros((2, len(ranked)))
        for row in np.flatnonzero(beyond & np.isfinite(ranked[:, [0, -1]]).all(axis=1)):
            mean[row], spread[row] = ranked[row].mean(), ranked[row].std()
        wins, losses = (sum((sign * gap > 0).sum(axis=1) for gap in gaps) for sign in (1, -1))
        scores = np.abs(mean) / np.where(spread > 0, spread, 1.0)
        tail = np.where(spread > 0, normal_tail(scores), mcnemar(wins, losses))
        p_values[beyond] = np.minimum(p_values, tail)[beyond]
    unlike = np.sum([(gap != 0).sum(axis=1) for gap in gaps], axis=0)
    return np.asarray(np.maximum(p_values, p_floor(unlike)))


def _permute(
    draws: _Draws, gaps: Sequence[Floats], pairs: Pairs, tails: bool
) -> tuple[Floats, NDArray[np.int64]]:
    """Test whether means differ: values change places, unit by unit; also count unlike units.

    p is the share of the 2**k patterns of the k units that differ in which the averages over groups
    differ at least as much. All are tried where they are no more than the resamples; else that many
    random ones are, the same for all pairs, and p = (b + 1) / (m + 1) (Phipson and Smyth 2010). p
    is 1 where one of the averages is infinite: no pattern is farther.
    """
    scaled = np.concatenate([gap / gap.shape[1] for gap in gaps], axis=1)
    unlike, (one, other) = np.count_nonzero(scaled, axis=1), pairs.T
    exact = unlike < draws.resampling.resamples.bit_length()
    failing, p_values = draws.failing[one] | draws.failing[other], np.ones(len(pairs))
    for row in np.flatnonzero(exact & ~failing & (unlike > 0)).tolist():
        of_row = scaled[row, scaled[row] != 0]
        sizes = np.sort(np.abs(of_row))
        p_values[row] = _try_every_sign(sizes.tobytes(), abs(of_row.sum()) - TIE * sizes[-1])
    rest = np.flatnonzero(~exact & ~failing)
    if len(rest):
        count, observed = draws.resampling.resamples, np.abs(scaled[rest].sum(axis=1))
        largest = np.max([np.abs(gap[rest]).max(axis=1) for gap in gaps], axis=0)
        signed, least = draws.signed, observed - TIE * largest
        # Pair by pair: two rows of draws stay in the processor's cache.
        trios = zip(one[rest], other[rest], least, strict=True)
        are_extreme = (np.abs(signed[a] - signed[b]) >= limit for a, b, limit in trios)
        extreme = np.array([*map(np.count_nonzero, are_extreme)])
        p_values[rest] = (extreme + 1) / (count + 1)
        few = rest[extreme < _RESOLVED]
        if tails and len(few):
            scores = np.abs(scaled[few].sum(axis=1)) / np.sqrt((scaled[few] ** 2).sum(axis=1))
            p_values[few] = np.minimum(normal_tail(scores), (_RESOLVED + 1) / (count + 1))
    return p_values, unlike


@lru_cache(maxsize=1 << 14)  # many pairs of hits have the same sizes
def _try_every_sign(packed: bytes, least: float) -> float:
    """Return the share of all patterns of signs for which a sum of sizes is as extreme."""
    sizes = np.frombuffer(packed)
    return float((np.abs(sizes @ _every_sign(len(sizes))) >= least).mean())


@lru_cache(maxsize=2)
def _every_sign(number: int) -> Floats:
    """Return all patterns of signs up to a turn of all, (K, 2**(K - 1)): the first sign stays."""
    digits = (np.arange(2 ** (number - 1)) >> np.arange(number)[:, None]) & 1
    return np.asarray(1.0 - 2.0 * digits, np.float64)


def normal_tail(scores: Floats) -> Floats:
    """Return two-sided p of normal scores of at least 0, never 0."""
    return np.asarray(np.maximum(2 * ndtr(-scores), np.finfo(np.float64).tiny))


def p_floor(unlike: Any) -> Floats:
    """Return the least p of any values on a number of units that differ."""
    return np.asarray(np.minimum(1.0, 2.0 ** (1.0 - unlike)))


def mcnemar(wins: Any, losses: Any) -> Floats:
    """Return two-sided p of McNemar's exact test of hits (1947), the sign test.

    A fair coin for each unit that only the first (`wins`), or only the second method answers.
    """
    p_values = np.minimum(1.0, 2.0 * bdtr(np.minimum(wins, losses), wins + losses, 0.5))
    # A multiple of a power of 2, which `bdtr` misses by a hair: 0.34375 shall not print as 0.3437.
    digits, power = np.frexp(p_values)
    return np.asarray(np.ldexp(np.rint(digits * 2.0**40) / 2.0**40, power))


def holm(p_values: Floats, family: int | None = None) -> Floats:
    """Adjust p-values (M,) so that the chance of any false finding stays below a level (Holm 1979).

    `family` is how many comparisons were looked at, at least M; those that are not given count as
    1, so that the given ones come out as large as they can.
    """
    order = np.argsort(p_values, kind="stable")
    factors = (family or len(p_values)) - np.arange(len(p_values))
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(p_values[order] * factors), 1.0)
    return adjusted


# --- every two of many variables, and the ranges of ranks that follow ---


def compare_all(
    sample: Sample, resampling: ResamplingConfig, wanted: Bools | None = None
) -> Floats:
    """Compare every two of V variables, or the `wanted` (V, V): low, high and p, (3, V, V).

    The limits are of row minus column, above the diagonal; p is symmetric, and 1 where there is no
    test.
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


def rank_ranges(values: Floats, corrected: Floats, *, higher_is_better: bool) -> NDArray[np.int64]:
    """Return the range of ranks (V, 2) of variables, by values (V,) and corrected p (V, V).

    Those are 1 + the number of significantly better ones, and V - the number of worse ones. With a
    chance of at least 95 % all true ranks lie in them (Mogstad, Romano, Shaikh and Wilhelm 2024).
    """
    signed = values if higher_is_better else -values
    apart = (corrected <= LEVEL) & (signed[:, None] != signed)  # equal values never differ
    better, worse = apart & (signed > signed[:, None]), apart & (signed < signed[:, None])
    return np.stack([1 + better.sum(axis=1), len(signed) - worse.sum(axis=1)], axis=1)


def unpaired_p_values(values: Floats, errors: Floats) -> Floats:
    """Test every two variables by their values and standard errors (V,) alone, (V, V).

    p is that of a normal difference, and 1 of an infinite value or one without standard error. The
    errors are added: whatever the correlation of two variables, their difference varies no more.
    """
    known = np.isfinite(values) & np.isfinite(errors)
    centre, spread = np.where(known, values, 0.0), np.where(known, errors, 1.0)
    apart, scale = np.abs(centre[:, None] - centre), spread[:, None] + spread
    scores = np.divide(apart, scale, out=np.zeros_like(apart), where=scale > 0)
    return np.where(known & known[:, None], normal_tail(scores), 1.0)

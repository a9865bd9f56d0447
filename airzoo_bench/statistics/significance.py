"""Paired tests of methods on the same units: permutation, bootstrap, McNemar; Holm's correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.intervals import Interval, Pairs, sample_intervals
from airzoo_bench.statistics.samples import (
    TIE,
    ResamplingConfig,
    Sample,
    blocks,
    difference,
    on_grid,
    paired_difference,
    sign_flips,
    stream_key,
    weighted_averages,
    without_infinite,
)

LEVEL = 0.05
"""A p-value up to here is a finding."""

_P_STEPS = 2.0**40  # within a factor of 2; far more than is shown
_Flips = Callable[[int, int, int], NDArray[np.uint8]]
"""Group, first pattern, count of patterns -> (N, count): 0 where two values change places."""


@dataclass(frozen=True)
class PairedTest:
    """A two-sided p-value, above 0 and at most 1, and how it was found.

    A test is exact that tried every pattern; else `patterns` random ones were tried, or as many
    resamples or scenes; 0 where there was nothing to try, and p is 1.
    """

    p_value: float
    exact: bool
    patterns: int
    kind: Literal["permutation", "bootstrap", "student"] = "permutation"


def paired_tests(
    sample: Sample, resampling: ResamplingConfig, places: Pairs
) -> tuple[list[Interval], list[PairedTest]]:
    """Take the interval of each pair's difference, and test whether it is 0.

    Means are tested by permutation. p of a median is that of its percentile interval, but never
    below what any test could find on as many units as differ. Where scenes are the units p is that
    of the interval's t, and by permutation without an interval.
    """
    found = sample_intervals(sample, resampling, places, groups=False)
    known = list(zip(places, found.p_values, strict=True))
    means = [pair for pair, p_value in known if p_value is None and not sample.medians[pair[0]]]
    permuted = iter(paired_permutation(sample, resampling, means))
    tests = []
    for (one, other), p_value in known:
        if not sample.medians[one]:
            units = sample.values[0].shape[1]
            of_scenes = None if p_value is None else PairedTest(p_value, True, units, "student")
            tests.append(of_scenes or next(permuted))
        elif p_value is None:
            tests.append(PairedTest(1.0, False, 0, "bootstrap"))
        else:
            gaps = sample.differences(one, other)
            p_value = max(p_value, p_floor(sum(int((part != 0).sum()) for part in gaps)))
            tests.append(PairedTest(p_value, False, resampling.resamples, "bootstrap"))
    return found.overall[len(sample.medians) :], tests


def paired_permutation(
    sample: Sample, resampling: ResamplingConfig, pairs: Pairs
) -> list[PairedTest]:
    """Test whether two means differ, for each pair: values change places, unit by unit.

    The statistic is the difference of the averages over groups. Each of the 2**k patterns of the k
    units that differ is as likely as the one observed; p is the share of patterns that differ at
    least as much, either way. All are tried where they are no more than `resampling.resamples`;
    else that many random ones are, the same for all pairs, and p = (b + 1) / (m + 1) (Phipson and
    Smyth 2010), which is never 0. Where one side's average is infinite, patterns that make it so
    too are ordered by wins minus losses.
    """
    failing = np.any([np.isinf(values).any(axis=1) for values in sample.values], axis=0)
    draws: Floats | None = None
    tests = []
    for one, other in pairs:
        gaps = sample.differences(one, other)
        unlike = [gap != 0 for gap in gaps]
        patterns = 2 ** sum(int(mask.sum()) for mask in unlike)
        exact = patterns <= resampling.resamples
        if failing[one] or failing[other]:
            patterns = patterns if exact else resampling.resamples
            flips = _every_pattern(unlike) if exact else _random_patterns(sample, resampling.seed)
            extreme = _count_by_swaps(sample, one, other, patterns, flips)
            p_value = (extreme if exact else extreme + 1) / (patterns if exact else patterns + 1)
        elif exact:
            scaled = [gap[mask] / len(gap) for gap, mask in zip(gaps, unlike, strict=True)]
            [p_value] = exact_p_values(np.concatenate(scaled)[None]).tolist()
        else:
            patterns = resampling.resamples
            draws = signed_sums(sample, resampling) if draws is None else draws
            observed = abs(sum(float(gap.mean()) for gap in gaps))
            least = observed - TIE * max(float(np.abs(gap).max()) for gap in gaps)
            extreme = int((np.abs(draws[one] - draws[other]) >= least).sum())
            p_value = (extreme + 1) / (patterns + 1)
        tests.append(PairedTest(p_value, exact, patterns))
    return tests


def signed_sums(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Sum the groups' means under random signs, (V, B); infinite values count as 0."""
    draws = np.zeros((len(sample.medians), resampling.resamples))
    flips = _random_patterns(sample, resampling.seed)
    for group, part in enumerate(sample.values):
        units = part.shape[1]
        whole, one, other = on_grid(without_infinite(part), units)
        total = whole.sum(axis=1, keepdims=True)
        for first, size in blocks(units, resampling.resamples):
            kept = flips(group, first, size).astype(np.float64)
            sums = (2 * (whole @ kept) - total) / one / other
            draws[:, first : first + size] += sums / units
    return draws


def exact_p_values(gaps: Floats) -> Floats:
    """Try all patterns of signs of k differences, (C, k): p of each row."""
    if not gaps.shape[1]:
        return np.ones(len(gaps))
    sums = np.abs(gaps @ _every_sign(gaps.shape[1]))
    least = np.abs(gaps.sum(axis=1)) - TIE * np.abs(gaps).max(axis=1)
    return np.asarray((sums >= least[:, None]).mean(axis=1))


@lru_cache(maxsize=2)
def _every_sign(number: int) -> Floats:
    """Return all patterns of signs up to a turn of all, (K, 2**(K - 1)): the first sign stays."""
    digits = (np.arange(2 ** (number - 1)) >> np.arange(number)[:, None]) & 1
    return np.asarray(1.0 - 2.0 * digits, np.float64)


def _every_pattern(unlike: list[Bools]) -> _Flips:
    """Count in binary: one digit for each unit that differs."""
    starts = np.cumsum([0, *(int(mask.sum()) for mask in unlike)])

    def flips(group: int, first: int, count: int) -> NDArray[np.uint8]:
        digits = np.arange(starts[group], starts[group + 1])
        patterns = np.ones((len(unlike[group]), count), np.uint8)
        patterns[unlike[group]] = 1 - ((np.arange(first, first + count) >> digits[:, None]) & 1)
        return patterns

    return flips


def _random_patterns(sample: Sample, seed: int) -> _Flips:
    keys = [stream_key(seed, "permutation", group) for group in sample.groups]

    def flips(group: int, first: int, count: int) -> NDArray[np.uint8]:
        return sign_flips(sample.values[group].shape[1], first, count, keys[group])

    return flips


def _count_by_swaps(sample: Sample, one: int, other: int, patterns: int, flips: _Flips) -> int:
    """Count the patterns that differ at least as much as observed, of means with infinite values.

    Where even the difference as observed is infinite, patterns that make it so are all alike: wins
    minus losses order them.
    """
    sides, before = np.zeros((2, patterns)), np.zeros((2, 1))
    ahead, observed_ahead = np.zeros(patterns), 0.0
    for group, values in enumerate(sample.values):
        units, pooled = values.shape[1], np.concatenate([values[one], values[other]])[None]
        signs = np.sign(paired_difference(values[one], values[other]))
        before += _both_sides(pooled, np.ones((units, 1), np.uint8))
        observed_ahead += signs.sum() / units
        for first, count in blocks(2 * units, patterns):
            kept, part = flips(group, first, count), slice(first, first + count)
            sides[:, part] += _both_sides(pooled, kept)
            ahead[part] += (2.0 * (signs @ kept) - signs.sum()) / units
    observed = abs(difference(before[0], before[1])[0])
    extreme = np.abs(difference(sides[0], sides[1])) >= (1 - TIE) * observed
    if np.isinf(observed):
        extreme &= np.abs(ahead) >= abs(observed_ahead) - TIE
    return int(np.count_nonzero(extreme))


def _both_sides(pooled: Floats, kept: NDArray[np.uint8]) -> Floats:
    """Average what each side (2, B) has of pooled values (1, 2 N) where some change places."""
    first, mean = np.concatenate([kept, 1 - kept]), np.zeros(1, np.bool_)
    return np.concatenate([weighted_averages(pooled, mean, side) for side in (first, 1 - first)])


def p_floor(unlike: int) -> float:
    """Return the least p that any values could have on this number of units that differ."""
    return min(1.0, 2.0 ** (1 - unlike))


def mcnemar(wins: NDArray[np.int64], losses: NDArray[np.int64]) -> Floats:
    """Return two-sided p of McNemar's exact test of hits (1947), the sign test.

    A fair coin for each unit that only the first (`wins`), or only the second method answers.
    """
    fewer = np.minimum(wins, losses)
    # A multiple of a power of 2, which `bdtr` misses by a hair: 0.34375 shall not print as 0.3437.
    digits, power = np.frexp(np.minimum(1.0, 2.0 * bdtr(fewer, wins + losses, 0.5)))
    return np.asarray(np.ldexp(np.rint(digits * _P_STEPS) / _P_STEPS, power))


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

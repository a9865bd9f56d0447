"""Paired tests of methods on the same units: permutation, bootstrap, McNemar; Holm's correction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
    paired_difference,
    sign_flips,
    stream_key,
    weighted_averages,
)

__all__ = [
    "LEVEL",
    "PairedTest",
    "holm",
    "mcnemar",
    "p_floor",
    "paired_permutation",
    "paired_tests",
]

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
    for pair, p_value in known:
        if not sample.medians[pair[0]]:
            units = sample.values[0].shape[1]
            of_scenes = None if p_value is None else PairedTest(p_value, True, units, "student")
            tests.append(of_scenes or next(permuted))
        elif p_value is None:
            tests.append(PairedTest(1.0, False, 0, "bootstrap"))
        else:
            unlike = sum(int((part != 0).sum()) for part in _differences(sample, np.array([pair])))
            p_value = max(p_value, p_floor(unlike))
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
    exact: dict[int, PairedTest] = {}
    for index, pair in enumerate(pairs):
        unlike = [part[0] != 0 for part in _differences(sample, np.array([pair]))]
        patterns = 2 ** sum(int(mask.sum()) for mask in unlike)
        if patterns <= resampling.resamples:
            [extreme] = _count_extreme(sample, [pair], patterns, _every_pattern(unlike))
            exact[index] = PairedTest(int(extreme) / patterns, True, patterns)
    many = [pair for index, pair in enumerate(pairs) if index not in exact]
    count, flips = resampling.resamples, _random_patterns(sample, resampling.seed)
    p_values = (_count_extreme(sample, many, count, flips) + 1) / (count + 1)
    drawn = iter([PairedTest(p_value, False, count) for p_value in p_values.tolist()])
    return [exact.get(index) or next(drawn) for index in range(len(pairs))]


def _differences(sample: Sample, pairs: NDArray[np.intp]) -> list[Floats]:
    """Subtract variables unit by unit: for each group C pairs of its N units, (C, N)."""
    return [paired_difference(part[pairs[:, 0]], part[pairs[:, 1]]) for part in sample.values]


def _every_pattern(unlike: Sequence[Bools]) -> _Flips:
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


def _count_extreme(sample: Sample, pairs: Pairs, patterns: int, flips: _Flips) -> NDArray[np.int64]:
    """Count, for each pair, the patterns that differ at least as much as what was observed."""
    chosen = np.array(pairs, np.intp).reshape(-1, 2)
    finite = np.all([np.isfinite(values).all(axis=1) for values in sample.values], axis=0)
    simple = finite[chosen].all(axis=1)
    counts = np.zeros(len(chosen), np.int64)
    if simple.any():
        observed, found = _signed_means(_differences(sample, chosen[simple]), patterns, flips)
        counts[simple] = (found >= observed[:, None]).sum(axis=1)
    if not simple.all():
        counts[~simple] = _count_by_swaps(sample, chosen[~simple], patterns, flips)
    return counts


def _signed_means(
    differences: Sequence[Floats], patterns: int, flips: _Flips
) -> tuple[Floats, Floats]:
    """Sum the groups' means, up to the sign: as they are (C,), and by pattern (C, patterns)."""
    count = len(differences[0])
    observed, largest, found = np.zeros(count), np.zeros(count), np.zeros((count, patterns))
    for group, values in enumerate(differences):
        units, total = values.shape[1], values.sum(axis=1)
        observed += total / units
        largest = np.maximum(largest, np.abs(values).max(axis=1))
        for first, size in blocks(units, patterns):
            kept = values @ flips(group, first, size).astype(np.float64)
            found[:, first : first + size] += (2 * kept - total[:, None]) / units
    return np.abs(observed) - TIE * largest, np.abs(found)


def _count_by_swaps(
    sample: Sample, pairs: NDArray[np.intp], patterns: int, flips: _Flips
) -> NDArray[np.int64]:
    """Count for means with infinite values: average what each side then has."""

    def both_sides(pooled: Floats, kept: NDArray[np.uint8]) -> Floats:
        first, no_median = np.concatenate([kept, 1 - kept]), np.zeros(len(pairs), np.bool_)
        return np.stack([weighted_averages(pooled, no_median, side) for side in (first, 1 - first)])

    sides, before = np.zeros((2, len(pairs), patterns)), np.zeros((2, len(pairs), 1))
    for group, values in enumerate(sample.values):
        pooled = np.concatenate([values[pairs[:, 0]], values[pairs[:, 1]]], axis=1)
        units = values.shape[1]
        before += both_sides(pooled, np.ones((units, 1), np.uint8))
        for first, count in blocks(2 * units, patterns):
            block = flips(group, first, count)
            sides[:, :, first : first + count] += both_sides(pooled, block)
    observed = np.abs(difference(before[0], before[1]))
    extreme = np.abs(difference(sides[0], sides[1])) >= (1 - TIE) * observed
    boundless = np.isinf(observed[:, 0])
    if boundless.any():  # these are all alike: wins minus losses order them
        signs = [np.sign(part) for part in _differences(sample, pairs[boundless])]
        ahead, found = _signed_means(signs, patterns, flips)
        extreme[boundless] &= found >= ahead[:, None]
    return np.asarray(extreme.sum(axis=1))


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

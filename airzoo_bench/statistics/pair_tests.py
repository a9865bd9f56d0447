"""Paired tests of every two of many variables, from one set of draws that all pairs share.

They are the tests of `significance.paired_tests`: over scenes Student's t, which needs no draws. Of
means a change of places turns the sign of a unit's difference, and the sum of differences under
given signs is the difference of two sums, one of each variable; so the sums of N variables hold the
draws of all N (N - 1) / 2 pairs. Of medians the resamples of a difference are the differences of
two medians' resamples.

Corrected for many pairs, p must be resolved far below one draw. Where fewer than 25 draws are as
extreme as what was observed, p of a mean is the normal tail with the exact variance of the signed
sum, which sums of random signs hardly exceed (Pinelis 1994); that of a median, where no resample
lies beyond 0, is the normal tail with the resamples' spread.

References
----------
I. Pinelis, Extremal probabilistic problems and Hotelling's T2 test under a symmetry condition,
Annals of Statistics 22 (1994).
"""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import percentile_p_values
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_means import SignedSums, Tested, codes_of, normal_tail
from airzoo_bench.statistics.pairs import Places, Wanted, rows_of
from airzoo_bench.statistics.resampling import (
    blocks,
    exact_products,
    resample_counts,
    sign_flips,
    stream_key,
    weighted_averages,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, difference, paired_difference
from airzoo_bench.statistics.scene_means import student
from airzoo_bench.statistics.significance import mcnemar, p_floor, paired_permutation

__all__ = [
    "mean_draws",
    "pair_draws",
    "pair_p_values",
    "resamples_for",
]

_WORK = 2.5e8
_FEW, _MANY = 2_000, 10_000
_CELLS = 1 << 22
_TIE = 1e-9


def resamples_for(count: int) -> int:
    """Return how many draws all pairs of so many variables can share in seconds.

    Parameters
    ----------
    count : int
        Of variables.

    Returns
    -------
    int
        10,000, as everywhere else, up to 224 variables; 2,000 of more.
    """
    return _MANY if count * (count - 1) // 2 * _MANY <= _WORK else _FEW


def pair_draws(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Draw what the tests of all pairs share.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all averaged by the median, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of draws, seed.

    Returns
    -------
    (V, B) array
        Of means, sums under random signs; of medians, their resamples; none over scenes. A
        variable's row is the same to the last bit whatever the others are.
    """
    if sample.unit == "scene":
        return np.empty((len(sample.medians), 0))
    if sample.medians.any():
        return mean_draws(sample, resampling)
    draws = np.zeros((len(sample.medians), resampling.resamples))
    for group, part in zip(sample.groups, sample.values, strict=True):
        units, key = part.shape[1], stream_key(resampling.seed, "permutation", group)
        values = np.where(np.isinf(part), 0.0, part)
        whole = exact_products(values, np.ones((units, 1)), units)
        for first, size in blocks(units, resampling.resamples):
            kept = sign_flips(units, first, size, key).astype(np.float64)
            sums = 2 * exact_products(values, kept, units) - whole
            draws[:, first : first + size] += sums / units
    return draws


def pair_p_values(
    sample: Sample,
    resampling: ResamplingConfig,
    draws: Floats | None = None,
) -> Floats:
    """Test every two variables of a sample.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all averaged by the median, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of draws, seed.
    draws : (V, B) array, optional
        From `pair_draws` of the same sample, where they were made before.

    Returns
    -------
    (V, V) array
        Two-sided p, symmetric; 1 on the diagonal. That of a
        pair is the same to the last bit whatever the other variables are.
    """
    count = len(sample.medians)
    found = np.where(np.eye(count, dtype=bool), 1.0, np.nan)
    wanted = np.triu(np.ones((count, count), np.bool_), 1)
    if wanted.any():
        draws = pair_draws(sample, resampling) if draws is None else draws
        over_scenes = sample.unit == "scene"
        tests = _of_medians if sample.medians.any() else _over_scenes if over_scenes else _of_means
        for one, others, p_values in tests(sample, resampling, draws, wanted):
            found[one, others] = found[others, one] = p_values
    return found


def _of_means(
    sample: Sample, resampling: ResamplingConfig, draws: Floats, wanted: Wanted
) -> Tested:
    failing = np.any([np.isinf(part.max(axis=1, initial=0.0)) for part in sample.values], axis=0)
    either = failing | failing[:, None]
    for one, others in rows_of(wanted & either):
        yield from _permuted(sample, resampling, one, others)
    finite = wanted & ~either
    if finite.any():
        yield from SignedSums.of(sample, draws, finite).tests(finite)


def _over_scenes(
    sample: Sample, resampling: ResamplingConfig, draws: Floats, wanted: Wanted
) -> Tested:
    [values] = sample.values
    for one, others in rows_of(wanted):
        gaps = paired_difference(values[others], values[one])
        _, p_values = student(gaps, np.zeros(len(others), np.bool_), resampling.confidence)
        yield one, others, p_values
        yield from _permuted(sample, resampling, one, others[np.isnan(p_values)])


def _permuted(sample: Sample, resampling: ResamplingConfig, one: int, others: Places) -> Tested:
    for first, size in blocks(2 * resampling.resamples, len(others)):
        part = others[first : first + size]
        pairs = [(min(one, other), max(one, other)) for other in part.tolist()]
        tests = paired_permutation(sample, resampling, pairs)
        yield one, part, np.array([test.p_value for test in tests])


def _of_medians(
    sample: Sample, resampling: ResamplingConfig, draws: Floats, wanted: Wanted
) -> Tested:
    if not draws.shape[1]:  # too few units: no interval, and so no finding
        yield from ((one, others, np.ones(len(others))) for one, others in rows_of(wanted))
        return
    codes = [codes_of(part) for part in sample.values]
    floors = np.array([p_floor(k) for k in range(sum(part.shape[1] for part in codes) + 1)])
    step = max(1, (_CELLS >> 2) // resampling.resamples)
    for one, others in rows_of(wanted):
        for start in range(0, len(others), step):
            some = others[start : start + step]
            unlike = np.zeros(len(some), np.int64)
            for part in codes:
                unlike += np.count_nonzero(part[some] != part[one], axis=1)
            p_values = _median_p_values(sample, draws, one, some)
            yield one, some, np.maximum(p_values, floors[unlike])


def mean_draws(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Average resamples of all variables, those of `intervals.bootstrap`.

    Parameters
    ----------
    sample : Sample
        Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed.

    Returns
    -------
    (V, B) array
        The mean over groups in each resample; no resamples where a group has fewer units than
        `FEWEST`.
    """
    if min(part.shape[1] for part in sample.values) < FEWEST:
        return np.empty((len(sample.medians), 0))
    total = np.zeros((len(sample.medians), resampling.resamples))
    for group, values in zip(sample.groups, sample.values, strict=True):
        units = values.shape[1]
        key = stream_key(resampling.seed, "bootstrap", group)
        for first, size in blocks(units, resampling.resamples):
            counts = resample_counts(units, first, size, key)
            total[:, first : first + size] += weighted_averages(values, sample.medians, counts)
    return total / len(sample.groups)


def _median_p_values(sample: Sample, draws: Floats, one: int, others: Places) -> Floats:
    found = difference(draws[others], draws[one])
    least = 2 / (found.shape[1] + 1)
    p_values = np.full(len(others), least)
    low, high = found.min(axis=1), found.max(axis=1)
    least_size = np.minimum(np.abs(low), np.abs(high))
    near = _TIE * np.maximum(1.0, np.where(np.isinf(least_size), 0.0, least_size))
    mixed = (low <= near) & (high >= -near)
    p_values[mixed] = percentile_p_values(paired_difference(draws[others[mixed]], draws[one]))
    p_values[~mixed] = np.minimum(least, _beyond(sample, found[~mixed], one, others[~mixed]))
    return p_values


def _beyond(sample: Sample, draws: Floats, one: int, others: Places) -> Floats:
    """Return p where all resamples lie on one side of 0."""
    usual = np.asarray(np.isfinite(draws).all(axis=1))
    known = draws[usual]
    spread = known.std(axis=1)
    varied = spread > 0
    p_values = np.empty(len(draws))
    usual[usual] = varied
    p_values[usual] = normal_tail(np.abs(known[varied].mean(axis=1)) / spread[varied])
    p_values[~usual] = _by_wins(sample, one, others[~usual])
    return p_values


def _by_wins(sample: Sample, one: int, others: Places) -> Floats:
    wins, losses = np.zeros((2, len(others)), np.int64)
    for part in sample.values:
        wins += np.count_nonzero(part[others] < part[one], axis=1)
        losses += np.count_nonzero(part[others] > part[one], axis=1)
    return mcnemar(wins, losses)

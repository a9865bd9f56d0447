"""Limits and tests of means over scenes, where scenes are the units.

Shares and paired differences have Student's limits, and p from the same t. Distances are positive
and skewed: the mean of a log-normal variable is exp(mu + sigma**2 / 2), and MOVER puts together
Student's limits of mu and those of sigma**2 / 2 by chi-squared (Zou, Taleban and Huo 2009, see
docs/statistics.md). Student's limits of logarithms alone are those of the geometric mean.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri, stdtr, stdtrit

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.intervals import FEWEST, Interval, SampleIntervals, few_units
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference

__all__ = ["intervals_over_scenes", "student"]

_MOST = 10.0  # an upper limit above so many times the mean is not known
_ALIKE = 1e-9


def intervals_over_scenes(
    sample: Sample, resampling: ResamplingConfig, differences: Sequence[tuple[int, int]] = ()
) -> SampleIntervals:
    """Take the intervals of means, then of differences, with p of these from the same t.

    An infinite upper limit is one that is not known. Several groups have no overall interval.
    """
    pairs = np.array(differences, np.intp).reshape(-1, 2)
    shares = np.zeros(len(sample.medians), np.bool_) if sample.shares is None else sample.shares
    found: dict[str, list[Interval]] = {}
    p_values = np.empty(0)
    for group, values in zip(sample.groups, sample.values, strict=True):
        gaps = paired_difference(values[pairs[:, 0]], values[pairs[:, 1]])
        limits, p_values = student(gaps, shares[pairs[:, 0]], resampling.confidence)
        few = few_units(values.shape[1], group, sample.unit)
        if few is not None:
            found[group] = [few] * (len(values) + len(pairs))
            continue
        means = [_mean(*row, resampling) for row in zip(values, shares.tolist(), strict=True)]
        found[group] = means + [
            _interval(row, two, "student", "the differences of all scenes are")
            for row, two in zip(gaps, limits, strict=True)
        ]
    overall = found[sample.groups[0]] if len(found) == 1 else []
    return SampleIntervals(found, overall, [None if np.isnan(p) else float(p) for p in p_values])


def student(values: Floats, shares: Bools, confidence: float) -> tuple[Floats, Floats]:
    """Return Student's limits (R, 2) of the means of rows (R, N), and p (R,) of their being 0.

    Those of `shares` (R,) lie between -1 and 1. All are NaN of fewer than `FEWEST` scenes, of a
    failed one, and where all are alike.
    """
    count = values.shape[1]
    usable = np.isfinite(values).all(axis=1) & (count >= FEWEST)
    known = np.where(usable[:, None], values, 0.0)
    usable &= np.ptp(known, axis=1) > _ALIKE
    limits, p_values = np.full((len(values), 2), np.nan), np.full(len(values), np.nan)
    if usable.any():
        mean, spread = known[usable].mean(axis=1), known[usable].std(axis=1, ddof=1)
        error = spread / np.sqrt(count)
        reach = stdtrit(count - 1, (1 + confidence) / 2) * error
        most = np.where(shares[usable], 1.0, np.inf)
        limits[usable] = np.clip([mean - reach, mean + reach], -most, most).T
        p_values[usable] = 2 * stdtr(count - 1, -np.abs(mean) / error)
    return limits, np.maximum(p_values, np.finfo(np.float64).tiny)


def _mean(values: Floats, share: bool, resampling: ResamplingConfig) -> Interval:
    if share or not np.isfinite(values).all():
        [limits], _ = student(values[None], np.array([True]), resampling.confidence)
        return _interval(values, np.maximum(limits, 0.0), "student", "all scenes are")
    if values.min() <= 0:
        return Interval(None, None, "", "a distance of 0 has no logarithm")
    return _interval(values, _lognormal(values, resampling), "lognormal", "all scenes are")


def _interval(values: Floats, limits: Floats, method: str, which: str) -> Interval:
    if not np.isfinite(values).all():
        return Interval(None, None, "", "a scene failed")
    if np.isnan(limits).any():
        return Interval(None, None, "", f"{which} alike")
    return Interval(float(limits[0]), float(limits[1]), method)


def _lognormal(values: Floats, resampling: ResamplingConfig) -> Floats:
    """Take the limits (2,) of a log-normal mean by MOVER; an infinite one is not known."""
    count, logs = len(values), np.log(values)
    middle, half = logs.mean(), logs.var(ddof=1) / 2
    [[_, highest]], _ = student(logs[None], np.array([False]), resampling.confidence)
    ratios = (count - 1) / chdtri(count - 1, resampling.tails)
    reaches = np.hypot(highest - middle, half * (ratios - 1))
    with np.errstate(over="ignore"):
        low, high = np.exp(middle + half + np.array([-1, 1]) * reaches)
    return np.array([low, high if high <= _MOST * values.mean() else np.inf])

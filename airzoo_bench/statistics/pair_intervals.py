"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import Places, mean_draws
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.shares import difference_limits

__all__ = ["pair_limits"]

_CELLS = 1 << 21


def pair_limits(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Take the interval of every difference: of shares by MOVER, of all else by percentiles.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all shares, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed, confidence.

    Returns
    -------
    (2, V, V) array
        Low and high of row minus column, above the diagonal; NaN below, on it, and where a group
        has fewer than `FEWEST` units.
    """
    count = len(sample.medians)
    limits = np.full((2, count, count), np.nan)
    if min(part.shape[1] for part in sample.values) < FEWEST:
        return limits
    by_shares = sample.shares is not None and bool(sample.shares.all())
    draws = np.empty((0, 0)) if by_shares else mean_draws(sample, resampling)
    units = sum(part.shape[1] for part in sample.values) if by_shares else resampling.resamples
    step = max(1, _CELLS // units)
    for one in range(count - 1):
        for start in range(one + 1, count, step):
            some = np.arange(start, min(start + step, count))
            found = (
                _of_shares(sample, one, some, resampling.confidence)
                if by_shares
                else _percentiles(draws, one, some, resampling.confidence)
            )
            limits[:, one, some] = found.T
    return limits


def _of_shares(sample: Sample, one: int, others: Places, confidence: float) -> Floats:
    parts = [paired_difference(part[one], part[others]) for part in sample.values]
    return difference_limits(parts, confidence)


def _percentiles(draws: Floats, one: int, others: Places, confidence: float) -> Floats:
    found = np.sort(paired_difference(draws[one], draws[others]), axis=1)
    tails = np.array([(1 - confidence) / 2, (1 + confidence) / 2])
    return quantiles(found, np.broadcast_to(tails, (len(found), 2)))

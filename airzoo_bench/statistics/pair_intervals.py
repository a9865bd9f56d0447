"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import Places, mean_draws, rows_of
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.scene_means import student
from airzoo_bench.statistics.shares import (
    Reaches,
    difference_limits,
    put_together,
    squares_of_hits,
)

__all__ = ["pair_limits"]

_Limits = Callable[[int, Places], Floats]
"""The limits (C, 2) of a variable's differences from others."""


def pair_limits(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Take the interval of every difference: over scenes by Student's t, shares MOVER, else drawn.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all shares, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed, confidence.

    Returns
    -------
    (2, V, V) array
        Low and high of row minus column, above the diagonal; NaN elsewhere, and where a group has
        fewer than `FEWEST` units. Those of a pair are the same to the last bit whatever the other
        variables are.
    """
    count = len(sample.medians)
    limits = np.full((2, count, count), np.nan)
    if sample.fewest[0] < FEWEST or count < 2:
        return limits
    if sample.unit == "scene":
        limits_of, width = _over_scenes(sample, resampling), 1
    elif sample.shares is None or not sample.shares.all():
        limits_of, width = _by_percentiles(sample, resampling), resampling.resamples
    elif all(((part == 0) | (part == 1)).all() for part in sample.values):
        limits_of, width = _of_hits(sample, resampling), 1
    else:
        limits_of = _of_graded_shares(sample, resampling)
        width = sum(part.shape[1] for part in sample.values)
    for one, others in rows_of(np.triu(np.ones((count, count), np.bool_), 1), width):
        limits[:, one, others] = limits_of(one, others).T
    return limits


def _over_scenes(sample: Sample, resampling: ResamplingConfig) -> _Limits:
    [values] = sample.values
    shares = np.zeros(len(values), np.bool_) if sample.shares is None else sample.shares

    def limits_of(one: int, others: Places) -> Floats:
        gaps = paired_difference(values[one], values[others])
        return student(gaps, shares[others], resampling.confidence)[0]

    return limits_of


def _by_percentiles(sample: Sample, resampling: ResamplingConfig) -> _Limits:
    draws = mean_draws(sample, resampling)

    def limits_of(one: int, others: Places) -> Floats:
        found = np.sort(paired_difference(draws[one], draws[others]), axis=1)
        return quantiles(found, np.broadcast_to(resampling.tails, (len(found), 2)))

    return limits_of


def _of_graded_shares(sample: Sample, resampling: ResamplingConfig) -> _Limits:
    def limits_of(one: int, others: Places) -> Floats:
        gaps = [paired_difference(part[one], part[others]) for part in sample.values]
        return difference_limits(gaps, resampling.confidence)

    return limits_of


def _of_hits(sample: Sample, resampling: ResamplingConfig) -> _Limits:
    """Take `difference_limits` from what each wins of another, which products count."""
    means = np.mean([part.mean(axis=1) for part in sample.values], axis=0)
    reaches = [Reaches.of_hits(part.shape[1], resampling.confidence) for part in sample.values]
    hits = [part.sum(axis=1) for part in sample.values]

    def limits_of(one: int, others: Places) -> Floats:
        squares = np.zeros((2, len(others)))
        for part, reach, counts in zip(sample.values, reaches, hits, strict=True):
            both = part[others] @ part[one]
            won, lost = ((counts[side] - both).astype(np.intp) for side in (one, others))
            squares += squares_of_hits(reach.at(won), reach.at(lost), part.shape[1])
        return put_together(means[one] - means[others], squares, len(sample.values))

    return limits_of

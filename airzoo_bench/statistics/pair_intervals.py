"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import Places, mean_draws, rows_of
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.scene_means import student
from airzoo_bench.statistics.shares import Reaches, difference_limits, put_together, squares_of_hits

__all__ = ["pair_limits"]


def pair_limits(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Take the interval of every difference: over scenes by Student's t, shares MOVER, else drawn.

    Of V variables, all shares or none, return low and high of row minus column (2, V, V) above the
    diagonal; NaN elsewhere, and where a group has fewer than `FEWEST` units. Those of a pair are
    the same to the last bit whatever the other variables are.
    """
    count, confidence = len(sample.medians), resampling.confidence
    limits = np.full((2, count, count), np.nan)
    if sample.fewest[0] < FEWEST:
        return limits
    wanted = np.triu(np.ones((count, count), np.bool_), 1)
    if sample.unit == "scene":
        [values] = sample.values
        shares = np.zeros(count, np.bool_) if sample.shares is None else sample.shares
        for one, others in rows_of(wanted):
            gaps = paired_difference(values[one], values[others])
            limits[:, one, others] = student(gaps, shares[others], confidence)[0].T
    elif sample.shares is None or not sample.shares.all():
        draws = mean_draws(sample, resampling)
        for one, others in rows_of(wanted, resampling.resamples):
            ranked = np.sort(paired_difference(draws[one], draws[others]), axis=1)
            levels = np.broadcast_to(resampling.tails, (len(ranked), 2))
            limits[:, one, others] = quantiles(ranked, levels).T
    elif all(((part == 0) | (part == 1)).all() for part in sample.values):
        hits = [part.sum(axis=1) for part in sample.values]
        for one, others in rows_of(wanted):
            limits[:, one, others] = _limits_of_hits(sample, hits, confidence, one, others).T
    else:
        for one, others in rows_of(wanted, sum(part.shape[1] for part in sample.values)):
            gaps_of_scenes = [paired_difference(part[one], part[others]) for part in sample.values]
            limits[:, one, others] = difference_limits(gaps_of_scenes, confidence).T
    return limits


def _limits_of_hits(
    sample: Sample, hits: Sequence[Floats], confidence: float, one: int, others: Places
) -> Floats:
    """Take `difference_limits` from what each wins of another, which products count."""
    squares, sizes = np.zeros((2, len(others))), [part.shape[1] for part in sample.values]
    for part, counts, queries in zip(sample.values, hits, sizes, strict=True):
        both, reaches = part[others] @ part[one], Reaches.of_hits(queries, confidence)
        won, lost = (reaches.at((counts[side] - both).astype(np.intp)) for side in (one, others))
        squares += squares_of_hits(won, lost, queries)
    means = np.mean([counts / queries for counts, queries in zip(hits, sizes, strict=True)], axis=0)
    return put_together(means[one] - means[others], squares, len(sizes))

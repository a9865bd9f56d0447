"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import mean_draws
from airzoo_bench.statistics.pairs import Places, rows_of
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.scene_means import student
from airzoo_bench.statistics.share_differences import (
    Reaches,
    difference_limits,
    put_together,
    squares_of_hits,
)

__all__ = ["pair_limits"]

_CELLS = 1 << 16


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
    wanted = np.triu(np.ones((count, count), np.bool_), 1)
    if min(part.shape[1] for part in sample.values) < FEWEST or not wanted.any():
        return limits
    by_shares = sample.shares is not None and bool(sample.shares.all())
    of_queries = _of_shares if by_shares else _by_percentiles
    rows = _over_scenes if sample.unit == "scene" else of_queries
    for one, others, found in rows(sample, resampling, wanted):
        limits[:, one, others] = found.T
    return limits


_Found = Iterator[tuple[int, Places, Floats]]


def _over_scenes(sample: Sample, resampling: ResamplingConfig, wanted: NDArray[np.bool_]) -> _Found:
    [values] = sample.values
    shares = np.zeros(len(values), np.bool_) if sample.shares is None else sample.shares
    for one, others in rows_of(wanted):
        gaps = paired_difference(values[one], values[others])
        yield one, others, student(gaps, shares[others], resampling.confidence)[0]


def _by_percentiles(
    sample: Sample, resampling: ResamplingConfig, wanted: NDArray[np.bool_]
) -> _Found:
    draws = mean_draws(sample, resampling)
    step = max(1, _CELLS // resampling.resamples)
    for one, others in rows_of(wanted):
        for start in range(0, len(others), step):
            some = others[start : start + step]
            yield one, some, _percentiles(draws, one, some, resampling.confidence)


def _of_shares(sample: Sample, resampling: ResamplingConfig, wanted: NDArray[np.bool_]) -> _Found:
    """Take `difference_limits`; of hits from what each wins of another, which products count."""
    confidence = resampling.confidence
    hits = all(((part == 0) | (part == 1)).all() for part in sample.values)
    means = np.mean([part.mean(axis=1) for part in sample.values], axis=0)
    for one, others in rows_of(wanted):
        if not hits:
            yield one, others, _directly(sample, one, others, confidence)
            continue
        squares = np.zeros((2, len(others)))
        for part in sample.values:
            reaches = Reaches.of_hits(part.shape[1], confidence)
            both, counts = part[others] @ part[one], part.sum(axis=1)
            won, lost = ((counts[side] - both).astype(np.intp) for side in (one, others))
            squares += squares_of_hits(reaches.at(won), reaches.at(lost), part.shape[1])
        yield one, others, put_together(means[one] - means[others], squares, len(sample.values))


def _directly(sample: Sample, one: int, others: Places, confidence: float) -> Floats:
    found = np.empty((len(others), 2))
    step = max(1, _CELLS // sum(part.shape[1] for part in sample.values))
    for start in range(0, len(others), step):
        some = others[start : start + step]
        parts = [paired_difference(part[one], part[some]) for part in sample.values]
        found[start : start + step] = difference_limits(parts, confidence)
    return found


def _percentiles(draws: Floats, one: int, others: Places, confidence: float) -> Floats:
    found = np.sort(paired_difference(draws[one], draws[others]), axis=1)
    tails = np.array([(1 - confidence) / 2, (1 + confidence) / 2])
    return quantiles(found, np.broadcast_to(tails, (len(found), 2)))

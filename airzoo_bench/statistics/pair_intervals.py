"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import Places, mean_draws
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.shares import (
    Reaches,
    difference_limits,
    put_together,
    squares_of_hits,
    student_squares,
)

__all__ = ["pair_limits"]

_CELLS = 1 << 21
_CANCELLED = 1e-6  # of two squares: what is left of their difference has few digits
_PARTS = 1 << 20  # shares that differ by less than one of these differ by rounding


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
    rows = _of_shares if by_shares else _by_percentiles
    for one, others, found in rows(sample, resampling):
        limits[:, one, others] = found.T
    return limits


_Found = Iterator[tuple[int, Places, Floats]]


def _by_percentiles(sample: Sample, resampling: ResamplingConfig) -> _Found:
    draws = mean_draws(sample, resampling)
    step = max(1, _CELLS // resampling.resamples)
    for one in range(len(draws) - 1):
        for start in range(one + 1, len(draws), step):
            some = np.arange(start, min(start + step, len(draws)))
            yield one, some, _percentiles(draws, one, some, resampling.confidence)


def _of_shares(sample: Sample, resampling: ResamplingConfig) -> _Found:
    """Take `difference_limits` from what pairs need of each scene, which matrix products give."""
    confidence = resampling.confidence
    hits = all(((part == 0) | (part == 1)).all() for part in sample.values)
    kind = _Hits if hits else _Graded
    scenes = [kind(part, confidence) for part in sample.values]
    means = np.mean([part.mean(axis=1) for part in sample.values], axis=0)
    for one in range(len(means) - 1):
        others = np.arange(one + 1, len(means))
        squares = np.zeros((2, len(others)))
        usual = np.zeros(len(others), np.bool_) if not hits else np.ones(len(others), np.bool_)
        alike = np.zeros(len(others), np.bool_)
        for scene in scenes:
            found, graded, constant = scene.squares(one, others)
            squares += found
            usual |= graded
            alike |= constant
        usual &= ~alike
        yield one, others, put_together(means[one] - means[others], squares, len(scenes))
        yield one, others[~usual], _directly(sample, one, others[~usual], confidence)


class _Hits:
    """A scene of hits: how many each method wins of another says all."""

    def __init__(self, values: Floats, confidence: float) -> None:
        self._count = values.shape[1]
        self._wins = np.rint(values @ (1 - values).T).astype(np.intp)
        self._reaches = Reaches.of_hits(self._count, confidence)

    def squares(
        self, one: int, others: Places
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        won = self._reaches.at(self._wins[one, others])
        lost = self._reaches.at(self._wins[others, one])
        no = np.zeros(len(others), np.bool_)
        return squares_of_hits(won, lost, self._count), ~no, no


class _Graded:
    """A scene of graded shares: the variance of differences; says where that is not enough."""

    def __init__(self, values: Floats, confidence: float) -> None:
        self._count, self._confidence = values.shape[1], confidence
        self._centred = values - values.mean(axis=1, keepdims=True)
        self._products = self._centred @ self._centred.T
        parts = np.rint((values % 1) * _PARTS).astype(np.int32)
        self._parts = np.where(parts == _PARTS, 0, parts)

    def squares(
        self, one: int, others: Places
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        own, theirs = self._products[one, one], self._products[others, others]
        sums = own + theirs - 2 * self._products[one, others]
        constant = sums <= _CANCELLED * (own + theirs)
        found = student_squares(
            np.maximum(sums, 0.0) / (self._count - 1), self._count, self._confidence
        )
        graded = np.zeros(len(others), np.bool_)
        step = max(1, (_CELLS >> 2) // self._count)
        for start in range(0, len(others), step):
            some = slice(start, start + step)
            graded[some] = (self._parts[others[some]] != self._parts[one]).any(axis=1)
        return np.stack([found, found]), graded, constant


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

"""Intervals of the difference of every two of many variables, those of `sample_intervals`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import quantiles
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.pair_tests import mean_draws
from airzoo_bench.statistics.pairs import Places, hubs, oriented, rows_of, wanted_pairs
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.share_differences import (
    Reaches,
    difference_limits,
    put_together,
    squares_of_hits,
    student_squares,
)
from airzoo_bench.statistics.unit_products import UnitProducts

__all__ = ["pair_limits"]

_CELLS = 1 << 21
_CANCELLED = 1e-3  # of two squares: what is left of their difference has few digits
_PARTS = 1 << 20  # shares that differ by less than one of these differ by rounding


def pair_limits(
    sample: Sample, resampling: ResamplingConfig, chosen: Places | None = None
) -> Floats:
    """Take the interval of every difference: of shares by MOVER, of all else by percentiles.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all shares, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed, confidence.
    chosen : (C,) array of int, optional
        Of the pairs that have one of these variables; of all where left out.

    Returns
    -------
    (2, V, V) array
        Low and high of row minus column, above the diagonal; NaN below, on it, for pairs that were
        not asked for, and where a group has fewer than `FEWEST` units. Those of a pair are the same
        to the last bit whatever the other variables are.
    """
    count = len(sample.medians)
    limits = np.full((2, count, count), np.nan)
    wanted = wanted_pairs(count, chosen)
    if min(part.shape[1] for part in sample.values) < FEWEST or not wanted.any():
        return limits
    by_shares = sample.shares is not None and bool(sample.shares.all())
    rows = _of_shares if by_shares else _by_percentiles
    for one, others, found in rows(sample, resampling, wanted):
        first, second = oriented(one, others)
        limits[:, first, second] = found.T
    return limits


_Found = Iterator[tuple[int, Places, Floats]]


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
    """Take `difference_limits` from what pairs need of each scene, which matrix products give."""
    confidence, rows = resampling.confidence, hubs(wanted)
    hits = all(((part == 0) | (part == 1)).all() for part in sample.values)
    kind = _Hits if hits else _Graded
    scenes = [kind(part, rows, confidence) for part in sample.values]
    means = np.mean([part.mean(axis=1) for part in sample.values], axis=0)
    for one, others in rows_of(wanted):
        first, second = oriented(one, others)
        squares = np.zeros((2, len(others)))
        graded, unsure = np.zeros((2, len(others)), np.bool_)
        for scene in scenes:
            found, fractions, cancelled = scene.squares(one, others)
            squares += found
            graded |= fractions
            unsure |= cancelled
        yield one, others, put_together(means[first] - means[second], squares, len(scenes))
        direct = others[unsure | ~(graded | hits)]
        if len(direct):
            yield one, direct, _directly(sample, one, direct, confidence)


_Squares = tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]
"""Squared reaches; whether differences have fractions; whether too few digits are left."""


class _Hits:
    """A scene of hits: how many each method wins of another says all."""

    def __init__(self, values: Floats, rows: Places, confidence: float) -> None:
        self._count = values.shape[1]
        self._products = UnitProducts.of(values, rows)
        self._reaches = Reaches.of_hits(self._count, confidence)

    def squares(self, one: int, others: Places) -> _Squares:
        both, hits = self._products.at(one, others), self._products.squares
        first, second = oriented(one, others)
        won, lost = ((hits[side] - both).astype(np.intp) for side in (first, second))
        reaches = self._reaches.at(won), self._reaches.at(lost)
        no = np.zeros(len(others), np.bool_)
        return squares_of_hits(*reaches, self._count), no, no


class _Graded:
    """A scene of graded shares, whose differences have Student's limits."""

    def __init__(self, values: Floats, rows: Places, confidence: float) -> None:
        self._count, self._confidence = values.shape[1], confidence
        self._products = UnitProducts.of(values - values.mean(axis=1, keepdims=True), rows)
        parts = np.rint((values % 1) * _PARTS).astype(np.int32)
        self._parts = np.where(parts == _PARTS, 0, parts)

    def squares(self, one: int, others: Places) -> _Squares:
        own, theirs = self._products.squares[one], self._products.squares[others]
        sums = own + theirs - 2 * self._products.at(one, others)
        variances = np.maximum(sums, 0.0) / (self._count - 1)
        found = student_squares(variances, self._count, self._confidence)
        fractions = np.zeros(len(others), np.bool_)
        step = max(1, (_CELLS >> 2) // self._count)
        for start in range(0, len(others), step):
            some = slice(start, start + step)
            fractions[some] = (self._parts[others[some]] != self._parts[one]).any(axis=1)
        return np.stack([found, found]), fractions, sums <= _CANCELLED * (own + theirs)


def _directly(sample: Sample, one: int, others: Places, confidence: float) -> Floats:
    found = np.empty((len(others), 2))
    step = max(1, _CELLS // sum(part.shape[1] for part in sample.values))
    for start in range(0, len(others), step):
        some = others[start : start + step]
        first, second = oriented(one, some)
        parts = [paired_difference(part[first], part[second]) for part in sample.values]
        found[start : start + step] = difference_limits(parts, confidence)
    return found


def _percentiles(draws: Floats, one: int, others: Places, confidence: float) -> Floats:
    first, second = oriented(one, others)
    found = np.sort(paired_difference(draws[first], draws[second]), axis=1)
    tails = np.array([(1 - confidence) / 2, (1 + confidence) / 2])
    return quantiles(found, np.broadcast_to(tails, (len(found), 2)))

"""Intervals of mean shares, such as hit rates, that hold where all queries of a scene are alike.

One scene has Wilson's interval (1927). The average over scenes is put together from the limits of
scenes by MOVER (Zou and Donner 2008), with Jeffreys' limits (Brown, Cai and DasGupta 2001), which
cover better than Wilson's where many scenes are added. A paired difference is the share won minus
the share lost; where it has fractions, as of AP@5, it has Student's limits in each scene. Effective
sizes are those of Franco, Little, Louis and Slud (2019). docs/statistics.md has the coverage.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, ndtri, stdtrit

from airzoo_bench.geometry.arrays import Floats

_PRIOR = 0.5  # so many queries more at 0, and at 1, as Jeffreys' prior has it
_ALIKE = 1e-9


class Rates(NamedTuple):
    """Mean shares (R,) of a scene as hit rates, with the sizes (R,) at which those vary as much.

    The size of hits is the number of queries; of shares that vary less, it is larger.
    """

    means: Floats
    sizes: Floats


def effective_rates(values: Floats) -> Rates:
    """Measure shares (R, N) from 0 to 1; those that vary as much as hits count as hits.

    Sizes come from the sums of squares of hits and of values, with the prior's queries added.
    """
    count, means = values.shape[1], values.mean(axis=1)
    squares = ((values - means[:, None]) ** 2).sum(axis=1)
    ends = _PRIOR * (means**2 + (1 - means) ** 2)
    sizes = count * means * (1 - means) * (count + 2 * _PRIOR) / (squares + ends)
    return Rates(means, np.maximum(sizes, count))


def wilson_limits(rates: Rates, confidence: float) -> Floats:
    """Return Wilson's limits of rates, (R, 2)."""
    squared = float(ndtri((1 + confidence) / 2)) ** 2
    means, sizes = rates
    centre = means + squared / (2 * sizes)
    reach = np.sqrt(squared * (means * (1 - means) / sizes + squared / (4 * sizes**2)))
    limits = np.stack([centre - reach, centre + reach], axis=1) / (1 + squared / sizes)[:, None]
    # Exactly, not but for rounding, at the ends.
    return _around(np.clip(limits, 0.0, 1.0), means)


def jeffreys_limits(rates: Rates, confidence: float) -> Floats:
    """Return Jeffreys' limits of rates, (R, 2): 0 where nothing was hit, 1 where everything was."""
    hits, misses = rates.means * rates.sizes, (1 - rates.means) * rates.sizes
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    limits = [betaincinv(hits + 0.5, misses + 0.5, tail) for tail in tails]
    return _around(np.stack(limits, axis=1), rates.means)


def _around(limits: Floats, means: Floats) -> Floats:
    """Let no limit lie beyond the mean; limits of 0 and 1 then lie on it."""
    return np.stack([np.minimum(limits[:, 0], means), np.maximum(limits[:, 1], means)], axis=1)


def average_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals (R, 2) of mean shares, (R, N) of each scene, averaged without weights."""
    return limits_of_rates([effective_rates(values) for values in scenes], confidence)


def limits_of_rates(rates: Sequence[Rates], confidence: float) -> Floats:
    """Take the intervals (R, 2) of averaged rates: Wilson's of one scene, MOVER's of several."""
    if len(rates) == 1:
        return wilson_limits(rates[0], confidence)
    means = np.mean([rate.means for rate in rates], axis=0)
    squares = sum(_reaches(rate, confidence) ** 2 for rate in rates)
    down, up = np.sqrt(squares) / len(rates)
    return np.stack([means - down, means + up], axis=1)


def _reaches(rates: Rates, confidence: float) -> Floats:
    """Return how far Jeffreys' limits lie below and above rates, (2, R)."""
    low, high = jeffreys_limits(rates, confidence).T
    return np.stack([rates.means - low, high - rates.means])


def difference_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals (R, 2) of paired differences, (R, N) of each scene, averaged over scenes.

    Of hits, what is won and what is lost are two shares, whose covariance is known: a query cannot
    be both. Differences with fractions have Student's limits in each scene, unless all of a scene
    are alike. MOVER puts together the limits of all scenes.
    """
    means = np.mean([values.mean(axis=1) for values in scenes], axis=0)
    graded = np.any([(values != np.rint(values)).any(axis=1) for values in scenes], axis=0)
    squares = np.zeros((2, len(means)))
    for values in scenes:
        count = values.shape[1]
        student = stdtrit(count - 1, (1 + confidence) / 2) ** 2 * values.var(axis=1, ddof=1) / count
        of_scene = np.stack([student, student])
        as_hits = ~graded | (np.ptp(values, axis=1) <= _ALIKE)
        if as_hits.any():
            of_scene[:, as_hits] = _squares_of_hits(values[as_hits], confidence)
        squares += of_scene
    down, up = np.sqrt(np.maximum(squares, 0.0)) / len(scenes)
    return np.stack([np.maximum(means - down, -1.0), np.minimum(means + up, 1.0)], axis=1)


def _squares_of_hits(values: Floats, confidence: float) -> Floats:
    """Return the squared reaches, down and up (2, R), of a scene's share won minus share lost."""
    won, lost = (effective_rates(np.maximum(side, 0.0)) for side in (values, -values))
    spread = np.sqrt(won.means * (1 - won.means) / won.sizes)
    spread = spread * np.sqrt(lost.means * (1 - lost.means) / lost.sizes) * values.shape[1]
    nothing = np.zeros(len(spread))
    correlation = np.divide(-won.means * lost.means, spread, out=nothing, where=spread > 0)
    one, other = _reaches(won, confidence), _reaches(lost, confidence)[::-1]
    squares = one**2 + other**2 - 2 * np.maximum(correlation, -1.0) * one * other
    return np.asarray(squares)

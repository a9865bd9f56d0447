"""Intervals of mean shares, such as hit rates, that hold where all queries of a scene are alike.

Resamples of a scene in which every query is a hit cannot differ, and so say that its rate is
known. Here such a scene keeps the uncertainty of its size. One scene has Wilson's interval; the
average over scenes is put together from the scenes' limits by MOVER, the method of variance
estimates recovery (Zou and Donner 2008), with Jeffreys' limits, which cover better than Wilson's
where many scenes are added (docs/statistics.md has the figures). `share_differences` has those of
paired differences.

References
----------
E. Wilson, Probable inference, the law of succession, and statistical inference, Journal of the
American Statistical Association 22 (1927).
G. Zou and A. Donner, Construction of confidence limits about effect measures: a general approach,
Statistics in Medicine 27 (2008); for sums of rates G. Zou, W. Huang and X. Zhang, A note on
confidence interval estimation for a linear function of binomial proportions, Computational
Statistics and Data Analysis 53 (2009).
L. Brown, T. Cai and A. DasGupta, Interval estimation for a binomial proportion, Statistical
Science 16 (2001): Wilson's and Jeffreys' intervals.
C. Franco, R. Little, T. Louis and E. Slud, Comparative study of confidence intervals for
proportions in complex sample surveys, Journal of Survey Statistics and Methodology 7 (2019):
effective sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats

__all__ = [
    "PRIOR",
    "Rates",
    "average_limits",
    "jeffreys_limits",
    "jeffreys_reaches",
    "limits_of_rates",
    "wilson_limits",
]

PRIOR = 0.5
"""So many queries more at 0, and at 1, as Jeffreys' prior has it, steady the variance of AP."""


@dataclass(frozen=True, eq=False)
class Rates:
    """Mean shares of a scene, as if they were hit rates.

    Attributes
    ----------
    means : (R,) array
    sizes : (R,) array
        Effective sizes: of how many hits and misses a rate would vary as much. For hits that is how
        many queries there are; for shares that vary less, more.
    """

    means: Floats
    sizes: Floats

    @classmethod
    def of(cls, values: Floats) -> Rates:
        """Measure shares, (R, N) from 0 to 1; those that vary as much as hits count as hits.

        Parameters
        ----------
        values : (R, N) array
            Shares of N queries, 0 to 1.

        Returns
        -------
        Rates
            Of each of the R rows.
        """
        count = values.shape[1]
        means = values.mean(axis=1)
        ends = PRIOR * (means**2 + (1 - means) ** 2)
        squares = ((values - means[:, None]) ** 2).sum(axis=1)
        sizes = count * means * (1 - means) * (count + 2 * PRIOR) / (squares + ends)
        return cls(means, np.maximum(sizes, count))

    @property
    def spread(self) -> Floats:
        """Standard errors (R,)."""
        return np.asarray(np.sqrt(self.means * (1 - self.means) / self.sizes))


Limits = Callable[[Rates, float], Floats]


def wilson_limits(rates: Rates, confidence: float) -> Floats:
    """Return Wilson's limits of rates, (R, 2).

    Parameters
    ----------
    rates : Rates
        R rates and their numbers of queries.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R, 2) array
        Low and high, 0 to 1.
    """
    from scipy.special import ndtri

    squared = float(ndtri((1 + confidence) / 2)) ** 2
    means, sizes = rates.means, rates.sizes
    centre = means + squared / (2 * sizes)
    reach = np.sqrt(squared * (means * (1 - means) / sizes + squared / (4 * sizes**2)))
    limits = np.stack([centre - reach, centre + reach], axis=1) / (1 + squared / sizes)[:, None]
    # Exactly, not but for rounding, at the ends.
    return _around(np.clip(limits, 0.0, 1.0), means)


def jeffreys_limits(rates: Rates, confidence: float) -> Floats:
    """Return Jeffreys' limits of rates, (R, 2): 0 where nothing was hit, 1 where everything was.

    Parameters
    ----------
    rates : Rates
        R rates and their numbers of queries.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R, 2) array
        Low and high, 0 to 1.
    """
    from scipy.special import betaincinv

    hits, misses = rates.means * rates.sizes, (1 - rates.means) * rates.sizes
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    limits = [betaincinv(hits + 0.5, misses + 0.5, tail) for tail in tails]
    return _around(np.stack(limits, axis=1), rates.means)


def _around(limits: Floats, means: Floats) -> Floats:
    """Let no limit, from 0 to 1, lie beyond the mean; those of 0 and 1 then lie on it."""
    return np.stack([np.minimum(limits[:, 0], means), np.maximum(limits[:, 1], means)], axis=1)


def average_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals of mean shares, averaged over scenes without weights.

    Parameters
    ----------
    scenes : sequence of (R, N) arrays
        R shares, from 0 to 1, of the N queries of each scene.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R, 2) array
        Wilson's limits of one scene, MOVER's of Jeffreys' limits of several.
    """
    return limits_of_rates([Rates.of(values) for values in scenes], confidence)


def limits_of_rates(rates: Sequence[Rates], confidence: float) -> Floats:
    """Take the intervals of rates, averaged over scenes without weights.

    Parameters
    ----------
    rates : sequence of Rates
        R rates of each scene.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R, 2) array
        See `average_limits`.
    """
    if len(rates) == 1:
        return wilson_limits(rates[0], confidence)
    reaches = [jeffreys_reaches(rate, confidence) for rate in rates]
    means = np.mean([rate.means for rate in rates], axis=0)
    down, up = (np.sqrt(sum(reach[side] ** 2 for reach in reaches)) for side in (0, 1))
    return np.stack([means - down / len(rates), means + up / len(rates)], axis=1)


def jeffreys_reaches(rates: Rates, confidence: float) -> tuple[Floats, Floats]:
    """Return how far Jeffreys' limits lie from the rates.

    Parameters
    ----------
    rates : Rates
        R rates and their numbers of queries.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    tuple of (R,) arrays
        Below, above.
    """
    low, high = jeffreys_limits(rates, confidence).T
    return rates.means - low, high - rates.means

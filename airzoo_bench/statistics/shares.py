"""Intervals of mean shares, such as hit rates, that hold where all queries of a scene are alike.

Resamples of a scene in which every query is a hit cannot differ, and so say that its rate is
known. Here such a scene keeps the uncertainty of its size. One scene has Wilson's interval; the
average over scenes is put together from the scenes' limits by MOVER, the method of variance
estimates recovery (Zou and Donner 2008), with Jeffreys' limits, which cover better than Wilson's
where many scenes are added (docs/statistics.md has the figures). A paired difference is the share
won minus the share lost, whose limits MOVER puts together likewise; of graded shares, such as AP@5,
it has Student's limits in each scene.

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
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = [
    "Rates",
    "Reaches",
    "average_limits",
    "difference_limits",
    "jeffreys_limits",
    "put_together",
    "squares_of_hits",
    "student_squares",
    "wilson_limits",
]

_PRIOR = 0.5
"""So many queries more at 0, and at 1, as Jeffreys' prior has it, steady the variance of AP."""


_ALIKE = 1e-9


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
        ends = _PRIOR * (means**2 + (1 - means) ** 2)
        squares = ((values - means[:, None]) ** 2).sum(axis=1)
        sizes = count * means * (1 - means) * (count + 2 * _PRIOR) / (squares + ends)
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
    rates = [Rates.of(values) for values in scenes]
    if len(rates) == 1:
        return wilson_limits(rates[0], confidence)
    reaches = [_reaches(rate, confidence) for rate in rates]
    means = np.mean([rate.means for rate in rates], axis=0)
    down, up = (np.sqrt(sum(reach[side] ** 2 for reach in reaches)) for side in (0, 1))
    return np.stack([means - down / len(rates), means + up / len(rates)], axis=1)


def difference_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals of paired differences of mean shares, averaged over scenes.

    Parameters
    ----------
    scenes : sequence of (R, N) arrays
        R differences, from -1 to 1, on the N queries of each scene.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R, 2) array
        Of hits, what is won and what is lost are two shares, whose covariance is known: a query
        cannot be both. Graded shares, such as AP@5, have Student's limits in each scene, and those
        of hits where all differences of a scene are alike. MOVER puts together the limits of all
        scenes.
    """
    count = len(scenes)
    means = np.mean([values.mean(axis=1) for values in scenes], axis=0)
    graded = np.any([(values % 1 != 0).any(axis=1) for values in scenes], axis=0)
    squares = sum(_squares(values, graded, confidence) for values in scenes)
    return put_together(means, np.asarray(squares), count)


def _squares(values: Floats, graded: NDArray[np.bool_], confidence: float) -> Floats:
    """Return the squared reaches of a scene's differences, down and up, (2, R)."""
    count = values.shape[1]
    student = student_squares(values.var(axis=1, ddof=1), count, confidence)
    vary = np.ptp(values, axis=1) > _ALIKE
    return np.where(graded & vary, student, _squares_of_hits(values, confidence))


def student_squares(variances: Floats, count: int, confidence: float) -> Floats:
    """Return the squared reaches of Student's limits of means.

    Parameters
    ----------
    variances : (R,) array
        Of the values of each mean.
    count : int
        How many values a mean has, at least 2.
    confidence : float
        Between 0 and 1.

    Returns
    -------
    (R,) array
        The same down and up.
    """
    from scipy.special import stdtrit

    return np.asarray(stdtrit(count - 1, (1 + confidence) / 2) ** 2 * variances / count)


def _squares_of_hits(values: Floats, confidence: float) -> Floats:
    sides = [Rates.of(np.maximum(part, 0.0)) for part in (values, -values)]
    won, lost = (Reaches.of(rates, confidence) for rates in sides)
    return squares_of_hits(won, lost, values.shape[1])


@dataclass(frozen=True, eq=False)
class Reaches:
    """Rates with their standard errors, and how far their limits lie below and above them.

    Attributes
    ----------
    means, spread : (R,) arrays
        Rates and standard errors.
    down, up : (R,) arrays
        How far Jeffreys' limits lie below and above.
    """

    means: Floats
    spread: Floats
    down: Floats
    up: Floats

    @classmethod
    def of(cls, rates: Rates, confidence: float) -> Reaches:
        """Take Jeffreys' limits of rates.

        Parameters
        ----------
        rates : Rates
            R rates.
        confidence : float
            Between 0 and 1.

        Returns
        -------
        Reaches
            Of each rate.
        """
        return cls(rates.means, rates.spread, *_reaches(rates, confidence))

    @classmethod
    def of_hits(cls, count: int, confidence: float) -> Reaches:
        """Take those of 0, 1, ..., `count` hits of so many queries.

        Parameters
        ----------
        count : int
            How many queries there are.
        confidence : float
            Between 0 and 1.

        Returns
        -------
        Reaches
            Of `count` + 1 rates, as `Rates.of` has them.
        """
        means = np.arange(count + 1) / count
        varied = count * means * (1 - means)
        ends = _PRIOR * (means**2 + (1 - means) ** 2)
        sizes = np.maximum(varied * (count + 2 * _PRIOR) / (varied + ends), count)
        return cls.of(Rates(means, sizes), confidence)

    def at(self, places: NDArray[np.intp]) -> Reaches:
        """Choose some.

        Parameters
        ----------
        places : (K,) array of int
            Of the rates.

        Returns
        -------
        Reaches
            Of K rates.
        """
        return Reaches(*(part[places] for part in (self.means, self.spread, self.down, self.up)))


def squares_of_hits(won: Reaches, lost: Reaches, count: int) -> Floats:
    """Return the squared reaches of a scene's difference of hits, down and up.

    Parameters
    ----------
    won, lost : Reaches
        Shares of the queries that only the first, and only the second method answers.
    count : int
        How many queries the scene has.

    Returns
    -------
    (2, R) array
        What `difference_limits` puts together by MOVER.
    """
    spread = won.spread * lost.spread * count
    correlation = np.divide(
        -won.means * lost.means, spread, out=np.zeros(len(won.means)), where=spread > 0
    )
    correlation = np.maximum(correlation, -1.0)
    pairs = ((won.down, lost.up), (won.up, lost.down))
    return np.stack([one**2 + other**2 - 2 * correlation * one * other for one, other in pairs])


def put_together(means: Floats, squares: Floats, count: int) -> Floats:
    """Put the reaches of scenes together by MOVER.

    Parameters
    ----------
    means : (R,) array
        Differences, averaged over scenes.
    squares : (2, R) array
        Squared reaches down and up, summed over scenes.
    count : int
        Of scenes.

    Returns
    -------
    (R, 2) array
        Low and high, -1 to 1.
    """
    down, up = np.sqrt(np.maximum(squares, 0.0)) / count
    return np.stack([np.maximum(means - down, -1.0), np.minimum(means + up, 1.0)], axis=1)


def _reaches(rates: Rates, confidence: float) -> tuple[Floats, Floats]:
    """Return how far limits lie below and above the mean."""
    low, high = jeffreys_limits(rates, confidence).T
    return rates.means - low, high - rates.means

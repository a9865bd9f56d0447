"""Intervals of paired differences of mean shares, whose scenes MOVER puts together; see `shares`.

A difference is the share won minus the share lost. Where a difference has fractions, as of AP@5, it
has Student's limits in each scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.shares import PRIOR, Rates, jeffreys_reaches

__all__ = [
    "Reaches",
    "difference_limits",
    "put_together",
    "squares_of_hits",
    "student_squares",
]

_ALIKE = 1e-9


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
    graded = np.any([(values != np.rint(values)).any(axis=1) for values in scenes], axis=0)
    squares = sum(_squares(values, graded, confidence) for values in scenes)
    return put_together(means, np.asarray(squares), count)


def _squares(values: Floats, graded: NDArray[np.bool_], confidence: float) -> Floats:
    """Return the squared reaches of a scene's differences, down and up, (2, R)."""
    count = values.shape[1]
    student = student_squares(values.var(axis=1, ddof=1), count, confidence)
    squares = np.stack([student, student])
    as_hits = ~graded | (np.ptp(values, axis=1) <= _ALIKE)
    if as_hits.any():
        squares[:, as_hits] = _squares_of_hits(values[as_hits], confidence)
    return squares


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
        return cls(rates.means, rates.spread, *jeffreys_reaches(rates, confidence))

    @classmethod
    @lru_cache(maxsize=64)  # scenes are often of one size, and have the same for every score
    def of_hits(cls, count: int, confidence: float) -> Reaches:
        """Take those of 0, 1, ..., `count` hits of so many queries."""
        means = np.arange(count + 1) / count
        varied = count * means * (1 - means)
        ends = PRIOR * (means**2 + (1 - means) ** 2)
        sizes = np.maximum(varied * (count + 2 * PRIOR) / (varied + ends), count)
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

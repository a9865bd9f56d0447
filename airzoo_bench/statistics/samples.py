"""Samples: what is resampled, within what, and how it is averaged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["Method", "ResamplingConfig", "Sample", "difference", "paired_difference"]

Method = Literal["bca", "percentile"]

TIE = 1e-9
"""Closer values of a unit, as a share of their size above 1, may differ by the processor alone."""


@dataclass(frozen=True)
class ResamplingConfig:
    """How intervals and tests are made.

    `resamples` are of the bootstrap and, where not all can be tried, of the permutation test; the
    seed is of the random draws of both. `interval` is the kind of the bootstrap's intervals, and
    `confidence` lies between 0 and 1.
    """

    resamples: int = 10_000
    seed: int = 0
    interval: Method = "bca"
    confidence: float = 0.95

    @property
    def tails(self) -> Floats:
        """Levels of the two limits (2,)."""
        return np.array([(1 - self.confidence) / 2, (1 + self.confidence) / 2])


@dataclass(frozen=True)
class Sample:
    """Variables measured on the same units; units are independent of each other.

    Attributes
    ----------
    unit : str
        What a unit is: "query" or "scene".
    groups : tuple of str
        Within what units are resampled: scenes, or all scenes as one group. All different, since
        the draws of a group are known by its name.
    values : tuple of (V, N) arrays
        For each group, V variables of its N units.
    medians : (V,) bool
        Which variables are averaged by the median within a group; the statistic of all groups
        is the unweighted mean of theirs.
    shares : (V,) bool, optional
        Which variables are shares from 0 to 1 of each unit, averaged by their mean, so that their
        intervals need no resamples; none where left out.
    """

    unit: str
    groups: tuple[str, ...]
    values: tuple[Floats, ...]
    medians: Bools
    shares: Bools | None = None

    @property
    def fewest(self) -> tuple[int, str]:
        """The size and name of the smallest group."""
        sizes = [part.shape[1] for part in self.values]
        return min(zip(sizes, self.groups, strict=True))


def difference(first: Floats, second: Floats) -> Floats:
    """Subtract arrays that broadcast; two infinite values, which are failures both, differ by 0."""
    both = np.isinf(first) & (first == second)
    return np.subtract(first, second, out=np.zeros(np.broadcast(first, second).shape), where=~both)


def paired_difference(first: Floats, second: Floats) -> Floats:
    """Subtract what two methods have on the same units; 0 where it is at most 1e-9 of their size.

    Sizes count as at least 1. Scores agree between processors to some 12 digits, not to the last,
    and what is a tie on one of them must be one on the other, since wins, signs and patterns are
    counted.
    """
    found = difference(first, second)
    sizes = np.maximum(1.0, np.maximum(np.abs(first), np.abs(second)))
    tied = np.isfinite(found) & (np.abs(found) <= TIE * np.where(np.isinf(sizes), 1.0, sizes))
    return np.where(tied, 0.0, found)

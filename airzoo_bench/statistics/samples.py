"""Samples: what is resampled, within what, and how it is averaged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["Method", "Plan", "Sample", "gap"]

Method = Literal["bca", "percentile"]


@dataclass(frozen=True)
class Plan:
    """How intervals and tests are made.

    Attributes
    ----------
    resamples : int
        Of the bootstrap and, where not all can be tried, of the permutation test.
    seed : int
    interval : {"bca", "percentile"}
    confidence : float
        Between 0 and 1.
    """

    resamples: int = 10_000
    seed: int = 0
    interval: Method = "bca"
    confidence: float = 0.95


@dataclass(frozen=True)
class Sample:
    """Variables measured on the same units; units are independent of each other.

    Attributes
    ----------
    unit : str
        What a unit is, for messages: "query" or "scene".
    groups : tuple of str
        Within what units are resampled: scenes, or all scenes as one group.
    values : tuple of (V, N) arrays
        For each group, V variables of its N units.
    medians : (V,) bool
        Which variables are averaged by the median within a group; the statistic of all groups
        is the unweighted mean of theirs.
    """

    unit: str
    groups: tuple[str, ...]
    values: tuple[Floats, ...]
    medians: NDArray[np.bool_]


def gap(first: Floats, second: Floats) -> Floats:
    """Subtract; two infinite values, which are failures both, differ by nothing.

    Parameters
    ----------
    first, second : (...) arrays

    Returns
    -------
    (...) array
    """
    both = np.isinf(first) & (first == second)
    return np.subtract(first, second, out=np.zeros(np.broadcast(first, second).shape), where=~both)

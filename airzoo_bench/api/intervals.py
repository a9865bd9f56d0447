"""Confidence intervals from Python, of columns of per-query values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["ConfidenceInterval", "bootstrap_ci"]

Statistic = Literal["share", "mean", "median"]

_MOST_CONFIDENCE = 0.999999  # limits of more are those of rounding
_LARGEST = 1e100  # third powers of larger values overflow


@dataclass(frozen=True, eq=False, repr=False)
class ConfidenceInterval(Shown):
    """An average and its interval; ``low, high = found`` takes the limits.

    Attributes
    ----------
    estimate : float
        Of all scenes, their unweighted mean.
    low, high : float or None
        None where there is no interval; a limit may be infinite.
    confidence : float
    method, reason : str
        "wilson", "mover", "bca" or "percentile", or empty; why there is none.
    scenes : dict of str to ConfidenceInterval
        Of each scene; empty where none were named.
    """

    estimate: float
    low: float | None
    high: float | None
    confidence: float
    method: str
    reason: str
    scenes: dict[str, ConfidenceInterval]

    def __iter__(self) -> Iterator[float | None]:
        return iter((self.low, self.high))

    def _display_fields(self) -> Mapping[str, object]:
        parts = {name: part._written() for name, part in self.scenes.items()}
        return {"all scenes" if parts else "value": self._written(), **parts}

    def _written(self) -> str:
        if self.low is None or self.high is None:
            return f"{number(self.estimate)} (no interval: {self.reason})"
        limits = f"[{number(self.low)}, {number(self.high)}]"
        return f"{number(self.estimate)} {limits} {self.confidence:.0%} {self.method}"


def bootstrap_ci(
    values: ArrayLike,
    scenes: ArrayLike | None = None,
    *,
    statistic: Statistic,
    confidence: float = 0.95,
    seed: int = 0,
) -> ConfidenceInterval:
    """Return the confidence interval of an average; docs/statistics.md says how it is made.

    Source: Wilson, JASA 22, 1927. Zou and Donner, Statistics in Medicine 27, 2008 (MOVER). Efron
    and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 14 (BCa).

    Parameters
    ----------
    values : (N,) array-like
        A value a query. Infinite errors are values like all others.
    scenes : (N,) array-like, optional
        The scene of each: the average is the unweighted mean of theirs, resampled within scenes.
    statistic : {"share", "mean", "median"}
        Means of shares from 0 to 1, such as hits and AP, have Wilson's interval, over scenes
        MOVER's; other means and medians are bootstrapped.
    confidence : float
        Between 0 and 1.
    seed : int
        Of the 10,000 resamples.

    Returns
    -------
    ConfidenceInterval
        None, with a `reason`, where a scene has fewer than 5 queries or all resampled values are
        alike.

    Raises
    ------
    ArgumentError
        NaN, no value, shares outside 0 to 1, `scenes` of another length, settings out of range.

    Examples
    --------
    >>> bootstrap_ci([1, 1, 0, 1, 1, 0, 1, 1, 1, 1], statistic="share")
    ConfidenceInterval
      value  0.8000 [0.4902, 0.9433] 95% wilson
    """
    arg.choice("statistic", statistic, get_args(Statistic))
    share = arg.positive("confidence", confidence, _MOST_CONFIDENCE)
    plan = ResamplingConfig(seed=arg.whole("seed", seed, 0), confidence=share)
    given = _checked_values(values, statistic)
    groups = {"": given}
    if scenes is not None:
        groups = _split(given, scenes)
        arg.check_labels(values=values, scenes=scenes)
    sample = Sample(
        "query",
        tuple(groups),
        tuple(part[None] for part in groups.values()),
        np.array([statistic == "median"]),
        np.array([statistic == "share"]),
    )
    found = sample_intervals(sample, plan, groups=scenes is not None)
    average = np.median if statistic == "median" else np.mean
    means = {name: float(average(part)) for name, part in groups.items()}
    spans = {name: part[0] for name, part in found.groups.items()}
    parts = {
        name: ConfidenceInterval(means[name], one.low, one.high, share, one.method, one.reason, {})
        for name, one in spans.items()
    }
    one, mean = found.overall[0], float(np.mean(list(means.values())))
    return ConfidenceInterval(mean, one.low, one.high, share, one.method, one.reason, parts)


def _checked_values(values: ArrayLike, statistic: Statistic) -> Floats:
    given = arg.floats("values", values, (None,))
    bad = ~(np.abs(given) <= _LARGEST) & ~np.isposinf(given)
    expected = "a number a query; a failure is the worst value, such as infinity for errors"
    arg.refuse_rows("values", bad, "NaN, -inf or too large a number", expected)
    if len(given) == 0:
        raise arg.fault("values", "holds no value", expected)
    if statistic == "share" and not ((given >= 0.0) & (given <= 1.0)).all():
        what = f"run from {given.min():g} to {given.max():g}"
        fix = 'divide percent by 100, or choose statistic="mean" or "median"'
        raise arg.fault("values", what, "shares from 0 to 1", fix)
    return given


def _split(values: Floats, scenes: ArrayLike) -> dict[str, Floats]:
    """Return the values of each scene, in the order in which scenes are first named."""
    named = arg.as_array("scenes", scenes).astype(object)
    if named.shape != values.shape or pd.isna(named).any():
        what = f"has shape {named.shape}, or names that are missing"
        raise arg.fault("scenes", what, f"({len(values)},), the scene of each value")
    rows, names = pd.factorize(named.astype(str))
    return {str(name): values[rows == place] for place, name in enumerate(names)}

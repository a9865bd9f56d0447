"""Confidence intervals of columns of per-query values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import choice, finite, floats, in_order, positive, whole
from airzoo_bench.api.labels import same_index
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import Method, ResamplingConfig, Sample

__all__ = ["ConfidenceInterval", "Statistic", "bootstrap_ci"]

Statistic = Literal["share", "mean", "median"]

_LEAST_RESAMPLES, _MOST_RESAMPLES = 100, 1_000_000
_MOST_CONFIDENCE = 0.999999  # limits of more are those of rounding
_LARGEST = 1e100  # third powers of what is larger overflow


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
    method : str
        "wilson", "mover", "bca" or "percentile"; empty where there is none.
    reason : str
        Why there is none; else empty.
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

    def _shown(self) -> Mapping[str, object]:
        parts = {str(name): part._written() for name, part in self.scenes.items()}
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
    interval: Method = "bca",
    resamples: int = 10_000,
    seed: int = 0,
) -> ConfidenceInterval:
    """Take the confidence interval of an average, by the method that docs/statistics.md gives it.

    Parameters
    ----------
    values : (N,) array-like
        A value a query. Infinite errors are values like all others.
    scenes : (N,) array-like, optional
        The scene of each query. The average is then the unweighted mean of the scenes' averages,
        and queries are resampled within scenes.
    statistic : {"share", "mean", "median"}
        What is averaged. The mean of shares from 0 to 1, such as hits and AP, needs no resamples:
        Wilson's interval, over scenes that of MOVER. Other means and medians are bootstrapped.
        It has no default: a column of errors below 1 m looks like one of shares.
    confidence : float
        Between 0 and 1.
    interval : {"bca", "percentile"}
        Taken from resamples; percentile also where BCa does not exist.
    resamples : int
        100 to 1,000,000.
    seed : int
        Of the resamples.

    Returns
    -------
    ConfidenceInterval
        The same for the same values in the same order, whatever the machine. There is no interval,
        and `reason` says so, where a scene has fewer than 5 queries, or all that is resampled is
        alike.

    Raises
    ------
    ArgumentError
        NaN, no value, shares outside 0 to 1, `scenes` of another length, settings out of range.

    References
    ----------
    Wilson, JASA 22, 1927. Zou and Donner, Statistics in Medicine 27, 2008 (MOVER). Efron and
    Tibshirani, An Introduction to the Bootstrap, 1993, chapter 14 (BCa).

    Examples
    --------
    >>> bootstrap_ci([1, 1, 0, 1, 1, 0, 1, 1, 1, 1], statistic="share")
    ConfidenceInterval
      value  0.8000 [0.4902, 0.9433] 95% wilson
    >>> low, high = bootstrap_ci([0.4, 1.2, 2.5, 0.8, 3.1, float("inf")], statistic="median")
    >>> high
    inf
    """
    choice("statistic", statistic, get_args(Statistic))
    same_index({"values": values, "scenes": scenes})
    given = _values(values, statistic)
    plan = _checked_plan(interval, resamples, seed, confidence)
    groups = {"": given} if scenes is None else _by_scene(given, scenes)
    sample = Sample(
        "query",
        tuple(groups),
        tuple(part[None] for part in groups.values()),
        np.array([statistic == "median"]),
        np.array([statistic == "share"]),
    )
    found = sample_intervals(sample, plan, groups=scenes is not None)
    averages = {name: _average(part, statistic) for name, part in groups.items()}
    parts = {name: _made(averages[name], part[0], plan, {}) for name, part in found.groups.items()}
    return _made(float(np.mean(list(averages.values()))), found.overall[0], plan, parts)


def _checked_plan(
    interval: Method, resamples: int, seed: int, confidence: float
) -> ResamplingConfig:
    """Return how intervals and tests are made; settings out of range are refused."""
    choice("interval", interval, get_args(Method))
    if whole("resamples", resamples, _LEAST_RESAMPLES) > _MOST_RESAMPLES:
        raise ArgumentError(
            f"is {resamples}", where="resamples", expected=f"at most {_MOST_RESAMPLES:,}"
        )
    if positive("confidence", confidence) > _MOST_CONFIDENCE:
        raise ArgumentError(
            f"is {confidence!r}", where="confidence", expected="a share, such as 0.95"
        )
    return ResamplingConfig(int(resamples), whole("seed", seed, 0), interval, float(confidence))


def _values(values: ArrayLike, statistic: Statistic) -> Floats:
    array = np.asarray(in_order("values", values))
    given = floats("values", array.astype(np.int64) if array.dtype == np.bool_ else array, (None,))
    if len(given) == 0:
        raise ArgumentError("holds no value", where="values", expected="a value a query")
    bad = np.flatnonzero(np.isnan(given) | np.isneginf(given))
    if bad.size:
        raise ArgumentError(
            f"NaN or -inf in {first_of(bad.tolist(), len(given), noun='row')}",
            where="values",
            expected="numbers; a failure is the worst value, such as infinity for errors",
        )
    finite("values", given[np.isfinite(given)], _LARGEST)
    if statistic == "share" and not ((given >= 0.0) & (given <= 1.0)).all():
        raise ArgumentError(
            f"run from {given.min():g} to {given.max():g}",
            where="values",
            expected="shares from 0 to 1",
            fix='divide percent by 100, or choose statistic="mean" or "median"',
        )
    return given


def _by_scene(values: Floats, scenes: Any) -> dict[str, Floats]:
    import pandas as pd

    named = np.asarray(in_order("scenes", scenes), dtype=object)
    if named.shape != values.shape or pd.isna(named).any():
        raise ArgumentError(
            f"has shape {named.shape}, or names that are missing",
            where="scenes",
            expected=f"({len(values)},), the scene of each value",
        )
    rows, names = pd.factorize(named.astype(str))
    return {str(name): values[rows == place] for place, name in enumerate(names)}


def _average(values: Floats, statistic: Statistic) -> float:
    return float(np.median(values) if statistic == "median" else np.mean(values))


def _made(
    estimate: float, found: Interval, plan: ResamplingConfig, parts: dict[str, ConfidenceInterval]
) -> ConfidenceInterval:
    return ConfidenceInterval(
        estimate, found.low, found.high, plan.confidence, found.method, found.reason, parts
    )

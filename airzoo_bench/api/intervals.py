"""Confidence intervals from Python, of columns of per-query values."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.arguments import Scores
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["bootstrap_ci"]

Statistic = Literal["share", "mean", "median"]

_MOST_CONFIDENCE = 0.999999  # limits of more are those of rounding
_LARGEST = 1e100  # third powers of larger values overflow


def bootstrap_ci(
    values: ArrayLike,
    scenes: ArrayLike | None = None,
    *,
    statistic: Statistic,
    confidence: float = 0.95,
    seed: int = 0,
) -> Scores:
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
    confidence, seed : float, int
        Between 0 and 1; the seed of the 10,000 resamples.

    Returns
    -------
    Scores
        ``estimate``; its ``low`` and ``high``, which may be infinite, or None, with a ``reason``,
        where a scene has fewer than 5 queries or all resampled values are alike; ``method``:
        "wilson", "mover", "bca" or "percentile"; ``scenes``, the same of each scene by name.

    Raises
    ------
    ArgumentError
        NaN, no value, shares outside 0 to 1, `scenes` of another length, settings out of range.
    """
    arg.choice("statistic", statistic, get_args(Statistic))
    share = arg.positive("confidence", confidence, _MOST_CONFIDENCE)
    plan = ResamplingConfig(seed=arg.whole("seed", seed, 0), confidence=share)
    numbers = arg.floats("values", values, (None,))
    bad = ~(np.abs(numbers) <= _LARGEST) & ~np.isposinf(numbers)
    if statistic == "share":
        bad |= (numbers < 0.0) | (numbers > 1.0)
    expected = "a number a query, infinite for failures; shares from 0 to 1, not percent"
    arg.refuse_rows("values", bad, "NaN or a value out of range", expected)
    if len(numbers) == 0:
        raise arg.fault("values", "holds no value", expected)
    groups = {"": numbers}
    if scenes is not None:
        labels = arg.as_array("scenes", scenes).astype(object)
        if labels.shape != numbers.shape or pd.isna(labels).any():
            what = f"has shape {labels.shape}, or names that are missing"
            raise arg.fault("scenes", what, f"({len(numbers)},), the scene of each value")
        arg.check_pairs(values=values, scenes=scenes)
        rows, names = pd.factorize(labels.astype(str))
        groups = {str(name): numbers[rows == place] for place, name in enumerate(names)}
    kinds = (np.array([statistic == kind]) for kind in ("median", "share"))
    sample = Sample("query", tuple(groups), tuple(one[None] for one in groups.values()), *kinds)
    found = sample_intervals(sample, plan, groups=scenes is not None)
    average = np.median if statistic == "median" else np.mean
    means = {name: float(average(part)) for name, part in groups.items()}
    parts = {name: _scores(means[name], one) for name, (one, *_) in found.groups.items()}
    return _scores(float(np.mean(list(means.values()))), found.overall[0], scenes=parts)


def _scores(estimate: float, found: Interval, **more: Any) -> Scores:
    values = {"estimate": estimate, "low": found.low, "high": found.high}
    kind = "reason" if found.low is None else "method"
    values[kind] = getattr(found, kind)
    return Scores(values, **{"reason": found.reason, "method": found.method} | more)

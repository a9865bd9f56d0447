"""Confidence intervals by bootstrap: percentile and BCa, of averages and of their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import counted, plural
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.bootstrap_limits import (
    acceleration,
    interval_limits,
    percentile_p_values,
)
from airzoo_bench.statistics.resampling import leave_one_out, resampled_averages, weighted_averages
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, difference, paired_difference

__all__ = ["FEWEST", "Interval", "SampleIntervals", "bootstrap"]

FEWEST = 5
"""Fewer units in a group than these have no interval: resamples of them repeat each other."""


@dataclass(frozen=True)
class Interval:
    """A confidence interval, whose limits may be infinite, or the reason why there is none.

    The method is "bca", "percentile", "wilson", "mover", "student", "lognormal", or empty.
    """

    low: float | None
    high: float | None
    method: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SampleIntervals:
    """Intervals of every variable, then of every difference, in the order that was asked for.

    They are of each group by its name, and overall of the unweighted mean over groups. Every
    difference of medians or over scenes has the two-sided p of its being 0, or None where it has no
    interval.
    """

    groups: dict[str, list[Interval]]
    overall: list[Interval]
    p_values: list[float | None]


class _Part(NamedTuple):
    """One group or the sum of several: of V variables and D differences, as many rows each.

    Estimates (V,), resamples (V, B), the jackknife's moments (V + D, 2), whether units vary.
    """

    estimates: Floats
    resamples: Floats
    moments: Floats
    varied: Bools


def bootstrap(
    sample: Sample,
    resampling: ResamplingConfig,
    differences: Sequence[tuple[int, int]] = (),
    *,
    groups: bool = True,
) -> SampleIntervals:
    """Resample units within groups, all variables alike, and take intervals.

    Values are finite or +inf; `differences` are pairs of variables, the first minus the second.
    There is no interval where a group has fewer than `FEWEST` units, or all of them are alike. BCa
    becomes percentile, and says so, where it does not exist: with infinite leave-one-out values, or
    all resamples on one side. Differences of medians always have percentile intervals: BCa's leave
    out the true difference too often where there are few units (docs/statistics.md).
    """
    if not sample.groups:
        raise ValueError("a sample has at least one group")
    pairs = np.array(differences, np.intp).reshape(-1, 2)
    variables, rows = len(sample.medians), len(sample.medians) + len(pairs)
    found: dict[str, list[Interval]] = {}
    total = _Part(
        np.zeros(variables),
        np.zeros((variables, resampling.resamples)),
        np.zeros((rows, 2)),
        np.zeros(rows, np.bool_),
    )
    for group, values in zip(sample.groups, sample.values, strict=True):
        few = few_units(values.shape[1], group, sample.unit)
        if few is not None:
            found[group] = [few] * rows
            continue
        part = _resample(group, values, sample.medians, pairs, resampling)
        found[group] = _intervals(part, pairs, resampling, sample.unit) if groups else []
        total = _Part(*map(np.add, total, part))
    found = found if groups else {}
    few = few_units(*sample.fewest, sample.unit)
    if few is not None:
        return SampleIntervals(found, [few] * rows, [None] * len(pairs))
    # Moments stay sums: the acceleration is the same of any multiple of a statistic.
    number = len(sample.groups)
    overall = total._replace(estimates=total.estimates / number, resamples=total.resamples / number)
    intervals = _intervals(overall, pairs, resampling, sample.unit)
    return SampleIntervals(found, intervals, _p_values(overall, pairs, sample.medians))


def few_units(units: int, group: str, unit: str) -> Interval | None:
    """Say that a group, of any name or none, has too few units for an interval, or return None."""
    if units >= FEWEST:
        return None
    where = f" in scene {group}" if group else ""
    reason = f"only {counted(units, unit)}{where}: an interval needs {FEWEST}"
    return Interval(None, None, "", reason)


def _resample(
    group: str,
    values: Floats,
    medians: Bools,
    pairs: NDArray[np.intp],
    resampling: ResamplingConfig,
) -> _Part:
    differences = paired_difference(values[pairs[:, 0]], values[pairs[:, 1]])
    left_out = leave_one_out(values, medians)
    contrasts = difference(left_out[pairs[:, 0]], left_out[pairs[:, 1]])
    moments = _moments(np.concatenate([left_out, contrasts]))
    moments[len(values) :][medians[pairs[:, 0]]] = np.inf  # BCa is not for these
    both = np.concatenate([values, differences])
    return _Part(
        # On the grid of the resamples: one that is equal to it is then equal to the last bit.
        weighted_averages(values, medians, np.ones((values.shape[1], 1), np.int64))[:, 0],
        resampled_averages(values, medians, group, resampling.seed, resampling.resamples),
        moments,
        np.asarray((both != both[:, :1]).any(axis=1)),
    )


def _moments(left_out: Floats) -> Floats:
    """Sum the jackknife's influence values, cubed and squared, (R, 2)."""
    units = left_out.shape[1]
    failing = np.any(np.isinf(left_out), axis=1, keepdims=True)
    finite = np.where(failing, 0.0, left_out)
    influence = (units - 1) * (finite.mean(axis=1, keepdims=True) - finite) / units
    moments = np.stack([(influence**3).sum(axis=1), (influence**2).sum(axis=1)], axis=1)
    moments[failing[:, 0]] = np.inf
    return np.asarray(moments)


def _intervals(
    part: _Part, pairs: NDArray[np.intp], resampling: ResamplingConfig, unit: str
) -> list[Interval]:
    one, other = pairs[:, 0], pairs[:, 1]
    sizes = np.abs(np.where(np.isinf(part.estimates), 0.0, part.estimates))
    limits, exists = interval_limits(
        np.concatenate([part.resamples, difference(part.resamples[one], part.resamples[other])]),
        np.concatenate([part.estimates, difference(part.estimates[one], part.estimates[other])]),
        np.concatenate([sizes, np.maximum(sizes[one], sizes[other])]),
        acceleration(part.moments),
        resampling,
    )
    methods = np.where(exists, resampling.interval, "percentile").tolist()
    who = [f"all {plural(unit)} are"] * len(sizes)
    who += [f"the differences of all {plural(unit)} are"] * len(pairs)
    return [
        Interval(low, high, method)
        if varied
        else Interval(None, None, "", f"{these} alike: resamples cannot differ")
        for (low, high), method, varied, these in zip(
            limits.tolist(), methods, part.varied, who, strict=True
        )
    ]


def _p_values(part: _Part, pairs: NDArray[np.intp], medians: Bools) -> list[float | None]:
    tested = medians[pairs[:, 0]]
    one, other = (part.resamples[pairs[tested, side]] for side in (0, 1))
    found = iter(percentile_p_values(paired_difference(one, other)).tolist())
    return [next(found) if by_median else None for by_median in tested]

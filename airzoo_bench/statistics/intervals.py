"""Confidence intervals by bootstrap: percentile and BCa, of averages and of their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.plurals import counted, plural
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import (
    acceleration,
    interval_limits,
    percentile_p_values,
)
from airzoo_bench.statistics.resampling import (
    blocks,
    leave_one_out,
    resample_counts,
    stream_key,
    weighted_averages,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, difference, paired_difference

__all__ = ["FEWEST", "Interval", "SampleIntervals", "bootstrap", "few_units"]

FEWEST = 5
"""Fewer units in a group than these have no interval: resamples of them repeat each other."""

_TINY = 1e-50


@dataclass(frozen=True)
class Interval:
    """A confidence interval, or the reason why there is none.

    Attributes
    ----------
    low, high : float or None
        None where there is none; a limit may be infinite.
    method : str
        "bca", "percentile", "wilson" or "mover"; empty where there is none.
    reason : str
        Why there is none; else empty.
    """

    low: float | None
    high: float | None
    method: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SampleIntervals:
    """Intervals of every variable, then of every difference, in the order that was asked for.

    Attributes
    ----------
    groups : dict of str to list of Interval
        Of each group, by its name; empty where they were not asked for.
    overall : list of Interval
        Of the unweighted mean over groups.
    p_values : list of float or None
        Of every difference of medians, that of all groups: whether it is 0, two-sided. None where
        there is no interval, or the difference is not one of medians.
    """

    groups: dict[str, list[Interval]]
    overall: list[Interval]
    p_values: list[float | None]


@dataclass(frozen=True)
class _Part:
    """One group, or all: estimates (V,), resamples (V, B), moments and evenness of V + D rows."""

    estimates: Floats
    resamples: Floats
    moments: Floats
    even: NDArray[np.bool_]
    fewest: tuple[int, str]


def bootstrap(
    sample: Sample,
    resampling: ResamplingConfig,
    differences: Sequence[tuple[int, int]] = (),
    *,
    groups: bool = True,
) -> SampleIntervals:
    """Resample units within groups, all variables alike, and take intervals.

    Parameters
    ----------
    sample : Sample
        Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed, kind of interval, confidence.
    differences : sequence of (int, int)
        Pairs of variables: the first minus the second.
    groups : bool
        Whether to take the intervals of each group too.

    Returns
    -------
    SampleIntervals
        The same for any number of threads. There is no interval where a group has fewer than
        `FEWEST` units, or all of them are alike. BCa becomes percentile, and says so, where it
        does not exist: with infinite leave-one-out values, or all resamples on one side.
        Differences of medians always have percentile intervals: BCa's leave out the true
        difference too often where there are few units (docs/statistics.md).

    Raises
    ------
    ValueError
        The sample has no group.
    """
    pairs = np.array(differences, dtype=np.intp).reshape(-1, 2)
    exponents = _exponents(sample.values, pairs)
    found: dict[str, list[Interval]] = {}
    total: _Part | None = None
    for group, values in zip(sample.groups, sample.values, strict=True):
        part = _resampled(group, values, sample.medians, pairs, exponents, resampling)
        if groups:
            found[group] = _intervals(part, pairs, resampling, sample.unit)
        total = part if total is None else _together(total, part)
    if total is None:
        raise ValueError("a sample has at least one group")
    # Moments stay sums: the acceleration is the same of any multiple of a statistic.
    number = len(sample.groups)
    overall = replace(total, estimates=total.estimates / number, resamples=total.resamples / number)
    return SampleIntervals(
        found,
        _intervals(overall, pairs, resampling, sample.unit),
        _p_values(overall, pairs, sample.medians),
    )


def _p_values(
    part: _Part, pairs: NDArray[np.intp], medians: NDArray[np.bool_]
) -> list[float | None]:
    tested = medians[pairs[:, 0]] & (part.resamples.shape[1] > 0)
    resamples = paired_difference(
        part.resamples[pairs[tested, 0]], part.resamples[pairs[tested, 1]]
    )
    found: list[float | None] = [None] * len(pairs)
    for place, p_value in zip(np.flatnonzero(tested), percentile_p_values(resamples), strict=True):
        found[place] = float(p_value)
    return found


def _resampled(
    group: str,
    values: Floats,
    medians: NDArray[np.bool_],
    pairs: NDArray[np.intp],
    exponents: NDArray[np.int32],
    resampling: ResamplingConfig,
) -> _Part:
    units = values.shape[1]
    differences = paired_difference(values[pairs[:, 0]], values[pairs[:, 1]])
    even = np.concatenate([_all_alike(values), _all_alike(differences)])
    # On the grid of the resamples: one that is equal to it is then equal to the last bit.
    ones = np.ones((units, 1), np.int64)
    estimates = weighted_averages(values, medians, ones)[:, 0]
    fewest = (units, group)
    if units < FEWEST:
        return _Part(estimates, np.empty((len(values), 0)), np.zeros((len(even), 2)), even, fewest)
    key = stream_key(resampling.seed, "bootstrap", group)
    resamples = np.empty((len(values), resampling.resamples))
    for first, count in blocks(units, resampling.resamples):
        counts = resample_counts(units, first, count, key)
        resamples[:, first : first + count] = weighted_averages(values, medians, counts)
    left_out = leave_one_out(values, medians)
    contrasts = difference(left_out[pairs[:, 0]], left_out[pairs[:, 1]])
    moments = _moments(np.ldexp(np.concatenate([left_out, contrasts]), -exponents[:, None]))
    moments[len(values) :][medians[pairs[:, 0]]] = np.inf  # BCa is not for these
    return _Part(estimates, resamples, moments, even, fewest)


def _exponents(values: Sequence[Floats], pairs: NDArray[np.intp]) -> NDArray[np.int32]:
    """Return by which powers of two (V + D,) tiny values are divided: their cubes would be 0."""
    largest = np.zeros(len(values[0]) + len(pairs)) if values else np.zeros(0)
    for part in values:
        differences = paired_difference(part[pairs[:, 0]], part[pairs[:, 1]])
        every = np.abs(np.concatenate([part, differences]))
        largest = np.maximum(largest, np.where(np.isinf(every), 0.0, every).max(axis=1, initial=0))
    exponents = np.frexp(largest)[1]
    return np.asarray(np.where(largest < _TINY, exponents, 0), np.int32)


def _all_alike(values: Floats) -> NDArray[np.bool_]:
    return np.asarray((values == values[:, :1]).all(axis=1))


def _moments(left_out: Floats) -> Floats:
    """Sum the jackknife's influence values, cubed and squared, (R, 2)."""
    units = left_out.shape[1]
    failing = np.any(np.isinf(left_out), axis=1, keepdims=True)
    finite = np.where(failing, 0.0, left_out)
    influence = (units - 1) * (finite.mean(axis=1, keepdims=True) - finite) / units
    moments = np.stack([(influence**3).sum(axis=1), (influence**2).sum(axis=1)], axis=1)
    moments[failing[:, 0]] = np.inf
    return np.asarray(moments)


def _together(one: _Part, other: _Part) -> _Part:
    if one.resamples.shape != other.resamples.shape:  # one of them has too few units
        resamples = np.empty((len(one.resamples), 0))
    else:
        resamples = one.resamples + other.resamples
    return _Part(
        one.estimates + other.estimates,
        resamples,
        one.moments + other.moments,
        one.even & other.even,
        min(one.fewest, other.fewest),
    )


def _intervals(
    part: _Part, pairs: NDArray[np.intp], resampling: ResamplingConfig, unit: str
) -> list[Interval]:
    few = few_units(*part.fewest, unit)
    if few is not None:
        return [few] * len(part.even)
    one, other = pairs[:, 0], pairs[:, 1]
    resamples = [part.resamples, difference(part.resamples[one], part.resamples[other])]
    estimates = [part.estimates, difference(part.estimates[one], part.estimates[other])]
    sizes = np.abs(np.where(np.isinf(part.estimates), 0.0, part.estimates))
    scales = [sizes, np.maximum(sizes[one], sizes[other])]
    limits, exists = interval_limits(
        np.concatenate(resamples),
        np.concatenate(estimates),
        np.concatenate(scales),
        acceleration(part.moments),
        resampling,
    )
    methods = np.where(exists, resampling.interval, "percentile").tolist()
    whose = [f"all {plural(unit)} are", f"the differences of all {plural(unit)} are"]
    alike = [Interval(None, None, "", f"{who} alike: resamples cannot differ") for who in whose]
    kinds = [alike[0]] * len(part.estimates) + [alike[1]] * len(pairs)
    return [
        kind if even else Interval(low, high, method)
        for (low, high), method, even, kind in zip(
            limits.tolist(), methods, part.even, kinds, strict=True
        )
    ]


def few_units(units: int, group: str, unit: str) -> Interval | None:
    """Say that a group has too few units for an interval; None where it has enough.

    Parameters
    ----------
    units : int
        Of the group.
    group : str
        Its name, for the reason; empty for the only one.
    unit : str
        What a unit is called, such as "query".

    Returns
    -------
    Interval or None
        Without limits, and with the reason.
    """
    if units >= FEWEST:
        return None
    where = f" in scene {group}" if group else ""
    return Interval(
        None, None, "", f"only {counted(units, unit)}{where}: an interval needs {FEWEST}"
    )

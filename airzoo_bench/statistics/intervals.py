"""Confidence intervals, each kind of average by the method that keeps its promise for it.

Means of shares have closed intervals (`shares`), means over scenes Student's t or, for distances,
the log-normal interval of Zou, Taleban and Huo (2009); all else is bootstrapped, percentile and BCa
(Efron and Tibshirani, An introduction to the bootstrap, 1993). docs/statistics.md has the figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtr, ndtri, stdtr, stdtrit

from airzoo_bench.core.errors import counted, plural
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.samples import (
    ResamplingConfig,
    Sample,
    difference,
    leave_one_out,
    paired_difference,
    resampled_averages,
    weighted_averages,
)
from airzoo_bench.statistics.shares import average_limits, difference_limits

FEWEST = 5
"""Fewer units in a group than these have no interval: resamples of them repeat each other."""

_TIE = 1e-12  # of the numbers' size: closer ones differ by rounding alone
_ALIKE = 1e-9
_MOST = 10.0  # an upper limit above so many times the mean is not known

Pairs = Sequence[tuple[int, int]] | NDArray[np.intp]


@dataclass(frozen=True)
class Interval:
    """A confidence interval with limits that may be infinite, or the reason for having none.

    The method is "bca", "percentile", "wilson", "mover", "student", "lognormal", or empty.
    """

    low: float | None
    high: float | None
    method: str = ""
    reason: str = ""

    @classmethod
    def lacking(cls, reason: str) -> Interval:
        """Return no interval, for a reason."""
        return cls(None, None, "", reason)


@dataclass(frozen=True)
class SampleIntervals:
    """Intervals of every variable, then of every difference, of each group by name and overall.

    Overall is the unweighted mean over groups. Every difference of medians or over scenes has the
    two-sided p of its being 0, or None where it has no interval.
    """

    groups: dict[str, list[Interval]]
    overall: list[Interval]
    p_values: list[float | None]


def sample_intervals(
    sample: Sample, resampling: ResamplingConfig, differences: Pairs = (), *, groups: bool = True
) -> SampleIntervals:
    """Take intervals: over scenes by Student's t, of shares by MOVER, of all else by bootstrap.

    Values are finite or +inf; `differences` are pairs of variables, both shares or neither: the
    first minus the second. `groups` asks for the intervals of each group too.
    """
    if sample.unit == "scene":
        return _over_scenes(sample, resampling, differences)
    pairs, shares = _as_array(differences), sample.are_shares
    variables, rows = len(shares), len(shares) + len(pairs)
    nothing = Interval.lacking("")
    found = SampleIntervals(
        {group: [nothing] * rows for group in sample.groups if groups},
        [nothing] * rows,
        [None] * len(pairs),
    )
    for some, take in ((~shares, bootstrap), (shares, _share_intervals)):
        if not some.any():
            continue
        places = np.flatnonzero(np.concatenate([some, some[pairs[:, 0]]])).tolist()
        own = (np.cumsum(some) - 1)[pairs[some[pairs[:, 0]]]]
        part = take(sample.take(some), resampling, own, groups=groups)
        for target, source in (
            (found.overall, part.overall),
            *((found.groups[group], part.groups[group]) for group in found.groups),
        ):
            for place, interval in zip(places, source, strict=True):
                target[place] = interval
        for place, p_value in zip(places[int(some.sum()) :], part.p_values, strict=True):
            found.p_values[place - variables] = p_value
    return found


def _as_array(pairs: Pairs) -> NDArray[np.intp]:
    return np.array(pairs, np.intp).reshape(-1, 2)


def _few_units(units: int, group: str, unit: str) -> Interval | None:
    """Say that a group, of any name or none, has too few units for an interval, or return None."""
    if units >= FEWEST:
        return None
    where = f" in scene {group}" if group else ""
    return Interval.lacking(f"only {counted(units, unit)}{where}: an interval needs {FEWEST}")


def _share_intervals(
    sample: Sample, resampling: ResamplingConfig, differences: Pairs, *, groups: bool
) -> SampleIntervals:
    pairs, found = _as_array(differences), {}
    for group, values in zip(sample.groups, sample.values, strict=True) if groups else ():
        alone = replace(sample, groups=(group,), values=(values,))
        found[group] = _share_intervals(alone, resampling, pairs, groups=False).overall
    without: list[float | None] = [None] * len(pairs)
    few = _few_units(*sample.fewest, sample.unit)
    if few is not None:
        return SampleIntervals(found, [few] * (len(sample.medians) + len(pairs)), without)
    gaps = sample.differences(pairs[:, 0], pairs[:, 1])
    method = "wilson" if len(sample.groups) == 1 else "mover"
    means = average_limits(sample.values, resampling.confidence).tolist()
    overall = [Interval(low, high, method) for low, high in means]
    limits = difference_limits(gaps, resampling.confidence).tolist()
    overall += [Interval(low, high, "mover") for low, high in limits]
    return SampleIntervals(found, overall, without)


class _Part(NamedTuple):
    """One group or the sum of several, of V variables and D differences.

    Estimates (V,), resamples (V, B), the jackknife's moments (V + D, 2), whether units vary.
    """

    estimates: Floats
    resamples: Floats
    moments: Floats
    varied: Bools


def bootstrap(
    sample: Sample, resampling: ResamplingConfig, differences: Pairs = (), *, groups: bool = True
) -> SampleIntervals:
    """Resample units within groups, all variables alike, and take intervals.

    There is none where a group has fewer than `FEWEST` units, or all of them are alike. BCa becomes
    percentile, and says so, where it does not exist: with infinite leave-one-out values, or all
    resamples on one side. Differences of medians always have percentile intervals: BCa's leave out
    the true difference too often where there are few units (docs/statistics.md).
    """
    if not sample.groups:
        raise ValueError("a sample has at least one group")
    pairs = _as_array(differences)
    rows = len(sample.medians) + len(pairs)
    found: dict[str, list[Interval]] = {}
    total: _Part | None = None
    for group, values in zip(sample.groups, sample.values, strict=True):
        few = _few_units(values.shape[1], group, sample.unit)
        if few is None:
            part = _resample(group, values, sample.medians, pairs, resampling)
            total = part if total is None else _Part(*map(np.add, total, part))
        if groups:
            found[group] = [few] * rows if few else _bootstrapped(part, pairs, resampling, sample)
    few = _few_units(*sample.fewest, sample.unit)
    if few is not None or total is None:
        return SampleIntervals(found, [few or Interval.lacking("")] * rows, [None] * len(pairs))
    # Moments stay sums: the acceleration is the same of any multiple of a statistic.
    number = len(sample.groups)
    overall = total._replace(estimates=total.estimates / number, resamples=total.resamples / number)
    tested = sample.medians[pairs[:, 0]]
    one, other = (overall.resamples[pairs[tested, side]] for side in (0, 1))
    p_values = iter(percentile_p_values(paired_difference(one, other)).tolist())
    return SampleIntervals(
        found,
        _bootstrapped(overall, pairs, resampling, sample),
        [next(p_values) if by_median else None for by_median in tested],
    )


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
    moments = jackknife_moments(np.concatenate([left_out, contrasts]))
    moments[len(values) :][medians[pairs[:, 0]]] = np.inf  # BCa is not for these
    both = np.concatenate([values, differences])
    # On the grid of the resamples: one that is equal to it is then equal to the last bit.
    estimates = weighted_averages(values, medians, np.ones((values.shape[1], 1), np.int64))[:, 0]
    resamples = resampled_averages(values, medians, group, resampling)
    return _Part(estimates, resamples, moments, np.asarray((both != both[:, :1]).any(axis=1)))


def jackknife_moments(left_out: Floats) -> Floats:
    """Sum the jackknife's influence values (R, N), cubed and squared, (R, 2)."""
    units = left_out.shape[1]
    failing = np.any(np.isinf(left_out), axis=1, keepdims=True)
    finite = np.where(failing, 0.0, left_out)
    influence = (units - 1) * (finite.mean(axis=1, keepdims=True) - finite) / units
    moments = np.stack([(influence**3).sum(axis=1), (influence**2).sum(axis=1)], axis=1)
    moments[failing[:, 0]] = np.inf
    return np.asarray(moments)


def _bootstrapped(
    part: _Part, pairs: NDArray[np.intp], resampling: ResamplingConfig, sample: Sample
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
    found = [
        Interval(low, high, resampling.interval if has_kind else "percentile")
        for (low, high), has_kind in zip(limits.tolist(), exists, strict=True)
    ]
    units = plural(sample.unit)
    for row in np.flatnonzero(~part.varied).tolist():
        which = f"all {units}" if row < len(sizes) else f"the differences of all {units}"
        found[row] = Interval.lacking(f"{which} are alike: resamples cannot differ")
    return found


def quantiles(ranked: Floats, levels: Floats) -> Floats:
    """Take quantiles (R, L) of sorted rows (R, B), linear between ranks, infinite ones included."""
    place = levels * (ranked.shape[1] - 1)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, ranked.shape[1] - 1)
    low = np.take_along_axis(ranked, below, axis=1)
    high = np.take_along_axis(ranked, above, axis=1)
    share = place - below
    between = (share > 0) & np.isfinite(low)
    found: Floats = low + np.multiply(
        difference(high, low), share, out=np.zeros_like(low), where=between
    )
    # Between minus and plus infinity: a lower limit is the one, an upper limit the other.
    open_ = np.isneginf(low) & np.isposinf(high) & (share > 0) & (levels >= 0.5)
    return np.where(open_, np.inf, found)


def percentile_p_values(resamples: Floats) -> Floats:
    """Return the p up to which percentile intervals of confidence 1 - p of resamples hold 0, (R,).

    Test and interval agree, whichever the confidence. p is at least 2 / (B + 1) of B resamples.
    """
    ranked = np.sort(resamples, axis=1)
    levels = np.minimum(_level_of_0(ranked), _level_of_0(-ranked[:, ::-1]))
    return np.asarray(np.clip(2 * levels, 2 / (resamples.shape[1] + 1), 1.0))


def _level_of_0(ranked: Floats) -> Floats:
    """Return the highest level at which `quantiles` is at most 0, (R,)."""
    last = ranked.shape[1] - 1
    ranks = (ranked <= 0).sum(axis=1)
    upper = np.clip(ranks, 1, last)[:, None]
    below = np.take_along_axis(ranked, upper - 1, axis=1)[:, 0]
    above = np.take_along_axis(ranked, upper, axis=1)[:, 0]
    between = (below <= 0) & (above > 0) & np.isfinite(below) & np.isfinite(above)
    span = np.subtract(above, below, out=np.ones_like(below), where=between)
    # Between minus infinity and a number all is minus infinity, up to a number's infinity none is.
    share = np.where(between, -below / span, np.isneginf(below))
    inner = (ranks > 0) & (ranks <= last)
    found: Floats = np.where(inner, (ranks - 1 + share) / last, (ranks > 0).astype(np.float64))
    return found


def acceleration(moments: Floats) -> Floats:
    """Return the acceleration of BCa (eq. 14.15), (R,); NaN where all influence values are 0."""
    third, second = moments.T
    defined = (second > 0) & np.isfinite(second)
    nothing = np.full(len(third), np.nan)
    size = 6 * np.where(defined, second, 1.0) ** 1.5
    found: Floats = np.divide(third, size, out=nothing, where=defined)
    return found


def interval_limits(
    resamples: Floats,
    estimates: Floats,
    scales: Floats,
    accelerations: Floats,
    resampling: ResamplingConfig,
) -> tuple[Floats, Bools]:
    """Take the limits of intervals (R, 2), and whether the kind that was asked for exists (R,).

    Elsewhere the limits are percentile's. `resamples` are (R, B); `scales` (R,) is the size of the
    numbers that a statistic is made of, since those of a difference may be large where it is almost
    0. `accelerations` (R,) are NaN where BCa does not exist.
    """
    tails = resampling.tails
    levels = np.broadcast_to(tails, (len(resamples), 2))
    exists = np.ones(len(resamples), np.bool_)
    if resampling.interval == "bca":
        # Eq. 14.10; a tie counts half.
        tie = (_TIE * scales)[:, None]
        below = (resamples < estimates[:, None] - tie).sum(axis=1)
        up_to = (resamples <= estimates[:, None] + tie).sum(axis=1)
        bias = ndtri((below + up_to) / (2.0 * resamples.shape[1]))[:, None]
        finite = np.isfinite(bias)
        shifted = np.where(finite, bias, 0.0) + ndtri(tails)
        adjusted = ndtr(bias + shifted / (1 - accelerations[:, None] * shifted))
        adjusted = np.where(finite, adjusted, np.nan)
        exists = np.asarray(np.isfinite(adjusted).all(axis=1))
        levels = np.where(exists[:, None], adjusted, levels)
    return quantiles(np.sort(resamples, axis=1), levels), exists


def _over_scenes(
    sample: Sample, resampling: ResamplingConfig, differences: Pairs
) -> SampleIntervals:
    """Take the intervals of means, then of differences, with p of these from the same t.

    An infinite upper limit is one that is not known. Several groups have no overall interval.
    """
    pairs, shares = _as_array(differences), sample.are_shares
    found: dict[str, list[Interval]] = {}
    p_values = np.empty(0)
    for group, values in zip(sample.groups, sample.values, strict=True):
        gaps = paired_difference(values[pairs[:, 0]], values[pairs[:, 1]])
        limits, p_values = student(gaps, shares[pairs[:, 0]], resampling.confidence)
        few = _few_units(values.shape[1], group, sample.unit)
        if few is not None:
            found[group] = [few] * (len(values) + len(pairs))
            continue
        found[group] = [
            *(_mean_of_scenes(*row, resampling) for row in zip(values, shares, strict=True)),
            *(
                _scene_interval(row, two, "student", "the differences of all scenes are")
                for row, two in zip(gaps, limits, strict=True)
            ),
        ]
    overall = found[sample.groups[0]] if len(found) == 1 else []
    return SampleIntervals(found, overall, [None if np.isnan(p) else float(p) for p in p_values])


def student(values: Floats, shares: Bools, confidence: float) -> tuple[Floats, Floats]:
    """Return Student's limits (R, 2) of the means of rows (R, N), and p (R,) of their being 0.

    Those of `shares` (R,) lie between -1 and 1. All are NaN of fewer than `FEWEST` scenes, of a
    failed one, and where all are alike.
    """
    count = values.shape[1]
    usable = np.isfinite(values).all(axis=1) & (count >= FEWEST)
    known = np.where(usable[:, None], values, 0.0)
    usable &= np.ptp(known, axis=1) > _ALIKE
    limits, p_values = np.full((len(values), 2), np.nan), np.full(len(values), np.nan)
    if usable.any():
        mean, spread = known[usable].mean(axis=1), known[usable].std(axis=1, ddof=1)
        error = spread / np.sqrt(count)
        reach = stdtrit(count - 1, (1 + confidence) / 2) * error
        most = np.where(shares[usable], 1.0, np.inf)
        limits[usable] = np.clip([mean - reach, mean + reach], -most, most).T
        p_values[usable] = 2 * stdtr(count - 1, -np.abs(mean) / error)
    return limits, np.maximum(p_values, np.finfo(np.float64).tiny)


def _mean_of_scenes(values: Floats, share: bool, resampling: ResamplingConfig) -> Interval:
    if share or not np.isfinite(values).all():
        [limits], _ = student(values[None], np.array([True]), resampling.confidence)
        return _scene_interval(values, np.maximum(limits, 0.0), "student", "all scenes are")
    if values.min() <= 0:
        return Interval.lacking("a distance of 0 has no logarithm")
    return _scene_interval(values, _lognormal(values, resampling), "lognormal", "all scenes are")


def _scene_interval(values: Floats, limits: Floats, method: str, which: str) -> Interval:
    if not np.isfinite(values).all():
        return Interval.lacking("a scene failed")
    if np.isnan(limits).any():
        return Interval.lacking(f"{which} alike")
    return Interval(float(limits[0]), float(limits[1]), method)


def _lognormal(values: Floats, resampling: ResamplingConfig) -> Floats:
    """Take the limits (2,) of a log-normal mean, exp(mu + sigma**2 / 2); infinite: not known.

    MOVER puts together Student's limits of mu and those of sigma**2 / 2 by chi-squared. Student's
    limits of logarithms alone would be those of the geometric mean.
    """
    count, logs = len(values), np.log(values)
    middle, half = logs.mean(), logs.var(ddof=1) / 2
    [[_, highest]], _ = student(logs[None], np.array([False]), resampling.confidence)
    ratios = (count - 1) / chdtri(count - 1, resampling.tails)
    reaches = np.hypot(highest - middle, half * (ratios - 1))
    with np.errstate(over="ignore"):
        low, high = np.exp(middle + half + np.array([-1, 1]) * reaches)
    return np.array([low, high if high <= _MOST * values.mean() else np.inf])

"""Confidence intervals, each kind of average by the method that keeps its promise for it.

Means of shares have closed intervals that hold where all queries of a scene are alike: Wilson's
(1927) of one scene; of an average over scenes MOVER (Zou and Donner 2008) puts them together from
Jeffreys' limits (Brown, Cai and DasGupta 2001), with effective sizes of Franco, Little, Louis and
Slud (2019). Means over scenes have Student's t or, for distances, the log-normal interval of Zou,
Taleban and Huo (2009); all else is bootstrapped by BCa (Efron and Tibshirani, An introduction to
the bootstrap, 1993). docs/statistics.md has the figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import betaincinv, chdtri, ndtr, ndtri, stdtr, stdtrit

from airzoo_bench.core.errors import counted, plural
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.samples import (
    ResamplingConfig,
    Sample,
    difference,
    leave_one_out,
    resampled_averages,
    weighted_averages,
)

FEWEST = 5
"""Fewer units in a group than these have no interval: resamples of them repeat each other."""

_TIE = 1e-12  # of the numbers' size: closer ones differ by rounding alone
_ALIKE = 1e-9
_MOST = 10.0  # an upper limit above so many times the mean is not known
_PRIOR = 0.5  # so many queries more at 0, and at 1, as Jeffreys' prior has it


@dataclass(frozen=True)
class Interval:
    """A confidence interval with limits that may be infinite, or the reason for having none.

    The method is "bca", "percentile", "wilson", "mover", "student", "lognormal", or empty.
    """

    low: float | None = None
    high: float | None = None
    method: str = ""
    reason: str = ""


@dataclass(frozen=True)
class SampleIntervals:
    """Intervals of every variable, of each group by name, and of the mean over groups."""

    groups: dict[str, list[Interval]]
    overall: list[Interval]


def sample_intervals(
    sample: Sample, resampling: ResamplingConfig, *, groups: bool = True
) -> SampleIntervals:
    """Take intervals: over scenes by Student's t, of shares by MOVER, of all else by bootstrap.

    Values are finite or +inf. `groups` asks for the intervals of each group too. There is none
    where a group has fewer than `FEWEST` units, or where resamples cannot differ. BCa becomes
    percentile, and says so, where it does not exist.
    """
    by_group, parts = {}, []
    for group, values in zip(sample.groups, sample.values, strict=True):
        alone = replace(sample, groups=(group,), values=(values,))
        few = few_units(alone)
        if sample.unit == "scene":
            rows = zip(values, sample.are_shares, strict=True)
            by_group[group] = [_mean_of_scenes(*row, resampling, few) for row in rows]
            continue
        if not few and not sample.are_shares.all():
            parts.append(_resample(alone.take(~sample.are_shares), resampling))
        if groups:
            by_group[group] = _averages(alone, parts[-1:], resampling)
    if sample.unit == "scene":  # the mean over groups of scenes has none
        return SampleIntervals(by_group, by_group[group] if len(by_group) == 1 else [])
    return SampleIntervals(by_group, _averages(sample, parts, resampling))


def few_units(sample: Sample) -> str:
    """Say which group has too few units for an interval; empty where none has."""
    sizes = [part.shape[1] for part in sample.values]
    units, group = min(zip(sizes, sample.groups, strict=True))
    if units >= FEWEST:
        return ""
    where = f" in scene {group}" if group else ""
    return f"only {counted(units, sample.unit)}{where}: an interval needs {FEWEST}"


class _Part(NamedTuple):
    """V bootstrapped variables of a group, or summed over several."""

    estimates: Floats  # (V,)
    resamples: Floats  # (V, B)
    cubes: Floats  # (V,), sums of the jackknife's influence values, cubed
    squares: Floats
    varied: Bools  # (V,), whether units vary


def _resample(group: Sample, resampling: ResamplingConfig) -> _Part:
    [values], [name], medians = group.values, group.groups, group.medians
    units = values.shape[1]
    # On the grid of the resamples: one that is equal to it is then equal to the last bit.
    estimates = weighted_averages(values, medians, np.ones((units, 1), np.int64))[:, 0]
    left_out = leave_one_out(values, medians)
    failing = np.isinf(left_out).any(axis=1, keepdims=True)
    finite = np.where(failing, 0.0, left_out)
    influence = (units - 1) * (finite.mean(axis=1, keepdims=True) - finite) / units
    cubes, squares = np.where(failing.T, np.inf, [(influence**n).sum(axis=1) for n in (3, 2)])
    varied = np.asarray((values != values[:, :1]).any(axis=1))
    drawn = resampled_averages(values, medians, name, resampling)
    return _Part(estimates, drawn, cubes, squares, varied)


def _averages(sample: Sample, parts: list[_Part], resampling: ResamplingConfig) -> list[Interval]:
    """Take the interval of each variable, of the mean over groups."""
    if few := few_units(sample):
        return [Interval(reason=few)] * len(sample.medians)
    shares, number = sample.are_shares, len(sample.groups)
    limits = average_limits(sample.take(shares).values, resampling.confidence).tolist()
    method = "wilson" if number == 1 else "mover"
    closed = (Interval(low, high, method) for low, high in limits)
    if shares.all():
        return list(closed)
    total = _Part(*(sum(field[1:], field[0]) for field in zip(*parts, strict=True)))
    # Moments stay sums: the acceleration is the same of any multiple of a statistic.
    part = total._replace(estimates=total.estimates / number, resamples=total.resamples / number)
    levels, exists = _bca_levels(part, resampling)
    ranges = quantiles(np.sort(part.resamples, axis=1), levels).tolist()
    drawn = (
        Interval(low, high, "bca" if is_bca else "percentile")
        if varied
        else Interval(reason=f"all {plural(sample.unit)} are alike: resamples cannot differ")
        for (low, high), is_bca, varied in zip(ranges, exists, part.varied, strict=True)
    )
    return [next(closed) if share else next(drawn) for share in shares]


def _bca_levels(part: _Part, resampling: ResamplingConfig) -> tuple[Floats, Bools]:
    """Return the levels of the limits (V, 2), and whether BCa exists (V,); else percentile's."""
    estimates, cubes, squares = part.estimates[:, None], part.cubes, part.squares
    # Eq. 14.10; a tie counts half.
    tie = _TIE * np.where(np.isinf(estimates), 0.0, np.abs(estimates))
    below = (part.resamples < estimates - tie).sum(axis=1)
    up_to = (part.resamples <= estimates + tie).sum(axis=1)
    bias = ndtri((below + up_to) / (2.0 * part.resamples.shape[1]))[:, None]
    # Eq. 14.15
    defined = (squares > 0) & np.isfinite(squares)
    nothing = np.full(len(cubes), np.nan)
    acceleration = np.divide(cubes, 6 * squares**1.5, out=nothing, where=defined)
    shifted = np.where(np.isfinite(bias), bias, np.nan) + ndtri(resampling.tails)
    adjusted = ndtr(bias + shifted / (1 - acceleration[:, None] * shifted))
    exists = np.asarray(np.isfinite(adjusted).all(axis=1))
    return np.where(exists[:, None], adjusted, resampling.tails), exists


def quantiles(ranked: Floats, levels: Floats) -> Floats:
    """Take quantiles (R, L) of sorted rows (R, B), linear between ranks, infinite ones included."""
    place = levels * (ranked.shape[1] - 1)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, ranked.shape[1] - 1)
    low = np.take_along_axis(ranked, below, axis=1)
    high = np.take_along_axis(ranked, above, axis=1)
    share = place - below
    between = (share > 0) & np.isfinite(low)
    steps = np.multiply(difference(high, low), share, out=np.zeros_like(low), where=between)
    # Between minus and plus infinity: a lower limit is the one, an upper limit the other.
    is_open = np.isneginf(low) & np.isposinf(high) & (share > 0) & (levels >= 0.5)
    return np.where(is_open, np.inf, low + steps)


def percentile_p_values(ranked: Floats) -> Floats:
    """Return the largest p (R,) for which the percentile interval of sorted rows holds 0."""
    rows, last, levels = np.arange(len(ranked)), ranked.shape[1] - 1, np.ones(len(ranked))
    up_to_0 = np.array([row.searchsorted(0.0, "right") for row in ranked], np.intp)
    below_0 = np.array([row.searchsorted(0.0) for row in ranked], np.intp)
    for sign, ranks in ((1, up_to_0), (-1, last + 1 - below_0)):
        upper = np.clip(ranks, 1, last)
        below, above = (sign * ranked[rows, sign * n - (sign < 0)] for n in (upper - 1, upper))
        between = (below <= 0) & (above > 0) & np.isfinite(below) & np.isfinite(above)
        span = np.subtract(above, below, out=np.ones_like(below), where=between)
        # Between minus infinity and a number all is minus infinity, up to infinity none is.
        share = np.where(between, -below / span, np.isneginf(below))
        inner = (ranks > 0) & (ranks <= last)
        levels = np.minimum(levels, np.where(inner, (ranks - 1 + share) / last, ranks > 0))
    return np.clip(2 * levels, 2 / (last + 2), 1.0)


def student(values: Floats, shares: Bools, confidence: float) -> tuple[Floats, Floats]:
    """Return Student's limits (R, 2) of the means of rows (R, N), and p (R,) of their being 0.

    All are NaN of fewer than `FEWEST` scenes, of a failed one, and where all are alike.
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


def _mean_of_scenes(
    values: Floats, share: bool, resampling: ResamplingConfig, few: str
) -> Interval:
    """Take Student's interval of a mean share, or the limits of a log-normal mean of distances.

    MOVER puts the latter, exp(mu + sigma**2 / 2), together from Student's limits of mu and those of
    sigma**2 / 2 by chi-squared.
    """
    reason = few or ("" if np.isfinite(values).all() else "a scene failed")
    if not reason and not share and values.min() <= 0:
        reason = "a distance of 0 has no logarithm"
    if reason:
        return Interval(reason=reason)
    measured = values if share else np.log(values)
    [[low, high]], _ = student(measured[None], np.array([share]), resampling.confidence)
    if np.isnan(low):
        return Interval(reason="all scenes are alike")
    if share:
        return Interval(max(float(low), 0.0), float(high), "student")
    middle, half = measured.mean(), measured.var(ddof=1) / 2
    ratios = (len(values) - 1) / chdtri(len(values) - 1, resampling.tails)
    reaches = np.hypot(high - middle, half * (ratios - 1))
    with np.errstate(over="ignore"):
        low, high = np.exp(middle + half + np.array([-1, 1]) * reaches)
    known = high <= _MOST * values.mean()  # an infinite limit is not known
    return Interval(float(low), float(high) if known else np.inf, "lognormal")


# --- shares ---


class Rates(NamedTuple):
    """Mean shares of a scene as hit rates."""

    means: Floats  # (R,)
    sizes: Floats  # (R,), at which hits vary as much: the number of queries, or more


def effective_rates(values: Floats) -> Rates:
    """Measure shares (R, N) from 0 to 1; those that vary as much as hits count as hits."""
    count, means = values.shape[1], values.mean(axis=1)
    squares = ((values - means[:, None]) ** 2).sum(axis=1)
    ends = _PRIOR * (means**2 + (1 - means) ** 2)
    sizes = count * means * (1 - means) * (count + 2 * _PRIOR) / (squares + ends)
    return Rates(means, np.maximum(sizes, count))


def _around(limits: Floats, means: Floats) -> Floats:
    """Let no limit lie beyond the mean; limits of 0 and 1 then lie on it, exactly."""
    return np.stack([np.minimum(limits[:, 0], means), np.maximum(limits[:, 1], means)], axis=1)


def wilson_limits(rates: Rates, confidence: float) -> Floats:
    """Return Wilson's limits of rates, (R, 2)."""
    squared = float(ndtri((1 + confidence) / 2)) ** 2
    means, sizes = rates
    centre = means + squared / (2 * sizes)
    reach = np.sqrt(squared * (means * (1 - means) / sizes + squared / (4 * sizes**2)))
    limits = np.stack([centre - reach, centre + reach], axis=1) / (1 + squared / sizes)[:, None]
    return _around(np.clip(limits, 0.0, 1.0), means)


def jeffreys_limits(rates: Rates, confidence: float) -> Floats:
    """Return Jeffreys' limits of rates, (R, 2): 0 where nothing was hit, 1 where everything was."""
    alike, at = np.unique(rates.means + 1j * rates.sizes, return_inverse=True)
    hits, misses = alike.real * alike.imag, (1 - alike.real) * alike.imag
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    limits = [betaincinv(hits + 0.5, misses + 0.5, tail)[at] for tail in tails]
    return _around(np.stack(limits, axis=1), rates.means)


def average_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals (R, 2) of mean shares, (R, N) of each scene, averaged without weights."""
    return limits_of_rates([effective_rates(values) for values in scenes], confidence)


def limits_of_rates(rates: Sequence[Rates], confidence: float) -> Floats:
    """Take the intervals (R, 2) of averaged rates: Wilson's of one scene, MOVER's of several."""
    if len(rates) == 1:
        return wilson_limits(rates[0], confidence)
    means = np.mean([rate.means for rate in rates], axis=0)
    squares = sum(_reaches(rate, confidence) ** 2 for rate in rates)
    down, up = np.sqrt(squares) / len(rates)
    return np.stack([means - down, means + up], axis=1)


def _reaches(rates: Rates, confidence: float) -> Floats:
    """Return how far Jeffreys' limits lie below and above rates, (2, R)."""
    low, high = jeffreys_limits(rates, confidence).T
    return np.stack([rates.means - low, high - rates.means])


def difference_limits(scenes: Sequence[Floats], confidence: float) -> Floats:
    """Take the intervals (R, 2) of paired differences, (R, N) of each scene, averaged over scenes.

    Of hits, what is won and what is lost are two shares, whose covariance is known: a query cannot
    be both. Differences with fractions have Student's limits, unless all of a scene are alike.
    """
    means = np.mean([values.mean(axis=1) for values in scenes], axis=0)
    graded = np.any([(values != np.rint(values)).any(axis=1) for values in scenes], axis=0)
    squares = np.zeros((2, len(means)))
    for values in scenes:
        count = values.shape[1]
        student = stdtrit(count - 1, (1 + confidence) / 2) ** 2 * values.var(axis=1, ddof=1) / count
        of_scene = np.stack([student, student])
        as_hits = ~graded | (np.ptp(values, axis=1) <= _ALIKE)
        if as_hits.any():
            of_scene[:, as_hits] = _squares_of_hits(values[as_hits], confidence)
        squares += of_scene
    down, up = np.sqrt(np.maximum(squares, 0.0)) / len(scenes)
    return np.stack([np.maximum(means - down, -1.0), np.minimum(means + up, 1.0)], axis=1)


def _squares_of_hits(values: Floats, confidence: float) -> Floats:
    """Return the squared reaches, down and up (2, R), of a scene's share won minus share lost."""
    won, lost = (effective_rates(np.maximum(side, 0.0)) for side in (values, -values))
    spread = np.sqrt(won.means * (1 - won.means) / won.sizes)
    spread = spread * np.sqrt(lost.means * (1 - lost.means) / lost.sizes) * values.shape[1]
    nothing = np.zeros(len(spread))
    correlation = np.divide(-won.means * lost.means, spread, out=nothing, where=spread > 0)
    one, other = _reaches(won, confidence), _reaches(lost, confidence)[::-1]
    squares = one**2 + other**2 - 2 * np.maximum(correlation, -1.0) * one * other
    return np.asarray(squares)

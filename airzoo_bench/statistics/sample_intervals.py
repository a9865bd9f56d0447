"""Intervals of a sample, each by the method that keeps its promise for that kind of average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.intervals import Interval, SampleIntervals, bootstrap, few_units
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.scene_means import intervals_over_scenes
from airzoo_bench.statistics.share_differences import difference_limits
from airzoo_bench.statistics.shares import average_limits

__all__ = ["sample_intervals"]

_Pairs = Sequence[tuple[int, int]]


def sample_intervals(
    sample: Sample, resampling: ResamplingConfig, differences: _Pairs = (), *, groups: bool = True
) -> SampleIntervals:
    """Take intervals: over scenes by Student's t, of shares by MOVER, of all else by bootstrap.

    Parameters
    ----------
    sample : Sample
        Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed, kind of interval, confidence.
    differences : sequence of (int, int)
        Pairs of variables: the first minus the second, both shares or neither.
    groups : bool
        Whether to take the intervals of each group too.

    Returns
    -------
    SampleIntervals
        There is no interval where a group has fewer than `FEWEST` units, or all units of what is
        resampled are alike.

    Raises
    ------
    ValueError
        The sample has no group.
    """
    if sample.unit == "scene":
        return intervals_over_scenes(sample, resampling.confidence, differences)
    shares = sample.shares
    if shares is None or not shares.any():
        return bootstrap(sample, resampling, differences, groups=groups)
    closed = _of_shares(sample, resampling, shares, differences, groups=groups)
    if shares.all():
        return closed
    drawn, pairs = _without_shares(sample, shares, differences)
    others = bootstrap(drawn, resampling, pairs, groups=groups)
    of_shares = np.concatenate(
        [shares, np.array([shares[one] for one, _ in differences], np.bool_)]
    )
    tested = iter(others.p_values)
    return SampleIntervals(
        {
            group: _merged(of_shares, found, others.groups[group])
            for group, found in closed.groups.items()
        },
        _merged(of_shares, closed.overall, others.overall),
        [None if shares[one] else next(tested) for one, _ in differences],
    )


def _without_shares(
    sample: Sample, shares: NDArray[np.bool_], differences: _Pairs
) -> tuple[Sample, list[tuple[int, int]]]:
    places = np.cumsum(~shares) - 1
    pairs = [(int(places[a]), int(places[b])) for a, b in differences if not shares[a]]
    values = tuple(part[~shares] for part in sample.values)
    return replace(sample, values=values, medians=sample.medians[~shares], shares=None), pairs


def _of_shares(
    sample: Sample,
    resampling: ResamplingConfig,
    shares: NDArray[np.bool_],
    differences: _Pairs,
    *,
    groups: bool,
) -> SampleIntervals:
    pairs = np.array([pair for pair in differences if shares[pair[0]]], np.intp).reshape(-1, 2)
    means = [part[shares] for part in sample.values]
    contrasts = [paired_difference(part[pairs[:, 0]], part[pairs[:, 1]]) for part in sample.values]
    parts = list(zip(sample.groups, means, contrasts, strict=True))
    found = {one[0]: _limits([one], resampling, sample.unit) for one in parts} if groups else {}
    return SampleIntervals(found, _limits(parts, resampling, sample.unit), [None] * len(pairs))


def _limits(
    parts: Sequence[tuple[str, Floats, Floats]], resampling: ResamplingConfig, unit: str
) -> list[Interval]:
    """Take the intervals of groups' means and differences, each (R, N)."""
    units, group = min((means.shape[1], group) for group, means, _ in parts)
    few = few_units(units, group, unit)
    if few is not None:
        return [few] * (len(parts[0][1]) + len(parts[0][2]))
    means = average_limits([part for _, part, _ in parts], resampling.confidence).tolist()
    contrasts = difference_limits([part for *_, part in parts], resampling.confidence).tolist()
    method = "wilson" if len(parts) == 1 else "mover"
    return [Interval(low, high, method) for low, high in means] + [
        Interval(low, high, "mover") for low, high in contrasts
    ]


def _merged(
    of_shares: NDArray[np.bool_], closed: Sequence[Interval], others: Sequence[Interval]
) -> list[Interval]:
    one, other = iter(closed), iter(others)
    return [next(one) if is_share else next(other) for is_share in of_shares]

"""Intervals of a sample, each by the method that keeps its promise for that kind of average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from airzoo_bench.statistics.intervals import Interval, SampleIntervals, bootstrap, few_units
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.scene_means import intervals_over_scenes
from airzoo_bench.statistics.shares import average_limits, difference_limits

__all__ = ["sample_intervals"]

_Pairs = Sequence[tuple[int, int]]
_T = TypeVar("_T")


def sample_intervals(
    sample: Sample, resampling: ResamplingConfig, differences: _Pairs = (), *, groups: bool = True
) -> SampleIntervals:
    """Take intervals: over scenes by Student's t, of shares by MOVER, of all else by bootstrap.

    Values are finite or +inf; `differences` are pairs of variables, both shares or neither: the
    first minus the second. `groups` asks for the intervals of each group too.
    """
    if sample.unit == "scene":
        return intervals_over_scenes(sample, resampling, differences)
    shares = sample.shares
    if shares is None or not shares.any():
        return bootstrap(sample, resampling, differences, groups=groups)
    if shares.all():
        return _of_shares(sample, resampling, differences, groups=groups)
    parts = []
    for some in (~shares, shares):
        numbers = np.cumsum(some) - 1
        pairs = [(int(numbers[a]), int(numbers[b])) for a, b in differences if some[a]]
        chosen = replace(
            sample,
            values=tuple(part[some] for part in sample.values),
            medians=sample.medians[some],
            shares=shares[some],
        )
        parts.append(sample_intervals(chosen, resampling, pairs, groups=groups))
    rows = [*shares.tolist(), *(bool(shares[one]) for one, _ in differences)]
    return SampleIntervals(
        {group: _merge(rows, *(part.groups[group] for part in parts)) for group in parts[0].groups},
        _merge(rows, *(part.overall for part in parts)),
        _merge(rows[len(shares) :], *(part.p_values for part in parts)),
    )


def _merge(of_shares: Sequence[bool], others: Sequence[_T], shares: Sequence[_T]) -> list[_T]:
    """Put rows in order again: of each, whether it is one of shares."""
    sides = iter(others), iter(shares)
    return [next(sides[is_share]) for is_share in of_shares]


def _of_shares(
    sample: Sample, resampling: ResamplingConfig, differences: _Pairs, *, groups: bool
) -> SampleIntervals:
    pairs = np.array(differences, np.intp).reshape(-1, 2)
    found = {}
    for group, values in zip(sample.groups, sample.values, strict=True) if groups else ():
        alone = replace(sample, groups=(group,), values=(values,))
        found[group] = _of_shares(alone, resampling, differences, groups=False).overall
    few = few_units(*sample.fewest, sample.unit)
    if few is not None:
        return SampleIntervals(
            found, [few] * (len(sample.medians) + len(pairs)), [None] * len(pairs)
        )
    method = "wilson" if len(sample.groups) == 1 else "mover"
    contrasts = [paired_difference(part[pairs[:, 0]], part[pairs[:, 1]]) for part in sample.values]
    means = average_limits(sample.values, resampling.confidence).tolist()
    gaps = difference_limits(contrasts, resampling.confidence).tolist()
    overall = [Interval(low, high, method) for low, high in means]
    overall += [Interval(low, high, "mover") for low, high in gaps]
    return SampleIntervals(found, overall, [None] * len(pairs))

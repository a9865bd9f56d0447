"""Intervals and tests of paired differences: means by permutation, medians by bootstrap."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.sample_intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.significance import PairedTest, p_floor, paired_permutation

__all__ = ["paired_tests"]


def paired_tests(
    sample: Sample, plan: ResamplingConfig, places: Sequence[tuple[int, int]]
) -> tuple[list[Interval], list[PairedTest]]:
    """Take the interval of paired differences, and test whether they are 0.

    Means by permutation, medians by the interval itself: p of a median is that of the bootstrap's
    percentile interval, but never below what any test could find on as many units as differ.

    Parameters
    ----------
    sample : Sample
        Values are finite or +inf.
    plan : ResamplingConfig
        How intervals and tests are made.
    places : sequence of (int, int)
        Of variables, both averaged in the same way.

    Returns
    -------
    intervals, tests : list of Interval, list of PairedTest
        One each for every pair of `places`.
    """
    found = sample_intervals(sample, plan, places, groups=False)
    by_median = [bool(sample.medians[one]) for one, _ in places]
    means = [place for place, median in zip(places, by_median, strict=True) if not median]
    permuted = iter(paired_permutation(sample, plan, means))
    tests = [
        _test_of_medians(sample, place, p_value, plan) if median else next(permuted)
        for place, median, p_value in zip(places, by_median, found.p_values, strict=True)
    ]
    return found.overall[len(sample.medians) :], tests


def _test_of_medians(
    sample: Sample, place: tuple[int, int], p_value: float | None, plan: ResamplingConfig
) -> PairedTest:
    if p_value is None:
        return PairedTest(1.0, exact=False, patterns=0, kind="bootstrap")
    one, other = place
    unlike = sum(
        int((paired_difference(part[one], part[other]) != 0).sum()) for part in sample.values
    )
    least = p_floor(unlike)
    return PairedTest(max(p_value, least), exact=False, patterns=plan.resamples, kind="bootstrap")

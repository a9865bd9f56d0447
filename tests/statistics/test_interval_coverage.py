"""Simulated coverage of bootstrap intervals."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.statistics.intervals import bootstrap
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import limits, sample


@pytest.mark.slow
@pytest.mark.parametrize("method", ["bca", "percentile"])
@pytest.mark.parametrize(("rate", "size"), [(0.3, 264), (0.5, 161), (0.9, 400)])
def test_coverage_of_a_binomial_score(method, rate, size):
    # 2,000 data sets; the share that covers is known to within 1 % (two standard errors).
    hits = np.random.default_rng(size).random((2_000, size)) < rate
    found = bootstrap(sample(hits), ResamplingConfig(2_000, interval=method), groups=False).overall
    low, high = np.array([limits(interval) for interval in found]).T
    covered = ((low <= rate) & (rate <= high)).mean()
    assert 0.93 <= covered <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("method", ["bca", "percentile"])
def test_coverage_of_the_mean_over_scenes_and_of_differences(method):
    # The second method answers 70 % of what the first does, and 30 % of the rest.
    random = np.random.default_rng(3)
    groups = []
    for size, rate in ((60, 0.8), (150, 0.4), (90, 0.6)):
        first = random.random((1_000, size)) < rate
        second = random.random((1_000, size)) < np.where(first, 0.7, 0.3)
        groups.append(np.concatenate([first, second]))
    pairs = [(row, 1_000 + row) for row in range(1_000)]
    resampling = ResamplingConfig(1_000, interval=method)
    found = bootstrap(sample(*groups), resampling, pairs, groups=False).overall
    low, high = np.array([limits(interval) for interval in found]).T
    mean, answered = 0.6, 0.7 * 0.6 + 0.3 * 0.4
    for rows, true in (
        (slice(0, 1_000), mean),
        (slice(1_000, 2_000), answered),
        (slice(2_000, 3_000), mean - answered),
    ):
        assert 0.93 <= ((low[rows] <= true) & (true <= high[rows])).mean() <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("method", ["bca", "percentile"])
def test_coverage_of_paired_differences_of_medians(method):
    # Errors of two methods on two scenes; their logarithms are correlated by 0.7.
    random = np.random.default_rng(5)
    groups = []
    for size, scale in ((120, 1.0), (200, 4.0)):
        shared, own = random.standard_normal((2, 1_000, size))
        first = scale * np.exp(shared)
        second = scale * np.exp(0.7 * shared + np.sqrt(1 - 0.49) * own + 0.2)
        groups.append(np.concatenate([first, second]))
    pairs = [(row, 1_000 + row) for row in range(1_000)]
    made = sample(*groups, medians=np.ones(2_000, bool))
    found = bootstrap(made, ResamplingConfig(1_000, interval=method), pairs, groups=False).overall
    low, high = np.array([limits(interval) for interval in found]).T
    first, second = (1.0 + 4.0) / 2, np.exp(0.2) * (1.0 + 4.0) / 2
    # Of a difference of medians all intervals are percentile, which are rather too wide.
    assert {interval.method for interval in found[2_000:]} == {"percentile"}
    for rows, true, limit in (
        (slice(0, 1_000), first, 0.97),
        (slice(1_000, 2_000), second, 0.97),
        (slice(2_000, 3_000), first - second, 0.98),
    ):
        assert 0.93 <= ((low[rows] <= true) & (true <= high[rows])).mean() <= limit

"""Samples of scenes, and the limits of their intervals."""

from __future__ import annotations

import numpy as np

from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

MEAN, MEDIAN = np.array([False]), np.array([True])
FAST = ResamplingConfig(resamples=1_000)


def sample(*groups: np.ndarray, medians: np.ndarray | None = None) -> Sample:
    names = tuple(f"s{number}" for number in range(len(groups)))
    values = tuple(np.atleast_2d(np.asarray(group, np.float64)) for group in groups)
    chosen = np.zeros(len(values[0]), bool) if medians is None else medians
    return Sample("query", names, values, chosen)


def limits(interval: Interval) -> tuple[float, float]:
    assert interval.low is not None
    assert interval.high is not None
    assert interval.reason == ""
    return interval.low, interval.high

"""Bootstrap intervals: by hand, what they depend on, where there is none, and their coverage."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.statistics.intervals import FEWEST, Interval, quantiles, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import paired_tests
from tests.statistics.support import FAST, MEDIAN, limits, sample

INF = np.inf


def test_quantiles_by_hand():
    ranked = np.array([[0.0, 1, INF], [-INF, 1, 4], [-INF, -INF, INF], [-INF, INF, INF]])
    levels = np.array([[0.0, 0.25, 0.5, 0.75, 1.0]] * 4)
    # Half way to infinity is infinity; between both, the side of the level.
    assert quantiles(ranked, levels).tolist() == [
        [0, 0.5, 1, INF, INF],
        [-INF, -INF, 1, 2.5, 4],
        [-INF, -INF, -INF, INF, INF],
        [-INF, -INF, INF, INF, INF],
    ]
    assert quantiles(np.array([[-INF, INF]]), np.array([[0.49, 0.5]])).tolist() == [[-INF, INF]]


def test_the_last_bit_is_no_bias():
    # Values and their order do not matter to BCa, though sums of tenths round otherwise.
    values = np.array([0.1, 0.2, 0.3, 0.4, 0.7, 0.9] * 5)
    one = sample_intervals(sample(values), FAST).overall[0]
    moved = sample_intervals(sample(values * 3e-7), FAST).overall[0]
    assert one.method == moved.method == "bca"
    assert np.array(limits(moved)) / 3e-7 == pytest.approx(limits(one), rel=1e-9)


def test_a_scene_s_interval_does_not_depend_on_other_scenes():
    random = np.random.default_rng(0)
    one, other = random.random(20), random.random(30)
    both = sample_intervals(sample(one, other), FAST)
    alone = sample_intervals(sample(one), FAST)
    assert both.groups["s0"] == alone.groups["s0"] == alone.overall
    # The average of two scenes is half of their sum.
    shifted = sample_intervals(sample(one, one + 10.0), FAST)
    assert limits(shifted.overall[0]) == pytest.approx((5.5, 5.5), abs=0.3)
    assert both.overall != alone.overall


def test_infinite_errors_stay():
    # Of 20 queries 8 fail: the median is finite, but resamples with 11 failures have none.
    errors = np.array([*range(1, 13), *[INF] * 8], float)
    low, high = limits(sample_intervals(sample(errors, medians=MEDIAN), FAST).overall[0])
    assert low < 10.5
    assert high == INF
    most = np.array([1.0, 2.0, *[INF] * 18])
    found = sample_intervals(sample(most, medians=MEDIAN), FAST).overall[0]
    assert limits(found) == (INF, INF)
    # A mean with failures is infinite, and so is its upper limit; BCa does not exist there, nor
    # where one of two scenes has a failure.
    finite = np.arange(1.0, 31.0)
    for groups in ([errors], [np.array([INF, *range(1, 30)])], [finite, errors]):
        found = sample_intervals(sample(*groups), FAST).overall[0]
        assert (found.method, found.high) == ("percentile", INF)
    # Variables beside it keep theirs.
    both = sample_intervals(sample(np.stack([finite, np.array([INF, *finite[1:]])])), FAST).overall
    assert both[0] == sample_intervals(sample(finite), FAST).overall[0]


def test_too_few_units():
    few, enough = np.arange(FEWEST - 1.0), np.arange(FEWEST * 1.0)
    found = sample_intervals(sample(enough, few), FAST)
    assert limits(found.groups["s0"][0])[0] < 2.0
    assert found.groups["s1"][0].low is None
    assert found.overall[0].low is None
    assert "scene s1" in found.overall[0].reason


@pytest.mark.parametrize("value", [0.0, 1.0, INF])
def test_units_that_are_all_alike(value):
    alike, mixed = np.full(30, value), np.arange(30.0)
    made = sample(np.stack([alike, mixed]))
    found = sample_intervals(made, FAST).overall
    assert found[0] == Interval(None, None, "", found[0].reason)
    assert "alike" in found[0].reason
    assert found[1].low is not None
    assert "alike" in paired_tests(made, FAST, [(1, 1)])[0][0].reason
    # Where one scene is even and another is not, there is an interval.
    assert sample_intervals(sample(alike, mixed), FAST).overall[0].high is not None


def test_the_same_bytes_with_any_number_of_threads():
    assert printed("1") == printed("2")


def printed(threads: str) -> str:
    """Return intervals from a process of its own: BLAS reads its threads when it is loaded."""
    code = (
        "import numpy as np\n"
        "from airzoo_bench.statistics.intervals import sample_intervals\n"
        "from airzoo_bench.statistics.significance import paired_tests\n"
        "from airzoo_bench.statistics.samples import ResamplingConfig, Sample\n"
        "v = np.random.default_rng(0).random((12, 700)) ** 3\n"
        "s = Sample('query', ('a', 'b'), (v[:, :600], v[:, 600:]), np.arange(12) % 4 == 0)\n"
        "plan = ResamplingConfig(500)\n"
        "print(sample_intervals(s, plan), paired_tests(s, plan, [(0, 4), (1, 2)]))\n"
    )
    more = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), threads)
    root = str(Path(__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | more | {"PYTHONPATH": root},
    )
    assert "Interval" in done.stdout
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "size"), [(0.3, 264), (0.5, 161), (0.9, 400)])
def test_coverage_of_a_binomial_score(rate, size):
    # 2,000 data sets; the share that covers is known to within 1 % (two standard errors).
    hits = np.random.default_rng(size).random((2_000, size)) < rate
    plan = ResamplingConfig(2_000)
    assert 0.93 <= covered(sample_intervals(sample(hits), plan, groups=False).overall, rate) <= 0.97


@pytest.mark.slow
def test_coverage_of_the_mean_over_scenes_and_of_differences():
    # The second method answers 70 % of what the first does, and 30 % of the rest.
    random = np.random.default_rng(3)
    groups = []
    for size, rate in ((60, 0.8), (150, 0.4), (90, 0.6)):
        first = random.random((1_000, size)) < rate
        second = random.random((1_000, size)) < np.where(first, 0.7, 0.3)
        groups.append(np.concatenate([first, second]))
    mean, answered = 0.6, 0.7 * 0.6 + 0.3 * 0.4
    for found, true in zip(three(sample(*groups)), (mean, answered, mean - answered), strict=True):
        assert 0.93 <= covered(found, true) <= 0.97


@pytest.mark.slow
def test_coverage_of_medians_and_of_paired_differences():
    # Errors of two methods on two scenes; their logarithms are correlated by 0.7.
    random = np.random.default_rng(5)
    groups = []
    for size, scale in ((120, 1.0), (200, 4.0)):
        shared, own = random.standard_normal((2, 1_000, size))
        second = scale * np.exp(0.7 * shared + np.sqrt(1 - 0.49) * own + 0.2)
        groups.append(np.concatenate([scale * np.exp(shared), second]))
    one, other = (1.0 + 4.0) / 2, np.exp(0.2) * (1.0 + 4.0) / 2
    found = three(sample(*groups, medians=np.ones(2_000, bool)))
    # Percentile intervals of a difference of medians are rather too wide.
    for part, true, most in zip(found, (one, other, one - other), (0.97, 0.97, 0.98), strict=True):
        assert 0.93 <= covered(part, true) <= most


def three(made):
    """Return the intervals of 1,000 first methods, of the second ones, and of the differences."""
    plan = ResamplingConfig(1_000)
    found = sample_intervals(made, plan, groups=False).overall
    pairs = [(row, 1_000 + row) for row in range(1_000)]
    return found[:1_000], found[1_000:], paired_tests(made, plan, pairs)[0]


def covered(found: list[Interval], true: float) -> float:
    low, high = np.array([limits(interval) for interval in found]).T
    return float(((low <= true) & (true <= high)).mean())

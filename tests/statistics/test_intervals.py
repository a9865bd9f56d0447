"""Bootstrap intervals: by hand, what they depend on, and where there is none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.statistics.intervals import (
    FEWEST,
    Interval,
    acceleration,
    bootstrap,
    interval_limits,
    jackknife_moments,
)
from airzoo_bench.statistics.samples import ResamplingConfig, leave_one_out
from tests.statistics.support import FAST, MEAN, MEDIAN, limits, sample


def test_percentiles_by_hand():
    resamples = np.array([[4.0, 1.0, 0.0, 3.0, 2.0], [1.0, np.inf, np.inf, 0.0, 2.0]])
    resampling = ResamplingConfig(interval="percentile", confidence=0.5)
    found, exists = interval_limits(resamples, *np.zeros((3, 2)), resampling)
    assert found.tolist() == [[1.0, 3.0], [1.0, np.inf]]
    assert exists.tolist() == [True, True]
    assert exists.dtype == np.bool_
    narrow = ResamplingConfig(interval="percentile", confidence=0.25)
    # Levels 0.375 and 0.625: half way between ranks, and half way to infinity is infinity.
    found, _ = interval_limits(resamples, *np.zeros((3, 2)), narrow)
    assert found.tolist() == [[1.5, 2.5], [1.5, np.inf]]


def test_percentiles_of_infinite_differences():
    resamples = np.array([[-np.inf, 5.0, -np.inf, np.inf, 6.0]])
    resampling = ResamplingConfig(interval="percentile", confidence=0.25)
    found, _ = interval_limits(resamples, *np.zeros((3, 1)), resampling)
    assert found.tolist() == [[-np.inf, 5.5]]


def test_ties_of_a_difference_of_nothing_count_half():
    # Averages of 0.1, 0.2, 0.3 and of 0.3, 0.2, 0.1 are equal, but in binary their sums are not.
    rates = ((0.1, 0.3), (0.2, 0.2), (0.3, 0.1))
    first = [np.arange(10) < round(10 * one) for one, _ in rates]
    second = [np.arange(10) >= 10 - round(10 * other) for _, other in rates]
    groups = sample(*map(np.stack, zip(first, second, strict=True)), medians=np.zeros(2, bool))
    for interval in bootstrap(groups, ResamplingConfig(), [(0, 1), (1, 0)]).overall[2:]:
        assert interval.method == "bca"
        assert limits(interval) == pytest.approx((-7 / 30, 7 / 30))


@pytest.mark.parametrize("rounding", [-1e-16, 0.0, 1e-16])
@pytest.mark.parametrize("size", [1.0, 1e3, 1e-3])
def test_rounding_is_no_bias(rounding, size):
    # Half of the resamples are the estimate, but for rounding, and the others lie about it alike.
    resamples = np.repeat([-2.0, -1.0, 0.0, 1.0, 2.0], [100, 150, 500, 150, 100])[None] * size
    given = (
        np.array([rounding * size]),
        np.array([size]),
        np.zeros(1),
        ResamplingConfig(confidence=0.7),
    )
    assert interval_limits(resamples, *given)[0].tolist() == [[-size, size]]
    # Where the numbers are 0, only what is equal is a tie.
    nothing = np.zeros(1), np.zeros(1), np.zeros(1), ResamplingConfig(confidence=0.7)
    assert interval_limits(resamples, *nothing)[0].tolist() == [[-size, size]]
    # Differences that are small, and no rounding, are no ties.
    aside = np.array([0.5e-9 * size])
    found = interval_limits(1e-9 * resamples, aside, *given[1:])[0] / size
    assert found.tolist() == [pytest.approx([0.0, 2e-9], abs=1e-15)]


def test_a_scene_s_interval_does_not_depend_on_other_scenes():
    random = np.random.default_rng(0)
    one, other = random.random(20), random.random(30)
    both = bootstrap(sample(one, other), FAST)
    alone = bootstrap(sample(one), FAST)
    assert both.groups["s0"] == alone.groups["s0"] == alone.overall
    # The average of two scenes is half of their sum.
    shifted = bootstrap(sample(one, one + 10.0), FAST)
    assert limits(shifted.overall[0]) == pytest.approx((5.5, 5.5), abs=0.3)
    assert both.overall != alone.overall


def test_infinite_errors_stay():
    # Of 20 queries 8 fail: the median is finite, but resamples with 11 failures have none.
    errors = np.array([*range(1, 13), *[np.inf] * 8], float)
    resampling = ResamplingConfig(interval="percentile")
    low, high = limits(bootstrap(sample(errors, medians=MEDIAN), resampling).overall[0])
    assert low < 10.5
    assert high == np.inf
    # A mean with failures is infinite, and so is its upper limit; BCa does not exist there.
    found = bootstrap(sample(errors), ResamplingConfig()).overall[0]
    assert found.high == np.inf
    assert found.method == "percentile"
    most = np.array([1.0, 2.0, *[np.inf] * 18])
    assert limits(bootstrap(sample(most, medians=MEDIAN), resampling).overall[0]) == (
        np.inf,
        np.inf,
    )


def test_two_failures_differ_by_nothing():
    failing = np.array([1.0, 2.0, *[np.inf] * 18])
    values = np.stack([failing, failing[::-1]])
    medians = np.array([True, True])
    found = bootstrap(sample(values, medians=medians), FAST, [(0, 1)]).overall[2]
    assert limits(found) == (0.0, 0.0)


def test_a_group_that_one_failure_makes_infinite_has_no_bca():
    # Without the failure the mean is finite, with it not: there is no acceleration of that.
    finite, failing = np.arange(1.0, 31.0), np.array([np.inf, *range(1, 30)])
    moments = jackknife_moments(
        leave_one_out(np.stack([finite, failing]), np.array([False, False]))
    )
    assert np.isfinite(moments[0]).all()
    assert moments[1].tolist() == [np.inf, np.inf]
    assert np.isnan(acceleration(moments)[1])
    # Of two groups, one with a failure, the sum has none either.
    overall = bootstrap(sample(finite, failing), FAST).overall[0]
    assert (overall.method, overall.high) == ("percentile", np.inf)


def test_moments_of_all_others_stay_beside_a_failure():
    values = np.random.default_rng(1).exponential(1.0, (2, 20))
    alone = jackknife_moments(leave_one_out(values[:1], MEAN))
    values[1, 3] = np.inf
    both = jackknife_moments(leave_one_out(values, np.array([False, False])))
    assert both[0].tolist() == alone[0].tolist()
    assert both[0] == pytest.approx(
        [
            (((20 - 1) * (m.mean() - m) / 20) ** k).sum()
            for m in [_left_out(values[0])]
            for k in (3, 2)
        ]
    )


def _left_out(values: np.ndarray) -> np.ndarray:
    return np.array([np.delete(values, place).mean() for place in range(len(values))])


def test_too_few_units():
    few, enough = np.arange(FEWEST - 1.0), np.arange(FEWEST * 1.0)
    found = bootstrap(sample(enough, few), FAST)
    assert limits(found.groups["s0"][0])[0] < 2.0
    reason = "only 4 queries in scene s1: an interval needs 5"
    assert found.groups["s1"][0] == Interval(None, None, "", reason)
    assert found.overall[0].low is None
    assert "scene s1" in found.overall[0].reason


def test_medians_alone_have_a_p_and_only_where_all_groups_are_large_enough():
    values = np.random.default_rng(0).random((4, 30))
    values[0] += 5.0
    mixed, pairs = np.array([True, True, False, False]), [(0, 1), (2, 3), (1, 0)]
    assert bootstrap(sample(values, medians=mixed), FAST, pairs).p_values == [
        2 / 1_001,
        None,
        2 / 1_001,
    ]
    for groups in ([values[:, :4]], [values, values[:, :4]], [values[:, :4], values]):
        made = sample(*groups, medians=mixed)
        assert bootstrap(made, FAST, pairs, groups=False).p_values == [None] * 3


@pytest.mark.parametrize("value", [0.0, 1.0, np.inf])
def test_units_that_are_all_alike(value):
    alike = np.full(30, value)
    mixed = np.arange(30.0)
    found = bootstrap(sample(np.stack([alike, mixed])), FAST, [(0, 0), (1, 1), (0, 1)]).overall
    reason = "all queries are alike: resamples cannot differ"
    assert found[0] == Interval(None, None, "", reason)
    assert found[1].low is not None
    reason = "the differences of all queries are alike: resamples cannot differ"
    assert found[2].reason == found[3].reason == reason
    # Where one scene is even and another is not, there is an interval.
    assert bootstrap(sample(alike, mixed), FAST).overall[0].high is not None


def test_the_same_bytes_with_any_number_of_threads():
    assert printed("1") == printed("2")


def printed(threads: str) -> str:
    """Return intervals from a process of its own: BLAS reads its threads when it is loaded."""
    code = (
        "import numpy as np\n"
        "from airzoo_bench.statistics.intervals import bootstrap\n"
        "from airzoo_bench.statistics.samples import ResamplingConfig, Sample\n"
        "v = np.random.default_rng(0).random((40, 700)) ** 3\n"
        "s = Sample('query', ('a', 'b'), (v[:, :600], v[:, 600:]), np.arange(40) % 4 == 0)\n"
        "print(bootstrap(s, ResamplingConfig(500), [(0, 4), (1, 2)]))\n"
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

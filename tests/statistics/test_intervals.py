"""Bootstrap intervals: draws by counting, averages of resamples, limits by hand, coverage."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.statistics.intervals import quantiles, sample_intervals
from airzoo_bench.statistics.samples import (
    ResamplingConfig,
    leave_one_out,
    resample_counts,
    sign_flips,
    stream_key,
    weighted_averages,
)
from airzoo_bench.statistics.significance import paired_tests
from tests.statistics.support import FAST, MEDIAN, limits, sample
from tests.support import environment

INF, BOTH = np.inf, np.array([False, True])
errors = st.one_of(st.floats(0, 1e7, allow_subnormal=False), st.just(INF))


# --- draws and averages ---


@pytest.mark.parametrize("draw", [resample_counts, sign_flips])
@pytest.mark.parametrize("units", [1, 2, 7, 8, 9, 63, 64, 65, 257])
def test_a_resample_does_not_depend_on_its_block(draw, units) -> None:
    whole = draw(units, 0, 40, 11)
    parts = [draw(units, 0, 1, 11), draw(units, 1, 25, 11), draw(units, 26, 14, 11)]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))
    assert whole.shape == (units, 40)


def test_draws_of_units_are_independent() -> None:  # that they are fair is in tests/oracles
    coins = sign_flips(100, 0, 10_000, 5).astype(np.float64)
    assert abs(coins.mean() - 0.5) < 0.002
    assert np.abs(np.corrcoef(coins) - np.eye(100)).max() < 0.05


def test_the_stream_stays_what_it_is() -> None:
    # Whoever changes these numbers changes every interval that was ever published.
    counts = [[0, 0, 0, 2, 1, 1], [3, 2, 0, 0, 3, 0], [1, 1, 3, 2, 0, 1], [0, 1, 1, 0, 0, 2]]
    assert resample_counts(4, 0, 6, 1).tolist() == counts
    signs = [[1, 0, 1, 1, 0, 0], [1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 1, 0]]
    assert sign_flips(3, 0, 6, 1).tolist() == signs
    assert stream_key(0, "bootstrap", "east") == 242631316549171704428568933449400340785


def assert_averages(values, counts) -> None:
    """Compare the averages with NumPy's of the resamples themselves, medians to the last bit."""
    means, medians = weighted_averages(np.stack([values, values]), BOTH, counts)
    drawn = [np.repeat(values, column) for column in counts.T]
    assert means == pytest.approx([part.mean() for part in drawn], rel=1e-12, abs=1e-6)
    assert medians.tolist() == [float(np.median(part)) for part in drawn]


@given(hnp.arrays(np.float64, st.integers(1, 40), elements=errors))
def test_averages_are_numpy_s(values) -> None:
    assert_averages(values, resample_counts(len(values), 0, 20, 1))


def test_averages_of_many() -> None:  # where only the middle is looked at
    for units in (500, 501, 2_000):
        values = np.random.default_rng(units).exponential(1.0, units)
        assert_averages(values, resample_counts(units, 0, 50, 1))


@pytest.mark.parametrize("scale", [1e-300, 1e-9, 1.0, 1e12, 1e300])
def test_means_of_any_size_and_of_failures(scale: float) -> None:
    values = np.array([[1.0, 2.0, 6.0], [np.inf, 2.0, 6.0]]) * scale
    found = weighted_averages(values, ~BOTH & BOTH, np.array([[1, 0], [1, 2], [1, 1]]))
    assert found[0] == pytest.approx(np.array([3.0, 10 / 3]) * scale, rel=1e-12)
    assert found[1] == pytest.approx(np.array([np.inf, 10 / 3 * scale]), rel=1e-12)


def test_sums_are_exact_in_any_order() -> None:
    # Plain float64 sums of these depend on the order; sums on the grid do not.
    random = np.random.default_rng(0)
    values, order = random.random(3_001) ** 3, random.permutation(3_001)
    counts = resample_counts(3_001, 0, 30, 1)
    one, other = weighted_averages(values[None], BOTH[:1], counts), counts[order]
    assert np.array_equal(one, weighted_averages(values[None, order], BOTH[:1], other))
    assert not np.array_equal(values @ counts, values[order] @ counts[order])


@given(hnp.arrays(np.float64, st.integers(2, 25), elements=errors))
def test_leave_one_out(values) -> None:
    rest = [np.delete(values, place) for place in range(len(values))]
    found = leave_one_out(np.stack([values, values]), BOTH)
    assert found[0] == pytest.approx([part.mean() for part in rest], rel=1e-9, abs=1e-6)
    assert found[1].tolist() == [float(np.median(part)) for part in rest]


# --- intervals ---


def test_quantiles_by_hand() -> None:
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


def test_the_last_bit_is_no_bias() -> None:
    # Values and their order do not matter to BCa, though sums of tenths round otherwise.
    values = np.array([0.1, 0.2, 0.3, 0.4, 0.7, 0.9] * 5)
    one = sample_intervals(sample(values), FAST).overall[0]
    moved = sample_intervals(sample(values * 3e-7), FAST).overall[0]
    assert one.method == moved.method == "bca"
    assert np.array(limits(moved)) / 3e-7 == pytest.approx(limits(one), rel=1e-9)


def test_a_scene_s_interval_does_not_depend_on_other_scenes() -> None:
    random = np.random.default_rng(0)
    one, other = random.random(20), random.random(30)
    both = sample_intervals(sample(one, other), FAST)
    alone = sample_intervals(sample(one), FAST)
    assert both.groups["s0"] == alone.groups["s0"] == alone.overall
    # The average of two scenes is half of their sum.
    shifted = sample_intervals(sample(one, one + 10.0), FAST)
    assert limits(shifted.overall[0]) == pytest.approx((5.5, 5.5), abs=0.3)
    assert both.overall != alone.overall


def test_infinite_errors_stay() -> None:
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


def test_too_few_units() -> None:
    few, enough = np.arange(4.0), np.arange(5.0)
    found = sample_intervals(sample(enough, few), FAST)
    assert limits(found.groups["s0"][0])[0] < 2.0
    assert found.groups["s1"][0].low is None
    assert found.overall[0].low is None
    assert "scene s1" in found.overall[0].reason


@pytest.mark.parametrize("value", [0.0, INF])
def test_units_that_are_all_alike(value) -> None:
    alike, mixed = np.full(30, value), np.arange(30.0)
    made = sample(np.stack([alike, mixed]))
    found = sample_intervals(made, FAST).overall
    assert (found[0].low, found[0].high, found[0].method) == (None, None, "")
    assert "alike" in found[0].reason
    assert found[1].low is not None
    assert "alike" in paired_tests(made, FAST, [(1, 1)])[0][0].reason
    # Where one scene is even and another is not, there is an interval.
    assert sample_intervals(sample(alike, mixed), FAST).overall[0].high is not None


def test_the_same_bytes_with_any_number_of_threads() -> None:
    # In processes of their own: BLAS reads its threads when it is loaded.
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
    said = []
    for threads in "12":
        env = environment(OPENBLAS_NUM_THREADS=threads, OMP_NUM_THREADS=threads)
        said.append(subprocess.check_output([sys.executable, "-c", code], text=True, env=env))
    assert said[0] == said[1]
    assert "Interval" in said[0]


@pytest.mark.slow
def test_coverage_of_medians_and_of_paired_differences() -> None:
    # Errors of two methods on two scenes; their logarithms are correlated by 0.7.
    random = np.random.default_rng(5)
    groups = []
    for size, scale in ((120, 1.0), (200, 4.0)):
        shared, own = random.standard_normal((2, 1_000, size))
        second = scale * np.exp(0.7 * shared + np.sqrt(1 - 0.49) * own + 0.2)
        groups.append(np.concatenate([scale * np.exp(shared), second]))
    made, plan = sample(*groups, medians=np.ones(2_000, bool)), ResamplingConfig(1_000)
    means = sample_intervals(made, plan, groups=False).overall
    gaps, _ = paired_tests(made, plan, [(row, 1_000 + row) for row in range(1_000)])
    one, other = (1.0 + 4.0) / 2, np.exp(0.2) * (1.0 + 4.0) / 2
    # Percentile intervals of a difference of medians are rather too wide.
    cases = ((means[:1_000], one, 0.97), (means[1_000:], other, 0.97), (gaps, one - other, 0.98))
    for found, true, most in cases:
        low, high = np.array([limits(interval) for interval in found]).T
        assert 0.93 <= ((low <= true) & (true <= high)).mean() <= most

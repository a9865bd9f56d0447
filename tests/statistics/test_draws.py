"""Draws by counting, the same whatever is drawn beside them, and averages of resamples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.statistics.samples import (
    leave_one_out,
    resample_counts,
    sign_flips,
    stream_key,
    weighted_averages,
)

BOTH = np.array([False, True])
errors = st.one_of(st.floats(0, 1e7, allow_subnormal=False), st.just(np.inf))


@pytest.mark.parametrize("draw", [resample_counts, sign_flips])
@pytest.mark.parametrize("units", [1, 2, 7, 8, 9, 63, 64, 65, 257])
def test_a_resample_does_not_depend_on_its_block(draw, units):
    whole = draw(units, 0, 40, 11)
    parts = [draw(units, 0, 1, 11), draw(units, 1, 25, 11), draw(units, 26, 14, 11)]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))
    assert whole.shape == (units, 40)


def test_draws_are_fair_and_independent():
    # 100,000 draws of 10: the chi-square of fair draws is below 27.9 with probability 0.999.
    drawn = resample_counts(10, 0, 10_000, 5).sum(axis=1)
    assert ((drawn - 10_000) ** 2 / 10_000).sum() < 27.9
    coins = sign_flips(100, 0, 10_000, 5).astype(np.float64)
    assert abs(coins.mean() - 0.5) < 0.002
    assert np.abs(np.corrcoef(coins) - np.eye(100)).max() < 0.05


def test_the_stream_stays_what_it_is():
    # Whoever changes these numbers changes every interval that was ever published.
    counts = [[0, 0, 0, 2, 1, 1], [3, 2, 0, 0, 3, 0], [1, 1, 3, 2, 0, 1], [0, 1, 1, 0, 0, 2]]
    assert resample_counts(4, 0, 6, 1).tolist() == counts
    signs = [[1, 0, 1, 1, 0, 0], [1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 1, 0]]
    assert sign_flips(3, 0, 6, 1).tolist() == signs
    assert stream_key(0, "bootstrap", "east") == 242631316549171704428568933449400340785


def assert_averages(values, counts):
    """Compare the averages with NumPy's of the resamples themselves, medians to the last bit."""
    means, medians = weighted_averages(np.stack([values, values]), BOTH, counts)
    drawn = [np.repeat(values, column) for column in counts.T]
    assert means == pytest.approx([part.mean() for part in drawn], rel=1e-12, abs=1e-6)
    assert medians.tolist() == [float(np.median(part)) for part in drawn]


@given(hnp.arrays(np.float64, st.integers(1, 40), elements=errors))
def test_averages_are_numpy_s(values):
    assert_averages(values, resample_counts(len(values), 0, 20, 1))


@pytest.mark.parametrize("units", [500, 501, 2_000])
def test_averages_where_only_the_middle_is_looked_at(units):
    values = np.random.default_rng(units).exponential(1.0, units)
    assert_averages(values, resample_counts(units, 0, 50, 1))


@pytest.mark.parametrize("scale", [1e-300, 1e-9, 1.0, 1e12, 1e300])
def test_means_of_any_size_and_of_failures(scale):
    values = np.array([[1.0, 2.0, 6.0], [np.inf, 2.0, 6.0]]) * scale
    found = weighted_averages(values, ~BOTH & BOTH, np.array([[1, 0], [1, 2], [1, 1]]))
    assert found[0] == pytest.approx(np.array([3.0, 10 / 3]) * scale, rel=1e-12)
    assert found[1] == pytest.approx(np.array([np.inf, 10 / 3 * scale]), rel=1e-12)


def test_sums_are_exact_in_any_order():
    # Plain float64 sums of these depend on the order; sums on the grid do not.
    random = np.random.default_rng(0)
    values, order = random.random(3_001) ** 3, random.permutation(3_001)
    counts = resample_counts(3_001, 0, 30, 1)
    one, other = weighted_averages(values[None], BOTH[:1], counts), counts[order]
    assert np.array_equal(one, weighted_averages(values[None, order], BOTH[:1], other))
    assert not np.array_equal(values @ counts, values[order] @ counts[order])


@given(hnp.arrays(np.float64, st.integers(2, 25), elements=errors))
def test_leave_one_out(values):
    rest = [np.delete(values, place) for place in range(len(values))]
    found = leave_one_out(np.stack([values, values]), BOTH)
    assert found[0] == pytest.approx([part.mean() for part in rest], rel=1e-9, abs=1e-6)
    assert found[1].tolist() == [float(np.median(part)) for part in rest]

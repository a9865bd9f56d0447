"""Averages of resamples by counts, beside NumPy on the resamples themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.statistics.samples import leave_one_out, resample_counts, weighted_averages

MEAN, MEDIAN = np.array([False]), np.array([True])

shares = st.floats(0, 1, allow_subnormal=False)
errors = st.one_of(st.floats(0, 1e7, allow_subnormal=False), st.just(np.inf))


def drawn(values: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    return [np.repeat(values, column) for column in counts.T]


@given(hnp.arrays(np.float64, st.integers(1, 40), elements=shares))
def test_means(values):
    counts = resample_counts(len(values), 0, 20, 1)
    found = weighted_averages(values[None], MEAN, counts)[0]
    expected = [part.mean() for part in drawn(values, counts)]
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(hnp.arrays(np.float64, st.integers(1, 40), elements=errors))
def test_medians_to_the_last_bit(values):
    counts = resample_counts(len(values), 0, 20, 1)
    found = weighted_averages(values[None], MEDIAN, counts)[0]
    assert found.tolist() == [float(np.median(part)) for part in drawn(values, counts)]


@pytest.mark.parametrize("units", [500, 501, 2_000])
def test_medians_where_only_the_middle_is_looked_at(units):
    values = np.random.default_rng(units).exponential(1.0, units)
    counts = resample_counts(units, 0, 50, 1)
    found = weighted_averages(values[None], MEDIAN, counts)[0]
    assert found.tolist() == [float(np.median(part)) for part in drawn(values, counts)]


def test_a_mean_is_infinite_where_a_failure_was_drawn():
    values = np.array([[1.0, np.inf, 3.0], [1.0, 2.0, 3.0]])
    counts = np.array([[1, 3, 0], [1, 0, 3], [1, 0, 0]])
    found = weighted_averages(values, np.array([False, False]), counts)
    assert found.tolist() == [[np.inf, 1.0, np.inf], [2.0, 1.0, 2.0]]


@pytest.mark.parametrize("scale", [1e-300, 1e-9, 1.0, 1e12, 1e300])
def test_means_of_any_size(scale):
    values = np.array([[1.0, 2.0, 6.0]]) * scale
    found = weighted_averages(values, MEAN, np.array([[1, 2], [1, 1], [1, 0]]))
    assert found[0] == pytest.approx(np.array([3.0, 4 / 3]) * scale, rel=1e-12)


def test_sums_are_exact_in_any_order():
    # Plain float64 sums of these depend on the order; sums on the grid do not.
    random = np.random.default_rng(0)
    values = random.random(3_001) ** 3
    counts = resample_counts(3_001, 0, 30, 1)
    found = weighted_averages(values[None], MEAN, counts)
    order = random.permutation(3_001)
    assert np.array_equal(weighted_averages(values[None, order], MEAN, counts[order]), found)
    plain = values @ counts, values[order] @ counts[order]
    assert not np.array_equal(*plain)


@given(hnp.arrays(np.float64, st.integers(2, 25), elements=errors))
def test_leave_one_out(values):
    rest = [np.delete(values, place) for place in range(len(values))]
    found = leave_one_out(np.stack([values, values]), np.array([False, True]))
    assert found[0] == pytest.approx([part.mean() for part in rest], rel=1e-9, abs=1e-6)
    assert found[1].tolist() == [float(np.median(part)) for part in rest]

"""Holm's correction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from airzoo_bench.results.comparison import family_of
from airzoo_bench.statistics.significance import holm


@pytest.mark.parametrize(
    ("p_values", "family", "adjusted"),
    [
        # Sorted: 0.005 x 4, 0.01 x 3, 0.03 x 2, and 0.04 x 1, raised to the one before.
        ([0.01, 0.04, 0.03, 0.005], None, [0.03, 0.06, 0.06, 0.02]),
        ([0.2], None, [0.2]),
        ([0.6, 0.5, 0.9], None, [1.0, 1.0, 1.0]),
        # Of a larger family: 0.001 x 6, 0.01 x 5, 0.02 x 4.
        ([0.02, 0.001, 0.01], 6, [0.08, 0.006, 0.05]),
    ],
)
def test_by_hand(p_values, family, adjusted):
    assert holm(np.array(p_values), family) == pytest.approx(adjusted)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_it_rejects_what_the_step_down_procedure_rejects(values):
    p_values, level = np.array(values), 0.05
    rejected = np.zeros(len(values), bool)
    for step, place in enumerate(np.argsort(p_values, kind="stable")):
        if p_values[place] * (len(values) - step) > level:
            break
        rejected[place] = True
    assert ((holm(p_values) <= level) == rejected).all()


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8), st.integers(0, 9))
def test_what_is_not_given_counts_as_1(values, others):
    p_values = np.array(values)
    of_all = holm(np.append(p_values, np.ones(others)))
    np.testing.assert_array_equal(holm(p_values, len(values) + others), of_all[: len(values)])


def test_the_best_of_equal_methods_is_no_better():
    # 15 methods that are equal, the best of them against the others, by a test of known p.
    random, count = np.random.default_rng(0), 15
    values = random.normal(size=(4_000, count))
    gaps = values.max(axis=1, keepdims=True) - values
    p_values = [2 * ndtr(-row[row > 0] / 2**0.5) for row in gaps]
    family = family_of([f"m{number}" for number in range(count)], "best")
    false = np.mean([(holm(row, family) <= 0.05).any() for row in p_values])
    assert false < 0.05
    # What the correction for the others alone comes to, which is why it is not enough.
    assert np.mean([(holm(row) <= 0.05).any() for row in p_values]) > 0.1

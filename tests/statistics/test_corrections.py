"""Holm's correction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.statistics.corrections import holm


def test_by_hand():
    # Sorted: 0.005 x 4, 0.01 x 3, 0.03 x 2, and 0.04 x 1, raised to the one before.
    found = holm(np.array([0.01, 0.04, 0.03, 0.005]))
    assert found == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_one_and_many():
    assert holm(np.array([0.2])).tolist() == [0.2]
    assert holm(np.array([0.6, 0.5, 0.9])).tolist() == [1.0, 1.0, 1.0]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_it_rejects_what_the_step_down_procedure_rejects(values):
    p_values, level = np.array(values), 0.05
    rejected = np.zeros(len(values), bool)
    for step, place in enumerate(np.argsort(p_values, kind="stable")):
        if p_values[place] * (len(values) - step) > level:
            break
        rejected[place] = True
    assert ((holm(p_values) <= level) == rejected).all()

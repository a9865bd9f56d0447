"""Tests of paired medians: how often they find what is not there, and what is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.results.comparison import compare
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import percentile_p_values, quantiles
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison import verdict
from tests.statistics.simulations import OTHERS, STATED, documented, findings, standard_error
from tests.statistics.support import ERROR, HIT, made_method

FAST = ResamplingConfig(resamples=600)
RESAMPLES = hnp.arrays(
    np.float64,
    st.tuples(st.just(4), st.integers(2, 60)),
    elements=st.one_of(
        st.sampled_from([-np.inf, -1.0, 0.0, 1.0, np.inf]), st.floats(-2, 2, width=16)
    ),
)


@example(np.array([[-np.inf, np.inf]]), 0.5)
@given(RESAMPLES, st.floats(0.05, 0.95))
def test_p_is_below_a_level_just_where_the_interval_leaves_0_out(
    resamples: np.ndarray, confidence: float
) -> None:
    tails = np.broadcast_to(ResamplingConfig(confidence=confidence).tails, (len(resamples), 2))
    low, high = quantiles(np.sort(resamples, axis=1), tails).T
    p_values = percentile_p_values(resamples)
    least = 2 / (resamples.shape[1] + 1)
    for p_value, left_out in zip(p_values, (low > 0) | (high < 0), strict=True):
        if p_value > least and abs(p_value - (1 - confidence)) > 1e-9:
            assert (p_value < 1 - confidence) == left_out


@pytest.mark.parametrize(
    ("resamples", "p_value"),
    [
        # Up to a quarter all is minus infinity, and so below 0; from the other side too.
        ([-np.inf, 1, 2, 3, 4], 2 * 1 / 4),
        ([-1, np.inf, np.inf, np.inf, np.inf], 2 / 6),
        # 0 lies at three quarters between the first two ranks, or at a quarter between the last.
        ([-3, 1, 2, 3, 4], 2 * 0.75 / 4),
        ([-4, -3, -2, -1, 3], 2 * 0.75 / 4),
        # Never below what so few resamples can tell.
        ([-0.5, 0.5, 0.6, 0.7, 0.8], 2 / 6),
        # 0 is a rank: only at or beyond it is 0 left out.
        ([0, 1, 2, 3, 4], 2 / 6),
        ([-1, 0, 1, 2, 3], 2 * 1 / 4),
        ([-1, 0, 0, 1, 2], 1.0),
        ([-2, -1, 0, 1, 2], 1.0),
    ],
)
def test_p_of_five_resamples_by_hand(resamples: list[float], p_value: float) -> None:
    both = np.array([resamples, [-value for value in resamples[::-1]]])
    assert percentile_p_values(both[:, [3, 0, 4, 1, 2]]) == pytest.approx([p_value] * 2)


def test_p_of_many_resamples_by_hand() -> None:
    assert percentile_p_values(np.arange(-5.0, 94.0, 2.0)[None]) == pytest.approx([2 * 2.5 / 49])
    assert percentile_p_values(np.array([[1.0] * 5, [0.0] * 5])).tolist() == [2 / 6, 1.0]


@pytest.mark.slow
@pytest.mark.parametrize("name", STATED | OTHERS)
def test_false_findings_and_power_are_as_documented(name: str) -> None:
    errors, shift = (STATED | OTHERS)[name]
    found = [findings(errors, 1_000, by) for by in (0.0, shift)]
    for share, printed in zip(found, documented(name), strict=True):
        assert share == pytest.approx(printed, abs=3 * standard_error(printed, 1_000, 2_000))
    error = 2 * standard_error(0.05, 1_000)
    assert (0.0 if name in OTHERS else 0.03 - error) <= found[0] <= 0.07 + error


@pytest.mark.parametrize("column", [HIT, ERROR])
def test_last_digits_are_ties(column: ScoreColumn) -> None:
    # What processors may differ by changes neither wins nor p.
    random = np.random.default_rng(0)
    one = random.random(40)
    other = np.where(np.arange(40) < 8, one + 0.3 * random.random(40), one)
    noise = 1e-12 * random.standard_normal((2, 40))
    pairs = []
    for sides in ((one, other), (one + noise[0], other + noise[1])):
        named = zip("ab", ({"s": {column.key: side.tolist()}} for side in sides), strict=True)
        methods = [made_method(scenes, (column,), name) for name, scenes in named]
        pairs += compare(methods, [column], resampling=FAST).pairs
    exact, noisy = pairs
    assert (noisy.wins, noisy.ties, noisy.losses) == (exact.wins, exact.ties, exact.losses)
    assert noisy.wins + noisy.losses == 8
    assert noisy.test.p_value == pytest.approx(exact.test.p_value, rel=1e-6)
    assert verdict(noisy) == verdict(exact)

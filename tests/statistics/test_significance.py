"""Paired tests of means and of medians: by hand, against all patterns, how often they find."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pytest
import scipy.special
import scipy.stats
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.results.comparison import compare
from airzoo_bench.statistics.intervals import percentile_p_values, quantiles
from airzoo_bench.statistics.samples import ResamplingConfig, sign_flips, stream_key
from airzoo_bench.statistics.significance import PairedTest, holm, mcnemar, p_floor, paired_tests
from airzoo_bench.tables.comparison import verdict
from tests.statistics.simulations import OTHERS, STATED, documented, findings, standard_error
from tests.statistics.support import ERROR, HIT, made_method, sample

ALL, MEDIANS = ResamplingConfig(resamples=100_000), np.array([True, True])
INF = np.inf
Group = Sequence[Sequence[float]]
RESAMPLES = hnp.arrays(
    np.float64,
    st.tuples(st.just(4), st.integers(2, 60)),
    elements=st.one_of(st.sampled_from([-INF, -1.0, 0.0, 1.0, INF]), st.floats(-2, 2, width=16)),
)


def run_test(*groups: Any, plan: ResamplingConfig = ALL, median: bool = False) -> PairedTest:
    made = sample(*groups, medians=MEDIANS if median else None)
    return paired_tests(made, plan, [(0, 1)])[1][0]


def count_extreme(groups: Sequence[Group], patterns: Iterable[Sequence[bool]]) -> int:
    """Count the patterns of swapped units that leave two means as far apart as they are."""

    def gap(stay: Sequence[bool]) -> float:
        rest, sides = iter(stay), np.zeros(2)
        for first, second in groups:
            kept = np.array([next(rest) for _ in first], bool)
            one, other = np.where(kept, first, second), np.where(kept, second, first)
            sides += [one.mean(), other.mean()]
        return round(abs(float(sides[0] - sides[1])), 9)

    observed = gap([True] * sum(len(group[0]) for group in groups))
    return sum(gap(pattern) >= observed for pattern in patterns)


@pytest.mark.parametrize(
    ("values", "p_value", "patterns"),
    [
        ([[3, 2, 1], [0, 0, 0]], 2 / 8, 8),
        # Units that do not differ do not count.
        ([[1, 1, 1, 5, 6], [0, 0, 0, 5, 6]], 2 / 8, 8),
        # 0.1 + 0.2 and 0.3 differ by rounding alone.
        ([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]], 2 / 8, 8),
        # The last three add up to 0, apart from rounding, which grows with size.
        ([[8e6, 1e7 / 3, 1e7 / 7, 0.0], [0.0, 0.0, 0.0, 1e8 / 21]], 10 / 16, 16),
        # An infinite average is farther than any pattern can tell.
        ([[INF] * 8, [1.0] * 8], 1.0, 256),
        ([[INF, 1, 2], [3, INF, 4]], 1.0, 8),
        ([[0.0, 1.0, INF], [0.0, 1.0, INF]], 1.0, 1),
        ([[0, 1], [0, 1]], 1.0, 1),
        ([[1.0], [0.0]], 1.0, 2),
    ],
)
def test_by_hand(values: list[Any], p_value: float, patterns: int) -> None:
    test = run_test(values)
    assert (test.p_value, test.exact, test.patterns) == (p_value, True, patterns)


def test_all_patterns_are_tried_where_they_are_no_more_than_the_resamples() -> None:
    tests = [run_test([[3, 2, 1], [0, 0, 0]], plan=ResamplingConfig(count)) for count in (7, 8, 9)]
    assert [(test.exact, test.patterns) for test in tests] == [(False, 7), (True, 8), (True, 8)]


@pytest.mark.parametrize(
    "groups",
    [
        *(
            [np.random.default_rng(s).integers(0, 4, (2, n)).tolist() for n in (5, 3)]
            for s in (1, 2)
        ),
        [[[0.3, 0.0, 0.0, 0.0], [0.0, 0.1, 0.2, 0.6]]],
    ],
)
def test_all_patterns_of_scenes(groups: Any) -> None:
    units = sum(len(group[0]) for group in groups)
    extreme = count_extreme(groups, itertools.product((False, True), repeat=units))
    assert run_test(*groups).p_value == pytest.approx(extreme / 2**units)


def test_random_patterns_are_those_that_the_seed_names() -> None:
    # Published p-values can be computed again: seed and scene say which units change places.
    groups: Any = [np.random.default_rng(size).random((2, size)) for size in (13, 8)]
    keys = [stream_key(7, "permutation", name) for name in ("s0", "s1")]
    sizes = zip((13, 8), keys, strict=True)
    kept = np.concatenate([sign_flips(size, 0, 300, key) for size, key in sizes])
    extreme = count_extreme(groups, kept.T.astype(bool).tolist())
    test = run_test(*groups, plan=ResamplingConfig(300, seed=7))
    assert (test.p_value, test.exact, test.patterns) == ((extreme + 1) / 301, False, 300)


def test_mcnemar_by_hand_and_the_fraction_that_it_is() -> None:
    # 5 against 0: both tails of 1/32. 6 against 2: 2 (1 + 8 + 28) / 256.
    found = mcnemar(np.array([5, 0, 6, 3, 0]), np.array([0, 5, 2, 3, 0]))
    assert found == pytest.approx([2 / 32, 2 / 32, 74 / 256, 1.0, 1.0], rel=1e-14)
    # 2 (1 + 9 + 36 + 84) / 2**9 and so on: the last digit shown must be that of the paired test.
    for wins, losses in ((7, 3), (3, 8), (0, 13), (12, 1)):
        values = [[1.0] * wins + [0.0] * losses, [0.0] * wins + [1.0] * losses]
        assert float(mcnemar(np.array(wins), np.array(losses))) == run_test(values).p_value
    assert 0 < float(mcnemar(np.array(0), np.array(900))) < 1e-200


def test_the_least_p_is_that_of_units_that_all_differ_alike() -> None:
    assert [p_floor(unlike) for unlike in (0, 1, 2, 3, 6)] == [1, 1, 1 / 2, 1 / 4, 1 / 32]
    for unlike in (1, 2, 5):
        values = [[2.0] * unlike + [7.0], [1.0] * unlike + [7.0]]
        assert run_test(values).p_value == p_floor(unlike)
        assert float(mcnemar(np.array(unlike), np.array(0))) == p_floor(unlike)


def test_medians_have_the_p_of_their_interval_but_no_less_than_units_allow() -> None:
    config = ResamplingConfig(resamples=500)
    apart = sample([[9.0, 8.0, 7.0, 9.5, 5.0], [1.0, 2.0, 1.5, 1.2, 5.0]], medians=MEDIANS)
    [interval], [test] = paired_tests(apart, config, [(0, 1)])
    assert (test.p_value, test.exact, test.patterns) == (p_floor(4), False, 500)
    assert (test.kind, interval.method) == ("bootstrap", "percentile")
    values = np.random.default_rng(5).normal(0.0, 1.0, (2, 40))
    near = run_test(values, plan=config, median=True).p_value
    for confidence in (1 - near - 1e-6, 1 - near + 1e-6):
        plan = ResamplingConfig(500, confidence=confidence)
        [interval], _ = paired_tests(sample(values, medians=MEDIANS), plan, [(0, 1)])
        assert interval.low is not None
        assert interval.high is not None
        assert (interval.low <= 0 <= interval.high) == (confidence > 1 - near)


@pytest.mark.parametrize("groups", [[[[1.0], [2.0]]], [np.eye(2, 4), np.eye(2, 30)]])
def test_medians_of_few_units_are_not_tested(groups: list[Any]) -> None:
    test = run_test(*groups, median=True)
    assert (test.p_value, test.exact, test.patterns, test.kind) == (1.0, False, 0, "bootstrap")


# --- medians ---


@example(np.array([[-INF, INF]]), 0.5)
@given(RESAMPLES, st.floats(0.05, 0.95))
def test_p_is_below_a_level_just_where_the_interval_leaves_0_out(resamples, confidence) -> None:
    tails = np.broadcast_to(ResamplingConfig(confidence=confidence).tails, (len(resamples), 2))
    low, high = quantiles(np.sort(resamples, axis=1), tails).T
    p_values = percentile_p_values(np.sort(resamples, axis=1))
    least = 2 / (resamples.shape[1] + 1)
    for p_value, left_out in zip(p_values, (low > 0) | (high < 0), strict=True):
        if p_value > least and abs(p_value - (1 - confidence)) > 1e-9:
            assert (p_value < 1 - confidence) == left_out


@pytest.mark.parametrize(
    ("resamples", "p_value"),
    [
        # Up to a quarter all is minus infinity, and so below 0; from the other side too.
        ([-INF, 1, 2, 3, 4], 2 * 1 / 4),
        ([-1, INF, INF, INF, INF], 2 / 6),
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
        ([1, 1, 1, 1, 1], 2 / 6),
        ([0, 0, 0, 0, 0], 1.0),
        (range(-5, 94, 2), 2 * 2.5 / 49),
    ],
)
def test_p_of_resamples_by_hand(resamples: Any, p_value: float) -> None:
    order = np.random.default_rng(0).permutation(len(resamples))
    both = np.array([resamples, [-value for value in resamples[::-1]]])[:, order]
    assert percentile_p_values(np.sort(both, axis=1)) == pytest.approx([p_value] * 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", STATED | OTHERS)
def test_false_findings_and_power_are_as_documented(name: Any) -> None:
    errors, shift = (STATED | OTHERS)[name]
    found = [findings(errors, 1_000, by) for by in (0.0, shift)]
    for share, printed in zip(found, documented(name), strict=True):
        assert share == pytest.approx(printed, abs=3 * standard_error(printed, 1_000, 2_000))
    error = 2 * standard_error(0.05, 1_000)
    assert (0.0 if name in OTHERS else 0.03 - error) <= found[0] <= 0.07 + error


@pytest.mark.parametrize("column", [HIT, ERROR])
def test_last_digits_are_ties(column: Any) -> None:
    # What processors may differ by changes neither wins nor p.
    random = np.random.default_rng(0)
    one = random.random(40)
    other = np.where(np.arange(40) < 8, one + 0.3 * random.random(40), one)
    noise = 1e-12 * random.standard_normal((2, 40))
    pairs = []
    for sides in ((one, other), (one + noise[0], other + noise[1])):
        named = zip("ab", ({"s": {column.key: side.tolist()}} for side in sides), strict=True)
        methods = [made_method(scenes, (column,), name) for name, scenes in named]
        pairs += compare(methods, [column], resampling=ResamplingConfig(600)).pairs
    exact, noisy = pairs
    assert (noisy.wins, noisy.ties, noisy.losses) == (exact.wins, exact.ties, exact.losses)
    assert noisy.wins + noisy.losses == 8
    assert noisy.test.p_value == pytest.approx(exact.test.p_value, rel=1e-6)
    assert verdict(noisy) == verdict(exact)


# --- Holm's correction ---


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
def test_holm_by_hand(p_values: list[float], family: int | None, adjusted: list[float]) -> None:
    assert holm(np.array(p_values), family) == pytest.approx(adjusted)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8), st.integers(0, 9))
def test_holm_rejects_what_the_step_down_procedure_rejects(values: Any, others: Any) -> None:
    p_values, level = np.array(values), 0.05
    rejected = np.zeros(len(values), bool)
    for step, place in enumerate(np.argsort(p_values, kind="stable")):
        if p_values[place] * (len(values) - step) > level:
            break
        rejected[place] = True
    assert ((holm(p_values) <= level) == rejected).all()
    # What is not given counts as 1.
    of_all = holm(np.append(p_values, np.ones(others)))
    np.testing.assert_array_equal(holm(p_values, len(values) + others), of_all[: len(values)])


def test_the_best_of_equal_methods_is_no_better() -> None:
    # 15 methods that are equal, the best of them against the others, by a test of known p.
    random, count = np.random.default_rng(0), 15
    values = random.normal(size=(4_000, count))
    gaps = values.max(axis=1, keepdims=True) - values
    p_values = [2 * scipy.special.ndtr(-row[row > 0] / 2**0.5) for row in gaps]
    family = count * (count - 1) // 2
    false = np.mean([(holm(row, family) <= 0.05).any() for row in p_values])
    assert false < 0.05
    # What the correction for the others alone comes to, which is why it is not enough.
    assert np.mean([(holm(row) <= 0.05).any() for row in p_values]) > 0.1

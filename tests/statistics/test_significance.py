"""Paired tests: by hand, against all patterns, and on values that make trouble."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.stats

from airzoo_bench.results.comparison import is_share
from airzoo_bench.statistics.intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, sign_flips, stream_key
from airzoo_bench.statistics.significance import (
    mcnemar,
    p_floor,
    paired_permutation,
    paired_tests,
)
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT

ALL = ResamplingConfig(resamples=100_000)


def sample(*groups: list[list[float]], median: bool = False) -> Sample:
    names = tuple(f"s{number}" for number in range(len(groups)))
    values = tuple(np.array(group, np.float64) for group in groups)
    return Sample("query", names, values, np.full(len(values[0]), median))


def by_brute_force(*groups: list[list[float]], median: bool = False) -> float:
    """Swap every subset of all units, and average with NumPy."""
    average = np.median if median else np.mean

    def statistic(swaps: tuple[bool, ...]) -> tuple[float, float]:
        rest, sides, ahead = list(swaps), np.zeros(2), 0.0
        for group in groups:
            first, second = np.array(group, np.float64)
            mask = np.array([rest.pop(0) for _ in first])
            one, other = np.where(mask, second, first), np.where(mask, first, second)
            sides += [average(one), average(other)]
            ahead += (np.mean(one > other) - np.mean(one < other)) / len(groups)
        difference = 0.0 if sides[0] == sides[1] else abs(float(sides[0] - sides[1]))
        return difference, abs(ahead) if np.isinf(difference) else 0.0

    units = sum(len(group[0]) for group in groups)
    size, ahead = statistic((False,) * units)
    least = size * (1 - 1e-9), ahead * (1 - 1e-9)
    patterns = itertools.product((False, True), repeat=units)
    return float(np.mean([statistic(pattern) >= least for pattern in patterns]))


def test_by_hand():
    # Three differences of the same sign: 2 of 8 patterns are as far from nothing.
    test = paired_permutation(sample([[3, 2, 1], [0, 0, 0]]), ALL, [(0, 1)])[0]
    assert (test.p_value, test.exact, test.patterns) == (2 / 8, True, 8)


def test_all_patterns_are_tried_where_they_are_no_more_than_the_resamples():
    made = sample([[3, 2, 1], [0, 0, 0]])
    tests = [
        paired_permutation(made, ResamplingConfig(resamples=count), [(0, 1)])[0]
        for count in (7, 8, 9)
    ]
    assert [(test.exact, test.patterns) for test in tests] == [(False, 7), (True, 8), (True, 8)]


def test_units_that_do_not_differ_do_not_count():
    test = paired_permutation(sample([[1, 1, 1, 5, 6], [0, 0, 0, 5, 6]]), ALL, [(0, 1)])[0]
    assert (test.p_value, test.patterns) == (2 / 8, 8)


def test_all_patterns_of_two_scenes():
    random = np.random.default_rng(4)
    for _ in range(5):
        groups = [random.integers(0, 4, (2, size)).tolist() for size in (5, 3)]
        test = paired_permutation(sample(*groups), ALL, [(0, 1)])[0]
        assert test.exact
        assert test.p_value == pytest.approx(by_brute_force(*groups))


def test_failures_are_infinite_errors():
    inf = np.inf
    for groups in (
        [[[1, inf, 3, inf, 2], [2, inf, inf, inf, 5]]],
        [[[inf, inf, inf, 2, 7], [2, 4, 6, 1, inf]], [[1, 2, 3], [2, 3, inf]]],
        [[[inf, 1, 2, 3, 4], [5, 2, 3, 4, 5]]],
    ):
        test = paired_permutation(sample(*groups), ALL, [(0, 1)])[0]
        assert test.p_value == pytest.approx(by_brute_force(*groups))


def test_one_method_fails_everywhere():
    # Every pattern with five failures on a side is infinitely far; two have as many wins.
    values = [[np.inf] * 8, [1.0] * 8]
    test = paired_permutation(sample(values), ALL, [(0, 1)])[0]
    assert test.p_value == 2 / 256


def test_random_patterns_come_near_all():
    random = np.random.default_rng(0)
    values = random.random((2, 12))
    values[0] += 0.1
    made = sample(values.tolist())
    exact = paired_permutation(made, ALL, [(0, 1)])[0]
    near = paired_permutation(made, ResamplingConfig(resamples=4_000), [(0, 1)])[0]
    assert (exact.exact, near.exact) == (True, False)
    assert near.p_value == pytest.approx(exact.p_value, abs=0.03)


def test_random_patterns_are_those_that_the_seed_names():
    # Published p-values can be computed again: seed and scene say which units change places.
    groups = [np.random.default_rng(size).random((2, size)) for size in (13, 8)]
    made = sample(*(values.tolist() for values in groups))
    found, observed = np.zeros(300), 0.0
    for name, (first, second) in zip(made.groups, groups, strict=True):
        kept = sign_flips(len(first), 0, 300, stream_key(7, "permutation", name))
        found += (first - second) @ (2.0 * kept - 1.0) / len(first)
        observed += (first - second).mean()
    test = paired_permutation(made, ResamplingConfig(resamples=300, seed=7), [(0, 1)])[0]
    assert test.p_value == ((np.abs(found) >= abs(observed)).sum() + 1) / 301


def test_equal_methods_and_one_unit():
    same = [[0.0, 1.0, np.inf], [0.0, 1.0, np.inf]]
    assert paired_permutation(sample(same), ALL, [(0, 1)])[0].p_value == 1.0
    assert paired_permutation(sample([[0, 1], [0, 1]]), ALL, [(0, 1)])[0].p_value == 1.0
    assert paired_permutation(sample([[1.0], [0.0]]), ALL, [(0, 1)])[0].p_value == 1.0


@pytest.mark.slow
def test_false_findings_are_as_rare_as_promised():
    # 400 pairs of methods that do not differ: 5 % are found at 5 %, give or take 1.1 %.
    values = np.random.default_rng(1).standard_normal((800, 60))
    made = Sample("query", ("a", "b"), (values[:, :20], values[:, 20:]), np.zeros(800, bool))
    pairs = [(2 * row, 2 * row + 1) for row in range(400)]
    found = [
        test.p_value for test in paired_permutation(made, ResamplingConfig(resamples=400), pairs)
    ]
    assert 0.02 <= np.mean(np.array(found) <= 0.05) <= 0.08


def test_ties_of_sums_are_ties():
    # 0.1 + 0.2 and 0.3 differ by rounding alone.
    values = [[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]]
    assert paired_permutation(sample(values), ALL, [(0, 1)])[0].p_value == 2 / 8
    mixed = [[0.3, 0.0, 0.0, 0.0], [0.0, 0.1, 0.2, 0.6]]
    test = paired_permutation(sample(mixed), ALL, [(0, 1)])[0]
    assert test.p_value == pytest.approx(by_brute_force(mixed))


def test_mcnemar_by_hand():
    # 5 against 0: both tails of 1/32. 6 against 2: 2 (1 + 8 + 28) / 256.
    found = mcnemar(np.array([5, 0, 6, 3, 0]), np.array([0, 5, 2, 3, 0]))
    assert found == pytest.approx([2 / 32, 2 / 32, 74 / 256, 1.0, 1.0], rel=1e-14)


def test_mcnemar_is_the_fraction_that_it_is():
    # 2 (1 + 9 + 36 + 84) / 2**9 and so on: the last digit shown must be that of the paired test.
    for wins, losses in ((7, 3), (3, 8), (0, 20), (20, 1)):
        values = [[1.0] * wins + [0.0] * losses, [0.0] * wins + [1.0] * losses]
        paired = paired_permutation(sample(values), ResamplingConfig(resamples=2**21), [(0, 1)])[0]
        assert paired.exact
        assert float(mcnemar(np.array(wins), np.array(losses))) == paired.p_value
    assert 0 < float(mcnemar(np.array(0), np.array(900))) < 1e-200


def test_the_least_p_is_that_of_units_that_all_differ_alike():
    assert [p_floor(unlike) for unlike in (0, 1, 2, 3, 6)] == [1, 1, 1 / 2, 1 / 4, 1 / 32]
    for unlike in (1, 2, 5):
        values = [[2.0] * unlike + [7.0], [1.0] * unlike + [7.0]]
        assert paired_permutation(sample(values), ALL, [(0, 1)])[0].p_value == p_floor(unlike)
        assert float(mcnemar(np.array(unlike), np.array(0))) == p_floor(unlike)


def test_shares_of_queries_are_means_from_0_to_1():
    assert [is_share(score) for score in (HIT, SOFT, ERROR, CHAMFER)] == [True, True, False, False]
    assert not is_share(SOFT.model_copy(update={"average": "median"}))


def test_failures_under_random_patterns_are_those_that_the_seed_names():
    inf = np.inf
    groups = [[[inf, inf, 3, 1, 2, 4, 5], [2, 1, 4, 2, 5, 3, 7]], [[1, 2, 8, 3], [2, 3, 5, 1]]]
    made, count = sample(*groups), 90
    observed, hits = paired(groups, [np.ones((len(g[0]), 1)) for g in groups]), 0
    kept = [
        sign_flips(len(group[0]), 0, count, stream_key(3, "permutation", name))
        for name, group in zip(made.groups, groups, strict=True)
    ]
    for draw in range(count):
        hits += paired(groups, [one[:, draw : draw + 1] for one in kept]) >= observed
    test = paired_permutation(made, ResamplingConfig(resamples=count, seed=3), [(0, 1)])[0]
    assert (test.p_value, test.exact, test.patterns) == ((hits + 1) / (count + 1), False, count)


def paired(groups: list[list[list[float]]], kept: list[np.ndarray]) -> tuple[float, float]:
    """Return how far apart two means are where some units change places, and by how many wins."""
    sides, ahead = np.zeros(2), 0.0
    for (first, second), stays in zip(groups, kept, strict=True):
        one = np.where(stays[:, 0] > 0, first, second)
        other = np.where(stays[:, 0] > 0, second, first)
        sides += [one.mean(), other.mean()]
        ahead += (np.mean(one > other) - np.mean(one < other)) / len(groups)
    apart = 0.0 if sides[0] == sides[1] else abs(float(sides[0] - sides[1]))
    return round(apart, 9), round(abs(ahead), 9) if np.isinf(apart) else 0.0


def test_medians_have_the_p_of_their_interval_but_no_less_than_units_allow():
    config = ResamplingConfig(resamples=500)
    apart = sample([[9.0, 8.0, 7.0, 9.5, 5.0], [1.0, 2.0, 1.5, 1.2, 5.0]], median=True)
    places = np.array([(0, 1)])
    [interval], [test] = paired_tests(apart, config, places)
    assert (test.p_value, test.exact, test.patterns) == (p_floor(4), False, 500)
    assert (test.kind, interval.method) == ("bootstrap", "percentile")
    values = np.random.default_rng(5).normal(0.0, 1.0, (2, 40))
    near = sample(values.tolist(), median=True)
    known = sample_intervals(near, config, places, groups=False).p_values
    assert [one.p_value for one in paired_tests(near, config, places)[1]] == known
    assert known[0] > p_floor(40)


def test_a_median_of_one_unit_is_not_tested():
    one = sample([[1.0], [2.0]], median=True)
    [_], [test] = paired_tests(one, ALL, np.array([(0, 1)]))
    assert (test.p_value, test.exact, test.patterns, test.kind) == (1.0, False, 0, "bootstrap")


def test_scenes_are_tested_by_the_t_of_their_interval():
    values = np.array([[0.9, 0.8, 0.7, 0.75, 0.5, 0.9], [0.5, 0.6, 0.4, 0.45, 0.5, 0.7]])
    scenes = Sample("scene", ("",), (values,), np.zeros(2, bool), np.ones(2, bool))
    [interval], [test] = paired_tests(scenes, ALL, np.array([(0, 1)]))
    expected = scipy.stats.ttest_rel(*values).pvalue
    assert test.p_value == pytest.approx(expected, rel=1e-9)
    assert (test.exact, test.patterns, test.kind, interval.method) == (
        True,
        6,
        "student",
        "student",
    )

"""Paired tests: by hand, against all patterns, and on values that make trouble."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import scipy.stats

from airzoo_bench.statistics.samples import ResamplingConfig, Sample, sign_flips, stream_key
from airzoo_bench.statistics.significance import PairedTest, mcnemar, p_floor, paired_tests

ALL = ResamplingConfig(resamples=100_000)
INF = np.inf
Group = Sequence[Sequence[float]]


def sample(*groups: Any, median: bool = False) -> Sample:
    names = tuple(f"s{number}" for number in range(len(groups)))
    values = tuple(np.array(group, np.float64) for group in groups)
    return Sample("query", names, values, np.full(len(values[0]), median))


def run_test(*groups: Any, plan: ResamplingConfig = ALL, median: bool = False) -> PairedTest:
    return paired_tests(sample(*groups, median=median), plan, [(0, 1)])[1][0]


def swapped(groups: Sequence[Group], stay: Sequence[bool]) -> float:
    """Return how far apart two means are where some units change places."""
    rest, sides = list(stay), np.zeros(2)
    for first, second in groups:
        kept = np.array([rest.pop(0) for _ in first], bool)
        one, other = np.where(kept, first, second), np.where(kept, second, first)
        sides += [one.mean(), other.mean()]
    return round(abs(float(sides[0] - sides[1])), 9)


def by_brute_force(*groups: Group) -> float:
    """Swap every subset of all units, and average with NumPy."""
    units = sum(len(group[0]) for group in groups)
    observed = swapped(groups, (True,) * units)
    patterns = itertools.product((False, True), repeat=units)
    return float(np.mean([swapped(groups, pattern) >= observed for pattern in patterns]))


@pytest.mark.parametrize(
    ("values", "p_value", "patterns"),
    [
        ([[3, 2, 1], [0, 0, 0]], 2 / 8, 8),
        # Units that do not differ do not count.
        ([[1, 1, 1, 5, 6], [0, 0, 0, 5, 6]], 2 / 8, 8),
        # 0.1 + 0.2 and 0.3 differ by rounding alone.
        ([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]], 2 / 8, 8),
        # An infinite average is farther than any pattern can tell.
        ([[INF] * 8, [1.0] * 8], 1.0, 256),
        ([[INF, 1, 2], [3, INF, 4]], 1.0, 8),
        ([[0.0, 1.0, INF], [0.0, 1.0, INF]], 1.0, 1),
        ([[0, 1], [0, 1]], 1.0, 1),
        ([[1.0], [0.0]], 1.0, 2),
    ],
)
def test_by_hand(values: Group, p_value: float, patterns: int) -> None:
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
def test_all_patterns_of_scenes(groups: list[Group]) -> None:
    assert run_test(*groups).p_value == pytest.approx(by_brute_force(*groups))


def test_random_patterns_come_near_all() -> None:
    values = np.random.default_rng(0).random((2, 12))
    values[0] += 0.1
    exact, near = run_test(values), run_test(values, plan=ResamplingConfig(4_000))
    assert (exact.exact, near.exact) == (True, False)
    assert near.p_value == pytest.approx(exact.p_value, abs=0.03)


def test_random_patterns_are_those_that_the_seed_names() -> None:
    # Published p-values can be computed again: seed and scene say which units change places.
    groups = [np.random.default_rng(size).random((2, size)) for size in (13, 8)]
    keys = [stream_key(7, "permutation", name) for name in ("s0", "s1")]
    kept = [
        sign_flips(group.shape[1], 0, 300, key) for group, key in zip(groups, keys, strict=True)
    ]
    patterns = np.concatenate(kept).T.astype(bool).tolist()
    observed = swapped(groups, [True] * 21)  # type: ignore[arg-type]
    extreme = sum(swapped(groups, pattern) >= observed for pattern in patterns)  # type: ignore[arg-type]
    test = run_test(*groups, plan=ResamplingConfig(300, seed=7))
    assert (test.p_value, test.exact, test.patterns) == ((extreme + 1) / 301, False, 300)


@pytest.mark.slow
def test_false_findings_are_as_rare_as_promised() -> None:
    # 400 pairs of methods that do not differ: 5 % are found at 5 %, give or take 1.1 %.
    values = np.random.default_rng(1).standard_normal((800, 60))
    pairs = [(2 * row, 2 * row + 1) for row in range(400)]
    _, tests = paired_tests(sample(values[:, :20], values[:, 20:]), ResamplingConfig(400), pairs)
    assert 0.02 <= np.mean([test.p_value <= 0.05 for test in tests]) <= 0.08


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
    apart = sample([[9.0, 8.0, 7.0, 9.5, 5.0], [1.0, 2.0, 1.5, 1.2, 5.0]], median=True)
    [interval], [test] = paired_tests(apart, config, [(0, 1)])
    assert (test.p_value, test.exact, test.patterns) == (p_floor(4), False, 500)
    assert (test.kind, interval.method) == ("bootstrap", "percentile")
    values = np.random.default_rng(5).normal(0.0, 1.0, (2, 40))
    near = run_test(values, plan=config, median=True).p_value
    for confidence in (1 - near - 1e-6, 1 - near + 1e-6):
        plan = ResamplingConfig(500, confidence=confidence)
        [interval], _ = paired_tests(sample(values, median=True), plan, [(0, 1)])
        assert interval.low is not None
        assert interval.high is not None
        assert (interval.low <= 0 <= interval.high) == (confidence > 1 - near)


@pytest.mark.parametrize("groups", [[[[1.0], [2.0]]], [np.eye(2, 4), np.eye(2, 30)]])
def test_medians_of_few_units_are_not_tested(groups: Any) -> None:
    test = run_test(*groups, median=True)
    assert (test.p_value, test.exact, test.patterns, test.kind) == (1.0, False, 0, "bootstrap")


def test_scenes_are_tested_by_the_t_of_their_interval() -> None:
    values = np.array([[0.9, 0.8, 0.7, 0.75, 0.5, 0.9], [0.5, 0.6, 0.4, 0.45, 0.5, 0.7]])
    scenes = Sample("scene", ("",), (values,), np.zeros(2, bool), np.ones(2, bool))
    [interval], [test] = paired_tests(scenes, ALL, [(0, 1)])
    assert test.p_value == pytest.approx(scipy.stats.ttest_rel(*values).pvalue, rel=1e-9)
    assert (test.kind, test.patterns, interval.method) == ("student", 6, "student")

"""All pairs at once: the numbers of `compare`, resolved further, and rank ranges."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from airzoo_bench.statistics.samples import ResamplingConfig, Sample, resampled_averages
from airzoo_bench.statistics.significance import (
    LEVEL,
    compare_all,
    correct_pairs,
    mcnemar,
    normal_tail,
    paired_tests,
    rank_ranges,
    unpaired_p_values,
)
from tests.statistics.simulations import KINDS, coverage_of_ranks

CONFIG, MEDIANS = ResamplingConfig(2_000), np.ones(2, bool)


def made(kind: str, count: int, *sizes: int) -> Sample:
    random, parts = np.random.default_rng(0), []
    for size in sizes:
        ease = random.normal(size=size) + 0.5 * random.normal(size=(count, size))
        skilled = ease + np.linspace(-0.7, 0.7, count)[:, None]
        graded = np.clip(np.round(2 * skilled + 2), 0, 5) / 5
        failing = np.where(skilled < -1.8, np.inf, np.exp(-2 * skilled))
        parts.append({"hits": (skilled > 0).astype(float), "graded": graded}.get(kind, failing))
    names = tuple(f"scene{number}" for number in range(len(sizes)))
    medians, shares = np.full(count, kind == "medians"), np.full(count, kind in KINDS[:2])
    return Sample("query", names, tuple(parts), medians, shares)


def upper(matrix: np.ndarray) -> np.ndarray:
    return matrix[np.triu_indices(len(matrix), 1)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sizes", [(9,), (6, 4, 3), (40, 25)])
def test_numbers_are_those_of_compare_unless_few_draws_are_as_extreme(kind, sizes) -> None:
    sample = made(kind, 6, *sizes)
    intervals, tests = paired_tests(sample, CONFIG, list(combinations(range(6), 2)))
    low, high, found = map(upper, compare_all(sample, CONFIG))
    if min(sizes) < 5:
        assert np.isnan(low).all()
    else:
        differ = [number for number, one in enumerate(intervals) if one.low is not None]
        expected = np.array([(intervals[n].low, intervals[n].high) for n in differ], float).T
        assert np.stack([low, high])[:, differ] == pytest.approx(expected, rel=1e-9)
    expected = np.array([test.p_value for test in tests])
    resolved = np.array([test.exact for test in tests]) | (expected > 26 / 2_001)
    assert resolved.any()
    assert found[resolved] == pytest.approx(expected[resolved], rel=1e-9)
    assert (found[~resolved] <= 26 / 2_001).all()


def test_the_tail_is_near_what_very_many_patterns_give() -> None:
    random = np.random.default_rng(1)
    hits = (random.random((2, 120)) < np.array([[0.72], [0.42]])).astype(float)
    sample = Sample("query", ("a",), (hits,), np.zeros(2, bool), np.ones(2, bool))
    _, [test] = paired_tests(sample, ResamplingConfig(400_000), [(0, 1)])
    assert test.p_value < 26 / 2001
    found = compare_all(sample, CONFIG)[2, 0, 1]
    assert test.p_value / 2 < found < 3 * test.p_value
    assert paired_tests(sample, CONFIG, [(0, 1)])[1][0].p_value >= 1 / 2_001  # which has no tail


def test_the_tail_of_medians_is_normal_and_without_spread_that_of_wins() -> None:
    values = np.random.default_rng(2).normal(size=(3, 90)) * 0.1 + np.array([[0.1], [0.0], [0.01]])
    made, few = Sample("query", ("a",), (values,), np.ones(3, bool)), (values[:2], MEDIANS)
    drawn = resampled_averages(*few, "a", CONFIG)
    gaps = drawn[0] - drawn[1]
    found = compare_all(made, CONFIG)[2]
    assert 0 < gaps.min() < gaps.max() < 1
    assert found[0, 1] == pytest.approx(normal_tail(gaps.mean() / gaps.std()), rel=1e-9, abs=0)
    # Where resamples lie on both sides of 0 there is no tail.
    assert found[1, 2] == pytest.approx(paired_tests(made, CONFIG, [(1, 2)])[1][0].p_value)
    # Over scenes the mean of their medians is drawn.
    scenes = Sample("query", ("a", "b"), (values, 5 * values), np.ones(3, bool))
    low, high, _ = compare_all(scenes, CONFIG)[:, 0, 1]
    parts = [
        resampled_averages(k * values[:2], MEDIANS, n, CONFIG) for k, n in ((1, "a"), (5, "b"))
    ]
    gaps = np.subtract(*np.mean(parts, axis=0))
    assert (low, high) == pytest.approx(np.quantile(gaps, CONFIG.tails))
    # All resamples have a median of 1; three units are ties, and one is a loss.
    steps = np.array([np.ones(60), np.zeros(60)])
    steps[0, :4] = 0, 0, 0, -1
    found = compare_all(Sample("query", ("a",), (steps,), MEDIANS), CONFIG)[2]
    assert found[0, 1] == pytest.approx(float(mcnemar(56, 1)), rel=1e-9, abs=0)


def test_a_median_that_is_always_infinite_is_far_from_a_finite_one() -> None:
    values = np.random.default_rng(0).random((2, 60))
    values[1, :50] = np.inf
    sample = Sample("query", ("a",), (values,), MEDIANS)
    assert 0 < compare_all(sample, CONFIG)[2, 0, 1] < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_pair_has_does_not_depend_on_the_other_methods(kind) -> None:
    sample, few = made(kind, 7, 33, 21), [1, 2, 4]
    chosen = np.isin(np.arange(7), few)
    whole, alone = compare_all(sample, CONFIG), compare_all(sample.take(chosen), CONFIG)
    np.testing.assert_array_equal(alone, whole[:, few][:, :, few])
    wanted = np.zeros((7, 7), bool)
    wanted[1, 4] = True
    asked = compare_all(sample, CONFIG, wanted)
    assert asked[:, 1, 4].tolist() == whole[:, 1, 4].tolist()
    wanted[4, 1] = True
    assert (asked[2][~wanted] == 1).all()  # and all others have no test


def test_ranges_by_hand() -> None:
    # The first two differ from the last two, and nothing else is told apart.
    corrected = np.ones((4, 4))
    corrected[:2, 2:] = corrected[2:, :2] = LEVEL
    higher = rank_ranges(np.array([0.9, 0.8, 0.3, 0.2]), corrected, higher_is_better=True)
    assert higher.tolist() == [[1, 2], [1, 2], [3, 4], [3, 4]]
    lower = rank_ranges(np.array([0.9, 0.8, 0.3, 0.2]), corrected, higher_is_better=False)
    assert lower.tolist() == [[3, 4], [3, 4], [1, 2], [1, 2]]


def test_every_pair_is_corrected_for_all_pairs() -> None:
    found = correct_pairs(np.array([[1.0, 0.02, 0.01], [0.02, 1.0, 0.5], [0.01, 0.5, 1.0]]))
    assert found[np.triu_indices(3, 1)] == pytest.approx([0.04, 0.03, 0.5])
    assert (found == found.T).all()
    assert (found.diagonal() == 1).all()


def test_unpaired_tests_take_what_is_known() -> None:
    values, errors = [0.5, 0.7, np.inf, 0.1, 0.2, 0.9], [0.02, 0.02, 0.1, np.nan, 0.0, 0.0]
    found = unpaired_p_values(np.array(values), np.array(errors))
    assert found[0, 1] == pytest.approx(5.733e-7, rel=1e-3)  # 5 standard deviations
    assert (found[2:4] == 1).all()
    assert found[4, 5] == 1  # of neither it is known how it varies


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_ranges_hold_the_true_ranks(kind) -> None:
    held, width = coverage_of_ranks(kind, 400)
    assert held >= 0.95 - 2 * np.sqrt(0.05 * 0.95 / 400)
    assert width < 9  # of 11, where nothing is told apart

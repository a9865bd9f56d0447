"""All pairs from shared draws: the decisions of the suite's own paired tests, and rank ranges."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from airzoo_bench.statistics.pair_tests import (
    correct_pairs,
    pair_limits,
    pair_p_values,
    rank_ranges,
    unpaired_p_values,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, exact_products
from airzoo_bench.statistics.significance import holm, paired_permutation, paired_tests
from tests.statistics.coverage import coverage_of_ranks

CONFIG = ResamplingConfig(2_000)


def made(kind: str, count: int, sizes: tuple[int, ...], seed: int = 0) -> Sample:
    random = np.random.default_rng(seed)
    parts = []
    for size in sizes:
        ease = random.normal(size=size) + 0.5 * random.normal(size=(count, size))
        skilled = ease + np.linspace(-0.7, 0.7, count)[:, None]
        if kind == "hits":
            parts.append((skilled > 0).astype(float))
        elif kind == "graded":
            parts.append(np.clip(np.round(2 * skilled + 2), 0, 5) / 5)
        else:
            errors = np.exp(-2 * skilled)
            errors[skilled < -1.8] = np.inf
            parts.append(errors)
    names = tuple(f"scene{number}" for number in range(len(sizes)))
    shares = kind in ("hits", "graded")
    return Sample(
        "query", names, tuple(parts), np.full(count, kind == "medians"), np.full(count, shares)
    )


def own_tests(sample: Sample, config: ResamplingConfig = CONFIG) -> tuple[np.ndarray, np.ndarray]:
    """Return p of every pair by the suite's own tests, and whether it is exact."""
    places = list(combinations(range(len(sample.medians)), 2))
    _, tests = paired_tests(sample, config, places)
    return np.array([t.p_value for t in tests]), np.array([t.exact for t in tests])


def upper(matrix: np.ndarray) -> np.ndarray:
    return matrix[np.triu_indices(len(matrix), 1)]


@pytest.mark.parametrize("kind", ["hits", "graded"])
@pytest.mark.parametrize("sizes", [(9,), (7, 5), (6, 4, 3)])
def test_few_queries_are_tested_exactly(kind: str, sizes: tuple[int, ...]) -> None:
    sample = made(kind, 6, sizes)
    expected, exact = own_tests(sample)
    assert exact.sum() > 5
    found = upper(pair_p_values(sample, CONFIG))
    assert found[exact] == pytest.approx(expected[exact], rel=1e-12)


@pytest.mark.parametrize("kind", ["hits", "graded", "medians"])
@pytest.mark.parametrize("seed", range(4))
def test_decisions_after_holm_are_those_of_the_paired_tests(kind: str, seed: int) -> None:
    sample = made(kind, 5, (40, 25), seed)
    expected, _ = own_tests(sample, ResamplingConfig())
    found = upper(correct_pairs(pair_p_values(sample, ResamplingConfig())))
    assert ((found <= 0.05) == (holm(expected) <= 0.05)).all()


def test_medians_are_tested_as_compare_does() -> None:
    sample = made("medians", 6, (40, 30))
    expected, _ = own_tests(sample)
    found = upper(pair_p_values(sample, CONFIG))
    resolved = expected > 2 / 2001
    assert resolved.sum() > 3
    assert found[resolved] == pytest.approx(expected[resolved], rel=1e-9)
    assert (found[~resolved] <= expected[~resolved]).all()


def test_the_tail_is_near_what_very_many_patterns_give() -> None:
    random = np.random.default_rng(1)
    hits = (random.random((2, 120)) < np.array([[0.72], [0.42]])).astype(float)
    sample = Sample("query", ("a",), (hits,), np.zeros(2, bool), np.ones(2, bool))
    [test] = paired_permutation(sample, ResamplingConfig(400_000), [(0, 1)])
    assert test.p_value < 26 / 2001
    found = pair_p_values(sample, CONFIG)[0, 1]
    assert test.p_value / 2 < found < 3 * test.p_value


def test_means_with_infinite_values_are_tested_by_the_own_test() -> None:
    random = np.random.default_rng(2)
    values = random.random((4, 12))
    values[1, 3], values[2, :5] = np.inf, np.inf
    sample = Sample("scene", ("",), (values,), np.zeros(4, bool))
    expected, _ = own_tests(sample)
    assert upper(pair_p_values(sample, CONFIG)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kind", ["hits", "graded", "medians", "errors"])
def test_what_a_pair_has_does_not_depend_on_the_other_methods(kind: str) -> None:
    sample = made(kind, 7, (33, 21))
    if kind == "errors":
        sample = Sample("query", sample.groups, sample.values, np.zeros(7, bool))
    p_values, limits = pair_p_values(sample, CONFIG), pair_limits(sample, CONFIG)
    few = [1, 2, 4]
    shares = None if sample.shares is None else sample.shares[few]
    alone = Sample(
        "query", sample.groups, tuple(v[few] for v in sample.values), sample.medians[few], shares
    )
    assert (pair_p_values(alone, CONFIG) == p_values[np.ix_(few, few)]).all()
    assert upper(pair_limits(alone, CONFIG)[0]).tolist() == [
        limits[0][one, other] for one, other in combinations(few, 2)
    ]


def test_products_are_exact_on_their_grid() -> None:
    random = np.random.default_rng(6)
    values, factors = random.random((3, 500)) * 1e6, random.integers(0, 2, (500, 7)) * 1.0
    found = exact_products(values, factors, 500)
    assert found == pytest.approx(values @ factors, rel=1e-9)
    assert (found[1:2] == exact_products(values[1:2], factors[:, :], 500)).all()
    assert (found[:, 3:4] == exact_products(values, factors[:, 3:4], 500)).all()


@pytest.mark.parametrize("kind", ["hits", "graded", "medians", "alike in a scene"])
def test_intervals_of_pairs_are_those_of_compare(kind: str) -> None:
    sample = made("graded" if kind == "alike in a scene" else kind, 5, (30, 25), seed=8)
    if kind == "alike in a scene":
        sample.values[0][:] = np.array([[0.6], [0.4], [0.3], [0.1], [0.7]])
    places = list(combinations(range(5), 2))
    intervals, _ = paired_tests(sample, CONFIG, places)
    found = pair_limits(sample, CONFIG)
    expected = np.array([[interval.low, interval.high] for interval in intervals], float)
    assert upper(found[0]) == pytest.approx(expected[:, 0], rel=1e-9, abs=1e-12)
    assert upper(found[1]) == pytest.approx(expected[:, 1], rel=1e-9, abs=1e-12)
    assert np.isnan(found[0][np.tril_indices(5)]).all()


def test_ranges_by_hand() -> None:
    # The first two differ from the last two, and nothing else is told apart.
    corrected = np.ones((4, 4))
    corrected[:2, 2:] = corrected[2:, :2] = 0.01
    higher = rank_ranges(np.array([0.9, 0.8, 0.3, 0.2]), corrected, higher_is_better=True)
    assert higher.tolist() == [[1, 2], [1, 2], [3, 4], [3, 4]]
    lower = rank_ranges(np.array([0.9, 0.8, 0.3, 0.2]), corrected, higher_is_better=False)
    assert lower.tolist() == [[3, 4], [3, 4], [1, 2], [1, 2]]


def test_unpaired_tests_take_what_is_known() -> None:
    values, errors = np.array([0.5, 0.7, np.inf, 0.1]), np.array([0.02, 0.02, 0.1, np.nan])
    found = unpaired_p_values(values, errors)
    assert found[0, 1] == pytest.approx(5.733e-7, rel=1e-3)  # 5 standard deviations
    assert (found[2] == 1).all()
    assert (found[3] == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hits", "graded", "errors", "medians"])
def test_ranges_hold_the_true_ranks(kind: str) -> None:
    held, width = coverage_of_ranks(kind, 400)
    assert held >= 0.95 - 2 * np.sqrt(0.05 * 0.95 / 400)
    assert width < 9  # of 11, where nothing is told apart

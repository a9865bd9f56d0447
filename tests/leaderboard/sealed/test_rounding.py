"""How coarse answers are: errors against simulation, and what they tell of single queries."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answer import Estimate
from airzoo_bench.leaderboard.sealed.rounding import (
    FLIPS,
    Spread,
    drawn,
    overall_estimate,
    told,
    told_alone,
)
from airzoo_bench.results.result import ScoreColumn
from tests.leaderboard.sealed.conftest import SALT

SHARE, MEDIAN, MEAN = (
    ScoreColumn(
        key="s", title="S", unit=unit, higher_is_better=True, average=average, headline=True
    )
    for unit, average in (("share", "mean"), ("m", "median"), ("m", "mean"))
)


@pytest.mark.parametrize("column", [SHARE, MEDIAN, MEAN], ids=["share", "median", "mean"])
@pytest.mark.parametrize("count", [20, 60, 300])
def test_errors_are_those_of_repeated_samples(column: ScoreColumn, count: int) -> None:
    random = np.random.default_rng(1)
    draws = random.random((2000, count))
    values = (draws < 0.4).astype(float) if column is SHARE else -np.log1p(-draws)
    spreads = [Spread.of(row, column) for row in values]
    true = np.std([spread.value for spread in spreads])
    stated = np.array([spread.error for spread in spreads], float)
    # Order statistics of few queries are careful.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / true < 1.45


def test_an_error_is_one_digit_and_never_less() -> None:
    """By hand: 60 queries, 30 hits. The largest error is 0.5 / 60 ** 0.5 = 0.0645, upward 0.07.

    Half of it is 0.035, but 4 queries move 4/60 = 0.0667, upward 0.067; 7 such steps are 0.469, and
    the rate with 4 more queries is 0.471; 0.471 x 0.529 / 60 is 0.0644 squared: 0.07.
    """
    found = told(Spread.of(np.repeat((0.0, 1.0), 30), SHARE))
    assert found.standard_error == 0.07
    assert found.step == 0.067
    assert found.value == 0.469


def test_the_large_sample_is_told_to_half_of_its_error() -> None:
    found = told(Spread.of(np.repeat((0.0, 1.0), 5000), SHARE))
    assert (found.standard_error, found.step, found.value) == (0.005, 0.0025, 0.5)


def test_a_perfect_score_has_an_error_too() -> None:
    for value in (0.0, 1.0):
        found = told(Spread.of(np.full(100, value), SHARE))
        assert found.standard_error == 0.02  # (2/104 x 102/104 / 100) ** 0.5 = 0.0137
        assert found.step == 0.04
        assert found.value == value


def test_failures() -> None:
    values = np.array([1.0, 2.0, 3.0, *[math.inf] * 5])
    assert told(Spread.of(values, MEDIAN)).value is None
    assert told(Spread.of(values, MEAN)).value is None
    half = told(Spread.of(np.array([*range(1, 12), *[math.inf] * 9], float), MEDIAN))
    assert half.value is not None
    assert half.standard_error is None
    assert half.step is not None
    whole = overall_estimate(math.inf, [Spread.of(values, MEDIAN)])
    assert told(whole).model_dump() == {"value": None, "standard_error": None, "step": None}


def test_one_record_a_scene() -> None:
    assert told_alone(0.87654, SHARE).model_dump() == {
        "value": 0.88,
        "standard_error": None,
        "step": 0.01,
    }
    assert told_alone(12.345, MEAN, 0.41).model_dump() == {
        "value": 12.0,
        "standard_error": 0.5,
        "step": 1.0,
    }
    assert told_alone(0.0, MEAN).value == 0.0
    assert told_alone(math.inf, MEAN).value is None


def test_a_scene_of_one_query_is_not_read_off_the_mean() -> None:
    """Four queries of it would move the mean of 11 scenes by 4/11: so coarse is the mean then."""
    random = np.random.default_rng(2)
    others = [(random.random(200) < 0.5).astype(float) for _ in range(10)]
    answers = {
        told(
            overall_estimate(
                float(np.mean([*(np.mean(one) for one in others), hit])),
                [Spread.of(one, SHARE) for one in (*others, np.array([hit]))],
            )
        ).value
        for hit in (0.0, 1.0)
    }
    assert len(answers) == 1


@given(st.lists(st.booleans(), min_size=10, max_size=400))
def test_shares_stay_shares_and_within_half_a_step(hits: list[bool]) -> None:
    values = np.array(hits, float)
    found = told(Spread.of(values, SHARE))
    assert found.value is not None
    assert found.step is not None
    assert 0.0 <= found.value <= 1.0
    assert abs(found.value - values.mean()) <= found.step / 2 + 1e-12 or found.value == 1.0
    assert found.step >= min(1.0, FLIPS / len(hits)) - 1e-12


@pytest.mark.parametrize("count", [15, 60, 161, 700])
@pytest.mark.parametrize("column", [SHARE, MEDIAN], ids=["share", "median"])
def test_one_query_mostly_changes_nothing(column: ScoreColumn, count: int) -> None:
    random = np.random.default_rng(3)
    same = 0
    for _ in range(400):
        rate = random.uniform(0.1, 0.9)
        values = random.exponential(1.0, count)
        if column is SHARE:
            values = (random.random(count) < rate).astype(float)
        other = values.copy()
        place = random.integers(count)
        other[place] = 1.0 - other[place] if column is SHARE else random.exponential(1.0)
        same += answer(values, column) == answer(other, column)
    assert same >= 400 * 0.55


def answer(values: Floats, column: ScoreColumn) -> Estimate:
    of = np.median(values, keepdims=True) if column is MEDIAN else values
    return told(Spread.of(values, column, drawn(SALT, "scene", of)))


@pytest.mark.parametrize("share", [0.0, 0.03, 0.31, 0.5, 0.77, 1.0])
def test_on_the_mean_the_score_is_told(share: float) -> None:
    """Over salts: what is told is the step below or above, and right on the mean."""
    values = (np.arange(200) < 200 * share).astype(float)
    spreads = [Spread.of(values, SHARE, drawn(f"{n:064x}", "a", values)) for n in range(2000)]
    found = np.array([told(spread).value for spread in spreads], float)
    step = told(spreads[0]).step
    assert step is not None
    assert found.mean() == pytest.approx(share, abs=0.05 * step)
    assert np.abs(found - share).max() < step


def test_the_same_answers_get_the_same_score() -> None:
    values = np.random.default_rng(0).random(50)
    assert drawn(SALT, "a", values) == drawn(SALT, "a", values + 1e-9 * values.round())
    others = (drawn(SALT, "b", values), drawn("6b" * 32, "a", values), drawn(SALT, "a", values / 2))
    assert drawn(SALT, "a", values) not in others

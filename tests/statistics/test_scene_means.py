"""Where scenes are the units: Student's t, log-normal means of distances, and none of failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from airzoo_bench.results.comparison import Pair, compare, make_sample, score_intervals
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import compare_all
from airzoo_bench.tables.comparison import describe_intervals, verdict
from tests.statistics.simulations import MEANS, coverage_over_scenes, documented, standard_error
from tests.statistics.support import CHAMFER, SOFT, made_method

PLAN = ResamplingConfig(500)
ONE = [0.42, 0.61, 0.55, 0.71, 0.38, 0.66]
OTHER = [0.40, 0.52, 0.50, 0.65, 0.37, 0.60]
F1 = SOFT.model_copy(update={"key": "f1@10"})


def method(values: list[float], score: ScoreColumn, name: str = "mine") -> Method:
    """Return a method of the reconstruction track, which has one record a scene."""
    scenes = {f"s{n}": {CHAMFER.key: [v], score.key: [v]} for n, v in enumerate(values)}
    return made_method(scenes, tuple({score, CHAMFER}), name)


def interval(values: list[float], score: ScoreColumn = CHAMFER) -> Interval:
    return score_intervals(method(values, score), [score], PLAN).overall[0]


def pair(one: list[float], other: list[float], score: ScoreColumn) -> Pair:
    methods = [method(other, score, "theirs"), method(one, score)]
    return compare(methods, [score], resampling=PLAN).pairs[0]


@pytest.mark.parametrize("score", [F1, CHAMFER])
def test_differences_have_students_interval_and_p_on_every_face(score) -> None:
    found, expected = pair(ONE, OTHER, score), stats.ttest_rel(ONE, OTHER)
    limits = tuple(expected.confidence_interval())
    assert (found.interval.low, found.interval.high) == pytest.approx(limits, rel=1e-12)
    assert (found.test.p_value, found.test.kind) == (pytest.approx(expected.pvalue), "student")
    sample = make_sample([method(ONE, score), method(OTHER, score, "theirs")], [score])
    numbers = compare_all(sample, PLAN)[:, 0, 1]
    assert numbers == pytest.approx([*limits, expected.pvalue], rel=1e-12)


def test_five_scenes_are_enough_for_a_finding() -> None:
    assert verdict(pair(ONE[:5], [value / 2 for value in ONE[:5]], F1)) == "better"


def test_shares_have_students_interval() -> None:
    found = interval(ONE, F1)
    expected = stats.ttest_1samp(ONE, 0).confidence_interval()
    assert (found.low, found.high) == pytest.approx(tuple(expected), rel=1e-12)
    assert interval([1, 1, 1, 1, 0.2], F1).high == 1


def test_distances_have_the_limits_of_a_log_normal_mean() -> None:
    logs, count = np.log(ONE), len(ONE)
    middle, half = logs.mean(), logs.var(ddof=1) / 2
    theirs = stats.t.ppf(0.975, count - 1) * stats.sem(logs)
    spread = [(count - 1) * half / stats.chi2.ppf(tail, count - 1) for tail in (0.975, 0.025)]
    down, up = (math.sqrt(theirs**2 + (limit - half) ** 2) for limit in spread)
    found = interval(ONE)
    expected = (math.exp(middle + half - down), math.exp(middle + half + up))
    assert (found.low, found.high) == pytest.approx(expected, rel=1e-12)


def test_an_upper_limit_above_ten_times_the_mean_is_not_known() -> None:
    for unit in (1.0, 1e3):
        found = interval(list(unit * np.power(ONE, 3.55)))  # 10.3 times the mean
        assert found.low is not None
        assert found.high == math.inf
        assert interval(list(unit * np.power(ONE, 3.5))).high < math.inf  # 9.7 times
    assert "not known" in describe_intervals([found], PLAN, "scene")[0]


@pytest.mark.parametrize(
    ("values", "why"),
    [(ONE[:4], "4"), ([*ONE, math.inf], "failed"), ([*ONE, 0.0], "0"), ([0.5] * 6, "alike")],
)
def test_why_there_is_no_interval(values, why) -> None:
    found = interval(values)
    assert (found.low, found.high) == (None, None)
    assert why in found.reason


def test_without_an_interval_the_difference_is_tested_by_permutation() -> None:
    found = pair([*ONE, math.inf], [*OTHER, 0.5], CHAMFER)
    assert (found.interval.low, found.test.kind) == (None, "permutation")
    assert found.test.p_value == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", MEANS)
@pytest.mark.parametrize("scenes", [5, 6, 8, 11, 16])
def test_intervals_hold_what_is_true_as_often_as_documented(kind, scenes) -> None:
    mean, unknown, difference = documented(kind, str(scenes))
    assert all(0.93 <= share <= 0.98 for share in (mean, difference))
    found = coverage_over_scenes(kind, scenes, 1_000)
    for share, stated in zip(found, (mean, unknown, difference), strict=True):
        assert abs(share - stated) < 4 * standard_error(stated, 1_000, 4_000)


def test_scenes_of_several_groups_have_no_common_interval() -> None:
    parts = tuple(np.array([ONE, OTHER]) for _ in range(2))
    sample = Sample("scene", ("a", "b"), parts, np.zeros(2, bool), np.ones(2, bool))
    found = sample_intervals(sample, PLAN)
    assert found.overall == []
    assert found.groups["a"] == found.groups["b"]

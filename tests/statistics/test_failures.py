"""Comparisons of methods that fail: nothing is NaN, nothing flatters, verdicts are sensible."""

from __future__ import annotations

import math

import pytest

from airzoo_bench.results.comparison import compare
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison_layout import comparison_table
from airzoo_bench.tables.render import render
from airzoo_bench.tables.verdicts import sentence, verdict
from tests.statistics.support import ERROR, HIT, made_method

MEAN = ScoreColumn(
    key="mean_m",
    title="Mean",
    unit="m",
    higher_is_better=False,
    average="mean",
    headline=True,
)
INF = math.inf
GOOD = [0.5 + 0.25 * n for n in range(12)]
POOR = [20.0 + n for n in range(12)]
FAILED = [INF] * 12

CASES = {
    "both fail everywhere": ((FAILED, FAILED), (FAILED, FAILED), ["equal"] * 3),
    "one fails everywhere": ((FAILED, FAILED), (GOOD, GOOD), ["better"] * 3),
    "one fails in a scene": ((GOOD, GOOD), (GOOD, FAILED), ["worse"] * 3),
    "each fails in another": ((GOOD, FAILED), (FAILED, GOOD), ["unclear"] * 3),
    "both fail in one": ((POOR, FAILED), (GOOD, FAILED), ["better", "unclear", "unclear"]),
    "alike": (([3.0] * 12, [4.0] * 12), ([3.0] * 12, [4.0] * 12), ["equal"] * 3),
    "one query": (([1.0], [1.0]), ([1.0], [INF]), ["too few"] * 3),
    "one query, failed": (([INF], [INF]), ([INF], [INF]), ["equal"] * 3),
}


def scores_of(errors: list[float]) -> dict[str, list[float]]:
    hits = [float(error < 5) for error in errors]
    return {"recall@1": hits, "error_m": errors, "mean_m": errors}


@pytest.mark.parametrize("case", CASES)
def test_failures(case: str) -> None:
    one, other, expected = CASES[case]
    columns = (HIT, ERROR, MEAN)
    methods = [
        made_method({"east": scores_of(part[0]), "west": scores_of(part[1])}, columns, name)
        for name, part in (("one", one), ("other", other))
    ]
    found = compare(methods, columns, resampling=ResamplingConfig(500))
    assert [verdict(pair) for pair in found.pairs] == expected
    said = render(comparison_table(found), "terminal", width=200)
    assert "nan" not in said.lower()
    for pair in found.pairs:
        assert 0 <= pair.test.p_value <= pair.p_holm <= 1
        assert pair.wins + pair.ties + pair.losses == len(one[0]) + len(one[1])
        told = sentence(pair, found.resampling)
        assert ("is better than" in told) == (verdict(pair) in ("better", "worse"))
        both = math.isinf(pair.value) and math.isinf(pair.reference_value)
        assert ("both" in told and "infinite" in told) == both


def test_why_differences_have_no_interval() -> None:
    # No two queries of a method are alike, and one is everywhere half a metre better.
    methods = [
        made_method({"s": {"error_m": [n + less for n in range(8)]}}, (ERROR,), name)
        for name, less in (("one", 0.5), ("other", 0.0))
    ]
    [pair] = compare(methods, [ERROR], resampling=ResamplingConfig(500)).pairs
    reason = "the differences of all queries are alike: resamples cannot differ"
    assert pair.interval.reason == reason

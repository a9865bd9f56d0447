"""Comparison of methods: pairs, their outcome, and methods that tie with the best."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.comparison import Comparison, compare, tied_with_best
from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import holm
from airzoo_bench.tables.comparison import comparison_table
from tests.statistics.support import ERROR, HIT, made_method, random_methods

FAST = ResamplingConfig(resamples=1_000)
EAST, WEST = [1.0, 1, 1, 1, 1, 0, 0, 0], [1.0, 1, 1, 0, 0]


def hits(name: str, east: list[float], west: list[float]) -> Scored:
    return made_method({"east": {"recall@1": east}, "west": {"recall@1": west}}, name=name)


def against(*methods: Scored, **options: object) -> Comparison:
    scores = choose_scores(methods, [])
    return compare(methods, scores, resampling=FAST, **options)  # type: ignore[arg-type]


def test_by_hand():
    better = hits("better", EAST, WEST)
    worse = hits("worse", [1.0, 0, 0, 0, 0, 1, 0, 0], [1.0, 1, 0, 0, 0])
    pair = against(better, worse).pairs[0]
    assert (pair.method, pair.reference) == ("worse", "better")
    assert pair.reference_value == pytest.approx((5 / 8 + 3 / 5) / 2)
    assert pair.value == pytest.approx((2 / 8 + 2 / 5) / 2)
    assert pair.difference == pytest.approx(-(3 / 8 + 1 / 5) / 2)
    assert (pair.wins, pair.ties, pair.losses) == (1, 7, 5)
    assert pair.p_mcnemar == pytest.approx(2 * (1 + 6) / 64)
    assert pair.test.patterns == 64
    assert pair.interval.low is not None
    assert pair.interval.high is not None
    assert pair.interval.low < pair.difference < pair.interval.high


def test_which_side_wins_where_lower_is_better():
    scenes = [
        {"s": {"error_m": values}}
        for values in ([1.0, np.inf, 3, np.inf, 6], [2.0, 5, 3, np.inf, 8])
    ]
    first, second = (made_method(s, (ERROR,), n) for s, n in zip(scenes, "ab", strict=True))
    pair = against(first, second).pairs[0]
    assert (pair.wins, pair.ties, pair.losses) == (1, 2, 2)
    assert pair.p_mcnemar is None


def test_reference_by_name_and_best():
    methods = random_methods(4, {"east": 40, "west": 30}, (HIT, ERROR))
    assert against(*methods).reference == "method00"
    assert against(*methods, reference="method02").reference == "method02"
    assert against(*methods, reference="best").reference == "method03"
    scores = choose_scores(methods, ["Median"])
    assert compare(methods, scores, reference="best", resampling=FAST).reference == "method03"
    with pytest.raises(UsageError, match="'evil' is no method"):
        against(*methods, reference="evil")


def test_who_takes_the_best_has_looked_at_every_pair():
    methods = random_methods(4, {"east": 60, "west": 60}, (HIT, ERROR))
    chosen, named = (against(*methods, reference=name) for name in ("best", "method03"))
    assert (chosen.reference, chosen.family, named.family) == ("method03", 6, 3)
    for part in (slice(0, 3), slice(3, 6)):
        p_values = np.array([pair.test.p_value for pair in chosen.pairs[part]])
        assert [pair.p_holm for pair in chosen.pairs[part]] == holm(p_values, 6).tolist()
        assert [pair.p_holm for pair in named.pairs[part]] == holm(p_values).tolist()
    assert against(*methods[:2], reference="best").family == 1
    # A method may have that name.
    called_best = hits("best", EAST, WEST)
    found = against(
        called_best, hits("b", [1.0] * 8, WEST), hits("c", EAST, WEST), reference="best"
    )
    assert (found.reference, found.family) == ("best", 2)


def test_equal_averages_are_equal_whatever_their_rounding():
    # 0.1 + 0.2 + 0.3 against 0.3 + 0.2 + 0.1: 5.6e-17 apart.
    methods = [
        made_method(
            {
                f"s{scene}": {"recall@1": [float(place < hits_of) for place in order]}
                for scene, hits_of in enumerate(counts)
            },
            name=name,
        )
        for name, counts, order in (("a", (1, 2, 3), range(10)), ("b", (3, 2, 1), range(9, -1, -1)))
    ]
    values = [method.result.overall["recall@1"] for method in methods]
    assert 0 < abs(values[0] - values[1]) < 1e-15
    comparison = against(*methods)
    pair = comparison.pairs[0]
    assert (pair.difference, pair.wins, pair.losses) == (0.0, 6, 6)
    table = comparison_table(comparison)
    assert table.texts()[0][2] == "unclear"
    assert table.texts()[0][5].startswith("0.00")
    assert table.notes[0].startswith("b and a cannot be told apart on R@1")


def test_ties_with_the_best_are_those_of_compare() -> None:
    methods = random_methods(4, {"east": 60, "west": 50}, (HIT, ERROR))[::-1]
    for scene in (None, "west"):
        found = tied_with_best(methods, [HIT, ERROR], FAST, scene)
        assert list(found) == ["recall@1", "error_m"]
        for score in (HIT, ERROR):
            pairs = compare(methods, [score], reference="best", scene=scene, resampling=FAST)
            p_values = {pairs.reference: 1.0} | {pair.method: pair.p_holm for pair in pairs.pairs}
            assert found[score.key] == [p_values[method.name] > 0.05 for method in methods]

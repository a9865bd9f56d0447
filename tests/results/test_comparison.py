"""Results beside each other: what is refused, pairs by hand, the best, and floors on every face."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.report.numbers import find, summary_panes
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import (
    FLOOR_MARK,
    MethodComparison,
    check_same_queries,
    choose_scores,
    compare,
    find_scene,
    floor_note,
    score_intervals,
    tied_with_best,
    why_untested,
)
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import Reference, ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import holm
from airzoo_bench.tables.comparison import comparison_table
from airzoo_bench.tables.layouts import method_table, methods_layout, scenes_table
from airzoo_bench.tables.render import render
from tests.statistics.support import ERROR, HIT, SOFT, made_method, random_methods

FAST = ResamplingConfig(resamples=1_000)
EAST, WEST = [1.0, 1, 1, 1, 1, 0, 0, 0], [1.0, 1, 1, 0, 0]


def hits(name: str, east: list[float], west: list[float]) -> Method:
    return made_method({"east": {"recall@1": east}, "west": {"recall@1": west}}, name=name)


def against(*methods: Method, **options: Any) -> MethodComparison:
    return compare(methods, choose_scores(methods, []), resampling=FAST, **options)


# --- what is comparable ---

SETTINGS = {"scores": {"k": [1, 3], "ap": "x"}}
OTHER = {"settings": {"scores": {"k": [1], "ap": "x"}, "more": True}, "protocol": "q" * 64}
UNLIKE: dict[str, tuple[list[float], dict[str, Any]]] = {
    r"m and m .*scores\.k is \[1, 3\] against \[1\]; more is absent against True": ([1], OTHER),
    "tttttttttttt and uuuuuuuuuuuu": ([1.0], {"settings": SETTINGS, "truth": "u" * 64}),
    r"1 of 2 \(s/q00001\)": ([1.0, 0.0], {"settings": SETTINGS}),
}


@pytest.mark.parametrize("said", UNLIKE)
def test_results_that_do_not_measure_the_same(said: str) -> None:
    values, parts = UNLIKE[said]
    one = made_method({"s": {"recall@1": [1.0]}}, name="m", settings=SETTINGS)
    with pytest.raises(ResultError, match=said):
        check_same_queries([one, made_method({"s": {"recall@1": values}}, name="m", **parts)])


def test_scenes_and_scores_by_name() -> None:
    titles = {"a": "Alp", "b": "a", "c": "Sea", "d": "Sea"}
    named = {name: find_scene(titles, name) for name in ("Alp", "a", "b", "c")}
    assert named == {"Alp": "a", "a": "a", "b": "b", "c": "c"}
    with pytest.raises(ResultError, match=r"2 scenes .* 'Sea'\n  expected: one of c, d"):
        find_scene(titles, "Sea")
    methods = random_methods(2, {"s": 5}, (HIT, SOFT))
    assert choose_scores(methods, []) == [HIT]
    assert choose_scores(methods, ["MRR", "recall@1", "mrr"]) == [SOFT, HIT]
    one = made_method({"s": {"recall@1": [1.0], "mrr": [1.0]}}, (HIT, SOFT))
    for some, name in ((methods, "recall@2"), ([one, hits("b", [1.0], [1.0])], "mrr")):
        with pytest.raises(UsageError, match=f"called '{name}'"):
            choose_scores(some, [name])


# --- pairs ---


def test_by_hand() -> None:
    worse = hits("worse", [1.0, 0, 0, 0, 0, 1, 0, 0], [1.0, 1, 0, 0, 0])
    pair = against(hits("better", EAST, WEST), worse).pairs[0]
    assert (pair.method, pair.reference) == ("worse", "better")
    assert pair.reference_value == pytest.approx((5 / 8 + 3 / 5) / 2)
    assert pair.value == pytest.approx((2 / 8 + 2 / 5) / 2)
    assert pair.difference == pytest.approx(-(3 / 8 + 1 / 5) / 2)
    assert (pair.wins, pair.ties, pair.losses) == (1, 7, 5)
    assert pair.p_mcnemar == pytest.approx(2 * (1 + 6) / 64)
    assert pair.test.patterns == 64
    # Where lower is better, two failures tie.
    errors = {"a": [1.0, np.inf, 3, np.inf, 6], "b": [2.0, 5, 3, np.inf, 8]}
    methods = [made_method({"s": {"error_m": v}}, (ERROR,), name) for name, v in errors.items()]
    [pair] = against(*methods).pairs
    assert (pair.wins, pair.ties, pair.losses, pair.p_mcnemar) == (1, 2, 2, None)
    # The least p of five signs is 1/16, and Student's t needs five.
    for unit, needed in (("query", "6 are"), ("scene", "5 are")):
        assert needed in why_untested(against(*methods).pairs[0].test, unit, 4)


def test_who_takes_the_best_has_looked_at_every_pair() -> None:
    methods = random_methods(4, {"east": 60, "west": 60}, (HIT, ERROR))
    chosen, named = (against(*methods, reference=name) for name in ("best", "method03"))
    assert (chosen.reference, chosen.family, named.family) == ("method03", 6, 3)
    for part in (slice(0, 3), slice(3, 6)):
        p_values = np.array([pair.test.p_value for pair in chosen.pairs[part]])
        assert [pair.p_holm for pair in chosen.pairs[part]] == holm(p_values, 6).tolist()
        assert [pair.p_holm for pair in named.pairs[part]] == holm(p_values).tolist()
    assert against(*methods).reference == "method00"
    # A method may have that name.
    others = hits("b", [1.0] * 8, WEST), hits("c", EAST, WEST)
    found = against(hits("best", EAST, WEST), *others, reference="best")
    assert (found.reference, found.family) == ("best", 2)
    with pytest.raises(UsageError, match="'evil' is no method"):
        against(*methods, reference="evil")


def test_equal_averages_are_equal_whatever_their_rounding() -> None:
    # 0.1 + 0.2 + 0.3 against 0.3 + 0.2 + 0.1: 5.6e-17 apart.
    methods = []
    for name, counts in (("a", (1, 2, 3)), ("b", (3, 2, 1))):
        scenes = {n: [1.0] * k + [0.0] * (10 - k) for n, k in zip("xyz", counts, strict=True)}
        parts = {n: {"recall@1": v if name == "a" else v[::-1]} for n, v in scenes.items()}
        methods.append(made_method(parts, name=name))
    one, two = (method.result.overall["recall@1"] for method in methods)
    assert 0 < abs(one - two) < 1e-15
    comparison = against(*methods)
    pair, table = comparison.pairs[0], comparison_table(comparison)
    assert (pair.difference, pair.wins, pair.losses) == (0.0, 6, 6)
    assert table.texts()[0][2] == "unclear"
    assert table.texts()[0][5].startswith("0.00")


def test_ties_with_the_best_are_those_of_compare_with_the_best_alone() -> None:
    methods = random_methods(4, {"east": 60, "west": 50}, (HIT, ERROR))[::-1]
    for scene in (None, "west"):
        found = tied_with_best(methods, [HIT, ERROR], FAST, scene)
        for score in (HIT, ERROR):
            pairs = compare(methods, [score], reference="best", scene=scene, resampling=FAST)
            p_values = {pairs.reference: 1.0} | {p.method: p.test.p_value for p in pairs.pairs}
            assert found[score.key] == [p_values[method.name] > 0.05 for method in methods]
    for name, values in {"Five queries": [0.0] * 5, "Six": [0.0] * 6}.items():
        few = [made_method({"s": {"recall@1": values}}, name=name) for name in "ab"]
        assert tied_with_best(few, [HIT], FAST)[HIT.key] == [True, name == "Six"]


# --- floors ---

HITS = {"east": 12, "west": 9}


def scored(
    name: str, floor: float, hits: dict[str, int], score: ScoreColumn = HIT, **parts: Any
) -> Method:
    """Return hits on 20 queries of each scene beside a reference of one value everywhere."""
    scenes = {s: {score.key: [1.0] * n + [0.0] * (20 - n)} for s, n in hits.items()}
    method, part = made_method(scenes, (score,), name), {score.key: floor}
    reference = Reference(meaning="m", scenes=dict.fromkeys(hits, part), overall=part, pooled=part)
    result = method.result.with_checksum(references={"Floor": reference}, **parts)
    return Method(name, result, method.records)


def test_a_method_is_no_better_than_a_floor_that_it_does_not_beat() -> None:
    for some in (HITS, {"east": 12}):  # of retrieval, with its interval
        low = score_intervals(scored("a", 0.1, some), [HIT], FAST).overall[0].low
        assert low is not None
        assert floor_note(scored("a", low - 1e-9, some).result) == ""
        note = floor_note(scored("a", low + 1e-9, some).result)
        assert all(part in note for part in (FLOOR_MARK, "Floor", f"R@1 {100 * low:.2f}"))
    cases = [(0.525, HIT, True), (0.52, HIT, False), (0.525, ERROR, False), (0.5, ERROR, True)]
    cases += [(1.0, HIT, False), (0.0, ERROR, False)]  # which nothing could beat
    for floor, score, told in cases:  # the errors' medians are 0 and 1
        found = scored("a", floor, HITS, score, track="matching").result
        assert bool(floor_note(found)) is told
        assert not floor_note(found, ["another score"])


def test_every_face_marks_it_and_says_so() -> None:
    poor, good = scored("poor", 0.4, HITS), scored("good", 0.4, {"east": 19, "west": 18})
    note, marked = floor_note(poor.result), f"poor {FLOOR_MARK}"
    for table in (
        methods_layout(method_table([poor.result, good.result])),
        comparison_table(compare([good, poor], [HIT], resampling=FAST)),
    ):
        assert f"poor: {note}" in table.notes
        assert [marked in row for row in table.texts()].count(True) == 1
        assert f"good {FLOOR_MARK}" not in str(table.texts())
        assert marked in render(table, "markdown")
        seen = [line for line in render(table, "latex").splitlines() if line[0] != "%"]
        assert re.search(r"bottomrule.*ddagger.*40\.00.*tabular", "".join(seen))
    alone, section = scenes_table(poor.result), Section([poor, good])
    assert note in alone.notes
    assert alone.texts()[-2][0] == f"Average {FLOOR_MARK}"
    [summary] = summary_panes(section, find(section))[0].tables
    assert f"poor: {note}" in summary.notes
    assert [row[0] for row in summary.texts()] == [marked, "good", "Floor"]

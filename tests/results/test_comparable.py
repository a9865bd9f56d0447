"""Results that do not measure the same are told apart, shortly."""

from __future__ import annotations

import pytest

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.results.comparable import (
    check_comparable,
    check_same_queries,
    choose_scores,
    find_scene,
)
from airzoo_bench.results.result import Result
from tests.statistics.support import HIT, SOFT, made_method, random_methods


def result(hits: list[float] = [1.0], **changes: object) -> Result:  # noqa: B006
    return made_method({"s": {"recall@1": hits}}, **changes).result


def refusal(*results: Result) -> ResultError:
    names = [f"m{number}" for number in range(len(results))]
    with pytest.raises(ResultError) as error:
        check_comparable(names, results)
    return error.value


def test_settings_that_differ_are_named() -> None:
    one = result(settings={"scores": {"k": [1, 3], "ap": "x"}})
    two = result(settings={"scores": {"k": [1], "ap": "x"}, "more": True}, protocol="q" * 64)
    found = refusal(one, two)
    assert found.what == (
        "m0 and m1 were made with different protocols (pppppppppppp and qqqqqqqqqqqq): "
        "scores.k is [1, 3] against [1]; more is absent against True"
    )
    assert "--protocol" in (found.fix or "")


def test_truth() -> None:
    found = refusal(result(), result(), result([1.0, 0.0], truth="u" * 64))
    assert found.what == (
        "m0 and m2 were compared with different truths (tttttttttttt and uuuuuuuuuuuu): "
        "benchmark made v1, prepared anew; scene s: 1 against 2 queries"
    )


def test_scenes_by_id_and_title() -> None:
    titles = {"a": "Alp", "b": "a", "c": "Sea", "d": "Sea"}
    assert find_scene(titles, "Alp") == find_scene(titles, "a") == "a"
    assert find_scene(titles, "b") == "b"
    assert find_scene(titles, "c") == "c"
    with pytest.raises(ResultError, match="2 scenes have the title 'Sea'\n  expected: one of c, d"):
        find_scene(titles, "Sea")


@pytest.mark.parametrize(
    "change", [{"title": "R@9"}, {"higher_is_better": False}, {"average": "median"}, {"unit": "m"}]
)
def test_scores_of_another_meaning(change: dict[str, object]) -> None:
    one, two = result(), result()
    columns = (one.columns[0].model_copy(update=change), *one.columns[1:])
    assert "mean different things by the score" in (
        refusal(one, two.model_copy(update={"columns": columns})).what
    )


def test_results_on_other_queries() -> None:
    methods = [
        made_method({name: {"recall@1": hits}})
        for name, hits in (("s", [1.0, 0.0]), ("s", [1.0]), ("t", [1.0]))
    ]
    with pytest.raises(ResultError, match="only 1 query in common"):
        check_same_queries(methods[:2])
    with pytest.raises(ResultError, match="no query in common") as error:
        check_same_queries(methods[1:])
    assert "2 of 2 (s/q00000, t/q00000)" in error.value.what


def test_scores_by_key_and_title() -> None:
    methods = random_methods(2, {"s": 5}, (HIT, SOFT))
    assert [c.key for c in choose_scores(methods, [])] == ["recall@1"]
    assert [c.key for c in choose_scores(methods, ["MRR", "recall@1", "mrr"])] == [
        "mrr",
        "recall@1",
    ]
    with pytest.raises(UsageError, match=r"called 'recall@2' \(did you mean 'recall@1'"):
        choose_scores(methods, ["recall@2"])
    one = made_method({"s": {"recall@1": [1.0], "mrr": [1.0]}}, (HIT, SOFT))
    with pytest.raises(UsageError, match=r"called 'mrr'\n.*\n.*not all have it"):
        choose_scores([one, made_method({"s": {"recall@1": [1.0]}})], ["mrr"])

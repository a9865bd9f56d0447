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


def test_settings_and_truths_that_differ_are_named() -> None:
    one = result(settings={"scores": {"k": [1, 3], "ap": "x"}})
    two = result(settings={"scores": {"k": [1], "ap": "x"}, "more": True}, protocol="q" * 64)
    found = refusal(one, one, two)
    assert "m0 and m2" in found.what
    assert "scores.k is [1, 3] against [1]; more is absent against True" in found.what
    assert "--protocol" in (found.fix or "")
    assert "tttttttttttt and uuuuuuuuuuuu" in refusal(result(), result(truth="u" * 64)).what


def test_results_on_other_queries() -> None:
    one, two = (made_method({"s": {"recall@1": hits}}) for hits in ([1.0, 0.0], [1.0]))
    with pytest.raises(ResultError, match=r"1 of 2 \(s/q00001\)"):
        check_same_queries([one, two])


def test_scenes_by_id_and_title() -> None:
    titles = {"a": "Alp", "b": "a", "c": "Sea", "d": "Sea"}
    assert find_scene(titles, "Alp") == find_scene(titles, "a") == "a"
    assert find_scene(titles, "b") == "b"
    assert find_scene(titles, "c") == "c"
    with pytest.raises(ResultError, match=r"2 scenes .* 'Sea'\n  expected: one of c, d"):
        find_scene(titles, "Sea")


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

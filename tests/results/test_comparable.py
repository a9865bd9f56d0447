"""Results that do not measure the same are told apart, shortly."""

from __future__ import annotations

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.comparable import check_comparable, find_scene, version_notes
from airzoo_bench.results.result import Result
from tests.statistics.support import made_method


def result(hits: list[float] = [1.0], **changes: object) -> Result:  # noqa: B006
    return made_method({"s": {"recall@1": hits}}, **changes).result


def refusal(*results: Result) -> ResultError:
    names = [f"m{number}" for number in range(len(results))]
    with pytest.raises(ResultError) as error:
        check_comparable(names, results)
    return error.value


def test_alike() -> None:
    check_comparable(["a"], [result()])
    check_comparable(["a", "b", "c"], [result(), result([0.0]), result()])


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


def test_versions_that_differ_are_named_once() -> None:
    made = result()
    older = made.model_copy(update={"versions": made.versions | {"airzoo-bench": "0.0.9"}})
    assert version_notes(["a", "b"], [made, made]) == []
    current = made.versions["airzoo-bench"]
    assert version_notes(["a", "b", "c"], [made, older, made]) == [
        f"made with different versions of airzoo-bench: {current} (a, c), 0.0.9 (b)"
    ]
    lacking = made.model_copy(update={"versions": {"airzoo-bench": "0.0.9", "numpy": "1"}})
    [note] = version_notes(["a", "b"], [older, lacking])
    assert note == "made with different versions of numpy: unknown (a), 1 (b)"


def test_scenes_by_id_and_title() -> None:
    titles = {"a": "Alp", "b": "a", "c": "Sea", "d": "Sea"}
    assert find_scene(titles, "Alp") == find_scene(titles, "a") == "a"
    assert find_scene(titles, "b") == "b"
    assert find_scene(titles, "c") == "c"
    with pytest.raises(ResultError, match="2 scenes have the title 'Sea'\n  expected: one of c, d"):
        find_scene(titles, "Sea")


def test_what_is_no_scene_gets_a_hint() -> None:
    titles = {"field1": "City", "field2": "Rural"}
    for wanted, hint in (
        ("Citi", "'City'"),
        ("Cty", "'City'"),
        ("RUR", "'Rural'"),
        ("field3", "'field2' or 'field1'"),
    ):
        with pytest.raises(ResultError) as error:
            find_scene(titles, wanted)
        assert f"there is no scene '{wanted}' in the results" in error.value.what
        assert hint in error.value.what
        assert error.value.expected == "one of field1, field2"


@pytest.mark.parametrize(
    "change", [{"title": "R@9"}, {"higher_is_better": False}, {"average": "median"}, {"unit": "m"}]
)
def test_scores_of_another_meaning(change: dict[str, object]) -> None:
    one, two = result(), result()
    columns = (one.columns[0].model_copy(update=change), *one.columns[1:])
    assert "mean different things by the score" in (
        refusal(one, two.model_copy(update={"columns": columns})).what
    )

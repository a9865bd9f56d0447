"""What is said of a comparison, and which ones are refused."""

from __future__ import annotations

import pytest

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.results.comparable import check_same_queries, choose_scores
from tests.results.compared import EAST, WEST, against, hits
from tests.statistics.support import HIT, SOFT, made_method, random_methods


class TestRefusals:
    def test_other_protocol(self):
        one = made_method({"s": {"recall@1": [1.0]}}, settings={"scores": {"k": [1, 3], "ap": "x"}})
        two = made_method(
            {"s": {"recall@1": [1.0]}},
            name="Two",
            protocol="q" * 64,
            settings={"scores": {"k": [1], "ap": "x"}, "more": True},
        )
        with pytest.raises(ResultError) as error:
            check_same_queries([one, two])
        assert "Method and Two were made with different protocols (pppppppppppp" in error.value.what
        assert "scores.k is [1, 3] against [1]; more is absent against True" in error.value.what

    def test_other_truth(self):
        one = made_method({"s": {"recall@1": [1.0]}})
        two = made_method({"s": {"recall@1": [1.0, 0.0]}}, name="Two", truth="u" * 64)
        with pytest.raises(ResultError, match="different truths") as error:
            check_same_queries([one, one, two])
        assert "benchmark made v1, prepared anew; scene s: 1 against 2 queries" in error.value.what

    def test_other_queries(self):
        one = made_method({"s": {"recall@1": [1.0, 0.0]}})
        two = made_method({"s": {"recall@1": [1.0]}}, name="Two")
        with pytest.raises(ResultError, match="only 1 query in common"):
            check_same_queries([one, two])
        three = made_method({"t": {"recall@1": [1.0]}}, name="Three")
        with pytest.raises(ResultError, match="no query in common") as error:
            check_same_queries([two, three])
        assert "2 of 2 (s/q00000, t/q00000)" in error.value.what

    def test_unknown_score(self):
        methods = random_methods(2, {"s": 5}, (HIT, SOFT))
        assert [c.key for c in choose_scores(methods, [])] == ["recall@1"]
        assert [c.key for c in choose_scores(methods, ["MRR", "recall@1", "mrr"])] == [
            "mrr",
            "recall@1",
        ]
        with pytest.raises(UsageError, match=r"called 'recall@2' \(did you mean 'recall@1'"):
            choose_scores(methods, ["recall@2"])

    def test_a_score_that_one_lacks(self):
        one = made_method({"s": {"recall@1": [1.0], "mrr": [1.0]}}, (HIT, SOFT))
        two = made_method({"s": {"recall@1": [1.0]}})
        with pytest.raises(UsageError, match=r"called 'mrr'\n.*\n.*not all have it"):
            choose_scores([one, two], ["mrr"])

    def test_unknown_scene(self):
        with pytest.raises(ResultError, match="there is no scene 'est' in the results"):
            against(hits("a", EAST, WEST), hits("b", EAST, WEST), scene="est")

"""Methods that cannot be told from the best."""

from __future__ import annotations

from airzoo_bench.results.comparison import against_best, compare
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import ERROR, HIT, made_method, random_methods

FAST = ResamplingConfig(resamples=1_000)


def test_every_method_against_the_best_as_compare_does() -> None:
    methods = random_methods(4, {"east": 60, "west": 50}, (HIT, ERROR))[::-1]
    for scene in (None, "west"):
        found = against_best(methods, [HIT, ERROR], FAST, scene)
        assert list(found) == ["recall@1", "error_m"]
        for score in (HIT, ERROR):
            pairs = compare(methods, [score], reference="best", scene=scene, resampling=FAST)
            of_best = found[score.key]
            assert methods[of_best.best].name == pairs.reference
            p_values = {methods[of_best.best].name: 1.0}
            p_values |= {pair.method: pair.p_holm for pair in pairs.pairs}
            assert of_best.p_values == tuple(p_values[method.name] for method in methods)
            assert of_best.tied == tuple(p > 0.05 for p in of_best.p_values)
            assert of_best.tied[of_best.best]


def test_each_score_has_its_own_best() -> None:
    scenes = (
        {"s": {"recall@1": [1.0] * 30, "error_m": [9.0 + q for q in range(30)]}},
        {"s": {"recall@1": [0.0] * 30, "error_m": [1.0 + q for q in range(30)]}},
        {"s": {"recall@1": [1.0] * 29 + [0.0], "error_m": [1.0 + q for q in range(30)]}},
    )
    methods = [made_method(s, (HIT, ERROR), n) for s, n in zip(scenes, "abc", strict=True)]
    found = against_best(methods, [HIT, ERROR], FAST)
    assert [found[key].best for key in ("recall@1", "error_m")] == [0, 1]
    assert found["recall@1"].tied == (True, False, True)
    assert found["error_m"].p_values[1:] == (1.0, 1.0)


def test_one_method_is_the_best() -> None:
    (method,) = random_methods(1, {"s": 20}, (HIT,))
    assert against_best([method], [HIT], FAST)["recall@1"].p_values == (1.0,)

"""Methods that cannot be told from the best."""

from __future__ import annotations

from airzoo_bench.results.comparison import against_best, compare
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import ERROR, HIT, random_methods

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

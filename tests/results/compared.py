"""Methods of two scenes, compared."""

from __future__ import annotations

from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.comparison import Comparison, compare
from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import made_method

FAST = ResamplingConfig(resamples=1_000)
EAST, WEST = [1.0, 1, 1, 1, 1, 0, 0, 0], [1.0, 1, 1, 0, 0]


def hits(name: str, east: list[float], west: list[float]) -> Scored:
    return made_method({"east": {"recall@1": east}, "west": {"recall@1": west}}, name=name)


def against(*methods: Scored, **options: object) -> Comparison:
    scores = choose_scores(methods, [])
    return compare(methods, scores, resampling=FAST, **options)  # type: ignore[arg-type]

"""Two methods of which one is better, compared."""

from __future__ import annotations

from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.comparison import Comparison, Pair, compare
from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import PairedTest
from tests.statistics.support import HIT

FAST = ResamplingConfig(resamples=1_000)
PAIR = Pair(
    score=HIT,
    method="mine",
    reference="theirs",
    value=0.5,
    reference_value=0.4,
    difference=0.1,
    interval=Interval(0.02, 0.2, "bca"),
    test=PairedTest(0.01, exact=False, patterns=1_000),
    p_holm=0.02,
    p_mcnemar=0.03,
    wins=10,
    ties=5,
    losses=2,
)


def against(*methods: Scored, every: bool = False) -> Comparison:
    return compare(methods, choose_scores(methods, [], every=every), resampling=FAST)

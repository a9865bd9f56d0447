"""A result with all its parts."""

from __future__ import annotations

import math

from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    ScoreColumn,
    TruthUsed,
)

COLUMNS = (
    ScoreColumn.share("recall@1", "R@1", headline=True),
    ScoreColumn.error("distance_m", "Distance", "m", "median"),
)


def result(method: str = "Method", **overall: float) -> Result:
    values = {"recall@1": 0.1 + 0.2, "distance_m": math.inf} | overall
    return Result(
        track="retrieval",
        protocol=ProtocolUsed(name="p", version=1, fingerprint="f", settings={"k": [1, None]}),
        truth=TruthUsed(benchmark="b", version=1, fingerprint="t", scene_titles={"s": "Scene"}),
        predictions=PredictionsUsed(file="p.npz", sha256="0", kind="ranked_ids", method=method),
        versions={"airzoo-bench": "1"},
        columns=COLUMNS,
        counts={"s": {"queries": 3}},
        extra_queries=0,
        notes=("A note.",),
        scenes={"s": values},
        overall=values,
        pooled=values,
    ).with_checksum()

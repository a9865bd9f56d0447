"""Results with records made by hand, in memory and on disk."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.evaluation.evaluate import save
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    ScoreColumn,
    TruthUsed,
    summarise,
)
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

HIT = ScoreColumn.share("recall@1", "R@1", headline=True)
ERROR = ScoreColumn.error("error_m", "Median", "m", "median", headline=True)
SOFT = ScoreColumn.share("mrr", "MRR")
CHAMFER = ScoreColumn.error("chamfer_m", "Chamfer", "m", "mean", headline=True)


def made_records(scenes: Mapping[str, Mapping[str, Sequence[float]]]) -> pd.DataFrame:
    """Return records from scores of scenes: `scenes["east"]["recall@1"][q]`."""
    parts = []
    for scene, scores in scenes.items():
        count = len(next(iter(scores.values())))
        ids = [f"{scene}/q{number:05d}" for number in range(count)]
        parts.append(pd.DataFrame({"scene": scene, "query": ids} | dict(scores)))
    return pd.concat(parts, ignore_index=True)


def made_result(
    records: pd.DataFrame,
    columns: Sequence[ScoreColumn],
    method: str = "Method",
    *,
    protocol: str = "p" * 64,
    truth: str = "t" * 64,
    settings: Mapping[str, Any] | None = None,
) -> Result:
    """Return the result that records give, of predictions that no other method has."""
    scenes = list(dict.fromkeys(records["scene"]))
    titles, kept = {scene: scene.title() for scene in scenes}, dict(settings or {})
    sha256 = hashlib.sha256(method.encode()).hexdigest()
    return Result(
        track="reconstruction" if any(c.key == "chamfer_m" for c in columns) else "retrieval",
        protocol=ProtocolUsed(name="made", version=1, fingerprint=protocol, settings=kept),
        truth=TruthUsed(benchmark="made", version=1, fingerprint=truth, scene_titles=titles),
        predictions=PredictionsUsed(file="p.npz", sha256=sha256, kind="ranked_ids", method=method),
        versions={"airzoo-bench": "1"},
        columns=tuple(columns),
        counts={s: {"queries": int((records["scene"] == s).sum())} for s in scenes},
        extra_queries=0,
        notes=(),
        **asdict(summarise(records, columns, scenes)),
    ).with_checksum()


def made_method(
    scenes: Mapping[str, Mapping[str, Sequence[float]]],
    columns: Sequence[ScoreColumn] = (HIT,),
    name: str = "Method",
    **result: Any,
) -> Method:
    """Return a method with its records."""
    records = made_records(scenes)
    return Method(name, made_result(records, columns, name, **result), records)


def small_result(method: str = "Method", **overall: float) -> Result:
    """Return a result of one scene with three queries, and with all its parts."""
    values = {"recall@1": 0.1 + 0.2, "distance_m": math.inf} | overall
    return Result(
        track="retrieval",
        protocol=ProtocolUsed(name="p", version=1, fingerprint="f", settings={"k": [1, None]}),
        truth=TruthUsed(benchmark="b", version=1, fingerprint="t", scene_titles={"s": "Scene"}),
        predictions=PredictionsUsed(file="p.npz", sha256="0", kind="ranked_ids", method=method),
        versions={"airzoo-bench": "1"},
        columns=(HIT, ScoreColumn.error("distance_m", "Distance", "m", "median")),
        counts={"s": {"queries": 3}},
        extra_queries=0,
        notes=("A note.",),
        scenes={"s": values},
        overall=values,
        pooled=values,
    ).with_checksum()


def write_run(result: Result, records: pd.DataFrame, folder: Path) -> None:
    """Write result and records as `eval` does."""
    predictions = SimpleNamespace(path=folder.parent / "p.npz")
    opened = SimpleNamespace(track=SimpleNamespace(files={}), predictions=predictions)
    run: Any = SimpleNamespace(result=result, records=records, opened=opened, scored={})
    save(run, folder)


def write_method(folder: Path, method: Method) -> Path:
    """Write result and records as `eval` does, and return the result's path."""
    write_run(method.result, method.records, folder)
    return folder / "result.json"


def random_methods(
    count: int, sizes: Mapping[str, int], columns: Sequence[ScoreColumn], seed: int = 0
) -> list[Method]:
    """Return methods that are the better the later they stand."""
    random = np.random.default_rng(seed)
    methods = []
    for number in range(count):
        rate = 0.3 + 0.4 * (number + 1) / count
        scenes = {
            scene: {column.key: _drawn(random, column, rate, size) for column in columns}
            for scene, size in sizes.items()
        }
        methods.append(made_method(scenes, columns, f"method{number:02d}"))
    return methods


def _drawn(random: np.random.Generator, column: ScoreColumn, rate: float, size: int) -> list[float]:
    if column.key.startswith("recall"):
        return (random.random(size) < rate).astype(np.float64).tolist()
    if column.unit == "share":
        return (random.random(size) ** (1 / rate)).tolist()
    errors = random.exponential(10 / rate, size)
    errors[random.random(size) < 0.1] = np.inf
    return errors.tolist()


MEDIAN = np.array([True])
FAST = ResamplingConfig(resamples=1_000)


def sample(*groups: np.ndarray, medians: np.ndarray | None = None) -> Sample:
    names = tuple(f"s{number}" for number in range(len(groups)))
    values = tuple(np.atleast_2d(np.asarray(group, np.float64)) for group in groups)
    chosen = np.zeros(len(values[0]), bool) if medians is None else medians
    return Sample("query", names, values, chosen)


def limits(interval: Interval) -> tuple[float, float]:
    assert interval.low is not None
    assert interval.high is not None
    assert interval.reason == ""
    return interval.low, interval.high

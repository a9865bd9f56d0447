"""The numbers that a board takes of a result: scores, intervals, conditions, and values to compare.

They are kept in a folder beside the site by the hash of result and records, so that a build
measures only what has changed. Whatever cannot be read there is measured again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import validated
from airzoo_bench.core.version import __version__
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.results.comparison import is_share, make_sample, score_intervals
from airzoo_bench.results.files import records_path
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)

__all__ = ["OVERALL", "RESAMPLING", "Measured", "Number", "forget_others", "measure", "sample_of"]

OVERALL = ""
RESAMPLING = ResamplingConfig()
ANSWER_FILE = "answer.json"

Number = tuple[float, float | None, float | None, float | None]
"""A score: its value, its interval, its standard error."""

_FORMAT = "5"
_NORMAL = 1.959964


@dataclass(frozen=True, eq=False)
class Measured:
    """The numbers of a result, and what they depend on.

    Scores are by scene, with `OVERALL` for the average, then by key. `groups` are the names and
    sizes of the parts of `values` (V, N), a row a headline score; a sealed answer has none.
    `queries` is a hash of the names of all records, `kept` what the cache calls these numbers.
    """

    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    benchmark: str
    benchmark_version: int | None
    truth: str
    sealed: bool
    unit: str
    method: str
    made_with: str
    columns: list[dict[str, Any]]
    scenes: list[dict[str, Any]]
    notes: list[str]
    scores: dict[str, dict[str, Number]]
    interval_kinds: list[str] = field(default_factory=list)
    references: dict[str, Any] = field(default_factory=dict)
    conditions: list[dict[str, Any]] = field(default_factory=list)
    groups: list[tuple[str, int]] = field(default_factory=list)
    queries: str = ""
    values: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    kept: str = ""

    @property
    def measures(self) -> tuple[Any, ...]:
        """The settings that numbers ranked together must share."""
        protocol = (self.protocol, self.protocol_version, self.protocol_fingerprint)
        return (*protocol, self.truth, self.sealed)

    @cached_property
    def score_columns(self) -> list[ScoreColumn]:
        """The scores, headline ones first."""
        found = [ScoreColumn(**column) for column in self.columns]
        return sorted(found, key=lambda column: not column.headline)

    def values_of(self, key: str) -> Floats:
        """Return the values (N,) of a headline score."""
        headline = [one["key"] for one in self.columns if one["headline"]]
        found: Floats = self.values[headline.index(key)]
        return found


def measure(file: Path, cache: Path) -> Measured:
    """Measure a result or a sealed answer, or take what the cache has of it."""
    content = b"".join(
        part.read_bytes() if part.is_file() else b""
        for part in (file, records_path(file))  # records are held to the hash in the result
    )
    key = hashlib.sha256(f"{_FORMAT} {__version__} {file.name}".encode() + content).hexdigest()
    kept = cache / f"{key}.measured"
    found = _load(kept)
    if found is None:
        found = _of_answer(file) if file.name == ANSWER_FILE else _of_result(file)
        _store(kept, found)
    return replace(found, kept=key)


def forget_others(keys: Collection[str], cache: Path) -> None:
    """Remove what was kept of results that are not among these."""
    for file in cache.glob("*.measured"):
        if file.stem not in keys:
            file.unlink()


def sample_of(methods: Sequence[Measured], column: ScoreColumn) -> Sample:
    """Put one headline score of many methods into a sample, as `make_sample` would."""
    first, rows = methods[0], [one.values_of(column.key) for one in methods]
    ends = np.cumsum([0, *(units for _, units in first.groups)]).tolist()
    by_median = first.unit == "query" and column.average == "median"
    return Sample(
        first.unit,
        tuple(name for name, _ in first.groups),
        tuple(np.stack([row[start:end] for row in rows]) for start, end in pairwise(ends)),
        np.full(len(rows), by_median),
        np.full(len(rows), is_share(column)),
    )


def _store(kept: Path, found: Measured) -> None:
    """Keep the numbers as JSON, with their values and the checksum of both."""
    text = json.dumps(asdict(replace(found, values=None))).encode()  # type: ignore[arg-type]
    values = found.values.astype("<f8")
    head = f"{len(text)} {values.shape[0]} {values.shape[1]}".encode()
    content = head + b"\n" + text + values.tobytes()
    with atomic_write(kept) as stream:
        stream.write(hashlib.sha256(content).digest() + content)


def _load(kept: Path) -> Measured | None:
    try:
        content = kept.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content[32:]).digest() != content[:32]:
        return None
    head, _, body = content[32:].partition(b"\n")
    size, rows, units = map(int, head.split())
    values = np.frombuffer(body[size:], "<f8").reshape(rows, units)
    return Measured(**json.loads(body[:size]) | {"values": values})


def _of_result(file: Path) -> Measured:
    result = read_result(file)
    method = Scored(result.predictions.method, result, read_records(file, result))
    headline = [column for column in result.columns if column.headline]
    found = score_intervals(method, headline, RESAMPLING)
    intervals = {
        scene: {column.key: one for column, one in zip(headline, row, strict=True)}
        for scene, row in ({OVERALL: found.overall} | found.groups).items()
    }
    scores: dict[str, dict[str, Number]] = {}
    for scene, part in ({OVERALL: result.overall} | result.scenes).items():
        limits = intervals.get(scene, {})
        scores[scene] = {
            key: (value, limits[key].low, limits[key].high, None)
            if key in limits
            else (value, None, None, None)
            for key, value in part.items()
        }
    kinds = {one.method for row in intervals.values() for one in row.values() if one.method}
    sample = make_sample([method], headline)
    names = "\n".join(method.records["query"].astype(str))
    return Measured(
        track=result.track,
        protocol=result.protocol.name,
        protocol_version=result.protocol.version,
        protocol_fingerprint=result.protocol.fingerprint,
        benchmark=result.truth.benchmark,
        benchmark_version=result.truth.version,
        truth=result.truth.fingerprint,
        sealed=False,
        unit=result.unit,
        method=result.predictions.method,
        made_with=result.versions["airzoo-bench"],
        columns=[column.model_dump() for column in result.columns],
        scenes=[
            {"id": s, "title": result.truth.scene_titles[s], "queries": result.counts[s]["queries"]}
            for s in result.scenes
        ],
        notes=list(result.notes),
        scores=scores,
        interval_kinds=sorted(kinds),
        references={name: part.model_dump() for name, part in result.references.items()},
        conditions=_conditions(method, headline),
        groups=[(g, v.shape[1]) for g, v in zip(sample.groups, sample.values, strict=True)],
        queries=hashlib.sha256(names.encode()).hexdigest(),
        values=np.concatenate(sample.values, axis=1),
    )


def _conditions(method: Scored, scores: Sequence[ScoreColumn]) -> list[dict[str, Any]]:
    """Average the headline scores within the groups of every condition, over all scenes."""
    if method.result.unit != "query" or not scores:
        return []
    values = np.array([method.records[score.key].to_numpy(np.float64) for score in scores])
    medians = np.array([score.average == "median" for score in scores])
    found = []
    for by in condition_names(method):
        grouping = group_records(method.records, by)
        means = group_averages(values, medians, grouping.codes, len(grouping.labels))
        found.append(
            {
                "by": by,
                "title": condition_title(by),
                "labels": list(grouping.labels),
                "counts": grouping.counts.tolist(),
                "members": hashlib.sha256(grouping.codes.tobytes()).hexdigest(),
                "values": {s.key: row.tolist() for s, row in zip(scores, means, strict=True)},
            }
        )
    return found


def _of_answer(file: Path) -> Measured:
    text = read_text(file, SubmissionError, "sealed answer")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SubmissionError(f"not JSON: {error}", where=file) from error
    if not isinstance(data, dict):
        raise SubmissionError("not a sealed answer", where=file)
    answer = validated(data, SealedAnswer, SubmissionError, file, "sealed answer")
    return Measured(
        track=answer.track,
        protocol=answer.protocol,
        protocol_version=answer.protocol_version,
        protocol_fingerprint=answer.protocol_fingerprint,
        benchmark=answer.benchmark,
        benchmark_version=None,
        truth=answer.truth_commitment,
        sealed=True,
        unit="query",
        method=answer.method,
        made_with=answer.versions.get("airzoo-bench", ""),
        columns=[column.model_dump() for column in answer.columns],
        scenes=[
            {"id": scene, "title": answer.scene_titles[scene], "queries": count}
            for scene, count in answer.queries.items()
        ],
        notes=[],
        scores={
            scene: {c.key: _estimated(part[c.key], c) for c in answer.columns if c.key in part}
            for scene, part in ({OVERALL: answer.overall} | answer.scenes).items()
        },
    )


def _estimated(estimate: Any, column: ScoreColumn) -> Number:
    """Return a rounded score with the interval of its standard error; no value is infinite."""
    value, error = estimate.value, estimate.standard_error
    if value is None or error is None:
        return (np.inf if value is None else value), None, None, error
    most = 1.0 if column.unit == "share" else np.inf
    reach = _NORMAL * error
    return value, max(0.0, value - reach), float(min(most, value + reach)), error

"""Measures results and sealed answers for a board, and keeps each by the hash of its files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import validated
from airzoo_bench.core.version import __version__
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answer import Estimate, SealedAnswer
from airzoo_bench.leaderboard.site.entries import Entry
from airzoo_bench.leaderboard.site.kept_files import keep_json, keep_rows, kept_json
from airzoo_bench.leaderboard.site.measured import OVERALL, RESAMPLING, Measured
from airzoo_bench.results.comparison import make_sample, score_intervals
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)

__all__ = ["forget_others", "measure_all"]

_FORMAT = "4"
_VALUES = ".values"
_SPREAD = 32  # fewer are measured before another process has started


def measure_all(
    entries: Sequence[Entry], cache: Path, engine: Engine = HERE
) -> list[tuple[Measured, Path] | SubmissionError]:
    """Measure entries, those that changed since the last build anew."""
    files = [cache / f"{_key(entry)}.json" for entry in entries]
    known = {file: _load(file) for file in files}
    missing = [
        (entry.file, file)
        for entry, file in zip(entries, files, strict=True)
        if known[file] is None
    ]
    used = engine if len(missing) >= _SPREAD else HERE
    stored = used.map(
        _store, missing, shared=None, stage="results", name=lambda asked: str(asked[0])
    )
    failed = {
        file: error for (_, file), error in zip(missing, stored, strict=True) if error is not None
    }
    return [
        SubmissionError(**failed[file])
        if file in failed
        else (known[file] or _measured(file), file.with_suffix(_VALUES))
        for file in files
    ]


def forget_others(entries: Sequence[Entry], cache: Path) -> None:
    """Remove what was kept of results that are not among these."""
    kept = {_key(entry) for entry in entries}
    for end in (".json", _VALUES):
        for file in cache.glob(f"{'[0-9a-f]' * 64}{end}"):
            if file.name.removesuffix(end) not in kept:
                file.unlink()


def _key(entry: Entry) -> str:
    return hashlib.sha256(f"{_FORMAT} {__version__} {entry.digest}".encode()).hexdigest()


def _measured(file: Path) -> Measured:
    found = _load(file)
    if found is None:
        raise SubmissionError("was removed while a build needed it", where=file, fix="build again")
    return found


def _load(file: Path) -> Measured | None:
    found = kept_json(file)
    return None if found is None else Measured(**found)


def _store(shared: None, asked: tuple[Path, Path]) -> dict[str, Any] | None:
    """Measure one and keep it; the error as a value, since all are told in one message."""
    del shared
    path, file = asked
    try:
        found, values = _sealed(path) if path.name == "answer.json" else _open(path)
    except UserError as error:
        return {
            "what": error.what,
            "where": error.where,
            "expected": error.expected,
            "fix": error.fix,
        }
    if values is not None:
        keep_rows(file.with_suffix(_VALUES), values)
    keep_json(file, asdict(found))  # last: where it stands, both do
    return None


def _open(path: Path) -> tuple[Measured, Floats]:
    result = read_result(path)
    method = Scored(result.predictions.method, result, read_records(path, result))
    headline = [column for column in result.columns if column.headline]
    found = score_intervals(method, headline, RESAMPLING)
    parts = {OVERALL: found.overall} | found.groups
    limits = {
        scene: {
            column.key: [interval.low, interval.high]
            for column, interval in zip(headline, intervals, strict=True)
            if interval.low is not None
        }
        for scene, intervals in parts.items()
    }
    sample = make_sample([method], headline)
    names = "\n".join(method.records["query"].astype(str))
    return Measured(
        result.track,
        result.protocol.name,
        result.protocol.version,
        result.protocol.fingerprint,
        result.truth.benchmark,
        result.truth.version,
        result.truth.fingerprint,
        False,
        result.unit,
        result.predictions.method,
        result.versions["airzoo-bench"],
        [column.model_dump() for column in result.columns],
        [[s, result.truth.scene_titles[s], result.counts[s]["queries"]] for s in result.scenes],
        list(result.notes),
        {OVERALL: result.overall} | result.scenes,
        limits,
        {},
        sorted({i.method for intervals in parts.values() for i in intervals if i.method}),
        {name: part.model_dump() for name, part in result.references.items()},
        _conditions(method, headline),
        [[g, v.shape[1]] for g, v in zip(sample.groups, sample.values, strict=True)],
        hashlib.sha256(names.encode()).hexdigest(),
    ), np.concatenate(sample.values, axis=1)


def _conditions(method: Scored, scores: Sequence[ScoreColumn]) -> list[dict[str, Any]]:
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


def _sealed(path: Path) -> tuple[Measured, None]:
    text = read_text(path, SubmissionError, "sealed answer")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SubmissionError(f"not JSON: {error}", where=path) from error
    if not isinstance(data, dict):
        raise SubmissionError("not a sealed answer", where=path)
    answer = validated(data, SealedAnswer, SubmissionError, path, "sealed answer")
    parts = {OVERALL: answer.overall} | answer.scenes
    return Measured(
        answer.track,
        answer.protocol,
        answer.protocol_version,
        answer.protocol_fingerprint,
        answer.benchmark,
        0,
        answer.truth_commitment,
        True,
        "query",
        answer.method,
        answer.versions.get("airzoo-bench", ""),
        [column.model_dump() for column in answer.columns],
        [[scene, answer.scene_titles[scene], n] for scene, n in answer.queries.items()],
        [],
        {scene: _estimates(part, "value") for scene, part in parts.items()},
        {},
        {scene: _estimates(part, "standard_error") for scene, part in parts.items()},
        [],
        {},
        [],
        [],
        "",
    ), None


def _estimates(part: Mapping[str, Estimate], what: str) -> dict[str, Any]:
    """Return numbers by score: a value that is none is infinite."""
    found = {key: getattr(estimate, what) for key, estimate in part.items()}
    if what == "value":
        return {key: float("inf") if number is None else number for key, number in found.items()}
    return {key: number for key, number in found.items() if number is not None}

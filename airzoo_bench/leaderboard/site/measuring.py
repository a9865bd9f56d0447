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
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.parallel import parallel_map
from airzoo_bench.core.validation import validated
from airzoo_bench.core.version import __version__
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answer import Estimate, SealedAnswer
from airzoo_bench.leaderboard.site.entries import Entry
from airzoo_bench.leaderboard.site.measured import OVERALL, RESAMPLING, Measured
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.results.sampling import make_sample, score_intervals
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)

__all__ = ["measure_all"]

_FORMAT = "1"
_SPREAD = 32  # fewer are measured before another process has started


def measure_all(
    entries: Sequence[Entry], cache: Path, jobs: int = 1
) -> list[tuple[Measured, Path] | SubmissionError]:
    """Measure entries, those that changed since the last build anew.

    Parameters
    ----------
    entries : sequence of Entry
    cache : Path
        A folder; what is missing in it is made again.
    jobs : int
        Processes.

    Returns
    -------
    list
        For each entry its numbers and the file of its array (V, N) of headline scores, which is
        not there of a sealed one; or what is wrong with it.
    """
    files = [cache / f"{_key(entry)}.json" for entry in entries]
    missing = [
        (entry.file, file) for entry, file in zip(entries, files, strict=True) if not file.is_file()
    ]
    jobs = jobs if len(missing) >= _SPREAD else 1
    failed = {
        file: error
        for (_, file), error in zip(missing, parallel_map(_store, missing, jobs), strict=True)
        if error is not None
    }
    return [
        SubmissionError(**failed[file])
        if file in failed
        else (_load(file), file.with_suffix(".npy"))
        for file in files
    ]


def _key(entry: Entry) -> str:
    return hashlib.sha256(f"{_FORMAT} {__version__} {entry.digest}".encode()).hexdigest()


def _load(file: Path) -> Measured:
    return Measured(**json.loads(file.read_text(encoding="utf-8")))


def _store(asked: tuple[Path, Path]) -> dict[str, Any] | None:
    """Measure one and keep it; the error as what makes it, since it comes from another process."""
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
        with atomic_write(file.with_suffix(".npy")) as stream:
            np.save(stream, values, allow_pickle=False)
    with atomic_write(file, "w") as stream:  # last: where it stands, both do
        json.dump(asdict(found), stream)
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

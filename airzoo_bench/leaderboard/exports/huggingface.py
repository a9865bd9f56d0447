"""Results as a dataset repository for Hugging Face, with the files of its community evaluations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_entries
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.exports.templates import rendered
from airzoo_bench.leaderboard.fields import known_licence
from airzoo_bench.results.comparable import check_comparable
from airzoo_bench.results.files import method_names, result_paths
from airzoo_bench.results.records import Scored, read_scored
from airzoo_bench.results.result import ScoreColumn, write_result
from airzoo_bench.results.sampling import score_intervals
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import methods_table
from airzoo_bench.tables.method_table import OVERALL, as_shown
from airzoo_bench.tables.render import render

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ENTRIES", "HubTarget", "export_huggingface"]

ENTRIES = ("dataset", "models")
"""What an export leaves in its folder."""

_REPOSITORY = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,95}/[A-Za-z0-9][A-Za-z0-9._-]{0,95}\Z")
_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (10**6, "100K<n<1M"))
_LARGER = "n>1M"
_DIGITS = 4
_OF_HUB = ("cc", "c-uda", "odbl", "odc-by", "openrail", "openrail++", "pddl", "other", "unknown")
"""Licences of data that the hub calls otherwise than SPDX, or that have no id there."""


@dataclass(frozen=True)
class HubTarget:
    """Where results go.

    Attributes
    ----------
    repository : str
        Of the dataset, ``ORGANISATION/NAME``.
    licence : str
        Of the results: an id of SPDX, in any case, or one of the hub's own.
    framework : str
        The evaluation framework, which must be on the hub's list for ``eval.yaml`` to be taken.
    source : str or None
        An address that model pages link to.
    """

    repository: str
    title: str
    licence: str
    framework: str
    source: str | None = None


@dataclass(frozen=True)
class _Task:
    """A protocol with the methods that it scored, and the score that its leaderboard shows."""

    id: str
    methods: list[Scored]
    intervals: list[dict[str, list[Interval]]]
    score: ScoreColumn

    @property
    def title(self) -> str:
        return f"{self.methods[0].result.truth.benchmark}, {self.methods[0].result.track}"

    @property
    def version(self) -> int:
        return self.methods[0].result.protocol.version

    @property
    def fingerprint(self) -> str:
        return self.methods[0].result.protocol.fingerprint

    @property
    def truth(self) -> str:
        return self.methods[0].result.truth.fingerprint

    @property
    def table(self) -> str:
        return render(methods_table([method.result for method in self.methods]), "markdown")


def export_huggingface(paths: Sequence[Path], out: Path, target: HubTarget) -> list[Path]:
    """Write a dataset repository of results, and for each method what its model repository takes.

    Parameters
    ----------
    paths : sequence of Path
        Of results with their records, or of the folders that hold one.
    out : Path
        A folder; an earlier export in it is replaced, all or none.
    target : HubTarget

    Raises
    ------
    UserError
        A result cannot be read; two of one protocol do not measure the same; the name of the
        repository or the licence is none; the folder cannot be written.
    """
    if not _REPOSITORY.match(target.repository):
        raise UsageError(
            f"--dataset {target.repository!r} is no dataset",
            expected="ORGANISATION/NAME, such as airzoo/leaderboard",
        )
    target = replace(target, licence=_licence(target.licence))
    methods = _named(paths)
    tasks = _tasks(methods)
    with atomic_entries(out, ENTRIES) as staged:
        _write_dataset(staged / "dataset", methods, tasks, target)
        for folder, entries in _model_entries(tasks, target).items():
            path = staged / "models" / folder / ".eval_results"
            path.mkdir(parents=True)
            name = f"{target.repository.rpartition('/')[2]}.yaml"
            text = rendered("huggingface/eval_results.yaml", entries=entries, source=target.source)
            (path / name).write_text(text, encoding="utf-8")
    return [out / name for name in ENTRIES]


def _named(paths: Sequence[Path]) -> list[Scored]:
    """Read results; those of a method on several protocols have one name."""
    methods = read_scored(paths)
    names = method_names(result_paths(paths), [method.result for method in methods])
    return [replace(method, name=name) for method, name in zip(methods, names, strict=True)]


def _tasks(methods: Sequence[Scored]) -> list[_Task]:
    by_protocol: dict[str, list[Scored]] = {}
    for method in methods:
        by_protocol.setdefault(method.result.protocol.name, []).append(method)
    return [_task(name, found) for name, found in sorted(by_protocol.items())]


def _task(name: str, methods: list[Scored]) -> _Task:
    check_comparable([method.name for method in methods], [method.result for method in methods])
    columns = methods[0].result.columns
    # Its leaderboards have one number, and sort the highest first.
    shares = [c for c in columns if c.headline and c.unit == "share" and c.higher_is_better]
    if not shares:
        raise UsageError(f"protocol {name} has no headline score of which higher is better")
    return _Task(name, methods, [_intervals(method) for method in methods], shares[0])


def _intervals(method: Scored) -> dict[str, list[Interval]]:
    """Return intervals by scene, and `OVERALL`, in the order of the result's columns."""
    found = score_intervals(method, method.result.columns, ResamplingConfig())
    return {OVERALL: found.overall} | found.groups


def _write_dataset(
    folder: Path, methods: Sequence[Scored], tasks: list[_Task], target: HubTarget
) -> None:
    (folder / "data").mkdir(parents=True)
    rows = _rows(tasks)
    rows.to_parquet(folder / "data" / "results.parquet", index=False)
    for number, method in enumerate(methods, 1):
        result = method.result
        write_result(folder / "results" / result.protocol.name / f"{number:03d}.json", result)
    values = {
        "title": target.title,
        "licence": target.licence,
        "framework": target.framework,
        "tasks": tasks,
        "methods": counted(len({method.name for method in methods}), "method"),
        "size": next((size for most, size in _SIZES if len(rows) < most), _LARGER),
        "description": "Aerial 3D vision, scored by airzoo-bench: "
        + "; ".join(f"{task.id} by {task.score.title}" for task in tasks),
        "version": __version__,
    }
    for name in ("README.md", "eval.yaml"):
        text = rendered(f"huggingface/{name}", **values)
        (folder / name).write_text(text, encoding="utf-8")


def _licence(given: str) -> str:
    """Return a licence as the hub writes it, which has SPDX's ids in small letters."""
    found = given.strip().lower()
    if found in _OF_HUB:
        return found
    try:
        known = known_licence(given)
    except ValueError:
        known = ""
    if not known or " " in known or known.startswith("LicenseRef-"):
        raise UsageError(
            f"the hub knows no licence {given!r}",
            where="--licence",
            expected="one id of SPDX, such as cc-by-4.0, or of the hub's own: "
            + ", ".join(_OF_HUB),
            fix="name the licence of the results; `other` where it has no id",
        )
    return known.lower()


def _rows(tasks: list[_Task]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        row
        for task in tasks
        for method, intervals in zip(task.methods, task.intervals, strict=True)
        for row in _rows_of(method, intervals)
    ]
    return pd.DataFrame(rows).astype({"low": float, "high": float})


def _rows_of(method: Scored, intervals: dict[str, list[Interval]]) -> list[dict[str, object]]:
    result = method.result
    fixed: dict[str, object] = {
        "benchmark": result.truth.benchmark,
        "track": result.track,
        "protocol": result.protocol.name,
        "protocol_version": result.protocol.version,
        "protocol_fingerprint": result.protocol.fingerprint,
        "truth_fingerprint": result.truth.fingerprint,
        "method": method.name,
        "predictions_sha256": result.predictions.sha256,
        "airzoo_bench": result.versions["airzoo-bench"],
    }
    rows = []
    for scene, values in {OVERALL: result.overall, **result.scenes}.items():
        spans = intervals.get(scene, [None] * len(result.columns))
        for column, span in zip(result.columns, spans, strict=True):
            rows.append(
                fixed
                | {
                    "scene": "overall" if scene == OVERALL else scene,
                    "score": column.key,
                    "title": column.title,
                    "unit": column.unit,
                    "higher_is_better": column.higher_is_better,
                    "value": values[column.key],
                    "low": None if span is None else span.low,
                    "high": None if span is None else span.high,
                }
            )
    return rows


def _model_entries(tasks: list[_Task], target: HubTarget) -> dict[str, list[dict[str, object]]]:
    """Return the entries of each method, by a folder's name that is made of the method's."""
    by_method: dict[str, list[dict[str, object]]] = {}
    for task in tasks:
        place = [column.key for column in task.methods[0].result.columns].index(task.score.key)
        for method, intervals in zip(task.methods, task.intervals, strict=True):
            value = as_shown(task.score, method.result.overall[task.score.key])
            entry = {
                "dataset": target.repository,
                "task": task.id,
                "value": round(value, _DIGITS),
                "notes": _notes(task.score, intervals[OVERALL][place], method),
            }
            by_method.setdefault(method.name, []).append(entry)
    named = enumerate(by_method.items(), 1)
    return {f"{number:03d}-{_slug(name)}": entries for number, (name, entries) in named}


def _slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:48] or "method"


def _notes(score: ScoreColumn, interval: Interval, method: Scored) -> str:
    span = "no interval"
    if interval.low is not None and interval.high is not None:
        low, high = (as_shown(score, limit) for limit in (interval.low, interval.high))
        span = f"95 % interval {low:.2f} to {high:.2f}"
    protocol = method.result.protocol
    return (
        f"{score.title} [%], {span}; {protocol.name} v{protocol.version}, airzoo-bench "
        + (method.result.versions["airzoo-bench"])
    )

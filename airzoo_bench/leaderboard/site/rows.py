"""Rows of the board's tables, from submissions, plain results, papers and floors."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.site.api import Finding, Row, Score
from airzoo_bench.leaderboard.site.entries import Entry
from airzoo_bench.leaderboard.site.kept_files import kept_row
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.intervals import score_texts
from airzoo_bench.tables.method_table import MethodRow

__all__ = [
    "Scored",
    "Scores",
    "floor_row",
    "overall_scores",
    "reported_row",
    "reported_scores",
    "scored_row",
    "scores_of",
    "slugs",
]

Scores = dict[str, dict[str, Score]]
"""By scene, `OVERALL` for the average, then by score."""

_NORMAL = 1.959964
_NOT_PLAIN = re.compile(r"[^a-z0-9]+")
_LONGEST = 40


@dataclass(frozen=True)
class Scored:
    """An entry with its numbers, and the name of its row."""

    id: str
    entry: Entry
    measured: Measured
    array: Path

    def values(self, key: str) -> Floats:
        """Return the values (N,) of a headline score."""
        place, count = self.measured.place(key), sum(units for _, units in self.measured.groups)
        found = kept_row(self.array, place, count)
        if found is None:
            raise SubmissionError(
                "is damaged: a build kept it",
                where=self.array,
                fix=f"delete the folder {self.array.parent}; all in it is made again",
            )
        return found

    @property
    def method(self) -> str:
        """The method's name in tables."""
        given = self.entry.submission
        return self.measured.method if given is None else given.method


def slugs(methods: Sequence[str], taken: Iterable[str] = ()) -> list[str]:
    """Make names for paths: the same for a method whatever its place among the others."""
    plain = [_plain(method) for method in methods]
    times = Counter([*plain, *(name.casefold() for name in taken)])
    return [
        name if times[name] == 1 else f"{name}-{hashlib.sha256(method.encode()).hexdigest()[:8]}"
        for name, method in zip(plain, methods, strict=True)
    ]


def _plain(method: str) -> str:
    letters = unicodedata.normalize("NFKD", method).encode("ascii", "ignore").decode().lower()
    return _NOT_PLAIN.sub("-", letters).strip("-")[:_LONGEST].strip("-") or "method"


def overall_scores(measured: Measured) -> dict[str, Score]:
    """Return the averages of a result, without rank ranges."""
    average = replace(measured, values={OVERALL: measured.values[OVERALL]})
    return scores_of(measured.score_columns, average)[OVERALL]


def scores_of(
    columns: Sequence[ScoreColumn],
    measured: Measured,
    ranges: Mapping[str, Floats | Any] | None = None,
    place: int = 0,
) -> Scores:
    """Return the scores of a result, with its rank ranges on the average."""
    return {
        scene: {
            column.key: _score(column, scene, measured, ranges or {}, place)
            for column in columns
            if column.key in part
        }
        for scene, part in measured.values.items()
    }


def _score(
    column: ScoreColumn,
    scene: str,
    measured: Measured,
    ranges: Mapping[str, Any],
    place: int,
) -> Score:
    value = measured.values[scene][column.key]
    error = measured.errors.get(scene, {}).get(column.key)
    limits = measured.limits.get(scene, {}).get(column.key)
    if error is not None and np.isfinite(value):
        most = 1.0 if column.unit == "share" else np.inf
        reach = _NORMAL * error
        limits = [max(0.0, value - reach), float(min(most, value + reach))]
    low, high = limits or (None, None)
    rank = None
    if scene == OVERALL and column.key in ranges:
        first, last = ranges[column.key][place]
        rank = (int(first), int(last))
    between = " to ".join(score_texts(column, limits)) if limits else ""
    return Score(value, score_texts(column, [value])[0], low, high, between, rank, error)


def scored_row(scored: Scored, scores: Mapping[str, Score]) -> Row:
    """Return the row of a submission or a plain result."""
    entry, measured, given = scored.entry, scored.measured, scored.entry.submission
    kind = "sealed" if measured.sealed else "re-scored"
    notes = tuple(measured.notes)
    if given is None:
        return Row(scored.id, kind, scored.method, scores, notes=notes)  # type: ignore[arg-type]
    return Row(
        scored.id,
        kind,  # type: ignore[arg-type]
        given.method,
        scores,
        summary=given.summary or "",
        team=given.team,
        authors=given.authors,
        date=given.date.isoformat(),
        paper=given.paper,
        code=given.code,
        weights=given.weights,
        licence=given.licence,
        training_data=given.training_data,
        stages=given.pipeline.stages,
        uses=given.pipeline.uses,
        hardware=None if given.cost is None else given.cost.hardware,
        seconds_per_query=None if given.cost is None else given.cost.seconds_per_query,
        measured_seconds_per_query=entry.measured_seconds_per_query,
        version=entry.number,
        rescored=entry.scored,
        notes=notes,
    )


def reported_scores(columns: Sequence[ScoreColumn], row: MethodRow) -> Scores:
    """Return printed numbers as scores; tables have shares in percent."""
    by_key = {column.key: column for column in columns}
    return {
        scene: {key: _printed(by_key[key], value) for key, value in part.items()}
        for scene, part in row.values.items()
    }


def _printed(column: ScoreColumn, value: float) -> Score:
    raw = value / 100 if column.unit == "share" else value
    return Score(raw, score_texts(column, [raw])[0])


def reported_row(
    name: str, row: MethodRow, scores: Mapping[str, Score], findings: Sequence[Finding]
) -> Row:
    """Return the row of a published method."""
    return Row(name, "reported", row.method, scores, source=row.reported, findings=tuple(findings))


def floor_row(name: str, title: str, meaning: str, scores: Mapping[str, Score]) -> Row:
    """Return the row of what scores without a method."""
    return Row(name, "floor", title, scores, source=meaning)

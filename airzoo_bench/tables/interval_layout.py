"""Intervals in tables: a row each, or next to the numbers of a table of methods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from airzoo_bench.results.floors import notes_of
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.results.sampling import score_intervals
from airzoo_bench.statistics.intervals import Interval, SampleIntervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import AVERAGE
from airzoo_bench.tables.method_table import OVERALL, MethodTable, as_shown
from airzoo_bench.tables.model import (
    Between,
    Cell,
    Column,
    Row,
    Table,
    Uncertainty,
)
from airzoo_bench.tables.wording import (
    INTERVAL_NAMES,
    brackets_note,
    notes_by_reason,
    resampled,
    score_cell,
    score_title,
)

__all__ = ["intervals_table", "with_intervals"]

_ONE_RECORD = "a scene has one record"


@dataclass(frozen=True)
class _Missing:
    """A number without an interval."""

    scene: str
    method: str
    score: str


def with_intervals(
    table: MethodTable,
    methods: Sequence[Scored],
    resampling: ResamplingConfig,
    shown: Sequence[str],
) -> MethodTable:
    """Put intervals next to the numbers of methods, and notes how they were made, or why not."""
    rows = []
    missing: dict[str, list[_Missing]] = {}
    seen: list[Interval] = []
    for row, method in zip(table.rows, methods, strict=True):
        known = {column.key for column in method.result.columns}
        scores = [score for score in table.scores if score.key in known]
        found = score_intervals(method, scores, resampling)
        parts = {OVERALL: found.overall} | found.groups
        spans = {scene: _spans(scores, intervals) for scene, intervals in parts.items()}
        rows.append(replace(row, uncertainties=spans))
        for scene in shown:
            seen += parts.get(scene, [])
            for score, reason in _reasons(scores, parts.get(scene)):
                missing.setdefault(reason, []).append(_Missing(scene, row.method, score.title))
    notes = [
        f"no interval for {_places(table, those)}: {reason}" for reason, those in missing.items()
    ]
    made = brackets_note(seen, resampling, resampled(methods[0].result.unit))
    return replace(table, rows=tuple(rows)).noted(*made, *notes)


def _spans(scores: Sequence[ScoreColumn], intervals: Sequence[Interval]) -> dict[str, Uncertainty]:
    return {
        score.key: Between(as_shown(score, interval.low), as_shown(score, interval.high))
        for score, interval in zip(scores, intervals, strict=True)
        if interval.low is not None and interval.high is not None
    }


def _reasons(
    scores: Sequence[ScoreColumn], intervals: Sequence[Interval] | None
) -> list[tuple[ScoreColumn, str]]:
    if intervals is None:
        return [(score, _ONE_RECORD) for score in scores]
    pairs = zip(scores, intervals, strict=True)
    return [(score, interval.reason) for score, interval in pairs if interval.low is None]


def _places(table: MethodTable, missing: Sequence[_Missing]) -> str:
    """Name numbers in as few words as tell which they are: scenes, in them methods and scores."""
    titles = {**table.scenes, OVERALL: "the average"}
    by_scene: dict[str, dict[str, list[str]]] = {}
    for one in missing:
        by_scene.setdefault(one.scene, {}).setdefault(one.method, []).append(one.score)
    parts: dict[str, list[str]] = {}
    for scene, by_method in by_scene.items():
        parts.setdefault(_which(table, by_method), []).append(titles[scene])
    return "; ".join(", ".join(scenes) + which for which, scenes in parts.items())


def _which(table: MethodTable, by_method: Mapping[str, list[str]]) -> str:
    by_scores: dict[str, list[str]] = {}
    for method, scores in by_method.items():
        every = len(scores) == len(table.scores)
        by_scores.setdefault("" if every else ", ".join(scores), []).append(method)
    parts = []
    for titles, methods in by_scores.items():
        # Of all methods, as of one alone, their names go without saying.
        names = "" if len(methods) == len(table.rows) else ", ".join(methods)
        parts.append(f"{names}: {titles}" if names and titles else names or titles)
    said = "; ".join(filter(None, parts))
    return f" ({said})" if said else ""


def intervals_table(
    method: Scored,
    scores: Sequence[ScoreColumn],
    found: SampleIntervals,
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> Table:
    """Lay out the intervals of one method: a row a scene and score, then the average."""
    result = method.result
    rows = list(_interval_rows(result, scores, found, scene))
    notes = (
        *notes_by_reason(
            ((row.interval.reason, row.score, row.title) for row in rows), "no interval; "
        ),
        *notes_of(result),
        *brackets_note([row.interval for row in rows], resampling, resampled(result.unit)),
    )
    title = f"{method.name} on {result.protocol.name} v{result.protocol.version}"
    columns = (Column("Scene"), Column("Score"), Column("Value"), Column("Interval"))
    return Table(title, columns, tuple(map(_interval_row, rows)), notes, leading=2)


@dataclass(frozen=True)
class _IntervalRow:
    """A row of a table of intervals."""

    title: str
    score: ScoreColumn
    value: float
    interval: Interval
    is_average: bool


def _interval_rows(
    result: Result, scores: Sequence[ScoreColumn], found: SampleIntervals, scene: str | None
) -> Iterator[_IntervalRow]:
    titles = result.truth.scene_titles
    # The average over one scene is that scene: said once.
    one = next(iter(result.scenes)) if len(found.groups) == 1 else None
    scene = one if scene is None else scene
    if scene is None:
        parts = [(titles[name], result.scenes[name], found.groups[name]) for name in found.groups]
        last = (AVERAGE, result.overall, found.overall)
    else:
        parts, last = [], (titles[scene], result.scenes[scene], found.overall)
    for place, (title, values, intervals) in enumerate([*parts, last]):
        is_average = scene is None and place == len(parts)
        for score, interval in zip(scores, intervals, strict=True):
            yield _IntervalRow(title, score, values[score.key], interval, is_average)


def _interval_row(row: _IntervalRow) -> Row:
    cells = (
        Cell(row.title),
        Cell(score_title(row.score)),
        score_cell(row.score, row.value, row.interval),
        Cell(INTERVAL_NAMES.get(row.interval.method)),
    )
    return Row(cells, row.is_average)

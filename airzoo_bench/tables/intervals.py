"""Intervals in tables: a row each, or next to the numbers of methods; how they were made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from airzoo_bench.core.errors import plural
from airzoo_bench.results.comparable import first_names
from airzoo_bench.results.comparison import notes_of, score_intervals
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval, SampleIntervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import AVERAGE
from airzoo_bench.tables.method_table import UNITS, MethodTable, as_shown
from airzoo_bench.tables.model import Between, Cell, Column, Row, Table, share_to_percent
from airzoo_bench.tables.published import OVERALL

_CLOSED = {
    "wilson": "Wilson",
    "mover": "MOVER",
    "student": "Student's t",
    "lognormal": "log-normal",
}
_DRAWN = {"bca": "BCa", "percentile": "percentile"}
_SHOWN = 6


def score_title(score: ScoreColumn) -> str:
    """Return title and unit of a score, for a row."""
    return f"{score.title} [{UNITS[score.unit]}]"


def score_texts(score: ScoreColumn, values: Iterable[float | None]) -> list[str]:
    """Write values of a score as tables do."""
    return [score_cell(score, None if v is None else float(v)).text(2) for v in values]


def score_cell(score: ScoreColumn, value: float | None, interval: Interval | None = None) -> Cell:
    """Return a value as tables show it, with its interval where there is one."""
    if value is None:
        return Cell(None)
    return Cell(as_shown(score, value), uncertainty=_limits(score, interval))


def _limits(score: ScoreColumn, interval: Interval | None) -> Between | None:
    if interval is None or interval.low is None or interval.high is None:
        return None
    return Between(as_shown(score, interval.low), as_shown(score, interval.high))


def resampled(unit: str) -> str:
    """Say what is drawn for the average over scenes, within what."""
    return "queries within scenes" if unit == "query" else plural(unit)


def intervals_made(
    intervals: Iterable[Interval], resampling: ResamplingConfig, drawn: str, what: str = "intervals"
) -> str:
    """Say how intervals were made, by the kinds that there are; empty where there are none."""
    listed = list(intervals)
    made = {interval.method for interval in listed}
    closed = [name for key, name in _CLOSED.items() if key in made]
    by_draws = [name for key, name in _DRAWN.items() if key in made]
    how = [f"{' or '.join(closed)} over {drawn}"] if closed else []
    if by_draws:
        number, seed = resampling.resamples, resampling.seed
        how.append(f"{' or '.join(by_draws)}, {number} resamples of {drawn}, seed {seed}")
    if not how:
        return ""
    if any(one.method == "lognormal" and one.high == math.inf for one in listed):
        how.append("inf: the upper limit is not known, it is above ten times the mean")
    return f"{share_to_percent(resampling.confidence):g} % {what}, {'; '.join(how)}"


def brackets_note(
    intervals: Iterable[Interval], resampling: ResamplingConfig, drawn: str, what: str = "intervals"
) -> list[str]:
    """Explain the square brackets, if there are any."""
    made = intervals_made(intervals, resampling, drawn, what)
    return [f"in square brackets: {made}"] if made else []


def notes_by_reason(
    entries: Iterable[tuple[str, ScoreColumn, str]], prefix: str = "", linked: str = "in"
) -> list[str]:
    """Name each reason, with the scores and the scenes or methods that share it."""
    members: dict[tuple[str, str], list[str]] = {}
    every = dict[str, None]()
    for reason, score, member in entries:
        members.setdefault((reason, score.title), []).append(member)
        every[member] = None
    titles: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (reason, title), those in members.items():
        titles.setdefault((reason, tuple(those)), []).append(title)
    notes = []
    for (reason, shared), scores in titles.items():
        where = "" if len(shared) == len(every) else f" {linked} {first_names(shared)}"
        notes += [f"{first_names(scores, _SHOWN)}{where}: {prefix}{reason}"] if reason else []
    return notes


def with_intervals(
    table: MethodTable,
    methods: Sequence[Scored],
    resampling: ResamplingConfig,
    shown: Sequence[str],
) -> MethodTable:
    """Put intervals next to the numbers of methods, and notes how they were made, or why not."""
    rows, seen = [], list[Interval]()
    missing: dict[str, dict[str, None]] = {}  # titles of scenes by reason
    titles = {**table.scenes, OVERALL: "the average"}
    for row, method in zip(table.rows, methods, strict=True):
        known = {column.key for column in method.result.columns}
        scores = [score for score in table.scores if score.key in known]
        found = score_intervals(method, scores, resampling)
        parts = {OVERALL: found.overall, **found.groups}
        spans = {
            scene: {
                score.key: limits
                for score, interval in zip(scores, intervals, strict=True)
                if (limits := _limits(score, interval))
            }
            for scene, intervals in parts.items()
        }
        rows.append(replace(row, uncertainties=spans))
        without = [Interval.lacking("a scene has one record")]
        for scene in shown:
            seen += parts.get(scene, [])
            for interval in parts.get(scene, without):
                if interval.low is None:
                    missing.setdefault(interval.reason, {})[titles[scene]] = None
    notes = brackets_note(seen, resampling, resampled(methods[0].result.unit))
    notes += [f"no interval for {', '.join(where)}: {why}" for why, where in missing.items()]
    return replace(table.noted(*notes, legend=False), rows=tuple(rows), about_intervals=(*notes,))


def intervals_table(
    method: Scored,
    scores: Sequence[ScoreColumn],
    found: SampleIntervals,
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> Table:
    """Lay out the intervals of one method: a row a scene and score, then the average."""
    result, titles = method.result, method.result.truth.scene_titles
    # The average over one scene is that scene: said once.
    if scene is None and len(found.groups) == 1:
        scene = next(iter(result.scenes))
    if scene is None:
        parts = [(titles[name], result.scenes[name], found.groups[name]) for name in found.groups]
        parts.append((AVERAGE, result.overall, found.overall))
    else:
        parts = [(titles[scene], result.scenes[scene], found.overall)]
    rows, reasons = [], []
    for place, (title, values, intervals) in enumerate(parts):
        is_average = scene is None and place == len(parts) - 1
        for score, interval in zip(scores, intervals, strict=True):
            number = score_cell(score, values[score.key], interval)
            kind = Cell((_CLOSED | _DRAWN).get(interval.method))
            rows.append(Row((Cell(title), Cell(score_title(score)), number, kind), is_average))
            reasons.append((interval.reason, score, title))
    drawn = [interval for *_, part in parts for interval in part]
    return Table(
        f"{method.name} on {result.protocol.name} v{result.protocol.version}",
        (Column("Scene"), Column("Score"), Column("Value"), Column("Interval")),
        tuple(rows),
        (
            *notes_by_reason(reasons, "no interval; "),
            *notes_of(result),
            *brackets_note(drawn, resampling, resampled(result.unit)),
        ),
        leading=2,
    )

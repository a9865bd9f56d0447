"""Intervals next to the numbers of methods, and how they were made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from airzoo_bench.core.errors import plural
from airzoo_bench.results.comparison import score_intervals
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import scenes_table
from airzoo_bench.tables.method_table import UNITS, MethodTable, as_shown, method_table, share_notes
from airzoo_bench.tables.model import Between, Cell, Table, share_to_percent
from airzoo_bench.tables.published import OVERALL

_METHODS = {
    "wilson": "Wilson",
    "mover": "MOVER",
    "student": "Student's t",
    "lognormal": "log-normal",
    "bca": "BCa",
    "percentile": "percentile",
}


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
    listed = [interval for interval in intervals if interval.method]
    made = {interval.method for interval in listed}
    if not made:
        return ""
    names = " or ".join(name for key, name in _METHODS.items() if key in made)
    said = f"{share_to_percent(resampling.confidence):g} % {what}, {names} over {drawn}"
    if made & {"bca", "percentile"}:
        said += f", {resampling.resamples} resamples, seed {resampling.seed}"
    if any(one.method == "lognormal" and one.high == math.inf for one in listed):
        said += "; inf: the upper limit is not known, it is above ten times the mean"
    return said


def brackets_note(
    intervals: Iterable[Interval], resampling: ResamplingConfig, drawn: str, what: str = "intervals"
) -> list[str]:
    """Explain the square brackets, if there are any."""
    made = intervals_made(intervals, resampling, drawn, what)
    return [f"in square brackets: {made}"] if made else []


def with_intervals(
    table: MethodTable,
    methods: Sequence[Method],
    resampling: ResamplingConfig,
    shown: Sequence[str],
) -> MethodTable:
    """Put intervals next to the numbers of methods, and notes how they were made, or why not."""
    rows, seen, reasons = [], list[Interval](), list[tuple[str, str]]()
    titles = {**table.scenes, OVERALL: "the average"}
    for row, method in zip(table.rows, methods, strict=True):
        scores = [score for score in table.scores if score in method.result.columns]
        found = score_intervals(method, scores, resampling)
        parts = {OVERALL: found.overall, **found.groups}
        spans: dict[str, dict[str, Between]] = {}
        for scene, intervals in parts.items():
            pairs = ((s.key, _limits(s, i)) for s, i in zip(scores, intervals, strict=True))
            spans[scene] = {key: limits for key, limits in pairs if limits}
        rows.append(replace(row, uncertainties=spans))
        for scene in shown:
            intervals = parts.get(scene, [Interval.lacking("a scene has one record")])
            seen += intervals
            whys = (f"no interval: {one.reason}" for one in intervals if one.low is None)
            reasons += [(titles[scene], why) for why in whys]
    notes = brackets_note(seen, resampling, resampled(methods[0].result.unit))
    return replace(table, rows=tuple(rows)).with_notes(*notes, *share_notes(reasons))


def intervals_table(
    method: Method, scores: Sequence[ScoreColumn], resampling: ResamplingConfig
) -> Table:
    """Lay out one method by scene, with intervals."""
    methods = replace(method_table([method.result]), scores=tuple(scores))
    shown = [*methods.scenes, OVERALL]
    return scenes_table(method.result, methods=with_intervals(methods, [method], resampling, shown))

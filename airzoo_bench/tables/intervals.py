"""Intervals in tables: a row each, or next to the numbers of methods; how they were made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from airzoo_bench.core.errors import plural
from airzoo_bench.results.comparable import first_names
from airzoo_bench.results.comparison import notes_of, score_intervals
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval, SampleIntervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import AVERAGE
from airzoo_bench.tables.method_table import OVERALL, UNITS, MethodTable, as_shown
from airzoo_bench.tables.model import (
    Between,
    Cell,
    Column,
    Row,
    Table,
    share_to_percent,
    show_number,
)

__all__ = [
    "brackets_note",
    "intervals_made",
    "intervals_table",
    "notes_by_reason",
    "resampled",
    "score_cell",
    "score_texts",
    "score_title",
    "with_intervals",
]

_NAMES = {
    "wilson": "Wilson",
    "mover": "MOVER",
    "student": "Student's t",
    "lognormal": "log-normal",
    "bca": "BCa",
    "percentile": "percentile",
}
_DRAWN = ("bca", "percentile")
_SHOWN = 6
_ONE_RECORD = "a scene has one record"


def score_title(score: ScoreColumn) -> str:
    """Return title and unit of a score whose numbers stand in rows."""
    return f"{score.title} [{UNITS[score.unit]}]"


def score_texts(score: ScoreColumn, values: Iterable[float | None]) -> list[str]:
    """Write values of a score as tables do."""
    return ["–" if v is None else show_number(as_shown(score, float(v)), 2) for v in values]


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
    closed = " or ".join(n for key, n in _NAMES.items() if key in made and key not in _DRAWN)
    by_draws = " or ".join(n for key, n in _NAMES.items() if key in made and key in _DRAWN)
    how = [f"{closed} over {drawn}"] if closed else []
    if by_draws:
        number, seed = resampling.resamples, resampling.seed
        how.append(f"{by_draws}, {number} resamples of {drawn}, seed {seed}")
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
    """Name each reason once, with the scores, scenes or methods that share it."""
    listed = list(entries)
    every_score = list(dict.fromkeys(score.title for _, score, _ in listed))
    every_member = list(dict.fromkeys(member for *_, member in listed))
    found: dict[str, dict[str, list[str]]] = {}
    for reason, score, member in listed:
        found.setdefault(reason, {}).setdefault(score.title, []).append(member)
    notes = []
    for reason, members_of in found.items():
        by_members: dict[tuple[str, ...], list[str]] = {}
        for title, members in members_of.items():
            by_members.setdefault(tuple(members), []).append(title)
        parts = []
        for those, titles in by_members.items():
            every = titles == every_score and len(titles) > 1
            named = "all scores" if every else first_names(titles, _SHOWN)
            where = "" if [*those] == every_member else f" {linked} {first_names(those)}"
            parts.append(named + where)
        notes += [f"{'; '.join(parts)}: {prefix}{reason}"] if reason else []
    return notes


def with_intervals(
    table: MethodTable,
    methods: Sequence[Scored],
    resampling: ResamplingConfig,
    shown: Sequence[str],
) -> MethodTable:
    """Put intervals next to the numbers of methods, and notes how they were made, or why not."""
    rows, seen = [], []
    missing: dict[str, dict[str, dict[str, list[str]]]] = {}  # by reason, scene, method: scores
    for row, method in zip(table.rows, methods, strict=True):
        known = {column.key for column in method.result.columns}
        scores = [score for score in table.scores if score.key in known]
        found = score_intervals(method, scores, resampling)
        parts = {OVERALL: found.overall} | found.groups
        spans = {
            scene: {
                score.key: limits
                for score, interval in zip(scores, intervals, strict=True)
                if (limits := _limits(score, interval))
            }
            for scene, intervals in parts.items()
        }
        rows.append(replace(row, uncertainties=spans))
        without = [Interval(None, None, "", _ONE_RECORD)] * len(scores)
        for scene in shown:
            seen += parts.get(scene, [])
            for score, interval in zip(scores, parts.get(scene, without), strict=True):
                if interval.low is None:
                    scenes = missing.setdefault(interval.reason, {})
                    scenes.setdefault(scene, {}).setdefault(row.method, []).append(score.title)
    notes = [f"no interval for {_places(table, places)}: {why}" for why, places in missing.items()]
    made = brackets_note(seen, resampling, resampled(methods[0].result.unit))
    return replace(table, rows=tuple(rows)).noted(*made, *notes)


def _places(table: MethodTable, by_scene: Mapping[str, Mapping[str, list[str]]]) -> str:
    """Name numbers in as few words as tell which they are: scenes, in them methods and scores."""
    titles = {**table.scenes, OVERALL: "the average"}
    parts: dict[str, list[str]] = {}
    for scene, by_method in by_scene.items():
        by_scores: dict[str, list[str]] = {}
        for method, scores in by_method.items():
            named = "" if len(scores) == len(table.scores) else ", ".join(scores)
            by_scores.setdefault(named, []).append(method)
        which = []
        for named, methods in by_scores.items():
            # Of all methods, as of one alone, their names go without saying.
            names = "" if len(methods) == len(table.rows) else ", ".join(methods)
            which.append(": ".join(filter(None, [names, named])))
        said = "; ".join(filter(None, which))
        parts.setdefault(f" ({said})" if said else "", []).append(titles[scene])
    return "; ".join(", ".join(scenes) + which for which, scenes in parts.items())


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
            kind = Cell(_NAMES.get(interval.method))
            rows.append(Row((Cell(title), Cell(score_title(score)), number, kind), is_average))
            reasons.append((interval.reason, score, title))
    notes = (
        *notes_by_reason(reasons, "no interval; "),
        *notes_of(result),
        *brackets_note(
            [interval for *_, part in parts for interval in part],
            resampling,
            resampled(result.unit),
        ),
    )
    return Table(
        f"{method.name} on {result.protocol.name} v{result.protocol.version}",
        (Column("Scene"), Column("Score"), Column("Value"), Column("Interval")),
        tuple(rows),
        notes,
        leading=2,
    )

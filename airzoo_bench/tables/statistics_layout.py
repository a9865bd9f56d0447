"""Intervals and bounds as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from airzoo_bench.core.plurals import counted
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.statistics.intervals import Interval, SampleIntervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.model import Cell, Column, Row, Table, share_to_percent
from airzoo_bench.tables.printed_comparison import Bounds, hit_rate_interval
from airzoo_bench.tables.verdicts import LEAST_P, bounds_verdict
from airzoo_bench.tables.wording import (
    INTERVAL_NAMES,
    brackets_note,
    by_reason,
    resampled,
    score_cell,
    score_title,
)

__all__ = ["bounds_table", "intervals_table"]

_AVERAGE = "Average"


def intervals_table(
    method: Scored,
    scores: Sequence[ScoreColumn],
    found: SampleIntervals,
    plan: ResamplingConfig,
    scene: str | None = None,
) -> Table:
    """Lay out the intervals of one method: a row a scene and score, then the average.

    Parameters
    ----------
    method : Scored
    scores : sequence of ScoreColumn
    found : SampleIntervals
        From `score_intervals`, of the same scores and scene.
    plan : ResamplingConfig
    scene : str, optional
        This scene's rows only.
    """
    result = method.result
    entries = list(_entries(result, scores, found, scene))
    without = by_reason((entry.interval.reason, entry.score, entry.title) for entry in entries)
    notes = (
        *(f"{names}: no interval; {reason}" for reason, names in without.items() if reason),
        *result.notes,
        *brackets_note([entry.interval for entry in entries], plan, resampled(result.unit)),
    )
    title = f"{method.name} on {result.protocol.name} v{result.protocol.version}"
    columns = (Column("Scene"), Column("Score"), Column("Value"), Column("Interval"))
    return Table(title, columns, tuple(map(_interval_row, entries)), notes, leading=2)


@dataclass(frozen=True)
class _Entry:
    """A row of a table of intervals."""

    title: str
    score: ScoreColumn
    value: float
    interval: Interval
    is_average: bool


def _entries(
    result: Result, scores: Sequence[ScoreColumn], found: SampleIntervals, scene: str | None
) -> Iterator[_Entry]:
    titles = result.truth.scene_titles
    # The average over one scene is that scene: said once.
    one = next(iter(result.scenes)) if len(found.groups) == 1 else None
    scene = one if scene is None else scene
    if scene is None:
        parts = [(titles[name], result.scenes[name], found.groups[name]) for name in found.groups]
        last = (_AVERAGE, result.overall, found.overall)
    else:
        parts, last = [], (titles[scene], result.scenes[scene], found.overall)
    for place, (title, values, intervals) in enumerate([*parts, last]):
        is_average = scene is None and place == len(parts)
        for score, interval in zip(scores, intervals, strict=True):
            yield _Entry(title, score, values[score.key], interval, is_average)


def _interval_row(entry: _Entry) -> Row:
    cells = (
        Cell(entry.title),
        Cell(score_title(entry.score)),
        score_cell(entry.score, entry.value, entry.interval),
        Cell(INTERVAL_NAMES.get(entry.interval.method)),
    )
    return Row(cells, entry.is_average)


def bounds_table(first: str, second: str, bounds: Bounds) -> Table:
    """Lay out what two printed hit rates can mean, with a verdict.

    Parameters
    ----------
    first, second : str
        As printed.
    bounds : Bounds
        From `printed_bounds`.
    """
    cases = (
        ("hits overlap the most", bounds.least),
        ("hits overlap the least", bounds.most),
    )
    columns = (
        Column("If"),
        Column(f"Only {first} hits"),
        Column(f"Only {second} hits"),
        Column("p, McNemar", decimals=4),
    )
    rows = tuple(
        Row((Cell(name), Cell(one), Cell(other), Cell(p, least=LEAST_P)))
        for name, (one, other, p) in cases
    )
    title = f"{first} % against {second} % on {counted(bounds.queries, 'query')}"
    rates = [
        _rate(text, counts, bounds.queries)
        for text, counts in zip((first, second), bounds.counts, strict=True)
    ]
    return Table(title, columns, rows, (bounds_verdict(first, second, bounds), *rates))


def _rate(text: str, counts: range, queries: int) -> str:
    limits = hit_rate_interval(counts[0], queries)[0], hit_rate_interval(counts[-1], queries)[1]
    hits = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    low, high = (share_to_percent(float(limit)) for limit in limits)
    return (
        f"{text} % is {hits} of {queries}; on its own between {low:.2f} and {high:.2f} % "
        "(95 %, Clopper and Pearson)"
    )

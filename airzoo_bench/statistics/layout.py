"""Intervals and bounds as tables."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.records import Scored
from airzoo_bench.result import ScoreColumn
from airzoo_bench.statistics.intervals import Bootstrap, Interval
from airzoo_bench.statistics.printed import Bounds, hit_rate_interval
from airzoo_bench.statistics.samples import Plan
from airzoo_bench.statistics.verdicts import bounds_verdict
from airzoo_bench.statistics.wording import (
    INTERVAL_NAMES,
    brackets_note,
    by_reason,
    score_cell,
    score_title,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table, share_to_percent

__all__ = ["bounds_table", "intervals_table"]

_AVERAGE = "Average"


def intervals_table(
    method: Scored,
    scores: Sequence[ScoreColumn],
    found: Bootstrap,
    plan: Plan,
    scene: str | None = None,
) -> Table:
    """Lay out the intervals of one method: a row a scene and score, then the average.

    Parameters
    ----------
    method : Scored
    scores : sequence of ScoreColumn
    found : Bootstrap
        From `score_intervals`, of the same scores and scene.
    plan : Plan
    scene : str, optional
        This scene's rows only.
    """
    result, titles = method.result, method.result.truth.scene_titles
    last = (_AVERAGE, result.overall) if scene is None else (titles[scene], result.scenes[scene])
    parts = [
        (titles[name], result.scenes[name], intervals)
        for name, intervals in (found.groups.items() if scene is None else ())
    ]
    entries = [
        (title, score, values[score.key], interval)
        for title, values, intervals in [*parts, (*last, found.overall)]
        for score, interval in zip(scores, intervals, strict=True)
    ]
    rows = tuple(
        _interval_row(*entry, summary=entry[0] == _AVERAGE and scene is None) for entry in entries
    )
    columns = (Column("Scene"), Column("Score"), Column("Value"), Column("Interval"))
    without = by_reason((interval.reason, score, title) for title, score, _, interval in entries)
    unit = "scenes" if result.track == "reconstruction" else "queries within scenes"
    notes = (
        *(f"{names}: no interval; {reason}" for reason, names in without.items() if reason),
        *result.notes,
        *brackets_note([interval for *_, interval in entries], plan, unit),
    )
    title = f"{method.name} on {result.protocol.name} v{result.protocol.version}"
    return Table(title, columns, rows, notes, leading=2)


def _interval_row(
    title: str, score: ScoreColumn, value: float, interval: Interval, *, summary: bool
) -> Row:
    cells = (
        Cell(title),
        Cell(score_title(score)),
        score_cell(score, value, interval),
        Cell(INTERVAL_NAMES.get(interval.method)),
    )
    return Row(cells, summary)


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
    rows = tuple(Row((Cell(name), *map(Cell, values))) for name, values in cases)
    title = f"{first} % against {second} % on {bounds.queries} queries"
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

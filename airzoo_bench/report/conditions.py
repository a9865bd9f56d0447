"""Scores by condition, as a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.breakdown import Grouping, condition_title, group_averages, group_records
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.records import Scored
from airzoo_bench.result import ScoreColumn
from airzoo_bench.statistics.intervals import bootstrap
from airzoo_bench.statistics.samples import Plan, Sample
from airzoo_bench.tables.model import Cell, Column, Row, Table, mark_best, share_to_percent

__all__ = ["breakdown_table"]

_UNITS = {"share": "%", "m": "m", "deg": "deg"}


def breakdown_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    by: str,
    *,
    bins: Sequence[float] | None = None,
    plan: Plan,
) -> Table:
    """Lay out scores by group: over all queries of the group, whatever their scene.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries.
    scores : sequence of ScoreColumn
        Of one method, all are columns, and the interval too where there is one score; of several
        methods, a column a method shows the first score.
    by, bins
        See `group_records`.
    plan : Plan
        Of the intervals.
    """
    grouping = group_records(methods[0].records, by, bins)
    alone = len(methods) == 1
    shown = list(scores) if alone else [scores[0]]
    columns = [m.records[s.key].to_numpy(np.float64) for s in shown for m in methods]
    medians = np.array([s.average == "median" for s in shown for _ in methods], np.bool_)
    values = np.array(columns).reshape(len(columns), len(grouping.codes))
    averages = group_averages(values, medians, grouping.codes, len(grouping.labels))
    units = [s.unit for s in shown for _ in methods]
    unit_name = "Scenes" if methods[0].result.track == "reconstruction" else "Queries"
    heads = [_score_head(s, s.title if alone else m.name) for s in shown for m in methods]
    rows = [
        [Cell(label), Cell(int(count)), *map(_cell, units, averages[:, group])]
        for group, (label, count) in enumerate(
            zip(_shown_labels(methods[0], grouping), grouping.counts, strict=True)
        )
    ]
    notes = [f"each value over all {unit_name.lower()} of its group, whatever their scene"]
    if alone and len(shown) == 1:
        heads += [*(Column(title, _UNITS[shown[0].unit]) for title in ("95 % from", "to"))]
        limits, reasons = _intervals(values, medians, grouping, plan, unit_name)
        rows = [
            [*row, *map(_cell, units * 2, limit)] for row, limit in zip(rows, limits, strict=True)
        ]
        notes += reasons
    table = Table(
        _title(methods, shown, by),
        (Column(condition_title(by)), Column(unit_name), *heads),
        tuple(Row(tuple(row)) for row in rows),
        tuple(notes),
    )
    return table if alone else _best_of_rows(table, shown[0])


def _shown_labels(method: Scored, grouping: Grouping) -> list[str]:
    titles = method.result.truth.scene_titles if grouping.by == "scene" else {}
    return [titles.get(label, label) for label in grouping.labels]


def _title(methods: Sequence[Scored], scores: Sequence[ScoreColumn], by: str) -> str:
    protocol = methods[0].result.protocol
    what = methods[0].name if len(methods) == 1 else f"{scores[0].title} of {len(methods)} methods"
    return f"{what} by {condition_title(by)}, {protocol.name} v{protocol.version}"


def _score_head(score: ScoreColumn, title: str) -> Column:
    return Column(title, _UNITS[score.unit], score.higher_is_better)


def _cell(unit: str, value: float) -> Cell:
    if np.isnan(value):
        return Cell(None)
    return Cell(share_to_percent(float(value)) if unit == "share" else float(value))


def _intervals(
    values: Floats, medians: NDArray[np.bool_], grouping: Grouping, plan: Plan, unit_name: str
) -> tuple[list[tuple[float, float]], list[str]]:
    """Return the limits of each group, NaN where there are none, and why not."""
    parts = tuple(
        np.ascontiguousarray(values[:, grouping.codes == group])
        for group in range(len(grouping.labels))
    )
    unit = "scene" if unit_name == "Scenes" else "query"
    found = bootstrap(Sample(unit, grouping.labels, parts, medians), plan).groups
    intervals = [found[label][0] for label in grouping.labels]
    limits = [
        (np.nan, np.nan) if i.low is None or i.high is None else (i.low, i.high) for i in intervals
    ]
    reasons = [
        f"{label}: {interval.reason}"
        for label, interval in zip(grouping.labels, intervals, strict=True)
        if interval.reason
    ]
    how = f"{plan.interval}, {plan.resamples} resamples within each group, seed {plan.seed}"
    return limits, [*reasons, f"intervals: {how}"]


def _best_of_rows(table: Table, score: ScoreColumn) -> Table:
    """Mark the best method of each group: the table is turned, marked, and turned back."""
    head = Column("", "", score.higher_is_better)
    rows = []
    for row in table.rows:
        turned = Table("", (head,), tuple(Row((cell,)) for cell in row.cells[2:]))
        best = tuple(marked.cells[0] for marked in mark_best(turned).rows)
        rows.append(Row((*row.cells[:2], *best)))
    return Table(table.title, table.columns, tuple(rows), table.notes)

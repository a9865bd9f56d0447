"""Scores by condition, as a table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import plural
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.comparable import check_same_column
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import pooled_sample
from airzoo_bench.statistics.intervals import FEWEST, Interval
from airzoo_bench.statistics.sample_intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.best_marks import mark_best
from airzoo_bench.tables.breakdown import (
    Grouping,
    condition_title,
    group_averages,
    group_records,
    number_texts,
)
from airzoo_bench.tables.method_table import UNITS
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.wording import (
    brackets_note,
    notes_by_reason,
    score_cell,
    score_title,
)

__all__ = ["breakdown_table", "group_intervals"]


@dataclass(frozen=True, eq=False)
class _Variables:
    """Every score of every method: score by score, in each method by method."""

    methods: Sequence[Scored]
    scores: Sequence[ScoreColumn]

    @property
    def all(self) -> list[tuple[ScoreColumn, Scored]]:
        return [(score, method) for score in self.scores for method in self.methods]

    @property
    def unit(self) -> str:
        return self.methods[0].result.unit

    @property
    def plural(self) -> str:
        return plural(self.unit)


def breakdown_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    by: str,
    *,
    bins: Sequence[float] | None = None,
    resampling: ResamplingConfig | None = None,
) -> Table:
    """Lay out scores by group: over all queries of the group, whatever their scene."""
    check_same_column(methods, by)
    grouping = group_records(methods[0].records, by, bins, keep_empty=True)
    shown = _Variables(methods, scores)
    sample = pooled_sample(methods, scores)
    averages = group_averages(
        sample.values[0], sample.medians, grouping.codes, len(grouping.labels)
    )
    intervals: list[list[Interval]] = []
    if resampling is not None:
        intervals = group_intervals(sample, grouping, resampling)
    labels = _labels(methods[0], grouping)
    about = [] if resampling is None else _about_intervals(shown, labels, intervals, resampling)
    table = Table(
        _title(shown, by),
        (Column(condition_title(by)), Column(shown.plural.capitalize()), *_columns(shown)),
        tuple(
            _rows(shown, zip(labels, grouping.counts.tolist(), strict=True), averages, intervals)
        ),
        (
            *_how(shown, by),
            *_range(methods[0], grouping, shown.plural),
            *_infinite(sample.medians, averages),
            *about,
        ),
        leading=2,
        groups_per_block=len(scores),  # where a page takes them
    )
    return table if len(methods) == 1 else _best_of_rows(table, shown)


def _rows(
    shown: _Variables,
    groups: Iterable[tuple[str, int]],
    averages: Floats,
    intervals: Sequence[Sequence[Interval]],
) -> Iterator[Row]:
    """Lay out a row a group, of label, count, averages (V, G) and intervals, where there are."""
    for place, (label, count) in enumerate(groups):
        found = intervals[place] if intervals else [None] * len(averages)
        values = averages[:, place].tolist() if count else [None] * len(averages)
        entries = zip(shown.all, values, found, strict=True)
        cells = (score_cell(score, value, interval) for (score, _), value, interval in entries)
        yield Row((Cell(label), Cell(count), *cells))


def _columns(shown: _Variables) -> list[Column]:
    several = len(shown.methods) > 1
    group = len(shown.scores) > 1 and several
    return [
        Column(
            method.name if several else score.title,
            UNITS[score.unit],
            score.higher_is_better,
            group=score_title(score) if group else "",
        )
        for score, method in shown.all
    ]


def _labels(method: Scored, grouping: Grouping) -> list[str]:
    titles = method.result.truth.scene_titles if grouping.by == "scene" else {}
    return [titles.get(label, label) for label in grouping.labels]


def _title(shown: _Variables, by: str) -> str:
    protocol = shown.methods[0].result.protocol
    what = shown.methods[0].name
    if len(shown.methods) > 1:
        titles = ", ".join(score.title for score in shown.scores)
        what = f"{titles} of {len(shown.methods)} methods"
    return f"{what} by {condition_title(by)}, {protocol.name} v{protocol.version}"


def _how(shown: _Variables, by: str) -> list[str]:
    if by == "scene":
        return []
    if shown.unit == "scene":
        return ["each value is the mean over the scenes of its group"]
    return ["each value over all queries of its group, whatever their scene"]


def _range(method: Scored, grouping: Grouping, units: str) -> list[str]:
    """Where bins are empty, say between which numbers there is something."""
    values = method.records[grouping.by]
    if grouping.counts.all() or values.isna().all():
        return []
    low, high = number_texts([float(values.min()), float(values.max())])
    return [f"bins without {units}: {condition_title(grouping.by)} is from {low} to {high}"]


def _infinite(by_median: NDArray[np.bool_], averages: Floats) -> list[str]:
    infinite = np.isinf(averages).any(axis=1)
    notes = []
    if (infinite & by_median).any():
        notes.append("inf: half of the group or more failed, so its median is infinite")
    if (infinite & ~by_median).any():
        notes.append("inf: one of the group or more failed, so its mean is infinite")
    return notes


def group_intervals(
    sample: Sample, grouping: Grouping, resampling: ResamplingConfig
) -> list[list[Interval]]:
    """Take the intervals of averages within groups, resampled within each group."""
    values, unit = sample.values[0], sample.unit
    counts = dict(zip(grouping.labels, grouping.counts.tolist(), strict=True))
    filled = [group for group, count in enumerate(counts.values()) if count]
    parts = tuple(np.ascontiguousarray(values[:, grouping.codes == group]) for group in filled)
    named = tuple(grouping.labels[group] for group in filled)
    found = sample_intervals(replace(sample, groups=named, values=parts), resampling).groups
    few = f"fewer than {FEWEST} {plural(unit)}"
    nothing = [Interval(None, None, "")] * len(values)
    return [
        [replace(i, reason=few) if 0 < count < FEWEST else i for i in found.get(label, nothing)]
        for label, count in counts.items()
    ]


def _about_intervals(
    shown: _Variables,
    labels: Sequence[str],
    intervals: list[list[Interval]],
    resampling: ResamplingConfig,
) -> list[str]:
    alone = len(shown.methods) == 1
    reasons = (
        (interval.reason, score, label if alone else f"{label} ({method.name})")
        for label, found in zip(labels, intervals, strict=True)
        for interval, (score, method) in zip(found, shown.all, strict=True)
    )
    within = f"{shown.plural} within each group"
    return [
        *notes_by_reason(reasons, "no interval; "),
        *brackets_note([i for found in intervals for i in found], resampling, within),
    ]


def _best_of_rows(table: Table, shown: _Variables) -> Table:
    """Mark the best method of each group: a score's cells are turned, marked, and put back."""
    count = len(shown.methods)
    rows = []
    for row in table.rows:
        cells = list(row.cells[:2])
        for number, score in enumerate(shown.scores):
            column = Column("", "", score.higher_is_better)
            part = row.cells[2 + number * count : 2 + (number + 1) * count]
            turned = mark_best(Table("", (column,), tuple(Row((cell,)) for cell in part)))
            cells += [marked.cells[0] for marked in turned.rows]
        rows.append(replace(row, cells=tuple(cells)))
    return replace(table, rows=tuple(rows))

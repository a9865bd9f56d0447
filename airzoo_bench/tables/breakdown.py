"""Breakdowns: scores by a condition, a column of the records or bins of a number, as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cache
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.comparable import check_same_column
from airzoo_bench.results.comparison import pooled_sample
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.intervals import brackets_note, notes_by_reason, score_cell, score_title
from airzoo_bench.tables.marks import mark_cells
from airzoo_bench.tables.method_table import UNITS, score_column
from airzoo_bench.tables.model import Cell, Column, Row, Table

UNKNOWN = "unknown"
"""The group of the queries for which a condition has no value."""

_MOST_CATEGORIES = 12
_MOST_BINS = 6
_MOST_GROUPS = 1_000
_SUFFIXES = {"_m": "m", "_deg": "°", "_s": "s", "_px": "px"}
_EDGE_DIGITS = 12
_LEAST_DIGITS, _ALL_DIGITS = 6, 17  # as `:g` has; as tell any two floats apart
_MOST_WHOLE = 10**15  # integers below are written in full


@dataclass(frozen=True, eq=False)
class Grouping:
    """Queries by group of a column.

    The labels (G) are in order, of numbers ascending, of texts alphabetical, `UNKNOWN` last; codes
    (Q,) are the group of each record. Edges are those between which a number was cut into bins.
    """

    by: str
    labels: tuple[str, ...]
    codes: NDArray[np.int64]
    edges: tuple[float, ...] = ()

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many records each group has (G,)."""
        return np.bincount(self.codes, minlength=len(self.labels))

    def without_empty(self, kept: int = 0) -> Grouping:
        """Leave out the groups without records, except the first `kept`."""
        left = np.flatnonzero((self.counts > 0) | (np.arange(len(self.labels)) < kept))
        codes = np.searchsorted(left, self.codes).astype(np.int64)
        return Grouping(self.by, tuple(self.labels[k] for k in left), codes, self.edges)


@cache
def _recorded(track: str) -> frozenset[str]:
    if track not in TRACKS:  # its package is not installed here
        return frozenset(("scene", "query", "answered"))
    return frozenset(load_track(track).recorded)


def is_condition(name: str, track: str) -> bool:
    """Whether a column of a track's records, and no score, tells of queries, not of methods."""
    return not any(fnmatchcase(name, pattern) for pattern in _recorded(track))


def condition_names(method: Scored) -> list[str]:
    """Return the columns of the records that are conditions, and not all of one value."""
    scores = {column.key for column in method.result.columns}
    records = method.records
    return [
        name
        for name in records.columns
        if is_condition(name, method.result.track)
        and name not in scores
        and records[name].nunique(dropna=False) > 1
        and (_is_number(records[name]) or records[name].nunique() <= _MOST_CATEGORIES)
    ]


def condition_title(name: str) -> str:
    """Return a column's name as a heading: ``altitude_m`` becomes ``altitude [m]``."""
    for suffix, unit in _SUFFIXES.items():
        if name.endswith(suffix) and len(name) > len(suffix):
            return f"{name.removesuffix(suffix).replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def even_edges(values: Floats, most: int = _MOST_BINS) -> tuple[float, ...]:
    """Choose round edges, multiples of 1, 2 or 5 times a power of ten, for at most `most` bins.

    The edges ascend; there are none where all values, which are finite, are alike.
    """
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return ()
    power = math.floor(math.log10((high - low) / most))
    for factor in (1, 2, 5, 10, 20):
        step = factor * 10.0**power
        first, last = math.floor(low / step) + 1, math.ceil(high / step)
        if last - first + 1 <= most:
            break
    edges = (float(f"{number * step:.{_EDGE_DIGITS}g}") for number in range(first, last))
    return tuple(edge for edge in edges if low < edge <= high)


def group_records(
    records: pd.DataFrame, by: str, bins: Sequence[float] | None = None, *, keep_empty: bool = False
) -> Grouping:
    """Put records into groups by a column."""
    check_column(records, by)
    column = records[by]
    if bins is not None:
        return _binned(by, column, _checked_bins(by, column, bins), keep_empty)
    if _is_number(column) and column.nunique() > _MOST_CATEGORIES:
        values = column.to_numpy(np.float64)
        return _binned(by, column, even_edges(values[np.isfinite(values)]))
    return _by_category(by, column)


def check_column(records: pd.DataFrame, by: str) -> None:
    """Refuse a column that the records do not have."""
    if by not in records.columns:
        names = [str(name) for name in records.columns]
        raise UsageError(
            f"--by {by}: the records have no such column{nearest(by, names)}",
            expected="one of " + ", ".join(names),
        )


def _is_number(column: pd.Series[str]) -> bool:
    return column.dtype.kind in "iuf"


def _checked_bins(by: str, column: pd.Series[str], bins: Sequence[float]) -> tuple[float, ...]:
    edges = tuple(float(edge) for edge in bins)
    if not _is_number(column):
        raise UsageError(
            f"--bins: {by} is no number",
            expected="a column of numbers, such as altitude_m",
            fix="leave --bins out: every value is then a group",
        )
    if not all(map(math.isfinite, edges)) or list(edges) != sorted(set(edges)) or not edges:
        numbers = ",".join(f"{edge:.15g}" for edge in edges)
        raise UsageError(f"--bins {numbers} do not ascend", expected="edges such as 50,100,200")
    return edges


def _binned(
    by: str, column: pd.Series[str], edges: tuple[float, ...], keep_empty: bool = False
) -> Grouping:
    values = column.to_numpy(np.float64)
    codes = np.searchsorted(np.array(edges), values, side="right").astype(np.int64)
    codes[np.isnan(values)] = len(edges) + 1
    labels = ["all"]
    if edges:
        texts = number_texts(edges)
        between = [f"{low} to {high}" for low, high in pairwise(texts)]
        labels = [f"below {texts[0]}", *between, f"{texts[-1]} and more"]
    found = Grouping(by, (*labels, UNKNOWN), codes, edges)
    return found.without_empty(kept=len(labels) if keep_empty else 0)


def number_texts(values: Sequence[float]) -> list[str]:
    """Write numbers in as few digits, six or more, as tell them apart; whole ones in all."""
    if all(isinstance(v, int) or (v.is_integer() and abs(v) < _MOST_WHOLE) for v in values):
        return [str(int(value)) for value in values]
    for digits in range(_LEAST_DIGITS, _ALL_DIGITS):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len(set(values)):
            return texts
    return [str(value) for value in values]


def _by_category(by: str, column: pd.Series[str]) -> Grouping:
    missing, numbers = column.isna().to_numpy(bool), _is_number(column)
    shown = column.to_numpy() if numbers else column.astype(str).to_numpy(object)
    if not numbers:
        missing = missing | (shown == UNKNOWN)  # who writes it means what an empty field does
    codes_of, values = pd.factorize(shown[~missing], sort=True)
    if len(values) > _MOST_GROUPS:
        many = f"--by {by}: {len(values)} different values are no groups"
        raise UsageError(many, fix="choose a column with fewer values")
    codes = np.full(len(column), len(values), np.int64)
    codes[~missing] = codes_of
    labels = number_texts(values.tolist()) if numbers else values.tolist()
    return Grouping(by, (*labels, UNKNOWN), codes).without_empty()


def group_averages(
    values: Floats, medians: NDArray[np.bool_], codes: NDArray[np.int64], groups: int
) -> Floats:
    """Average variables (V, Q) within groups, (V, G); NaN in empty ones."""
    order = np.argsort(codes, kind="stable")
    counts = np.bincount(codes, minlength=groups)
    parts = np.split(values[:, order], np.cumsum(counts)[:-1], axis=1)
    averages = np.full((len(values), groups), np.nan)
    for group, part in enumerate(parts):
        if part.shape[1]:
            averages[~medians, group] = part[~medians].mean(axis=1)
            averages[medians, group] = np.median(part[medians], axis=1)
    return averages


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
    nothing = [Interval.lacking("")] * len(values)
    return [
        [replace(i, reason=few) if 0 < count < FEWEST else i for i in found.get(label, nothing)]
        for label, count in counts.items()
    ]


def breakdown_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    by: str,
    *,
    bins: Sequence[float] | None = None,
    resampling: ResamplingConfig | None = None,
    grouping: Grouping | None = None,
) -> Table:
    """Lay out scores by group: over all queries of the group, whatever their scene."""
    if grouping is None:
        check_same_column(methods, by)
        grouping = group_records(methods[0].records, by, bins, keep_empty=True)
    sample, result = pooled_sample(methods, scores), methods[0].result
    counts, protocol = grouping.counts.tolist(), result.protocol
    averages = group_averages(sample.values[0], sample.medians, grouping.codes, len(counts))
    intervals = group_intervals(sample, grouping, resampling) if resampling else []
    titles = result.truth.scene_titles if by == "scene" else {}
    labels = [titles.get(label, label) for label in grouping.labels]
    rows = []
    for place, (label, count) in enumerate(zip(labels, counts, strict=True)):
        cells = [Cell(label), Cell(count)]
        for number, score in enumerate(scores):
            race = range(number * len(methods), (number + 1) * len(methods))
            spans = [intervals[place][i] if intervals else None for i in race]
            values = [float(averages[i, place]) if count else None for i in race]
            race_cells = [score_cell(score, *p) for p in zip(values, spans, strict=True)]
            cells += mark_cells(score_column(score), race_cells)
        rows.append(Row(tuple(cells)))
    notes = _notes(methods[0], grouping, sample, averages)
    if resampling is not None:
        notes += _interval_notes(methods, scores, labels, intervals, resampling)
    units, several = plural(result.unit).capitalize(), len(methods) > 1
    what = methods[0].name
    if several:
        what = f"{', '.join(score.title for score in scores)} of {len(methods)} methods"
    return Table(
        f"{what} by {condition_title(by)}, {protocol.name} v{protocol.version}",
        (Column(condition_title(by)), Column(units), *_columns(methods, scores)),
        tuple(rows),
        tuple(notes),
        leading=2,
        groups_per_block=len(scores),  # where a page takes them
    )


def _columns(methods: Sequence[Scored], scores: Sequence[ScoreColumn]) -> list[Column]:
    several = len(methods) > 1
    return [
        Column(
            method.name if several else score.title,
            UNITS[score.unit],
            score.higher_is_better,
            group=score_title(score) if several and len(scores) > 1 else "",
        )
        for score in scores
        for method in methods
    ]


def _notes(method: Scored, grouping: Grouping, sample: Sample, averages: Floats) -> list[str]:
    """Say over which values, between which numbers there is something, why some are infinite."""
    notes, values = [], method.records[grouping.by]
    if grouping.by != "scene":
        notes.append(
            "each value is the mean over the scenes of its group"
            if sample.unit == "scene"
            else "each value over all queries of its group, whatever their scene"
        )
    if not grouping.counts.all() and not values.isna().all():
        low, high = number_texts([float(values.min()), float(values.max())])
        title, units = condition_title(grouping.by), plural(sample.unit)
        notes.append(f"bins without {units}: {title} is from {low} to {high}")
    infinite = np.isinf(averages).any(axis=1)
    if (infinite & sample.medians).any():
        notes.append("inf: half of the group or more failed, so its median is infinite")
    if (infinite & ~sample.medians).any():
        notes.append("inf: one of the group or more failed, so its mean is infinite")
    return notes


def _interval_notes(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    labels: Sequence[str],
    intervals: Sequence[Sequence[Interval]],
    resampling: ResamplingConfig,
) -> list[str]:
    shown = [(score, method) for score in scores for method in methods]
    reasons = [
        (interval.reason, score, label if len(methods) == 1 else f"{label} ({method.name})")
        for label, part in zip(labels, intervals, strict=True)
        for interval, (score, method) in zip(part, shown, strict=True)
    ]
    drawn = f"{plural(methods[0].result.unit)} within each group"
    made = [interval for part in intervals for interval in part]
    return [*notes_by_reason(reasons, "no interval; "), *brackets_note(made, resampling, drawn)]

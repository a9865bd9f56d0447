"""Breakdowns: scores by a condition, a column of the records or bins of a number, as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
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
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.intervals import brackets_note, score_cell, score_title
from airzoo_bench.tables.marks import mark_cells
from airzoo_bench.tables.method_table import UNITS, score_column, share_notes
from airzoo_bench.tables.model import Cell, Column, Row, Table

UNKNOWN = "unknown"
"""The group of the queries for which a condition has no value."""

_MOST_CATEGORIES = 12
_MOST_BINS = 6
_MOST_GROUPS = 1_000
_SUFFIXES = {"_m": "m", "_deg": "°", "_s": "s", "_px": "px"}


@dataclass(frozen=True, eq=False)
class Grouping:
    """Queries by group of a column.

    The labels (G) are in order, of numbers ascending, of texts alphabetical, `UNKNOWN` last; codes
    (Q,) are the group of each record.
    """

    labels: tuple[str, ...]
    codes: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many records each group has (G,)."""
        return np.bincount(self.codes, minlength=len(self.labels))


def is_condition(name: str, track: str) -> bool:
    """Whether a column of a track's records, and no score, tells of queries, not of methods."""
    # A track of another package may not be installed here.
    recorded = load_track(track).recorded if track in TRACKS else ("scene", "query", "answered")
    return not any(fnmatchcase(name, pattern) for pattern in recorded)


def condition_names(method: Method) -> list[str]:
    """Return the columns of the records that are conditions, and not all of one value."""
    scores, records = {column.key for column in method.result.columns}, method.records
    return [
        name
        for name in map(str, records)
        for column in [records[name]]
        if is_condition(name, method.result.track)
        and name not in scores
        and column.nunique(dropna=False) > 1
        and (_is_number(column) or column.nunique() <= _MOST_CATEGORIES)
    ]


def condition_title(name: str) -> str:
    """Return a column's name as a heading: ``altitude_m`` becomes ``altitude [m]``."""
    for suffix, unit in _SUFFIXES.items():
        if name.endswith(suffix) and len(name) > len(suffix):
            return f"{name.removesuffix(suffix).replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def number_texts(values: Sequence[float]) -> list[str]:
    """Write numbers in up to 12 digits, whole ones in all of theirs."""
    return [str(value) if isinstance(value, int) else f"{value:.12g}" for value in values]


def _is_number(column: pd.Series[str]) -> bool:
    return column.dtype.kind in "iuf"


def check_column(records: pd.DataFrame, by: str) -> None:
    """Refuse a column that the records do not have."""
    if by not in records.columns:
        names = [str(name) for name in records.columns]
        raise UsageError(
            f"--by {by}: the records have no such column{nearest(by, names)}",
            expected="one of " + ", ".join(names),
        )


def group_records(records: pd.DataFrame, by: str, bins: Sequence[float] | None = None) -> Grouping:
    """Put records into groups by a column: by its values, or by bins of a number.

    Bins that are given stay where nothing is in them.
    """
    check_column(records, by)
    column = records[by]
    is_number, values = _is_number(column), column.to_numpy()
    if bins is not None or (is_number and column.nunique() > _MOST_CATEGORIES):
        if bins is None:
            edges = even_edges(values[np.isfinite(values)])
        elif not is_number or not bins or not (np.diff([*bins, math.inf]) > 0).all():
            raise UsageError(
                f"--bins: {by} is no number, or its edges do not ascend",
                expected="edges such as 50,100,200 of a column such as altitude_m",
            )
        else:
            edges = tuple(map(float, bins))
        codes = np.searchsorted(edges, values, side="right")
        codes[np.isnan(values)] = len(edges) + 1
        texts = number_texts(edges)
        between = [f"{low} to {high}" for low, high in pairwise(texts)]
        labels = [f"below {texts[0]}", *between, f"{texts[-1]} and more"] if edges else ["all"]
        kept = len(labels) if bins is not None else 0
    else:
        # Who writes "unknown" means what an empty field does.
        known = (
            column
            if is_number
            else column.astype("string").where(column.astype("string") != UNKNOWN)
        )
        codes, found = pd.factorize(known, sort=True)
        if len(found) > _MOST_GROUPS:
            many = f"--by {by}: {len(found)} different values are no groups"
            raise UsageError(many, fix="choose a column with fewer values")
        labels, kept = number_texts(found.tolist()) if is_number else [*map(str, found)], 0
        codes[codes < 0] = len(labels)
    labels.append(UNKNOWN)
    left = np.flatnonzero(
        (np.bincount(codes, minlength=len(labels)) > 0) | (np.arange(len(labels)) < kept)
    )
    return Grouping(tuple(labels[k] for k in left), np.searchsorted(left, codes))


def even_edges(values: Floats, most: int = _MOST_BINS) -> tuple[float, ...]:
    """Choose round edges, multiples of 1, 2 or 5 times a power of ten, for at most `most` bins.

    The edges ascend; there are none where all values, which are finite, are alike.
    """
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return ()
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    for step in power * np.array([1, 2, 5, 10, 20]):
        numbers = np.arange(math.floor(low / step) + 1, math.ceil(high / step))
        if len(numbers) < most:
            break
    edges = (float(f"{edge:.12g}") for edge in numbers * step)
    return tuple(edge for edge in edges if low < edge <= high)


def group_averages(
    values: Floats, medians: NDArray[np.bool_], codes: NDArray[np.int64], groups: int
) -> Floats:
    """Average variables (V, Q) within groups, (V, G); NaN in empty ones."""
    by_group = pd.DataFrame(values.T).groupby(codes)
    means, middles = (
        frame.reindex(range(groups)).to_numpy().T for frame in (by_group.mean(), by_group.median())
    )
    return np.where(medians[:, None], middles, means)


def _group_intervals(
    sample: Sample, grouping: Grouping, resampling: ResamplingConfig
) -> list[list[Interval]]:
    """Take the intervals of averages within groups, resampled within each group."""
    values, counts = sample.values[0], grouping.counts.tolist()
    filled = [group for group, count in enumerate(counts) if count]
    parts = tuple(np.ascontiguousarray(values[:, grouping.codes == group]) for group in filled)
    named = tuple(grouping.labels[group] for group in filled)
    found = sample_intervals(replace(sample, groups=named, values=parts), resampling).groups
    few = f"fewer than {FEWEST} {plural(sample.unit)}"
    nothing = [Interval.lacking("")] * len(values)
    return [
        [replace(i, reason=few) if 0 < count < FEWEST else i for i in found.get(label, nothing)]
        for label, count in zip(grouping.labels, counts, strict=True)
    ]


def breakdown_table(
    methods: Sequence[Method],
    scores: Sequence[ScoreColumn],
    by: str,
    *,
    bins: Sequence[float] | None = None,
    resampling: ResamplingConfig | None = None,
) -> Table:
    """Lay out scores by group: over all queries of the group, whatever their scene."""
    check_same_column(methods, by)
    grouping = group_records(methods[0].records, by, bins)
    sample, result, several = pooled_sample(methods, scores), methods[0].result, len(methods) > 1
    counts, protocol = grouping.counts.tolist(), result.protocol
    averages = group_averages(sample.values[0], sample.medians, grouping.codes, len(counts))
    intervals = _group_intervals(sample, grouping, resampling) if resampling else []
    titles = result.truth.scene_titles if by == "scene" else {}
    rows, reasons = [], []
    for place, (label, count) in enumerate(zip(grouping.labels, counts, strict=True)):
        title = titles.get(label, label)
        cells = [Cell(title), Cell(count)]
        for number, score in enumerate(scores):
            race = range(number * len(methods), (number + 1) * len(methods))
            spans = [intervals[place][i] if intervals else None for i in race]
            values = [float(averages[i, place]) if count else None for i in race]
            race_cells = [score_cell(score, *p) for p in zip(values, spans, strict=True)]
            cells += mark_cells(score_column(score), race_cells)
            reasons += [(title, f"no interval: {s.reason}") for s in spans if s and s.reason]
        rows.append(Row(tuple(cells)))
    units = plural(result.unit)
    mean = "the mean over the scenes" if result.unit == "scene" else "over all queries"
    notes = [f"each value is {mean} of its group"] if by != "scene" else []
    if np.isinf(averages).any():
        notes.append("inf: too many of the group failed, half for a median and one for a mean")
    if resampling is not None:
        made = [interval for part in intervals for interval in part]
        notes += share_notes(reasons)
        notes += brackets_note(made, resampling, f"{units} within each group")
    what = methods[0].name
    if several:
        what = f"{', '.join(score.title for score in scores)} of {len(methods)} methods"
    columns = [
        Column(
            method.name if several else score.title,
            UNITS[score.unit],
            score.higher_is_better,
            group=score_title(score) if several and len(scores) > 1 else "",
        )
        for score in scores
        for method in methods
    ]
    return Table(
        f"{what} by {condition_title(by)}, {protocol.name} v{protocol.version}",
        (Column(condition_title(by)), Column(units.capitalize()), *columns),
        tuple(rows),
        tuple(notes),
        leading=2,
    )

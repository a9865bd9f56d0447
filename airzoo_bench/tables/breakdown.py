"""Breakdowns: scores by a condition, a column of the records or bins of a number, as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.comparison import check_same_column, pooled_sample
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.comparison import describe_intervals
from airzoo_bench.tables.layouts import UNITS, score_cell, score_column, share_notes
from airzoo_bench.tables.marks import mark_cells
from airzoo_bench.tables.model import Cell, Column, Row, Table

UNKNOWN = "unknown"
"""The group of the queries for which a condition has no value."""

_MOST_CATEGORIES = 12
_MOST_BINS = 6
_SUFFIXES = {"_m": "m", "_deg": "°", "_s": "s", "_px": "px"}


def is_condition(name: str, track: str) -> bool:
    """Whether a column of a track's records, and no score, tells of queries, not of methods."""
    recorded = load_track(track).recorded if track in TRACKS else ("scene", "query", "answered")
    return not any(fnmatchcase(name, pattern) for pattern in recorded)


def condition_names(method: Method) -> list[str]:
    """Return the columns of the records that are conditions, and not all of one value."""
    scores, track = {column.key for column in method.result.columns}, method.result.track
    return [
        str(name)
        for name, column in method.records.items()
        if is_condition(str(name), track)
        and name not in scores
        and column.nunique(dropna=False) > 1
        and (column.dtype.kind in "iuf" or column.nunique() <= _MOST_CATEGORIES)
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


def check_column(records: pd.DataFrame, by: str) -> None:
    """Refuse a column that the records do not have."""
    if by not in records.columns:
        names = [str(name) for name in records.columns]
        what = f"--by {by}: the records have no such column{nearest(by, names)}"
        raise UsageError(what, expected="one of " + ", ".join(names))


def group_records(
    records: pd.DataFrame, by: str, bins: Sequence[float] | None = None
) -> pd.Categorical[str]:
    """Put records into groups by a column: by its values, or by bins of a number.

    The categories are in order, of numbers ascending, of texts alphabetical, `UNKNOWN` last. Bins
    that are given stay where nothing is in them.
    """
    check_column(records, by)
    column, kind = records[by], records[by].dtype.kind
    sizes, least = column.value_counts(), min(FEWEST, len(column) // _MOST_BINS)
    too_many = len(sizes) > _MOST_CATEGORIES or (sizes < least).any()
    if bins is not None or (kind in "iuf" and too_many):
        if bins is not None and not (kind in "iuf" and (np.diff([*bins, np.inf]) > 0).all()):
            what = f"--bins: {by} is no number, or its edges do not ascend"
            raise UsageError(what, expected="edges such as 50,100 of a column such as altitude_m")
        values = column.to_numpy(np.float64)
        finite = values[np.isfinite(values)]
        edges = [*map(float, bins)] if bins else even_edges(finite, least=least)
        codes = np.searchsorted(edges, values, side="right")
        codes[np.isnan(values)] = len(edges) + 1
        texts = number_texts(edges)
        between = [f"{low} to {high}" for low, high in pairwise(texts)]
        labels = [f"below {texts[0]}", *between, f"{texts[-1]} and more"] if edges else ["all"]
    else:
        known = column if kind in "iuf" else column.astype("string")
        # Who writes "unknown" means what an empty field does, whose code is -1.
        codes, found = pd.factorize(known.mask(known == UNKNOWN), sort=True)
        texts = number_texts(found.tolist()) if kind in "iuf" else [*map(str, found)]
        places = {text: place for place, text in enumerate(dict.fromkeys(texts))}
        labels = list(places)  # numbers that are written alike are one
        codes = np.array([*map(places.__getitem__, texts), len(labels)])[codes]
    groups = pd.Categorical.from_codes(codes, pd.Index([*labels, UNKNOWN]))
    shown = {*groups.unique(), *(labels if bins is not None else ())}
    return groups.set_categories([name for name in groups.categories if name in shown])


def even_edges(values: Floats, most: int = _MOST_BINS, least: int = 0) -> list[float]:
    """Choose round edges, multiples of 1, 2 or 5 times a power of ten, for at most `most` bins.

    A bin of fewer than `least` values is put to a neighbour; values that are alike have no edges.
    """
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return []
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    for step in power * np.array([1, 2, 5, 10, 20]):
        numbers = np.arange(math.floor(low / step) + 1, math.ceil(high / step))
        if len(numbers) < most:
            break
    rounded = (float(f"{edge:.12g}") for edge in numbers * step)
    edges = [edge for edge in rounded if low < edge <= high]
    while (sizes := np.histogram(values, [-math.inf, *edges, math.inf])[0]).min() < least and edges:
        at, beside = int(sizes.argmin()), np.pad(sizes, 1, constant_values=len(values) + 1)
        del edges[at - int(beside[at] < beside[at + 2])]
    return edges


def group_averages(
    values: Floats, medians: NDArray[np.bool_], groups: pd.Categorical[str]
) -> Floats:
    """Average variables (V, Q) within groups, (V, G); NaN in empty ones."""
    by_group = pd.DataFrame(values.T).groupby(pd.Series(groups), observed=False)
    return np.asarray(np.where(medians, by_group.median(), by_group.mean()).T)


def _group_intervals(
    sample: Sample, groups: pd.Categorical[str], resampling: ResamplingConfig
) -> dict[str, list[Interval]]:
    """Take the intervals of averages within groups, resampled within each group."""
    filled = groups.remove_unused_categories()
    names, values = tuple(filled.categories), sample.values[0]
    parts = tuple(np.ascontiguousarray(values[:, filled == name]) for name in names)
    found = sample_intervals(replace(sample, groups=names, values=parts), resampling).groups
    few = f"fewer than {FEWEST} {plural(sample.unit)}"
    small = {name for name, part in zip(names, parts, strict=True) if part.shape[1] < FEWEST}
    return found | {name: [replace(i, reason=few) for i in found[name]] for name in small}


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
    groups = group_records(methods[0].records, by, bins)
    sample, result, several = pooled_sample(methods, scores), methods[0].result, len(methods) > 1
    averages = group_averages(sample.values[0], sample.medians, groups)
    intervals = _group_intervals(sample, groups, resampling) if resampling else {}
    titles = result.truth.scene_titles if by == "scene" else {}
    rows, reasons = [], []
    for place, label in enumerate(groups.categories):
        title, count = titles.get(label, label), int((groups.codes == place).sum())
        spans = intervals.get(label, [None] * len(averages))
        reasons += [(title, f"no interval: {s.reason}") for s in spans if s and s.reason]
        cells = [Cell(title), Cell(count)]
        for number, score in enumerate(scores):
            race = slice(number * len(methods), (number + 1) * len(methods))
            values = [value if count else None for value in averages[race, place].tolist()]
            pairs = zip(values, spans[race], strict=True)
            found = [score_cell(score, *pair) for pair in pairs]
            differ = count > 1 and len({cell.text(2) for cell in found}) > 1
            cells += mark_cells(score_column(score), found) if differ else found
        rows.append(Row(tuple(cells)))
    mean = "the mean over the scenes" if result.unit == "scene" else "over all queries"
    notes = [f"each value is {mean} of its group"] if by != "scene" else []
    if np.isinf(averages).any():
        notes.append("inf: too many of the group failed, half for a median and one for a mean")
    if resampling is not None:
        made = [interval for part in intervals.values() for interval in part]
        notes += share_notes(reasons)
        notes += describe_intervals(made, resampling, result.unit, within="each group")
    what, columns = methods[0].name, list(map(score_column, scores))
    if several:
        what = f"{', '.join(score.title for score in scores)} of {len(methods)} methods"
        groups_of = [f"{s.title} [{UNITS[s.unit]}]" * (len(scores) > 1) for s in scores]
        heads = [*zip(columns, groups_of, strict=True)]
        columns = [replace(c, title=m.name, group=g) for c, g in heads for m in methods]
    return Table(
        f"{what} by {condition_title(by)}, {result.protocol.name} v{result.protocol.version}",
        (Column(condition_title(by)), Column(plural(result.unit).capitalize()), *columns),
        tuple(rows),
        tuple(notes),
        leading=2,
    )

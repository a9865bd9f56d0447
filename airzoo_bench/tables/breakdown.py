"""Breakdowns: scores by a condition, a column of the records or bins of a number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.records import Scored

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "UNKNOWN",
    "Grouping",
    "check_column",
    "condition_names",
    "condition_title",
    "even_edges",
    "group_averages",
    "group_records",
    "is_condition",
    "number_texts",
]

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
    """Queries by group.

    Attributes
    ----------
    by : str
        The column.
    labels : tuple of G str
        All different. In order: of numbers ascending, of texts alphabetical; `UNKNOWN` last, which
        is also that of the text ``unknown``.
    codes : (Q,) int64
        The group of each record.
    edges : tuple of float
        Where a number was cut into bins; empty for categories.
    """

    by: str
    labels: tuple[str, ...]
    codes: NDArray[np.int64]
    edges: tuple[float, ...] = ()

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many records each group has (G,)."""
        return np.bincount(self.codes, minlength=len(self.labels))


def is_condition(name: str, track: str) -> bool:
    """Whether a column of a track's records, and no score, tells of queries, not of methods."""
    return not any(fnmatchcase(name, pattern) for pattern in _recorded(track))


@cache
def _recorded(track: str) -> frozenset[str]:
    if track not in TRACKS:  # its package is not installed here
        return frozenset(("scene", "query", "answered"))
    return frozenset(load_track(track).recorded)


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
    """Choose round edges (multiples of 1, 2 or 5 times a power of ten) that cut values into bins.

    Parameters
    ----------
    values : (N,) array
        Finite.
    most : int
        How many bins at most.

    Returns
    -------
    tuple of float
        Inner edges, ascending; none where all values are alike.
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
        given = ",".join(f"{edge:.15g}" for edge in edges)
        raise UsageError(f"--bins {given} do not ascend", expected="edges such as 50,100,200")
    return edges


def _binned(
    by: str, column: pd.Series[str], edges: tuple[float, ...], keep_empty: bool = False
) -> Grouping:
    values = column.to_numpy(np.float64)
    missing = np.isnan(values)
    codes = np.searchsorted(np.array(edges), values, side="right").astype(np.int64)
    codes[missing] = len(edges) + 1
    found = Grouping(by, (*_bin_labels(edges), UNKNOWN), codes, edges)
    return _without_empty(found, kept=len(edges) + 1 if keep_empty else 0)


def _bin_labels(edges: tuple[float, ...]) -> list[str]:
    if not edges:
        return ["all"]
    texts = number_texts(edges)
    between = [f"{low} to {high}" for low, high in pairwise(texts)]
    return [f"below {texts[0]}", *between, f"{texts[-1]} and more"]


def number_texts(values: Sequence[float]) -> list[str]:
    """Write numbers in as few digits, six or more, as tell them apart; integers in all of theirs.

    Parameters
    ----------
    values : sequence of float or int
        Not NaN.
    """
    if all(_is_whole(value) for value in values):
        return [str(int(value)) for value in values]
    for digits in range(_LEAST_DIGITS, _ALL_DIGITS):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len(set(values)):
            return texts
    return [str(value) for value in values]


def _is_whole(value: float) -> bool:
    return isinstance(value, int) or (value.is_integer() and abs(value) < _MOST_WHOLE)


def _by_category(by: str, column: pd.Series[str]) -> Grouping:
    missing = column.isna().to_numpy(bool)
    numbers = _is_number(column)
    shown = column.to_numpy() if numbers else column.astype(str).to_numpy(object)
    if not numbers:
        missing = missing | (shown == UNKNOWN)  # who writes it means what an empty field does
    values = sorted(set(shown[~missing].tolist()))
    if len(values) > _MOST_GROUPS:
        many = f"--by {by}: {len(values)} different values are no groups"
        raise UsageError(many, fix="choose a column with fewer values")
    places = {value: place for place, value in enumerate(values)}
    codes = np.full(len(column), len(values), np.int64)
    codes[~missing] = [places[value] for value in shown[~missing].tolist()]
    labels = number_texts(values) if numbers else values
    return _without_empty(Grouping(by, (*labels, UNKNOWN), codes))


def _without_empty(grouping: Grouping, kept: int = 0) -> Grouping:
    counts = grouping.counts
    counts[:kept] = 1  # these stay, empty or not
    left = np.flatnonzero(counts)
    codes = np.searchsorted(left, grouping.codes).astype(np.int64)
    return Grouping(grouping.by, tuple(grouping.labels[k] for k in left), codes, grouping.edges)


def group_averages(
    values: Floats, medians: NDArray[np.bool_], codes: NDArray[np.int64], groups: int
) -> Floats:
    """Average variables within groups."""
    order = np.argsort(codes, kind="stable")
    counts = np.bincount(codes, minlength=groups)
    parts = np.split(values[:, order], np.cumsum(counts)[:-1], axis=1)
    averages = np.full((len(values), groups), np.nan)
    for group, part in enumerate(parts):
        if part.shape[1]:
            averages[~medians, group] = part[~medians].mean(axis=1)
            averages[medians, group] = np.median(part[medians], axis=1)
    return averages

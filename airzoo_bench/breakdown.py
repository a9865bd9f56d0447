"""Breakdowns: scores by a condition, a column of the records or bins of a number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.records import Scored
from airzoo_bench.validation import nearest

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "MEASURED",
    "UNKNOWN",
    "Grouping",
    "check_column",
    "condition_names",
    "condition_title",
    "even_edges",
    "group_averages",
    "group_records",
]

UNKNOWN = "unknown"
"""The group of the queries for which a condition has no value."""

MEASURED = frozenset(
    (
        *("scene", "query", "answered", "failed", "status", "seconds"),
        *("positives", "tie_dependent", "first_hit_rank", "first_tile"),
        *("matches", "lifted", "outside_map", "outside_dsm", "no_height", "inliers"),
        *("error_m", "horizontal_m", "vertical_m", "rotation_deg"),
        *("alignment", "scale", "cameras", "inlier_cameras"),
        *("centres_rms_m", "centres_median_m", "rotations_median_deg"),
        *("points", "not_finite", "outside", "thinned", "distrusted"),
        *("truth_points", "truth_outside", "truth_thinned", "cameras_missing"),
        *("predicted_points", "true_points", "ranked"),
    )
)
"""Columns of records that tell what a method did, or was held against, and are no conditions."""

_RANKED_TILE = "tile@"

_MOST_CATEGORIES = 12
_MOST_BINS = 6
_MOST_GROUPS = 1_000
_SUFFIXES = {"_m": "m", "_deg": "°", "_s": "s", "_px": "px"}
_EDGE_DIGITS = 12


@dataclass(frozen=True, eq=False)
class Grouping:
    """Queries by group.

    Attributes
    ----------
    by : str
        The column.
    labels : tuple of G str
        In order: of numbers ascending, of texts alphabetical; `UNKNOWN` last.
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


def condition_names(method: Scored) -> list[str]:
    """Return the columns of the records that are conditions, and not all of one value."""
    known = MEASURED | {column.key for column in method.result.columns}
    records = method.records
    found = [
        name for name in records.columns if name not in known and not name.startswith(_RANKED_TILE)
    ]
    return [
        name
        for name in found
        if records[name].nunique(dropna=False) > 1 and _groupable(records[name])
    ]


def _groupable(column: pd.Series[str]) -> bool:
    return _is_number(column) or column.nunique() <= _MOST_CATEGORIES


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


def group_records(records: pd.DataFrame, by: str, bins: Sequence[float] | None = None) -> Grouping:
    """Put records into groups by a column.

    Parameters
    ----------
    records : DataFrame
    by : str
        A column: a condition, the scene, or anything else that stands in the records.
    bins : sequence of float, optional
        Inner edges: below the first, from the first to below the second, ... Where left out, a
        number with more than 12 values is cut by `even_edges`.

    Raises
    ------
    UsageError
        There is no such column; bins of a text; bins that do not ascend; a text with more than
        1,000 values.
    """
    check_column(records, by)
    column = records[by]
    if bins is not None:
        return _binned(by, column, _checked_bins(by, column, bins))
    if _is_number(column) and column.nunique() > _MOST_CATEGORIES:
        values = column.to_numpy(np.float64)
        return _binned(by, column, even_edges(values[np.isfinite(values)]))
    return _by_category(by, column)


def check_column(records: pd.DataFrame, by: str) -> None:
    """Refuse a column that the records do not have.

    Raises
    ------
    UsageError
        There is no such column; it names those that there are.
    """
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
            mend="leave --bins out: every value is then a group",
        )
    if not all(map(math.isfinite, edges)) or list(edges) != sorted(set(edges)) or not edges:
        raise UsageError(
            f"--bins {','.join(f'{edge:g}' for edge in edges)} do not ascend",
            expected="edges such as 50,100,200",
        )
    return edges


def _binned(by: str, column: pd.Series[str], edges: tuple[float, ...]) -> Grouping:
    values = column.to_numpy(np.float64)
    missing = np.isnan(values)
    codes = np.searchsorted(np.array(edges), values, side="right").astype(np.int64)
    codes[missing] = len(edges) + 1
    return _without_empty(Grouping(by, (*_bin_labels(edges), UNKNOWN), codes, edges))


def _bin_labels(edges: tuple[float, ...]) -> list[str]:
    if not edges:
        return ["all"]
    between = [f"{low:g} to {high:g}" for low, high in pairwise(edges)]
    return [f"below {edges[0]:g}", *between, f"{edges[-1]:g} and more"]


def _by_category(by: str, column: pd.Series[str]) -> Grouping:
    missing = column.isna().to_numpy(bool)
    known = column[~missing]
    numbers = _is_number(known)
    values = sorted(known.unique().tolist()) if numbers else sorted(map(str, known.unique()))
    if len(values) > _MOST_GROUPS:
        raise UsageError(
            f"--by {by}: {len(values)} different values are no groups",
            mend="choose a column with fewer values",
        )
    places = {value: place for place, value in enumerate(values)}
    codes = np.full(len(column), len(values), np.int64)
    shown = known.tolist() if numbers else map(str, known)
    codes[~missing] = [places[value] for value in shown]
    labels = [f"{value:g}" if numbers else str(value) for value in values]
    return _without_empty(Grouping(by, (*labels, UNKNOWN), codes))


def _without_empty(grouping: Grouping) -> Grouping:
    kept = np.flatnonzero(grouping.counts)
    codes = np.searchsorted(kept, grouping.codes).astype(np.int64)
    return Grouping(grouping.by, tuple(grouping.labels[k] for k in kept), codes, grouping.edges)


def group_averages(
    values: Floats, medians: NDArray[np.bool_], codes: NDArray[np.int64], groups: int
) -> Floats:
    """Average variables within groups.

    Parameters
    ----------
    values : (V, Q) array
        Finite or +inf.
    medians : (V,) bool
        Which variables are averaged by the median.
    codes : (Q,) array
        Group of each column, 0 to `groups` - 1.
    groups : int

    Returns
    -------
    (V, `groups`) float64
        NaN where a group is empty.
    """
    order = np.argsort(codes, kind="stable")
    counts = np.bincount(codes, minlength=groups)
    parts = np.split(values[:, order], np.cumsum(counts)[:-1], axis=1)
    averages = np.full((len(values), groups), np.nan)
    for group, part in enumerate(parts):
        if part.shape[1]:
            averages[:, group] = _averages(part, medians)
    return averages


def _averages(part: Floats, medians: NDArray[np.bool_]) -> Floats:
    found = np.empty(len(part))
    found[~medians] = part[~medians].mean(axis=1)
    found[medians] = np.median(part[medians], axis=1)
    return found

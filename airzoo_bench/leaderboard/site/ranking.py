"""Rank ranges of a table, and any two of its methods compared."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import ResultError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.site.api import API, Pairs
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured, sample_of
from airzoo_bench.leaderboard.site.rows import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.pair_tests import (
    correct_pairs,
    pair_limits,
    pair_p_values,
    rank_ranges,
    resamples_for,
    told_apart,
    unpaired_p_values,
)
from airzoo_bench.statistics.samples import ResamplingConfig

__all__ = ["Ranked", "check_alike", "headline_first", "rank", "rank_sealed"]


@dataclass(frozen=True)
class Ranked:
    """One score of a table's methods, in their order: rank ranges (V, 2), which two differ (V, V).

    A sealed table, and one method, have no pairs.
    """

    ranges: NDArray[np.int64]
    apart: NDArray[np.bool_]
    pairs: Pairs | None


def check_alike(methods: Sequence[Scored]) -> None:
    """Refuse methods of one table that do not measure the same."""
    known: dict[str, tuple[str, dict[str, Any]]] = {}
    for one in methods:
        if one.measured.queries != methods[0].measured.queries:
            raise ResultError(
                f"{methods[0].method} and {one.method} are not on the same queries",
                where=one.entry.file,
                fix="score the predictions again with the same benchmark folder",
            )
        for column in one.measured.columns:
            given = {key: value for key, value in column.items() if key != "headline"}
            whose, first = known.setdefault(column["key"], (one.method, given))
            if first != given:
                raise ResultError(
                    f"{whose} and {one.method} mean different things by the score {column['key']}",
                    where=one.entry.file,
                    fix="score all predictions again with the same version",
                )


def headline_first(
    methods: Sequence[Scored], otherwise: Sequence[ScoreColumn] = ()
) -> list[ScoreColumn]:
    """Return the scores that any method has, the headline ones that all have first."""
    found = {c.key: c for one in methods for c in one.measured.score_columns}
    columns = list(found.values()) or list(otherwise)
    of_all = [{c.key for c in one.measured.score_columns if c.headline} for one in methods]
    headline = set.intersection(*of_all) if of_all else {c.key for c in columns if c.headline}
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns]
    return sorted(marked, key=lambda column: not column.headline)


def rank(methods: Sequence[Scored], column: ScoreColumn) -> Ranked:
    """Rank methods of one protocol and truth, see `check_alike`, by a headline score."""
    resampling = ResamplingConfig(resamples_for(len(methods)))
    rows = [one.values(column.key) for one in methods]
    sample = sample_of(methods[0].measured, rows, column)
    p_values = pair_p_values(sample, resampling)
    corrected = correct_pairs(p_values)
    values = np.array([one.measured.values[OVERALL][column.key] for one in methods])
    ranges = rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    apart = told_apart(values, corrected)
    if len(methods) < 2:
        return Ranked(ranges, apart, None)
    upper = np.triu_indices(len(methods), 1)
    low, high = pair_limits(sample, resampling)
    pairs = Pairs(
        API,
        column.key,
        tuple(one.id for one in methods),
        tuple(values.tolist()),
        _packed(low[upper]),
        _packed(high[upper]),
        _packed(p_values[upper]),
        _packed(corrected[upper]),
        len(upper[0]),
        resampling.resamples,
        _about(methods[0].measured, column, resampling),
    )
    return Ranked(ranges, apart, pairs)


def _about(measured: Measured, column: ScoreColumn, resampling: ResamplingConfig) -> str:
    number = f"{resampling.resamples:,}"
    test = (
        f"bootstrap of the difference of medians, {number} resamples"
        if measured.by_medians(column)
        else "Student's t of paired differences, by permutation where there is no t"
        if measured.unit == "scene"
        else f"paired permutation test, exact where {number} patterns are all there are"
    )
    units = "scenes" if measured.unit == "scene" else "queries within scenes"
    return f"{test}, over {units}; p for these two alone, and by Holm for all pairs of the column"


def _packed(values: Floats) -> str:
    return base64.b64encode((values + 0.0).astype("<f4").tobytes()).decode()  # no -0.0


def rank_sealed(measured: Sequence[Measured], column: ScoreColumn) -> Ranked:
    """Rank methods of which only rounded scores and standard errors are known."""
    values = np.array([one.values[OVERALL].get(column.key, np.inf) for one in measured])
    errors = np.array([one.errors[OVERALL].get(column.key, np.nan) for one in measured])
    corrected = correct_pairs(unpaired_p_values(values, errors))
    ranges = rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    return Ranked(ranges, told_apart(values, corrected), None)

"""From results and their records to pictures, for the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.breakdown import condition_title, group_averages, group_records
from airzoo_bench.errors import UsageError
from airzoo_bench.records import Scored
from airzoo_bench.report.curves import (
    draw_by_condition,
    draw_error_curves,
    draw_recall_curves,
    draw_threshold_curves,
    threshold_scores,
)
from airzoo_bench.report.overview import draw_heat_map, draw_intervals
from airzoo_bench.result import ScoreColumn
from airzoo_bench.statistics.comparison import make_sample
from airzoo_bench.statistics.compatibility import choose_scores
from airzoo_bench.statistics.intervals import bootstrap
from airzoo_bench.statistics.samples import Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "choose_score",
    "condition",
    "errors",
    "intervals",
    "kept_ranks",
    "recall",
    "scenes",
    "thresholds",
]


def choose_score(
    methods: Sequence[Scored], wanted: str | None, *, of_errors: bool = False
) -> ScoreColumn:
    """Return the score that was named, else the first headline one, or the first error.

    Raises
    ------
    ResultError
        There is no such score.
    UsageError
        Errors are to be drawn, and the score is none, or there are none.
    """
    if wanted is not None:
        chosen = choose_scores(methods, [wanted])[0]
        if of_errors and chosen.unit == "share":
            raise UsageError(f"{chosen.title} is no error", expected="a score in m or degrees")
        return chosen
    if not of_errors:
        return choose_scores(methods, [])[0]
    found = [column for column in methods[0].result.columns if column.unit != "share"]
    if not found:
        raise UsageError("these results have no errors in m or degrees")
    return found[0]


def kept_ranks(method: Scored) -> int:
    """How many ranks the protocol keeps of each query.

    Raises
    ------
    UsageError
        The results are of another track.
    """
    kept = method.result.protocol.settings.get("scores", {}).get("ranks_kept")
    if not isinstance(kept, int) or "first_hit_rank" not in method.records:
        raise UsageError(
            f"results of the {method.result.track} track have no ranks",
            expected="results of the retrieval track",
        )
    return kept


def recall(methods: Sequence[Scored], up_to: int | None = None) -> Figure:
    """Draw recall at K over K.

    Raises
    ------
    UsageError
        See `kept_ranks`; or `up_to` is beyond them.
    """
    kept = kept_ranks(methods[0])
    if up_to is not None and up_to > kept:
        raise UsageError(f"--up-to {up_to}: the protocol keeps {kept} ranks of each query")
    return draw_recall_curves(methods, up_to or kept)


def errors(methods: Sequence[Scored], score: ScoreColumn) -> Figure:
    """Draw the share of queries whose error is below a value."""
    return draw_error_curves(methods, score)


def thresholds(methods: Sequence[Scored]) -> Figure:
    """Draw precision, recall and F1 over distance.

    Raises
    ------
    UsageError
        The results are of another track.
    """
    if not threshold_scores(methods[0].result.columns)["f1"]:
        raise UsageError(
            f"results of the {methods[0].result.track} track have no precision over distance",
            expected="results of the reconstruction track",
        )
    return draw_threshold_curves(methods)


def intervals(methods: Sequence[Scored], score: ScoreColumn) -> Figure:
    """Draw the average over scenes with its 95 % interval, by the plan of `compare`."""
    found = bootstrap(make_sample(methods, [score]), Plan(), groups=False).overall
    limits = [(np.nan, np.nan) if i.low is None else (i.low, i.high) for i in found]
    values = np.array([method.result.overall[score.key] for method in methods])
    names = [method.name for method in methods]
    return draw_intervals(
        names,
        values,
        np.array(limits, np.float64),
        score,
        "average over scenes with its 95 % interval",
    )


def scenes(methods: Sequence[Scored], score: ScoreColumn) -> Figure:
    """Draw a score by method and scene."""
    titles = methods[0].result.truth.scene_titles
    values = [[m.result.scenes[scene][score.key] for scene in titles] for m in methods]
    return draw_heat_map([m.name for m in methods], list(titles.values()), np.array(values), score)


def condition(
    methods: Sequence[Scored], score: ScoreColumn, by: str, bins: Sequence[float] | None = None
) -> Figure:
    """Draw a score by a condition.

    Raises
    ------
    UsageError
        See `airzoo_bench.breakdown.group_records`.
    """
    grouping = group_records(methods[0].records, by, bins)
    values = np.array([method.records[score.key].to_numpy(np.float64) for method in methods])
    medians = np.full(len(methods), score.average == "median")
    averages = group_averages(values, medians, grouping.codes, len(grouping.labels))
    names = [method.name for method in methods]
    counts = grouping.counts.tolist()
    title = condition_title(by)
    return draw_by_condition(names, averages, grouping.labels, counts, score, title)

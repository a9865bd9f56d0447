"""From results and their records to pictures, for the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.plurals import plural
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.by_condition import draw_by_condition
from airzoo_bench.report.curves import (
    draw_error_curves,
    draw_recall_curves,
    draw_threshold_curves,
    threshold_scores,
)
from airzoo_bench.report.labels import small_print, who
from airzoo_bench.report.overview import draw_heat_map, draw_intervals
from airzoo_bench.report.sheet import Sheet
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import is_share, make_sample
from airzoo_bench.results.selection import choose_scores, find_scene
from airzoo_bench.statistics.intervals import FEWEST, Interval
from airzoo_bench.statistics.sample_intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.breakdown import condition_title, group_averages, group_records
from airzoo_bench.tables.breakdown_layout import group_intervals
from airzoo_bench.tables.wording import intervals_made, resampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "choose_score",
    "condition",
    "errors",
    "intervals",
    "kept_ranks",
    "of_scene",
    "over_what",
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


def of_scene(methods: Sequence[Scored], wanted: str) -> list[Scored]:
    """Return the methods as if one scene, named by id or title, were all that was measured.

    Raises
    ------
    ResultError
        There is no such scene, or several have that title.
    """
    titles = methods[0].result.truth.scene_titles
    scene = find_scene(titles, wanted)
    found = []
    for method in methods:
        values, truth = method.result.scenes[scene], method.result.truth
        changes = {
            "scenes": {scene: values},
            "overall": values,
            "truth": truth.model_copy(update={"scene_titles": {scene: titles[scene]}}),
        }
        records = method.records[method.records["scene"] == scene].reset_index(drop=True)
        found.append(Scored(method.name, method.result.model_copy(update=changes), records))
    return found


def kept_ranks(method: Scored) -> int:
    """How many ranks the protocol keeps of each query.

    Raises
    ------
    UsageError
        The results are of another track, or their settings do not say.
    """
    if "first_hit_rank" not in method.records:
        raise UsageError(
            f"results of the {method.result.track} track have no ranks",
            expected="results of the retrieval track",
        )
    kept = method.result.protocol.settings.get("scores", {}).get("ranks_kept")
    if not isinstance(kept, int) or kept < 1:
        raise UsageError(
            "the protocol's settings do not say how many ranks were kept",
            expected="a number above 0 as scores.ranks_kept",
        )
    return kept


def recall(
    methods: Sequence[Scored], up_to: int | None = None, sheet: Sheet | None = None
) -> Figure:
    """Draw recall at K over K.

    Raises
    ------
    UsageError
        See `kept_ranks`; or `up_to` is beyond them.
    """
    kept = kept_ranks(methods[0])
    if up_to is not None and up_to > kept:
        raise UsageError(f"--up-to {up_to}: the protocol keeps {kept} ranks of each query")
    return draw_recall_curves(methods, up_to or kept, _noted(methods, sheet))


def errors(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the share of queries whose error is below a value."""
    return draw_error_curves(methods, score, _noted(methods, sheet))


def thresholds(methods: Sequence[Scored], sheet: Sheet | None = None) -> Figure:
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
    return draw_threshold_curves(methods, _noted(methods, sheet))


def intervals(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the average over scenes with its 95 % interval, by the plan of `compare`."""
    plan = ResamplingConfig()
    sample = make_sample(methods, [score])
    found = sample_intervals(sample, plan, groups=False).overall
    values = np.array([method.result.overall[score.key] for method in methods])
    names = [method.name for method in methods]
    made = intervals_made(found, plan, resampled(methods[0].result.unit), "interval")
    what = f"{over_what(methods)}; bars: {made}" if made else over_what(methods)
    noted = _noted(methods, sheet).noting(what, *_reasons(names, found))
    return draw_intervals(names, values, _limits(found), score, "", noted)


def over_what(methods: Sequence[Scored]) -> str:
    """Say what an overall value is of: the average over scenes, or the one scene that there is."""
    titles = list(methods[0].result.truth.scene_titles.values())
    return "average over scenes" if len(titles) > 1 else f"scene {titles[0]}"


def _limits(found: Sequence[Interval]) -> Floats:
    """Return limits (N, 2), NaN where there is no interval."""
    none = (np.nan, np.nan)
    limits = [none if i.low is None or i.high is None else (i.low, i.high) for i in found]
    return np.array(limits, np.float64).reshape(-1, 2)


def _reasons(names: Sequence[str], found: Sequence[Interval]) -> list[str]:
    """Say why methods have no interval, once where all have none for the same reason."""
    said: dict[str, list[str]] = {}
    for name, interval in zip(names, found, strict=True):
        if interval.reason:
            said.setdefault(interval.reason, []).append(name)
    return [
        f"no interval{'' if len(lacking) == len(names) else f' of {who(lacking)}'}: {reason}"
        for reason, lacking in said.items()
    ]


def scenes(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw a score by method and scene."""
    titles = methods[0].result.truth.scene_titles
    values = [[m.result.scenes[scene][score.key] for scene in titles] for m in methods]
    names = [method.name for method in methods]
    noted = _noted(methods, sheet)
    return draw_heat_map(names, list(titles.values()), np.array(values), score, noted)


def condition(
    methods: Sequence[Scored],
    score: ScoreColumn,
    by: str,
    bins: Sequence[float] | None = None,
    sheet: Sheet | None = None,
) -> Figure:
    """Draw a score by a condition, with 95 % intervals where a group has enough queries.

    Raises
    ------
    UsageError
        See `airzoo_bench.tables.breakdown.group_records`.
    """
    grouping = group_records(methods[0].records, by, bins)
    values = np.array([method.records[score.key].to_numpy(np.float64) for method in methods])
    medians = np.full(len(methods), score.average == "median")
    averages = group_averages(values, medians, grouping.codes, len(grouping.labels))
    plan, unit = ResamplingConfig(), methods[0].result.unit
    shares = np.full(len(methods), unit == "query" and is_share(score))
    sample = Sample(unit, ("",), (values,), medians, shares)
    found = group_intervals(sample, grouping, plan)
    titles = methods[0].result.truth.scene_titles if by == "scene" else {}
    over = f"over all {plural(unit)} of a group, whatever their scene"
    return draw_by_condition(
        [method.name for method in methods],
        averages,
        [titles.get(label, label) for label in grouping.labels],
        grouping.counts.tolist(),
        score,
        condition_title(by),
        np.stack([_limits(group) for group in found], axis=1),
        _noted(methods, sheet).noting(
            f"{over}; {_whiskers(found, plan, plural(unit))}", _open_marks(averages)
        ),
    )


def _open_marks(averages: Floats) -> str:
    infinite = int(np.isposinf(averages).sum())
    return f"open: infinite, {infinite} of {averages.size} values" if infinite else ""


def _whiskers(found: Sequence[Sequence[Interval]], plan: ResamplingConfig, units: str) -> str:
    """Say what whiskers are, and why some groups have none."""
    every = [interval for group in found for interval in group]
    alike = any("alike" in interval.reason for interval in every)
    why = f"fewer than {FEWEST} {units}" + ", or all are alike" * alike
    made = intervals_made(every, plan, f"{units} within each group")
    if not made:
        return f"no intervals: each group has {why}"
    lacking = any(interval.reason for interval in every)
    return f"whiskers: {made}{f', none where a group has {why}' if lacking else ''}"


def _noted(methods: Sequence[Scored], sheet: Sheet | None) -> Sheet:
    """Return the sheet with what the picture is of as the first line of its small print."""
    given = sheet or Sheet()
    return replace(given, notes=(small_print(methods), *given.notes))

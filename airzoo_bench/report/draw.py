"""Pictures of results and their records, one function per kind of picture."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.by_condition import draw_by_condition
from airzoo_bench.report.curves import NEAR, PERCENT, errors, recall
from airzoo_bench.report.figures import new_canvas
from airzoo_bench.report.labels import noted, over_scenes, who
from airzoo_bench.report.markers import draw_lines, draw_markers
from airzoo_bench.report.overview import draw_heat_map, draw_intervals
from airzoo_bench.report.sheet import Sheet, finish
from airzoo_bench.results.comparable import check_same_column, choose_scores, find_scene
from airzoo_bench.results.comparison import is_share, make_sample
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables.breakdown import (
    condition_title,
    group_averages,
    group_intervals,
    group_records,
)
from airzoo_bench.tables.intervals import intervals_made, resampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "choose_score",
    "condition",
    "errors",
    "intervals",
    "of_scene",
    "over_what",
    "recall",
    "scenes",
    "threshold_scores",
    "thresholds",
]


_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")
_DECADE = 10.0


def choose_score(
    methods: Sequence[Scored], wanted: str | None, *, of_errors: bool = False
) -> ScoreColumn:
    """Return the score that was named, else the first headline one, or the first error."""
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
    """Return the methods restricted to one scene, named by id or title."""
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


def threshold_scores(columns: Sequence[ScoreColumn]) -> dict[str, dict[float, str]]:
    """Map each distance to the key of its score, separately for precision, recall and F1."""
    found: dict[str, dict[float, str]] = {"precision": {}, "recall": {}, "f1": {}}
    for column in columns:
        if match := _THRESHOLD.fullmatch(column.key):
            found[match[1]][float(match[2])] = column.key
    return {what: dict(sorted(keys.items())) for what, keys in found.items()}


@default_style()
def thresholds(methods: Sequence[Scored], sheet: Sheet | None = None) -> Figure:
    """Draw precision, recall and F1 at the protocol's distances, averaged over scenes."""
    keys = threshold_scores(methods[0].result.columns)
    if not keys["f1"]:
        raise UsageError(
            f"results of the {methods[0].result.track} track have no precision over distance",
            expected="results of the reconstruction track",
        )
    sheet = noted(methods, sheet)
    wide = sheet.wide(9.0)
    stacked = wide < 5.5
    figure = new_canvas(wide, 5.4 if stacked else 3.0)
    panels = figure.subplots(*((3, 1) if stacked else (1, 3)), sharey=True, sharex=True)
    headline = methods[0].result.protocol.settings.get("scores", {}).get("headline_below_m")
    for axes, (what, at) in zip(panels, keys.items(), strict=True):
        _draw_panel(axes, methods, at, headline)
        title = {"f1": "F1"}.get(what, what)
        axes.set(title=title, ylim=PERCENT)
    for axes in panels[-1:] if stacked else panels:
        axes.set_xlabel("distance d [m]")
    label = "points nearer than d [%]"
    if stacked:
        figure.supylabel(label, fontsize=sheet.font(wide))
    else:
        panels[0].set_ylabel(label)
    said = ["mean over scenes"] * bool(over_scenes(methods))
    said += [f"dashed: d = {headline:g} m, of the headline scores"] if headline else []
    finish(figure, sheet.noting("; ".join(said)), [method.name for method in methods])
    return figure


def _draw_panel(
    axes: Axes, methods: Sequence[Scored], at: dict[float, str], headline: float | None
) -> None:
    distances = np.array(list(at))
    values = [[100 * method.result.overall[key] for key in at.values()] for method in methods]
    is_log = distances[-1] >= _DECADE * distances[0]
    axes.set_xscale("log" if is_log else "linear")
    draw_lines(axes, [distances] * len(methods), [np.array(row) for row in values])
    draw_markers(axes, distances, np.array(values), near=2 * NEAR, size=4.0)
    if headline:
        axes.axvline(headline, color="0.45", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    axes.set_xticks(distances.tolist(), [f"{d:g}" for d in at])
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)


def intervals(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the average over scenes with its 95 % interval, resampled as in `compare`."""
    plan = ResamplingConfig()
    sample = make_sample(methods, [score])
    found = sample_intervals(sample, plan, groups=False).overall
    values = np.array([method.result.overall[score.key] for method in methods])
    names = [method.name for method in methods]
    made = intervals_made(found, plan, resampled(methods[0].result.unit), "interval")
    what = f"{over_what(methods)}; bars: {made}" if made else over_what(methods)
    sheet = noted(methods, sheet).noting(what, *_reasons(names, found))
    return draw_intervals(names, values, _limits(found), score, "", sheet)


def over_what(methods: Sequence[Scored]) -> str:
    """Say what overall values are: averages over scenes, or values of the only scene."""
    titles = list(methods[0].result.truth.scene_titles.values())
    return "average over scenes" if len(titles) > 1 else f"scene {titles[0]}"


def _limits(found: Sequence[Interval]) -> Floats:
    """Return limits (N, 2), NaN where there is no interval."""
    none = (np.nan, np.nan)
    limits = [none if i.low is None or i.high is None else (i.low, i.high) for i in found]
    return np.array(limits, np.float64).reshape(-1, 2)


def _reasons(names: Sequence[str], found: Sequence[Interval]) -> list[str]:
    """Say why methods have no interval; one sentence if the reason is the same for all."""
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
    sheet = noted(methods, sheet)
    return draw_heat_map(names, list(titles.values()), np.array(values), score, sheet)


def condition(
    methods: Sequence[Scored],
    score: ScoreColumn,
    by: str,
    bins: Sequence[float] | None = None,
    sheet: Sheet | None = None,
) -> Figure:
    """Draw a score by a condition, with 95 % intervals where a group has enough queries."""
    check_same_column(methods, by)
    grouping = group_records(methods[0].records, by, bins)
    values = np.array([method.records[score.key].to_numpy(np.float64) for method in methods])
    medians = np.full(len(methods), score.average == "median")
    averages = group_averages(values, medians, grouping.codes, len(grouping.labels))
    plan, unit = ResamplingConfig(), methods[0].result.unit
    shares = np.full(len(methods), is_share(score))
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
        noted(methods, sheet).noting(
            f"{over}; {_whiskers(found, plan, plural(unit))}", _open_marks(averages)
        ),
    )


def _open_marks(averages: Floats) -> str:
    infinite = int(np.isposinf(averages).sum())
    return f"open: infinite, {infinite} of {averages.size} values" if infinite else ""


def _whiskers(found: Sequence[Sequence[Interval]], plan: ResamplingConfig, units: str) -> str:
    """Explain the whiskers, and why some groups have none."""
    every = [interval for group in found for interval in group]
    alike = any("alike" in interval.reason for interval in every)
    why = f"fewer than {FEWEST} {units}" + ", or all are alike" * alike
    made = intervals_made(every, plan, f"{units} within each group")
    if not made:
        return f"no intervals: each group has {why}"
    lacking = any(interval.reason for interval in every)
    return f"whiskers: {made}{f', none where a group has {why}' if lacking else ''}"

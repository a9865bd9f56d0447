"""Pictures of methods side by side, as marks: intervals, scores by scene, and by a condition."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import plural
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    finish,
    label_text,
    name_text,
    new_canvas,
    series_style,
)
from airzoo_bench.report.labels import arrow, axis_label, noted, shown_value, spans_decades, who
from airzoo_bench.results.comparable import check_same_column
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
from airzoo_bench.tables.model import show_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure


_COLOURS = "viridis"  # even steps of lightness, for print and colour-blind readers
_DARK = 0.18  # black and white have the same contrast on it (WCAG 2.2, relative luminance)
_LEAST_SPAN = 10.0  # percent: near shares are near in colour
_POINTS, _LETTER = 72.0, 0.6
_LEAST_PT, _MOST_PT = 6.0, 8.0
_WIDEST_IN = 14.0
_SHARE_OF_GROUP = 0.84


def over_what(methods: Sequence[Scored]) -> str:
    """Say what overall values are: averages over scenes, or values of the only scene."""
    titles = list(methods[0].result.truth.scene_titles.values())
    return "average over scenes" if len(titles) > 1 else f"scene {titles[0]}"


def intervals(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the average over scenes with its 95 % interval, resampled as in `compare`."""
    plan = ResamplingConfig()
    found = sample_intervals(make_sample(methods, [score]), plan, groups=False).overall
    made = intervals_made(found, plan, resampled(methods[0].result.unit), "interval")
    what = f"{over_what(methods)}; bars: {made}" if made else over_what(methods)
    sheet = noted(methods, sheet).noting(what, *_reasons([m.name for m in methods], found))
    return draw_intervals(methods, score, _limits(found), sheet)


def _limits(found: Sequence[Interval]) -> Floats:
    """Return limits (N, 2), NaN where there is no interval."""
    none = (np.nan, np.nan)
    limits = [none if i.low is None or i.high is None else (i.low, i.high) for i in found]
    return np.array(limits, np.float64).reshape(-1, 2)


def _reasons(names: Sequence[str], found: Sequence[Interval]) -> list[str]:
    """Say why methods have no interval; one sentence if the reason is the same for all."""
    lacking: dict[str, list[str]] = {}
    for name, interval in zip(names, found, strict=True):
        if interval.reason:
            lacking.setdefault(interval.reason, []).append(name)
    return [
        f"no interval{'' if len(those) == len(names) else f' of {who(those)}'}: {reason}"
        for reason, those in lacking.items()
    ]


@default_style()
def draw_intervals(
    methods: Sequence[Scored], score: ScoreColumn, limits: Floats, sheet: Sheet
) -> Figure:
    """Draw each method's average and its interval (M, 2), NaN for none, the best on top."""
    figure = new_canvas(sheet.wide(6.4), 0.75 + 0.3 * len(methods))
    axes = figure.add_subplot()
    values = np.array([method.result.overall[score.key] for method in methods])
    order = np.argsort((-1 if score.higher_is_better else 1) * values, kind="stable")[::-1]
    shown = shown_value(score, np.column_stack([values, limits]))
    _fit(axes, shown[np.isfinite(shown)], score)
    for place, row in enumerate(order):
        value, low, high = shown[row]
        if np.isfinite(low):
            _draw_span(axes, (low, high), place, {"color": COLOURS[0], "linewidth": 2.2}, "x")
        _draw_value(axes, value, place, {"color": COLOURS[1], "marker": "o", "markersize": 6}, "x")
    longest = 48 if sheet.wide(6.4) >= 5 else 26
    axes.set_yticks(range(len(order)), [_short(methods[row].name, longest) for row in order])
    axes.set_ylim(-0.6, len(order) - 0.4)
    axes.set_xlabel(f"{axis_label(score)}, {'→' if score.higher_is_better else '←'} better")
    axes.grid(axis="x", alpha=0.3)
    infinite = "open, at the right edge: infinite" if np.isposinf(values).any() else ""
    finish(figure, sheet.noting(infinite))
    return figure


def _short(name: str, most: int) -> str:
    name = name_text(name)
    return label_text(name if len(name) <= most else name[: most - 1] + "…")


def _fit(axes: Axes, finite: Floats, score: ScoreColumn) -> None:
    """Let the axis cover all finite values; logarithmic if errors span decades."""
    if not len(finite):
        axes.set_xticks([])
        return
    low, high = float(finite.min()), float(finite.max())
    if spans_decades(score, finite):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(low / (high / low) ** 0.05, high * (high / low) ** 0.1)
    else:
        span = (high - low) or 0.1 * abs(high) or 1.0
        axes.set_xlim(low - 0.05 * span, high + 0.1 * span)


def _draw_value(axes: Axes, value: float, place: float, style: dict[str, Any], along: str) -> None:
    """Draw a value along an axis; an infinite one is an open mark on the edge."""
    more: dict[str, Any] = {"linestyle": "none", "clip_on": False, "zorder": 4}
    if np.isposinf(value):
        edge = axes.get_yaxis_transform() if along == "x" else axes.get_xaxis_transform()
        more |= {"markerfacecolor": "white", "transform": edge}
        value = 1.0
    if np.isfinite(value):
        point = ([value], [place]) if along == "x" else ([place], [value])
        axes.plot(*point, **style | more)


def _draw_span(
    axes: Axes, ends: tuple[float, float], place: float, style: dict[str, Any], along: str
) -> None:
    """Draw an interval along an axis; one without an upper limit is an arrow to the edge."""
    low, high = ends
    if np.isfinite(high):
        pair = (place, place)
        axes.plot(*((ends, pair) if along == "x" else (pair, ends)), zorder=2, **style)
        return
    flat = along == "x"
    axes.annotate(
        "",
        xy=(1.0, place) if flat else (place, 1.0),
        xycoords=("axes fraction", "data") if flat else ("data", "axes fraction"),
        xytext=(low, place) if flat else (place, low),
        textcoords="data",
        arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0, **style},
    )
    axes.update_datalim([(low, place) if flat else (place, low)])


@default_style()
def scenes(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw a score by method and scene as coloured cells: brighter is better."""
    sheet = noted(methods, sheet)
    titles = methods[0].result.truth.scene_titles
    values = [[m.result.scenes[scene][score.key] for scene in titles] for m in methods]
    shown = shown_value(score, np.array(values))
    width = sheet.wide(max(6.4, 2.9 + 0.58 * len(titles)))
    size = sheet.font(width)
    figure = new_canvas(width, max(1.6, 0.9 + 0.33 * len(methods)))
    axes = figure.add_subplot()
    axes.set_facecolor("0.85")
    finite = np.isfinite(shown)
    image = axes.imshow(
        np.ma.masked_array(shown, ~finite),
        cmap=_COLOURS if score.higher_is_better else f"{_COLOURS}_r",
        norm=_colour_scale(score, shown[finite]),
        aspect="auto",
        interpolation="nearest",
    )
    if finite.any():
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=max(8, 3 * len(methods)))
        bar.set_label(f"{axis_label(score)} {arrow(score)}")
        bar.ax.yaxis.set_major_formatter("{x:g}")
    longest = 48 if width >= 5 else 22
    axes.set_yticks(range(len(methods)), [_short(m.name, longest) for m in methods])
    cell_pt = (width - 2.6) * _POINTS / len(titles)
    step = max(1, int(np.ceil(1.2 * _LEAST_PT / cell_pt)))
    _name_groups(axes, [*titles.values()], cell_pt, size - 1, step)
    grey = "" if finite.all() else "; grey: infinite"
    named = f"too narrow for names: one scene of {step} is named" if step > 1 else ""
    numbers = _write_numbers(axes, shown, image.to_rgba(shown), cell_pt)
    finish(figure, sheet.noting(f"brighter is better{grey}", numbers, named))
    return figure


def _colour_scale(score: ScoreColumn, finite: Floats) -> Normalize:
    """Return the colour scale, logarithmic if errors span decades."""
    from matplotlib.colors import LogNorm, Normalize

    if spans_decades(score, finite):
        return LogNorm(float(finite.min()), float(finite.max()))
    least = _LEAST_SPAN if score.unit == "share" else 0.0
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    return Normalize(low, max(high, low + least))


def _write_numbers(axes: Axes, shown: Floats, rgba: Floats, cell_pt: float) -> str:
    """Write the values into the cells, as in tables; return a note if cells are too small."""
    texts = np.vectorize(lambda value: show_number(value, 2), otypes=[object])(shown)
    size = min(_MOST_PT, cell_pt / (_LETTER * (max(map(len, texts.ravel())) + 1)))
    if size < _LEAST_PT:
        return "too narrow for numbers: see the table"
    linear = np.where(rgba <= 0.04045, rgba / 12.92, ((rgba + 0.055) / 1.055) ** 2.4)
    dark = np.isfinite(shown) & (linear[..., :3] @ (0.2126, 0.7152, 0.0722) < _DARK)
    for row, column in np.ndindex(*shown.shape):
        colour = "white" if dark[row, column] else "black"
        style: Any = {"ha": "center", "va": "center", "color": colour, "fontsize": size}
        axes.text(column, row, texts[row, column], **style)
    return ""


def _name_groups(
    axes: Axes, labels: Sequence[str], slot_pt: float, size: float, step: int = 1
) -> None:
    """Name groups below an axis: upright where there is room, otherwise slanted."""
    axes.set_xticks(range(0, len(labels), step), [label_text(t) for t in labels][::step])
    if max(map(len, labels)) * _LETTER * size > slot_pt:
        turn = 45 if slot_pt > 1.8 * size else 90
        for text in axes.get_xticklabels():
            text.set(rotation=turn, ha="right", va="center", rotation_mode="anchor")
        figure: Any = axes.get_figure(root=True)
        more = max(map(len, labels)) * _LETTER * size * np.sin(np.radians(turn)) / _POINTS
        figure.set_figheight(figure.get_figheight() + min(more, 2.5))


@default_style()
def condition(
    methods: Sequence[Scored],
    score: ScoreColumn,
    by: str,
    bins: Sequence[float] | None = None,
    sheet: Sheet | None = None,
    plan: ResamplingConfig | None = ResamplingConfig(),  # noqa: B008
) -> Figure:
    """Draw a score by a condition, with 95 % intervals where a group has enough queries."""
    check_same_column(methods, by)
    grouping = group_records(methods[0].records, by, bins)
    values = np.array([method.records[score.key].to_numpy(np.float64) for method in methods])
    medians = np.full(len(methods), score.average == "median")
    averages = group_averages(values, medians, grouping.codes, len(grouping.labels))
    unit, shares = methods[0].result.unit, np.full(len(methods), is_share(score))
    sample = Sample(unit, ("",), (values,), medians, shares)
    lacking = [[Interval.lacking("")] * len(methods)] * len(grouping.labels)
    found = group_intervals(sample, grouping, plan) if plan else lacking
    whiskers = _whiskers(found, plan, plural(unit)) if plan else "no intervals: too many queries"
    titles = methods[0].result.truth.scene_titles if by == "scene" else {}
    infinite = int(np.isposinf(averages).sum())
    over = f"over all {plural(unit)} of a group, whatever their scene"
    sheet = noted(methods, sheet).noting(
        f"{over}; {whiskers}",
        f"open: infinite, {infinite} of {averages.size} values" if infinite else "",
    )
    labels = [titles.get(label, label) for label in grouping.labels]
    limits = np.stack([_limits(group) for group in found], axis=1)
    figure = _draw_groups(methods, averages, limits, score, len(labels), sheet)
    axes, width = figure.axes[0], figure.get_figwidth()
    axes.set_xlabel(label_text(condition_title(by)))
    slot_pt, size = (width - 0.9) * _POINTS / len(labels), sheet.font(width) - 1
    counts = grouping.counts.tolist()
    named = [f"{label} (n = {count})" for label, count in zip(labels, counts, strict=True)]
    _name_groups(axes, named, slot_pt, size)
    finish(figure, sheet, [method.name for method in methods], lines=False)
    return figure


def _whiskers(found: Sequence[Sequence[Interval]], plan: ResamplingConfig, units: str) -> str:
    """Explain the whiskers, and why some groups have none."""
    made = intervals_made(chain.from_iterable(found), plan, f"{units} within each group")
    why = f"a group has fewer than {FEWEST} {units}, or all are alike"
    return f"whiskers: {made}, none where {why}" if made else f"no intervals: {why}"


def _draw_groups(
    methods: Sequence[Scored],
    averages: Floats,
    limits: Floats,
    score: ScoreColumn,
    groups: int,
    sheet: Sheet,
) -> Figure:
    """Draw the marks of all methods side by side in each group, with their intervals."""
    usual = 1.2 + groups * max(0.5, 0.25 + 0.075 * len(methods))
    width = sheet.wide(float(np.clip(usual, 6.4, _WIDEST_IN)))
    figure = new_canvas(width, 3.2 if width >= 5 else 2.4)
    axes = figure.add_subplot()
    step = _SHARE_OF_GROUP / len(methods)
    size = float(np.clip(0.85 * step * (width - 0.9) * _POINTS / groups, 1.5, 6.0))
    values, ends = shown_value(score, averages), shown_value(score, limits)
    for number, group in np.ndindex(*values.shape):
        place = group + step * (number - (len(methods) - 1) / 2)
        style = series_style(number)
        low, high = ends[number, group]
        if np.isfinite(low):
            line = {"color": style["color"], "linewidth": 0.9}
            _draw_span(axes, (float(low), float(high)), place, line, "y")
        mark = {"color": style["color"], "marker": style["marker"], "markersize": size}
        _draw_value(axes, float(values[number, group]), place, mark, "y")
    for edge in np.arange(1, groups) - 0.5:
        axes.axvline(edge, color="0.85", linewidth=0.8, zorder=0)
    _scale(axes, score, values[np.isfinite(values)])
    axes.set(xlim=(-0.5, groups - 0.5), ylabel=axis_label(score))
    axes.grid(axis="y", alpha=0.3)
    return figure


def _scale(axes: Axes, score: ScoreColumn, finite: Floats) -> None:
    """Scale the axis: shares from 0 to 100, errors logarithmically if they span two decades."""
    if score.unit == "share":
        axes.set_ylim(-2, 102)
    elif spans_decades(score, finite):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        top = float(axes.dataLim.y1) if np.isfinite(axes.dataLim.y1) else 1.0
        axes.set_ylim(0, 1.05 * top or 1.0)

"""Pictures of methods side by side: curves, intervals, scores by scene and by a condition."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    axis_label,
    error_label,
    finish,
    label_text,
    name_text,
    new_canvas,
    noted,
    over_scenes,
    scale_shares,
    series_style,
    spans_decades,
    who,
)
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
    from matplotlib.figure import Figure

_STEPS, _MARKS = 256, 9
_KS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
_PERCENT = (-2.0, 102.0)
_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")
_DARK = 0.18  # black and white have the same contrast on it (WCAG 2.2, relative luminance)
_LEAST_SPAN = 10.0  # percent: near shares are near in colour
_POINTS, _LETTER, _LEAST_PT, _MOST_PT = 72.0, 0.6, 6.0, 8.0
_WIDEST_IN, _SHARE_OF_GROUP = 14.0, 0.84


def recall_curve(method: Scored, up_to: int) -> Floats:
    """Recall at K = 1 ... `up_to`, the unweighted mean over scenes, from first hits."""
    scenes = method.records.groupby("scene")["first_hit_rank"]
    ranks = [np.where((r >= 1) & (r <= up_to), r, up_to + 1) for _, r in scenes]
    hits = [np.bincount(r, minlength=up_to + 2)[1:-1] / len(r) for r in ranks]
    return np.asarray(np.mean(np.cumsum(hits, axis=1), axis=0))


def longest_list(method: Scored, up_to: int) -> int:
    """Return the length of a method's longest list of tiles, 1 to `up_to`."""
    if "ranked" not in method.records:
        return up_to
    return int(np.clip(method.records["ranked"].max(), 1, up_to))


def ranks_in_records(method: Scored) -> int:
    """Return how many ranks of each query the protocol keeps."""
    if "first_hit_rank" not in method.records:
        raise UsageError(
            f"results of the {method.result.track} track have no ranks",
            expected="results of the retrieval track",
        )
    return int(method.result.protocol.settings["scores"]["ranks_kept"])


def share_below(errors: Floats, limits: Floats) -> Floats:
    """Return the share of errors strictly below each limit (L,), as protocols count; 0 if empty."""
    below: Floats = np.searchsorted(np.sort(errors), limits, side="left") / max(len(errors), 1)
    return below


def error_shares(method: Scored, key: str, limits: Floats) -> Floats:
    """Return the share of queries with an error strictly below each limit, mean over scenes."""
    scenes = method.records.groupby("scene")[key]
    shares = [share_below(errors.to_numpy(np.float64), limits) for _, errors in scenes]
    return np.asarray(np.mean(shares, axis=0))


def _draw_lines(axes: Axes, xs: Sequence[Floats], ys: Sequence[Floats], **more: Any) -> None:
    """Draw a line a method, wider and with larger marks where later ones cover it."""
    for number, (x, y) in enumerate(zip(xs, ys, strict=True)):
        rest = [(one[: len(y)], y[: len(one)]) for one in ys[number + 1 :]]
        covering = min(3, sum(np.allclose(*pair, atol=0.3, rtol=0) for pair in rest))
        widths = {"linewidth": 1.4 + 1.4 * covering, "markersize": 4.5 + 2.5 * covering}
        axes.plot(x, y, clip_on=False, zorder=2, **series_style(number) | widths | more)


def _new_axes(sheet: Sheet) -> tuple[Figure, Axes]:
    wide = sheet.wide(6.4)
    figure = new_canvas(wide, 3.4 if wide >= 5.0 else 2.2)
    axes = figure.add_subplot()
    axes.grid(alpha=0.3)
    return figure, axes


@default_style()
def recall(
    methods: Sequence[Scored], up_to: int | None = None, sheet: Sheet | None = None
) -> Figure:
    """Draw recall at K over K, for each method up to the length of its longest list."""
    kept, sheet = ranks_in_records(methods[0]), noted(methods, sheet)
    if up_to is not None and up_to > kept:
        raise UsageError(f"--up-to {up_to}: the protocol keeps {kept} ranks of each query")
    lengths = [longest_list(method, up_to or kept) for method in methods]
    last = max(lengths)
    figure, axes = _new_axes(sheet)
    curves = [100 * recall_curve(m, n) for m, n in zip(methods, lengths, strict=True)]
    ticks = [k for k in _KS if k <= max(2, last)]
    _draw_lines(axes, [np.arange(1.0, n + 1) for n in lengths], curves)
    for line, length in zip(axes.lines, lengths, strict=True):
        line.set_markevery(sorted({k - 1 for k in (*ticks, length) if k <= length}))
    axes.set(xscale="log", xlim=(0.9, max(2, last) * 1.13), ylim=_PERCENT)
    axes.set(xlabel="K, number of tiles looked at", ylabel=f"R@K{over_scenes(methods)} [%]")
    axes.set_xticks(ticks, [f"{k}" for k in ticks])
    axes.set_xticks([], minor=True)
    short = [(n, m.name) for m, n in zip(methods, lengths, strict=True) if n < last]
    ends = [f"{who([m for k, m in short if k == n])} at {n}" for n in sorted({n for n, _ in short})]
    ended = f"lists end earlier: {'; '.join(ends)}" if ends else ""
    finish(figure, sheet.noting(ended), [method.name for method in methods])
    return figure


@default_style()
def errors(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the share of queries with an error below a value; failures never count as below."""
    sheet = noted(methods, sheet)
    figure, axes = _new_axes(sheet)
    every = [method.records[score.key].to_numpy(np.float64) for method in methods]
    there = np.concatenate([one[np.isfinite(one) & (one > 0)] for one in every])
    low, high = np.quantile(there, [0.001, 0.999]) if len(there) else (0.1, 100.0)
    limits = np.geomspace(low / 1.1, high * 1.1, _STEPS)
    curves = [100 * error_shares(method, score.key, limits) for method in methods]
    _draw_lines(axes, [limits] * len(methods), curves, drawstyle="steps-mid")
    for number, line in enumerate(axes.lines):
        line.set_markevery((number % 5 * _STEPS // (5 * _MARKS), _STEPS // _MARKS))
    unit = plural(methods[0].result.unit)
    mean = over_scenes(methods) if unit == "queries" else ""
    axes.set(xlim=(limits[0], limits[-1]), ylim=_PERCENT)
    axes.set(xlabel=error_label(score), ylabel=f"{unit} below{mean} [%]")
    if limits[-1] >= 4 * limits[0]:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        if limits[-1] < 1000 * limits[0]:  # few powers of ten: 2 and 5 between them have labels
            axes.xaxis.set_minor_formatter(lambda v, _: f"{v:g}" if f"{v:e}"[0] in "25" else "")
    stated = methods[0].result.protocol.settings.get("scores", {}).get("translation_below_m", [])
    for limit in stated if score.key == "error_m" else ():
        if limits[0] < limit < limits[-1]:
            axes.axvline(limit, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
    beyond = _beyond([m.name for m in methods], every, float(limits[-1]), unit)
    finish(figure, sheet.noting(beyond), [method.name for method in methods])
    return figure


def _beyond(names: Sequence[str], every: Sequence[Floats], right: float, unit: str) -> str:
    """Count the errors beyond the right end of the axis, which curves do not show."""
    counts = []
    for name, found in zip(names, every, strict=True):
        infinite, beyond = np.isinf(found).sum(), (found >= right).sum()
        kinds = {"infinite": infinite, "larger": beyond - infinite}
        parts = " and ".join(f"{count} {kind}" for kind, count in kinds.items() if count)
        counts += [f"{name_text(name)} {parts}"] if parts else []
    return f"off the axis, of {len(every[0])} {unit}: {who(counts, '; ')}" * bool(counts)


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
    keys, result = threshold_scores(methods[0].result.columns), methods[0].result
    if not keys["f1"]:
        raise UsageError(
            f"results of the {result.track} track have no precision over distance",
            expected="results of the reconstruction track",
        )
    sheet = noted(methods, sheet)
    wide = sheet.wide(9.0)
    stacked = wide < 5.0
    figure = new_canvas(wide, 4.2 if stacked else 2.8)
    panels = figure.subplots(3, 1, sharex=True) if stacked else figure.subplots(1, 3, sharey=True)
    headline = result.protocol.settings.get("scores", {}).get("headline_below_m")
    for axes, (what, at) in zip(panels, keys.items(), strict=True):
        distances = np.array(list(at))
        axes.set_xscale("log" if distances[-1] >= 10 * distances[0] else "linear")
        values = [100 * np.array([m.result.overall[key] for key in at.values()]) for m in methods]
        _draw_lines(axes, [distances] * len(methods), values)
        if headline:
            axes.axvline(headline, color="0.45", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
        axes.set_xticks(distances.tolist(), [f"{d:g}" for d in at])
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
        axes.set(title={"f1": "F1"}.get(what, what), ylim=_PERCENT)
    for axes in panels[-1:] if stacked else panels:
        axes.set_xlabel("distance d [m]")
    panels[len(panels) // 2 if stacked else 0].set_ylabel("points nearer than d [%]")
    dashed = f"dashed: d = {headline:g} m, of the headline scores" if headline else ""
    mean = over_scenes(methods).removeprefix(", ")
    finish(figure, sheet.noting(mean, dashed), [method.name for method in methods])
    return figure


def over_what(methods: Sequence[Scored]) -> str:
    """Say what overall values are: averages over scenes, or values of the only scene."""
    titles = list(methods[0].result.truth.scene_titles.values())
    return "average over scenes" if len(titles) > 1 else f"scene {titles[0]}"


def intervals(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the average over scenes with its 95 % interval, resampled as in `compare`."""
    plan = ResamplingConfig()
    found = sample_intervals(make_sample(methods, [score]), plan, groups=False).overall
    made = intervals_made(found, plan, resampled(methods[0].result.unit), "interval")
    lacking: dict[str, list[str]] = {}
    for method, interval in zip(methods, found, strict=True):
        if interval.reason:
            lacking.setdefault(interval.reason, []).append(method.name)
    reasons = [
        f"no interval{'' if len(those) == len(methods) else f' of {who(those)}'}: {reason}"
        for reason, those in lacking.items()
    ]
    what = f"{over_what(methods)}; bars: {made}" if made else over_what(methods)
    sheet = noted(methods, sheet).noting(what, *reasons)
    return draw_intervals(methods, score, _limits(found), sheet)


def _limits(found: Sequence[Interval]) -> Floats:
    """Return limits (N, 2), NaN where there is no interval."""
    return np.array([(i.low, i.high) for i in found], np.float64).reshape(-1, 2)


@default_style()
def draw_intervals(
    methods: Sequence[Scored], score: ScoreColumn, limits: Floats, sheet: Sheet
) -> Figure:
    """Draw each method's average and its interval (M, 2), NaN for none, the best on top."""
    figure = new_canvas(sheet.wide(6.4), 0.75 + 0.3 * len(methods))
    axes = figure.add_subplot()
    values = np.array([method.result.overall[score.key] for method in methods])
    order = np.argsort((-1 if score.higher_is_better else 1) * values, kind="stable")[::-1]
    shown = scale_shares(score, np.column_stack([values, limits]))
    _fit(axes, shown[np.isfinite(shown)], score)
    for place, row in enumerate(order):
        _draw_span(axes, shown[row, 1:], place, {"color": COLOURS[0], "linewidth": 2.2}, "x")
        mark = {"color": COLOURS[1], "marker": "o", "markersize": 6}
        _draw_value(axes, shown[row, 0], place, mark, "x")
    names = [_short(methods[row].name, 48 if sheet.wide(6.4) >= 5 else 26) for row in order]
    axes.set_yticks(range(len(order)), names)
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


def _draw_span(axes: Axes, ends: Floats, place: float, style: dict[str, Any], along: str) -> None:
    """Draw an interval, if there is one, along an axis; an arrow where it has no upper limit."""
    low, high = ends.tolist()
    flat = along == "x"
    if not np.isfinite(low):
        return
    if np.isfinite(high):
        pair = (place, place)
        axes.plot(*(((low, high), pair) if flat else (pair, (low, high))), zorder=2, **style)
        return
    start = (low, place) if flat else (place, low)
    axes.annotate(
        "",
        xy=(1.0, place) if flat else (place, 1.0),
        xycoords=("axes fraction", "data") if flat else ("data", "axes fraction"),
        xytext=start,
        textcoords="data",
        arrowprops={"arrowstyle": "->", "shrinkA": 0, "shrinkB": 0, **style},
    )
    axes.update_datalim([start])


@default_style()
def scenes(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw a score by method and scene as coloured cells: brighter is better."""
    from matplotlib.colors import LogNorm, Normalize

    sheet = noted(methods, sheet)
    titles = methods[0].result.truth.scene_titles
    values = [[m.result.scenes[scene][score.key] for scene in titles] for m in methods]
    shown = scale_shares(score, np.array(values))
    width = sheet.wide(max(6.4, 2.9 + 0.58 * len(titles)))
    figure = new_canvas(width, max(1.6, 0.9 + 0.33 * len(methods)))
    axes = figure.add_subplot()
    axes.set_facecolor("0.85")
    finite = np.isfinite(shown)
    ends = shown[finite] if finite.any() else np.array([0.0, 1.0])
    low, high = float(ends.min()), float(ends.max())
    least = low + (_LEAST_SPAN if score.unit == "share" else 0.0)
    is_log = spans_decades(score, shown[finite])
    image = axes.imshow(
        np.ma.masked_array(shown, ~finite),
        cmap="viridis" if score.higher_is_better else "viridis_r",
        norm=LogNorm(low, high) if is_log else Normalize(low, max(high, least)),
        aspect="auto",
        interpolation="nearest",
    )
    if finite.any():
        bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=max(8, 3 * len(methods)))
        bar.set_label(f"{axis_label(score)} {'↑' if score.higher_is_better else '↓'}")
        bar.ax.yaxis.set_major_formatter("{x:g}")
    names = [_short(method.name, 48 if width >= 5 else 22) for method in methods]
    axes.set_yticks(range(len(methods)), names)
    cell_pt = (width - 2.6) * _POINTS / len(titles)
    step = max(1, int(np.ceil(1.2 * _LEAST_PT / cell_pt)))
    _name_groups(axes, [*titles.values()], cell_pt, sheet.font(width) - 1, step)
    grey = "" if finite.all() else "; grey: infinite"
    named = f"too narrow for names: one scene of {step} is named" if step > 1 else ""
    numbers = _write_numbers(axes, shown, image.to_rgba(shown), cell_pt)
    finish(figure, sheet.noting(f"brighter is better{grey}", numbers, named))
    return figure


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
    found, whiskers = [[Interval.lacking("")] * len(methods)] * len(grouping.labels), ""
    if plan is not None:
        sample = Sample(unit, ("",), (values,), medians, shares)
        found = group_intervals(sample, grouping, plan)
        drawn = f"{plural(unit)} within each group"
        whiskers = intervals_made(chain.from_iterable(found), plan, drawn)
    lacking = f"a group has fewer than {FEWEST} {plural(unit)}, or all are alike"
    said = f"whiskers: {whiskers}, none where {lacking}"
    if not whiskers:
        said = f"no intervals: {lacking if plan else 'there are too many queries'}"
    titles = methods[0].result.truth.scene_titles if by == "scene" else {}
    infinite = int(np.isposinf(averages).sum())
    sheet = noted(methods, sheet).noting(
        f"over all {plural(unit)} of a group, whatever their scene; {said}",
        f"open: infinite, {infinite} of {averages.size} values" if infinite else "",
    )
    limits = np.stack([_limits(group) for group in found], axis=1)
    figure = _draw_groups(methods, averages, limits, score, sheet)
    axes, width = figure.axes[0], figure.get_figwidth()
    axes.set_xlabel(label_text(condition_title(by)))
    counts = zip(grouping.labels, grouping.counts.tolist(), strict=True)
    named = [f"{titles.get(label, label)} (n = {count})" for label, count in counts]
    slot_pt = (width - 0.9) * _POINTS / len(named)
    _name_groups(axes, named, slot_pt, sheet.font(width) - 1)
    finish(figure, sheet, [method.name for method in methods], lines=False)
    return figure


def _draw_groups(
    methods: Sequence[Scored], averages: Floats, limits: Floats, score: ScoreColumn, sheet: Sheet
) -> Figure:
    """Draw the marks of all methods side by side in each group, with their intervals."""
    groups = averages.shape[1]
    usual = 1.2 + groups * max(0.5, 0.25 + 0.075 * len(methods))
    width = sheet.wide(float(np.clip(usual, 6.4, _WIDEST_IN)))
    figure = new_canvas(width, 3.2 if width >= 5 else 2.4)
    axes = figure.add_subplot()
    step = _SHARE_OF_GROUP / len(methods)
    size = float(np.clip(0.85 * step * (width - 0.9) * _POINTS / groups, 1.5, 6.0))
    values, ends = scale_shares(score, averages), scale_shares(score, limits)
    for number, group in np.ndindex(*values.shape):
        place = group + step * (number - (len(methods) - 1) / 2)
        style = series_style(number)
        line = {"color": style["color"], "linewidth": 0.9}
        _draw_span(axes, ends[number, group], place, line, "y")
        mark = {"color": style["color"], "marker": style["marker"], "markersize": size}
        _draw_value(axes, float(values[number, group]), place, mark, "y")
    for edge in np.arange(1, groups) - 0.5:
        axes.axvline(edge, color="0.85", linewidth=0.8, zorder=0)
    if score.unit == "share":
        axes.set_ylim(*_PERCENT)
    elif spans_decades(score, values[np.isfinite(values)]):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        top = float(axes.dataLim.y1) if np.isfinite(axes.dataLim.y1) else 1.0
        axes.set_ylim(0, 1.05 * top or 1.0)
    axes.set(xlim=(-0.5, groups - 0.5), ylabel=axis_label(score))
    axes.grid(axis="y", alpha=0.3)
    return figure

"""Pictures of methods side by side, as curves: recall over K, errors, precision over distance."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import Sheet, finish, name_text, new_canvas, series_style
from airzoo_bench.report.labels import error_label, noted, over_scenes, who
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_STEPS = 256
_FEW_DECADES = 1e3
_LEAST_RATIO = 4.0
_KS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
_PERCENT = (-2.0, 102.0)
_MARKS = 9
_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")


def recall_curve(method: Scored, up_to: int) -> Floats:
    """Recall at K = 1 ... `up_to`, the unweighted mean over scenes, from first hits."""
    shares = []
    for _, rows in method.records.groupby("scene", sort=True):
        ranks = rows["first_hit_rank"].to_numpy(np.int64)
        hits = np.bincount(ranks[(ranks >= 1) & (ranks <= up_to)], minlength=up_to + 1)[1:]
        shares.append(np.cumsum(hits) / len(ranks))
    mean: Floats = np.mean(shares, axis=0)
    return mean


def longest_list(method: Scored, up_to: int) -> int:
    """Return the length of a method's longest list of tiles, 1 to `up_to`."""
    if "ranked" not in method.records:
        return up_to
    return int(np.clip(method.records["ranked"].max(), 1, up_to))


def kept_ranks(method: Scored) -> int:
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
    scenes = method.records.groupby("scene", sort=True)[key]
    shares = [share_below(errors.to_numpy(np.float64), limits) for _, errors in scenes]
    return np.asarray(np.mean(shares, axis=0))


def _draw_lines(axes: Axes, xs: Sequence[Floats], ys: Sequence[Floats], **more: Any) -> None:
    """Draw a line a method, wider and with larger marks where later ones cover it."""
    for number, (x, y) in enumerate(zip(xs, ys, strict=True)):
        covering = min(3, sum(_covers(other, y) for other in ys[number + 1 :]))
        widths = {"linewidth": 1.4 + 1.4 * covering, "markersize": 4.5 + 2.5 * covering}
        axes.plot(x, y, clip_on=False, zorder=2, **series_style(number) | widths | more)


def _covers(one: Floats, other: Floats) -> bool:
    common = min(len(one), len(other))
    return bool(np.allclose(one[:common], other[:common], atol=0.3, rtol=0))


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
    kept, sheet = kept_ranks(methods[0]), noted(methods, sheet)
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
    limits = _error_limits(methods, score.key)
    curves = [100 * error_shares(method, score.key, limits) for method in methods]
    _draw_lines(axes, [limits] * len(methods), curves, drawstyle="steps-mid")
    for number, line in enumerate(axes.lines):
        line.set_markevery((number % 5 * _STEPS // (5 * _MARKS), _STEPS // _MARKS))
    unit = plural(methods[0].result.unit)
    mean = over_scenes(methods) if unit == "queries" else ""
    axes.set(xlim=(limits[0], limits[-1]), ylim=_PERCENT)
    axes.set(xlabel=error_label(score), ylabel=f"{unit} below{mean} [%]")
    _scale(axes, limits)
    _draw_thresholds(axes, methods[0], score)
    beyond = _beyond(methods, score.key, limits[-1], unit)
    finish(figure, sheet.noting(beyond), [method.name for method in methods])
    return figure


def _draw_thresholds(axes: Axes, method: Scored, score: ScoreColumn) -> None:
    """Mark the distances below which the protocol counts queries."""
    settings = method.result.protocol.settings.get("scores", {})
    stated = settings.get("translation_below_m", []) if score.key == "error_m" else []
    for limit in stated:
        if axes.get_xlim()[0] < limit < axes.get_xlim()[1]:
            axes.axvline(limit, color="0.6", linewidth=0.8, linestyle="--", zorder=0)


def _beyond(methods: Sequence[Scored], key: str, right: float, unit: str) -> str:
    """Count the errors beyond the right end of the axis, which curves do not show."""
    counts = []
    for method in methods:
        errors = method.records[key].to_numpy(np.float64)
        infinite, beyond = np.isinf(errors).sum(), (errors >= right).sum()
        kinds = {"infinite": infinite, "larger": beyond - infinite}
        parts = " and ".join(f"{count} {kind}" for kind, count in kinds.items() if count)
        counts += [f"{name_text(method.name)} {parts}"] if parts else []
    return f"off the axis, of {len(methods[0].records)} {unit}: {who(counts, '; ')}" * bool(counts)


def _scale(axes: Axes, limits: Floats) -> None:
    """Make the axis logarithmic, unless errors span too little for decade ticks."""
    if limits[-1] < _LEAST_RATIO * limits[0]:
        return
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    if limits[-1] < _FEW_DECADES * limits[0]:
        axes.xaxis.set_minor_formatter(_minor_label)


def _minor_label(value: float, _: float | None = None) -> str:
    """Label 2 and 5 between powers of ten."""
    return f"{value:g}" if f"{value:e}"[0] in "25" else ""


def _error_limits(methods: Sequence[Scored], key: str) -> Floats:
    """Return the errors at which curves are drawn, between the extreme quantiles of finite ones."""
    errors = np.concatenate([method.records[key].to_numpy(np.float64) for method in methods])
    there = errors[np.isfinite(errors) & (errors > 0)]
    low, high = np.quantile(there, [0.001, 0.999]) if len(there) else (0.1, 100.0)
    limits: Floats = np.geomspace(low / 1.1, high * 1.1, _STEPS)
    return limits


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
    stacked = wide < 5.0
    figure = new_canvas(wide, 4.2 if stacked else 2.8)
    panels = figure.subplots(3, 1, sharex=True) if stacked else figure.subplots(1, 3, sharey=True)
    headline = methods[0].result.protocol.settings.get("scores", {}).get("headline_below_m")
    for axes, (what, at) in zip(panels, keys.items(), strict=True):
        _draw_panel(axes, methods, at, headline)
        axes.set(title={"f1": "F1"}.get(what, what), ylim=_PERCENT)
    for axes in panels[-1:] if stacked else panels:
        axes.set_xlabel("distance d [m]")
    panels[len(panels) // 2 if stacked else 0].set_ylabel("points nearer than d [%]")
    dashed = f"dashed: d = {headline:g} m, of the headline scores" if headline else ""
    said = ["mean over scenes"] * bool(over_scenes(methods)) + [dashed] * bool(dashed)
    finish(figure, sheet.noting("; ".join(said)), [method.name for method in methods])
    return figure


def _draw_panel(
    axes: Axes, methods: Sequence[Scored], at: dict[float, str], headline: float | None
) -> None:
    distances = np.array(list(at))
    values = [[100 * method.result.overall[key] for key in at.values()] for method in methods]
    axes.set_xscale("log" if distances[-1] >= 10 * distances[0] else "linear")
    _draw_lines(axes, [distances] * len(methods), [np.array(row) for row in values])
    if headline:
        axes.axvline(headline, color="0.45", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    axes.set_xticks(distances.tolist(), [f"{d:g}" for d in at])
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)

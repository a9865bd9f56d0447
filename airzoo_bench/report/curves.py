"""Pictures of methods side by side, as curves: recall over K, errors, thresholds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import name_text, series_style
from airzoo_bench.report.labels import axis_label, error_label, over_scenes, shown_value, who
from airzoo_bench.report.marks import draw_lines, draw_markers
from airzoo_bench.report.sheet import Sheet, finish, new_canvas, wrapped
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "axis_label",
    "draw_error_curves",
    "draw_recall_curves",
    "draw_threshold_curves",
    "error_shares",
    "longest_list",
    "recall_curve",
    "share_below",
    "shown_value",
    "threshold_scores",
]

_STEPS = 256
_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")
_DECADE = 10.0
_FEW_DECADES = 1e3
_LEAST_RATIO = 4.0
_KS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
_PERCENT = (-2.0, 102.0)
_NEAR = 2.2
_MARKS = 9
_COUNTED = 6


def recall_curve(method: Scored, up_to: int) -> Floats:
    """Recall at K = 1 ... `up_to`, the unweighted mean over scenes, from first hits.

    Returns
    -------
    (`up_to`,) float64
        0 to 1.
    """
    shares = []
    for _, rows in method.records.groupby("scene", sort=True):
        ranks = rows["first_hit_rank"].to_numpy(np.int64)
        hits = np.bincount(ranks[(ranks >= 1) & (ranks <= up_to)], minlength=up_to + 1)[1:]
        shares.append(np.cumsum(hits) / len(ranks))
    mean: Floats = np.mean(shares, axis=0)
    return mean


def longest_list(method: Scored, up_to: int) -> int:
    """Return how many tiles a method's longest list has, 1 to `up_to`.

    Beyond it nothing was measured. Records without the column ``ranked`` do not tell: `up_to`.
    """
    if "ranked" not in method.records:
        return up_to
    return int(np.clip(method.records["ranked"].max(), 1, up_to))


@default_style()
def draw_recall_curves(methods: Sequence[Scored], up_to: int, sheet: Sheet | None = None) -> Figure:
    """Draw recall at K over K, each method's as far as its longest list goes.

    Markers stand at the K that the axis names; between them only the line is measured.

    Parameters
    ----------
    methods : sequence of Scored
        Of the retrieval track: their records have the rank of the first hit, 0 without one.
    up_to : int
        The largest K: no more than the ranks that were kept.
    sheet : Sheet, optional
    """
    sheet = sheet or Sheet()
    lengths = [longest_list(method, up_to) for method in methods]
    last = max(lengths)
    figure = new_canvas(sheet.wide(6.4), _height(sheet))
    axes = figure.add_subplot()
    curves = [100 * recall_curve(m, n) for m, n in zip(methods, lengths, strict=True)]
    draw_lines(axes, [np.arange(1.0, n + 1) for n in lengths], curves)
    ticks = [k for k in _KS if k <= max(2, last)]
    marked = sorted({*ticks, *lengths} & set(range(1, last + 1)))
    values = np.full((len(methods), len(marked)), np.nan)
    for number, (curve, length) in enumerate(zip(curves, lengths, strict=True)):
        for place, k in enumerate(marked):
            if k <= length and (k in ticks or k == length):
                values[number, place] = curve[k - 1]
    axes.set(xscale="log", xlim=(0.9, max(2, last) * 1.13), ylim=_PERCENT)
    draw_markers(axes, np.array(marked, np.float64), values, near=_near(sheet))
    label = f"R@K{over_scenes(methods)} [%]"
    axes.set(xlabel="K, number of tiles looked at", ylabel=label)
    axes.set_xticks(ticks, [f"{k}" for k in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)
    short = [(n, m.name) for m, n in zip(methods, lengths, strict=True) if n < last]
    ends = [f"{who([m for k, m in short if k == n])} at {n}" for n in sorted({n for n, _ in short})]
    ended = f"lists end earlier: {'; '.join(ends)}" if ends else ""
    finish(figure, sheet.noting(ended), [method.name for method in methods])
    return figure


def share_below(errors: Floats, limits: Floats) -> Floats:
    """Return the share of errors strictly below each limit (L,), as protocols count; 0 of none."""
    below: Floats = np.searchsorted(np.sort(errors), limits, side="left") / max(len(errors), 1)
    return below


def error_shares(method: Scored, key: str, limits: Floats) -> Floats:
    """Return the share of queries with an error strictly below each limit, mean over scenes."""
    shares = []
    for _, rows in method.records.groupby("scene", sort=True):
        shares.append(share_below(rows[key].to_numpy(np.float64), limits))
    mean: Floats = np.mean(shares, axis=0)
    return mean


@default_style()
def draw_error_curves(
    methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None
) -> Figure:
    """Draw the share of queries whose error is below a value; failures never are.

    Parameters
    ----------
    methods : sequence of Scored
    score : ScoreColumn
        Of metres or degrees.
    sheet : Sheet, optional
    """
    sheet = sheet or Sheet()
    figure = new_canvas(sheet.wide(6.4), _height(sheet))
    axes = figure.add_subplot()
    limits = _error_limits(methods, score.key)
    curves = [100 * error_shares(method, score.key, limits) for method in methods]
    draw_lines(axes, [limits] * len(methods), curves, steps=True)
    for number, curve in enumerate(curves):
        first = number % 5 * _STEPS // (5 * _MARKS)
        style = series_style(number) | {"linestyle": "none", "markersize": 4.0}
        every = slice(first, None, _STEPS // _MARKS)
        axes.plot(limits[every], curve[every], clip_on=False, zorder=3, **style)
    axes.set(xlim=(limits[0], limits[-1]), ylim=_PERCENT)
    _scale(axes, limits)
    unit = "scenes" if methods[0].result.track == "reconstruction" else "queries"
    mean = over_scenes(methods) if unit == "queries" else ""
    label = wrapped(f"{unit} below{mean} [%]", _height(sheet) - 0.5, sheet.font(6.4))
    axes.set(xlabel=error_label(score), ylabel=label)
    axes.grid(alpha=0.3)
    beyond = _beyond(methods, score.key, limits[-1], unit)
    finish(figure, sheet.noting(beyond), [method.name for method in methods])
    return figure


def _beyond(methods: Sequence[Scored], key: str, right: float, unit: str) -> str:
    """Count the errors that lie beyond the axis: a curve never rises by them."""
    total = f"of {len(methods[0].records)} {unit}"
    errors = np.array([method.records[key].to_numpy(np.float64) for method in methods])
    infinite = np.isinf(errors).sum(axis=1)
    larger = (errors >= right).sum(axis=1) - infinite
    lacking = np.flatnonzero(infinite + larger)
    if not len(lacking):
        return ""
    if len(lacking) > _COUNTED:
        least, most = (infinite + larger)[lacking].min(), (infinite + larger)[lacking].max()
        said = f"between {least} and {most} of each of {len(lacking)} methods"
        return f"off the axis, {total}: {said}, {infinite.sum()} infinite in all"
    counts = [
        f"{name_text(methods[n].name)} {_counted(int(infinite[n]), int(larger[n]))}"
        for n in lacking.tolist()
    ]
    return f"off the axis, {total}: {'; '.join(counts)}"


def _counted(infinite: int, larger: int) -> str:
    parts = [f"{infinite} infinite"] * (infinite > 0) + [f"{larger} larger"] * (larger > 0)
    return " and ".join(parts)


def _scale(axes: Axes, limits: Floats) -> None:
    """Let errors go by powers of ten, unless they span too little for that to have ticks."""
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
    """Return values to draw at, from nearly the least to nearly the largest finite error."""
    errors = np.concatenate([method.records[key].to_numpy(np.float64) for method in methods])
    there = errors[np.isfinite(errors) & (errors > 0)]
    low, high = np.quantile(there, [0.001, 0.999]) if len(there) else (0.1, 100.0)
    limits: Floats = np.geomspace(low / 1.1, high * 1.1, _STEPS)
    return limits


def threshold_scores(columns: Sequence[ScoreColumn]) -> dict[str, dict[float, str]]:
    """Find scores over distance: for precision, recall and F1 the key at each distance."""
    found: dict[str, dict[float, str]] = {"precision": {}, "recall": {}, "f1": {}}
    for column in columns:
        if match := _THRESHOLD.fullmatch(column.key):
            found[match[1]][float(match[2])] = column.key
    return {what: dict(sorted(keys.items())) for what, keys in found.items()}


@default_style()
def draw_threshold_curves(methods: Sequence[Scored], sheet: Sheet | None = None) -> Figure:
    """Draw precision, recall and F1 at the protocol's distances, the mean over scenes.

    Parameters
    ----------
    methods : sequence of Scored
        Of the reconstruction track.
    sheet : Sheet, optional
        Panels stand below each other where it is narrow.
    """
    sheet = sheet or Sheet()
    wide = sheet.wide(9.0)
    stacked = wide < 5.5
    figure = new_canvas(wide, 5.4 if stacked else 3.0)
    panels = figure.subplots(*((3, 1) if stacked else (1, 3)), sharey=True, sharex=True)
    headline = methods[0].result.protocol.settings.get("scores", {}).get("headline_below_m")
    keys = threshold_scores(methods[0].result.columns)
    for axes, (what, at) in zip(panels, keys.items(), strict=True):
        _draw_panel(axes, methods, at, headline)
        title = {"f1": "F1"}.get(what, what)
        axes.set(title=title, ylim=_PERCENT)
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
    draw_markers(axes, distances, np.array(values), near=2 * _NEAR, size=4.0)
    if headline:
        axes.axvline(headline, color="0.45", linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    axes.set_xticks(distances.tolist(), [f"{d:g}" for d in at])
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)


def _height(sheet: Sheet) -> float:
    return 3.6 if sheet.wide(6.4) >= 5.0 else 2.3


def _near(sheet: Sheet) -> float:
    """Return within how many percent markers cover each other: more in a lower picture."""
    return _NEAR * 3.6 / _height(sheet)

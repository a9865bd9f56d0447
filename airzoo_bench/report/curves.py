"""Pictures of methods side by side, as curves: recall over K, errors, thresholds, conditions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.breakdown import condition_title
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.records import Scored
from airzoo_bench.report.figures import label_text, new_figure, series_style
from airzoo_bench.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "axis_label",
    "draw_by_condition",
    "draw_error_curves",
    "draw_recall_curves",
    "draw_threshold_curves",
    "error_shares",
    "recall_curve",
    "shown_value",
    "threshold_scores",
]

_STEPS = 256
_UNITS = {"share": "%", "m": "m", "deg": "°"}
_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")
_MOST_IN_LEGEND = 24
_DECADES = 1e3


def axis_label(score: ScoreColumn) -> str:
    """Name a score with its unit."""
    return f"{score.title} [{_UNITS[score.unit]}]"


def shown_value(score: ScoreColumn, values: Floats) -> Floats:
    """Turn shares into percent; other values stay."""
    scaled: Floats = values * (100.0 if score.unit == "share" else 1.0)
    return scaled


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


def draw_recall_curves(methods: Sequence[Scored], up_to: int) -> Figure:
    """Draw recall at K over K.

    Parameters
    ----------
    methods : sequence of Scored
        Of the retrieval track: their records have the rank of the first hit, 0 without one.
    up_to : int
        The largest K: no more than the ranks that were kept.
    """
    figure, axes = new_figure(*_size(methods))
    ks = np.arange(1, up_to + 1)
    for number, method in enumerate(methods):
        axes.plot(ks, 100 * recall_curve(method, up_to), **_line(number, method.name, up_to))
    axes.set(xscale="log", xlim=(0.95, max(2, up_to) * 1.05), ylim=(0, 100))
    axes.set(xlabel="K, tiles looked at", ylabel="R@K, mean over scenes [%]")
    ticks = [k for k in (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000) if k <= max(2, up_to)]
    axes.set_xticks(ticks, [f"{k}" for k in ticks])
    axes.set_xticks([], minor=True)
    _finish(axes, len(methods))
    return figure


def error_shares(method: Scored, key: str, limits: Floats) -> Floats:
    """Return the share of queries with an error strictly below each limit, mean over scenes."""
    shares = []
    for _, rows in method.records.groupby("scene", sort=True):
        errors = np.sort(rows[key].to_numpy(np.float64))
        shares.append(np.searchsorted(errors, limits, side="left") / max(len(errors), 1))
    mean: Floats = np.mean(shares, axis=0)
    return mean


def draw_error_curves(methods: Sequence[Scored], score: ScoreColumn) -> Figure:
    """Draw the share of queries whose error is below a value; failures never are.

    Parameters
    ----------
    methods : sequence of Scored
    score : ScoreColumn
        Of metres or degrees.
    """
    figure, axes = new_figure(*_size(methods))
    limits = _error_limits(methods, score.key)
    for number, method in enumerate(methods):
        shares = 100 * error_shares(method, score.key, limits)
        axes.plot(limits, shares, **_line(number, method.name, len(limits)))
    axes.set(xscale="log", xlim=(limits[0], limits[-1]), ylim=(0, 100))
    axes.set(xlabel=condition_title(score.key), ylabel="queries below, mean over scenes [%]")
    axes.xaxis.set_major_formatter("{x:g}")
    if limits[-1] < _DECADES * limits[0]:
        axes.xaxis.set_minor_formatter(_minor_label)
    _finish(axes, len(methods))
    return figure


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


def draw_threshold_curves(methods: Sequence[Scored]) -> Figure:
    """Draw precision, recall and F1 at the protocol's distances, the mean over scenes.

    Parameters
    ----------
    methods : sequence of Scored
        Of the reconstruction track.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.4 + 0.2 * len(methods)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 3, sharey=True)
    keys = threshold_scores(methods[0].result.columns)
    for axes, (what, at) in zip(panels, keys.items(), strict=True):
        for number, method in enumerate(methods):
            values = [100 * method.result.overall[key] for key in at.values()]
            axes.plot(list(at), values, **_line(number, method.name, len(at)))
        axes.set(xscale="log", xlabel="distance d [m]", title={"f1": "F1"}.get(what, what))
        axes.set_xticks(list(at), [f"{d:g}" for d in at])
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
    panels[0].set(ylim=(0, 102), ylabel="points nearer than d [%]")
    lines = panels[0].get_lines()
    figure.legend(
        lines,
        [label_text(method.name) for method in methods],
        loc="outside lower center",
        ncols=min(3, len(methods)),
        frameon=False,
    )
    return figure


def draw_by_condition(
    names: Sequence[str],
    values: Floats,
    labels: Sequence[str],
    counts: Sequence[int],
    score: ScoreColumn,
    title: str,
) -> Figure:
    """Draw a score of methods in groups of queries.

    Parameters
    ----------
    names : sequence of M str
    values : (M, G) array
        As in records: shares 0 to 1. NaN and infinite values are left out.
    labels : sequence of G str
    counts : sequence of G int
        Queries in each group, shown below its label.
    score : ScoreColumn
    title : str
        Of the condition, with its unit.
    """
    figure, axes = new_figure(max(6.0, 2.5 + 0.9 * len(labels)), 3.6 + 0.12 * len(names))
    places = np.arange(len(labels))
    shifts = np.linspace(-0.3, 0.3, len(names)) if len(names) > 1 else np.zeros(1)
    for number, name in enumerate(names):
        shown = shown_value(score, values[number])
        shown[~np.isfinite(shown)] = np.nan
        style = series_style(number) | {"linestyle": "none"}
        axes.plot(
            places + shifts[number], shown, label=label_text(name), clip_on=False, zorder=3, **style
        )
    for edge in places[1:] - 0.5:
        axes.axvline(edge, color="0.85", linewidth=0.8, zorder=0)
    ticks = [
        f"{label_text(label)}\nn = {count}" for label, count in zip(labels, counts, strict=True)
    ]
    axes.set_xticks(places, ticks, fontsize=8)
    axes.set(xlim=(-0.5, len(labels) - 0.5), xlabel=label_text(title), ylabel=axis_label(score))
    axes.set_ylim(0, 100 if score.unit == "share" else None)
    axes.grid(axis="y", alpha=0.3)
    _legend(axes, len(names))
    return figure


def _size(methods: Sequence[Scored]) -> tuple[float, float]:
    return 6.4, 4.0 + 0.16 * min(len(methods), _MOST_IN_LEGEND)


def _line(number: int, name: str, points: int) -> dict[str, Any]:
    """Return how a curve is drawn: markers, a dozen at most, tell lines apart without colour."""
    return series_style(number) | {
        "label": label_text(name),
        "markevery": (number % 5, max(1, points // 10)) if points > 12 else 1,
        "markersize": 4,
        "linewidth": 1.4,
    }


def _finish(axes: Axes, methods: int) -> None:
    axes.grid(alpha=0.3)
    _legend(axes, methods)


def _legend(axes: Axes, methods: int) -> None:
    # Handles are named: a name that begins with an underscore would otherwise be left out.
    lines = [line for line in axes.get_lines() if line.get_marker() not in ("None", None, "")]
    figure = axes.get_figure(root=True)
    if figure is not None:
        figure.legend(
            lines[:_MOST_IN_LEGEND],
            [str(line.get_label()) for line in lines[:_MOST_IN_LEGEND]],
            loc="outside lower center",
            ncols=2 if methods > 1 else 1,
            fontsize=8,
            frameon=False,
        )

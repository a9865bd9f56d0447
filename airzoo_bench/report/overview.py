"""Pictures of methods side by side, as marks: intervals, and scores by scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.curves import axis_label, shown_value
from airzoo_bench.report.figures import COLOURS, label_text, new_figure
from airzoo_bench.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_heat_map", "draw_intervals"]

_COLOURS = "viridis"  # even steps of lightness, for print and colour-blind readers
_DARK = 0.55
_TWO_DIGITS = 10


def draw_intervals(
    names: Sequence[str], values: Floats, limits: Floats, score: ScoreColumn, what: str
) -> Figure:
    """Draw a value and its interval for each method, the best on top.

    Parameters
    ----------
    names : sequence of M str
    values : (M,) array
        As in results: shares 0 to 1. An infinite value is an arrow at the right.
    limits : (M, 2) array
        Of the intervals; NaN where there is none.
    score : ScoreColumn
    what : str
        What the values are over, for the title.
    """
    figure, axes = new_figure(6.4, 1.3 + 0.34 * len(names))
    sign = -1 if score.higher_is_better else 1
    order = np.argsort(sign * values, kind="stable")[::-1]
    for place, method in enumerate(order):
        _draw_interval(
            axes, place, *shown_value(score, np.array([values[method], *limits[method]]))
        )
    axes.set_yticks(range(len(order)), [label_text(names[method]) for method in order])
    axes.set_ylim(-0.6, len(order) - 0.4)
    arrow = "→" if score.higher_is_better else "←"
    axes.set_xlabel(f"{axis_label(score)}, {arrow} better")
    figure.suptitle(what, fontsize=10)
    axes.grid(axis="x", alpha=0.3)
    return figure


def _draw_interval(axes: Axes, place: int, value: float, low: float, high: float) -> None:
    if np.isinf(value):
        axes.annotate(
            "infinite", (0.99, place), xycoords=("axes fraction", "data"), ha="right", va="center"
        )
        return
    if np.isfinite([low, high]).all():
        axes.plot([low, high], [place, place], color=COLOURS[0], linewidth=2.2)
        axes.plot([low, high], [place, place], "|", color=COLOURS[0], markersize=9)
    axes.plot([value], [place], "o", color=COLOURS[1], markersize=6)


def draw_heat_map(
    names: Sequence[str], scenes: Sequence[str], values: Floats, score: ScoreColumn
) -> Figure:
    """Draw a score of each method in each scene: bright is better.

    Parameters
    ----------
    names : sequence of M str
    scenes : sequence of S str
        Their titles.
    values : (M, S) array
        As in results: shares 0 to 1; infinite ones have the worst colour.
    score : ScoreColumn
    """
    shown = shown_value(score, values)
    finite = shown[np.isfinite(shown)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    level = np.clip((shown - low) / ((high - low) or 1.0), 0, 1)
    goodness = level if score.higher_is_better else 1 - level
    figure, axes = new_figure(max(6.4, 2.6 + 0.75 * len(scenes)), 1.4 + 0.36 * len(names))
    axes.imshow(goodness, cmap=_COLOURS, vmin=0, vmax=1, aspect="auto")
    decimals = 1 if high >= _TWO_DIGITS else 2
    for row, column in np.ndindex(*shown.shape):
        colour = "black" if goodness[row, column] > _DARK else "white"
        text = f"{shown[row, column]:.{decimals}f}"
        axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    axes.set_yticks(range(len(names)), [label_text(name) for name in names])
    axes.set_xticks(range(len(scenes)), [label_text(scene) for scene in scenes])
    axes.tick_params(axis="x", labelrotation=45 if len(scenes) > 6 else 0)
    figure.suptitle(f"{axis_label(score)} by scene, brighter is better", fontsize=10)
    return figure

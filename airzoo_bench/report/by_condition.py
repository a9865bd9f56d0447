"""A score in groups of queries as a picture: one marker per method and group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import label_text, new_canvas, series_style
from airzoo_bench.report.labels import axis_label, shown_value
from airzoo_bench.report.markers import add_band
from airzoo_bench.report.sheet import Sheet, finish, slant, wrapped
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_by_condition"]

_DECADES = 100.0
_POINTS = 72.0
_WIDEST_IN = 14.0
_SHARE_OF_GROUP = 0.84
_LETTER = 0.6


@default_style()
def draw_by_condition(
    names: Sequence[str],
    values: Floats,
    labels: Sequence[str],
    counts: Sequence[int],
    score: ScoreColumn,
    title: str,
    limits: Floats | None = None,
    sheet: Sheet | None = None,
) -> Figure:
    """Draw a score of methods in groups of queries."""
    sheet = sheet or Sheet()
    usual = 1.2 + len(labels) * max(0.5, 0.25 + 0.075 * len(names))
    width = sheet.wide(float(np.clip(usual, 6.4, _WIDEST_IN)))
    height = 3.4 if width >= 5 else 2.6
    figure = new_canvas(width, height)
    axes, band = add_band(figure, "top" if np.isposinf(values).any() else None)
    slot_pt = (width - 0.9) * _POINTS / len(labels)
    _draw_methods((axes, band), names, values, limits, score, slot_pt)
    _scale(axes, score, shown_value(score, values))
    _draw_rules(axes, band, len(labels))
    _label(axes, labels, counts, slot_pt, sheet.font(width) - 1)
    axes.set(xlim=(-0.5, len(labels) - 0.5), xlabel=label_text(title))
    axes.set_ylabel(wrapped(axis_label(score), height - 1.0, sheet.font(width)))
    axes.grid(axis="y", alpha=0.3)
    finish(figure, sheet, names, lines=False)
    return figure


def _draw_methods(
    parts: tuple[Axes, Axes | None],
    names: Sequence[str],
    values: Floats,
    limits: Floats | None,
    score: ScoreColumn,
    slot_pt: float,
) -> None:
    """Draw the markers of all methods side by side in each group, infinite values on the band."""
    axes, band = parts
    methods, groups = values.shape
    step = _SHARE_OF_GROUP / methods
    size = float(np.clip(0.85 * step * slot_pt, 1.5, 6.0))
    infinite = np.isposinf(values)
    for number in range(methods):
        places: Floats = np.arange(groups) + step * (number - (methods - 1) / 2)
        shown = shown_value(score, np.where(infinite[number], np.nan, values[number]))
        style = series_style(number) | {"linestyle": "none", "markersize": size}
        axes.plot(places, shown, label=names[number], clip_on=False, zorder=4, **style)
        if limits is not None:
            _draw_whiskers(axes, places, shown_value(score, limits[number]), number)
        if band is not None and infinite[number].any():
            there = places[infinite[number]]
            band.plot(there, np.zeros(len(there)), markerfacecolor="white", zorder=4, **style)


def _draw_rules(axes: Axes, band: Axes | None, groups: int) -> None:
    for edge in np.arange(1, groups) - 0.5:
        for part in (axes, band):
            if part is not None:
                part.axvline(edge, color="0.85", linewidth=0.8, zorder=0)


def _draw_whiskers(axes: Axes, places: Floats, limits: Floats, number: int) -> None:
    """Draw intervals as thin lines; where a limit is infinite, an arrow points there."""
    there = ~np.isnan(limits).any(axis=1) & np.isfinite(limits[:, 0])
    colour = series_style(number)["color"]
    for place, (low, high) in zip(places[there], limits[there], strict=True):
        if np.isfinite(high):
            axes.plot([place, place], [low, high], color=colour, linewidth=0.9, zorder=2)
            continue
        axes.annotate(
            "",
            xy=(place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(place, low),
            textcoords="data",
            arrowprops={
                "arrowstyle": "->",
                "color": colour,
                "linewidth": 0.9,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 7,
            },
            zorder=2,
        )
        axes.update_datalim([(place, low)])


def _scale(axes: Axes, score: ScoreColumn, values: Floats) -> None:
    """Scale the axis: shares from 0 to 100, errors logarithmically if they span two decades."""
    if score.unit == "share":
        axes.set_ylim(-2, 102)
        return
    finite = values[np.isfinite(values)]
    positive = finite[finite > 0]
    if len(positive) and positive.max() > _DECADES * positive.min():
        if len(positive) == len(finite):
            axes.set_yscale("log")
        else:
            axes.set_yscale("symlog", linthresh=float(positive.min()))
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        top = float(axes.dataLim.y1) if np.isfinite(axes.dataLim.y1) else 1.0
        axes.set_ylim(0, 1.05 * top or 1.0)


def _label(
    axes: Axes, labels: Sequence[str], counts: Sequence[int], slot_pt: float, size: float
) -> None:
    """Label groups with their counts: on two upright lines if there is room, otherwise slanted."""
    longest = max(max(len(label), len(f"n = {n}")) for label, n in zip(labels, counts, strict=True))
    upright = longest * _LETTER * size <= slot_pt
    pattern = "{}\nn = {}" if upright else "{} (n = {})"
    ticks = [pattern.format(label_text(la), n) for la, n in zip(labels, counts, strict=True)]
    axes.set_xticks(range(len(labels)), ticks)
    if not upright:
        slant(axes, max(map(len, ticks)), slot_pt, size)

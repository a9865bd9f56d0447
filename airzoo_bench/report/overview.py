"""Pictures of methods side by side, as marks: intervals, and scores by scene."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import (
    COLOURS,
    NO_ROOM,
    any_letters,
    label_text,
    name_text,
    new_canvas,
)
from airzoo_bench.report.labels import arrow, axis_label, shown_value, spans_decades
from airzoo_bench.report.markers import add_band
from airzoo_bench.report.sheet import LEAST_PT, Sheet, finish, slant, wrapped
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.model import Column, show_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["colour_scale", "draw_heat_map", "draw_intervals"]

_COLOURS = "viridis"  # even steps of lightness, for print and colour-blind readers
_POINTS = 72.0
_LETTER = 0.62
_LINE = 1.15
_MOST_FONT = 8.0
_DARK = 0.18  # black and white have the same contrast on it (WCAG 2.2, relative luminance)
_LEAST_SPAN = 10.0
_LEAST_RATIO = 0.25


@default_style()
def draw_intervals(
    names: Sequence[str],
    values: Floats,
    limits: Floats,
    score: ScoreColumn,
    what: str,
    sheet: Sheet | None = None,
) -> Figure:
    """Draw a value and its interval for each method, the best on top."""
    sheet = (sheet or Sheet()).noting(what)
    width = sheet.wide(6.4)
    figure = new_canvas(width, 0.85 + 0.3 * len(names))
    axes, band = add_band(figure, "right" if np.isposinf(values).any() else None)
    sign = -1 if score.higher_is_better else 1
    order = np.argsort(sign * values, kind="stable")[::-1]
    shown = shown_value(score, np.column_stack([values, limits]))
    _make_room(axes, shown, score)
    for place, method in enumerate(order):
        _draw_interval(axes, band, place, *shown[method])
    longest = 48 if width >= 5 else 26
    axes.set_yticks(range(len(order)), [_short(names[method], longest) for method in order])
    axes.set_ylim(-0.6, len(order) - 0.4)
    if not np.isfinite(shown).any():
        axes.set_xticks([])
    arrow = "→" if score.higher_is_better else "←"
    axes.set_xlabel(f"{axis_label(score)}, {arrow} better")
    axes.grid(axis="x", alpha=0.3)
    finish(figure, sheet)
    return figure


def _short(name: str, most: int) -> str:
    name = name_text(name)
    return label_text(name if len(name) <= most else name[: most - 1] + "…")


def _make_room(axes: Axes, shown: Floats, score: ScoreColumn) -> None:
    """Let the axis cover all finite values; logarithmic if errors span decades."""
    finite = shown[np.isfinite(shown)]
    if not len(finite):
        return
    low, high = float(finite.min()), float(finite.max())
    right = 0.12 if np.isposinf(shown).any() else 0.05
    if spans_decades(score, finite):
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(low / (high / low) ** 0.05, high * (high / low) ** right)
    else:
        span = (high - low) or 0.1 * abs(high) or 1.0
        axes.set_xlim(low - 0.05 * span, high + right * span)


def _draw_interval(
    axes: Axes, band: Axes | None, place: int, value: float, low: float, high: float
) -> None:
    style: dict[str, Any] = {"color": COLOURS[0], "linewidth": 2.2}
    if np.isfinite(low) and np.isposinf(high):
        arrow = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **style}
        axes.annotate(
            "",
            xy=(1.0, place),
            xycoords=("axes fraction", "data"),
            xytext=(low, place),
            textcoords="data",
            arrowprops=arrow,
        )
        axes.plot([low], [place], "|", color=COLOURS[0], markersize=9)
    elif np.isfinite([low, high]).all():
        axes.plot([low, high], [place, place], **style)
        axes.plot([low, high], [place, place], "|", color=COLOURS[0], markersize=9)
    if np.isfinite(value):
        axes.plot([value], [place], "o", color=COLOURS[1], markersize=6, zorder=4)
    elif band is not None:
        band.plot([0], [place], "o", color=COLOURS[1], markerfacecolor="white", markersize=6)


@default_style()
def draw_heat_map(
    names: Sequence[str],
    scenes: Sequence[str],
    values: Floats,
    score: ScoreColumn,
    sheet: Sheet | None = None,
) -> Figure:
    """Draw a score by method and scene as coloured cells: brighter is better."""
    sheet = sheet or Sheet()
    shown = shown_value(score, values)
    width = sheet.wide(max(6.4, 2.9 + 0.58 * len(scenes)))
    size = sheet.font(width)
    figure = new_canvas(width, max(1.6, 0.9 + 0.33 * len(names)))
    axes = figure.add_subplot()
    image = _draw_cells(axes, shown, score)
    longest = 48 if width >= 5 else 22
    axes.set_yticks(range(len(names)), [_short(name, longest) for name in names])
    axes.set_xticks(range(len(scenes)), [label_text(scene) for scene in scenes])
    if np.isfinite(shown).any():
        _add_bar(axes, image, score, size)
    cell_pt = _cell_width(axes, len(scenes))
    if max(map(len, scenes)) * _LETTER * size > cell_pt:
        slant(axes, max(map(len, scenes)), cell_pt, size - 1)
    left_out = _write_numbers(axes, shown, image.to_rgba(shown), cell_pt)
    hatched = "" if np.isfinite(shown).all() else "; hatched: infinite"
    every = _name_some(axes, scenes, cell_pt)
    finish(figure, sheet.noting(f"brighter is better{hatched}", left_out, every))
    if cell_pt < _LINE * (size - 1):
        axes.tick_params(axis="x", labelsize=max(LEAST_PT, cell_pt / _LINE))
    return figure


def _name_some(axes: Axes, scenes: Sequence[str], cell_pt: float) -> str:
    """Hide scene names that have no room; return a note if any are hidden."""
    step = max(1, math.ceil(LEAST_PT / cell_pt))
    for number, text in enumerate(axes.get_xticklabels()):
        text.set_visible(number % step == 0)
    if step == 1:
        return ""
    return f"too narrow for names: one scene of {step} is named, of {len(scenes)}"


def _draw_cells(axes: Axes, shown: Floats, score: ScoreColumn) -> AxesImage:
    finite = np.isfinite(shown)
    for row, column in np.argwhere(~finite):
        _hatch(axes, int(row), int(column))
    return axes.imshow(
        np.ma.masked_array(shown, ~finite),
        cmap=_COLOURS if score.higher_is_better else f"{_COLOURS}_r",
        norm=colour_scale(score, shown[finite]),
        aspect="auto",
        interpolation="nearest",
    )


def _add_bar(axes: Axes, image: AxesImage, score: ScoreColumn, size: float) -> None:
    """Add the colour bar."""
    figure: Any = axes.get_figure(root=True)
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=max(8, 3 * len(axes.get_yticks())))
    bar.set_label(
        wrapped(f"{axis_label(score)} {arrow(score)}", figure.get_figheight() - 0.7, size)
    )
    bar.ax.yaxis.set_major_formatter("{x:g}")


def _cell_width(axes: Axes, columns: int) -> float:
    """Return the width of a cell in points, after the layout of everything around it."""
    figure: Any = axes.get_figure(root=True)
    with any_letters():
        warnings.filterwarnings("ignore", NO_ROOM, UserWarning)
        figure.draw_without_rendering()
    return float(axes.get_window_extent().width / figure.dpi * _POINTS / columns)


def colour_scale(score: ScoreColumn, finite: Floats) -> Normalize:
    """Return the colour scale: of a least span, logarithmic if errors span decades."""
    from matplotlib.colors import LogNorm, Normalize

    if not len(finite):
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if spans_decades(score, finite):
        return LogNorm(low, high)
    least = _LEAST_SPAN if score.unit == "share" else _LEAST_RATIO * high or 1.0
    lack = max(0.0, least - (high - low)) / 2
    low, high = low - lack, high + lack
    if score.unit == "share":
        shift = min(0.0, 100.0 - high) - min(0.0, low)
        low, high = low + shift, high + shift
    return Normalize(low, high)


def _hatch(axes: Axes, row: int, column: int) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(
        Rectangle(
            (column - 0.5, row - 0.5), 1, 1, hatch="////", facecolor="white", edgecolor="0.6", lw=0
        )
    )


def _write_numbers(axes: Axes, shown: Floats, rgba: Floats, cell_pt: float) -> str:
    """Write the values into the cells, as in tables; return a note if cells are too small."""
    decimals = Column("").decimals
    texts = np.vectorize(lambda value: show_number(value, decimals), otypes=[object])(shown)
    size = min(_MOST_FONT, cell_pt / (_LETTER * (max(map(len, texts.ravel())) + 1)))
    if size < LEAST_PT:
        return "too narrow for numbers: see the table"
    linear = np.where(rgba <= 0.04045, rgba / 12.92, ((rgba + 0.055) / 1.055) ** 2.4)
    luminance = linear[..., :3] @ (0.2126, 0.7152, 0.0722)
    for row, column in np.ndindex(*shown.shape):
        finite = np.isfinite(shown[row, column])
        dark = finite and luminance[row, column] < _DARK
        ground = {} if finite else {"bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1}}
        axes.text(
            column,
            row,
            texts[row, column],
            ha="center",
            va="center",
            color="white" if dark else "black",
            fontsize=size,
            **ground,
        )
    return ""

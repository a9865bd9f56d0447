"""Markers of many methods in one picture: alternating where they overlap; infinite values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import series_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["add_band", "draw_lines", "draw_markers", "take_turns"]

_RING_PT = 3.0
_BREAK: Any = {
    "marker": [(-1, -0.6), (1, 0.6)],
    "markersize": 7,
    "linestyle": "none",
    "color": "black",
    "markeredgewidth": 1,
    "clip_on": False,
}


def take_turns(values: Floats, near: float) -> NDArray[np.bool_]:
    """Choose which markers are drawn where several would overlap."""
    chosen = np.zeros(values.shape, np.bool_)
    for place, column in enumerate(values.T):
        there = np.flatnonzero(np.isfinite(column))
        for method in there[np.argsort(chosen[there].sum(axis=1), kind="stable")]:
            drawn = column[chosen[:, place]]
            chosen[method, place] = not (np.abs(drawn - column[method]) <= near).any()
    return chosen


def draw_lines(
    axes: Axes, xs: Sequence[Floats], ys: Sequence[Floats], *, steps: bool = False
) -> None:
    """Draw one line per method, wider where later ones cover it, so that it stays visible."""
    drawn: Any = {"drawstyle": "steps-mid" if steps else "default", "zorder": 2}
    for number, (x, y) in enumerate(zip(xs, ys, strict=True)):
        style = series_style(number) | {"marker": "none"}
        later = sum(_follows(y, other) for other in ys[number + 1 :])
        axes.plot(x, y, linewidth=1.4 + 1.4 * min(later, 3), **drawn, **style)


def _follows(one: Floats, other: Floats) -> bool:
    common = min(len(one), len(other))
    return bool(np.allclose(one[:common], other[:common], atol=0.3, rtol=0))


def draw_markers(axes: Axes, x: Floats, values: Floats, *, near: float, size: float = 4.5) -> None:
    """Draw the markers of methods at given positions of the x-axis."""
    chosen = take_turns(values, near)
    for number, (row, drawn) in enumerate(zip(values, chosen, strict=True)):
        edge = {"markeredgewidth": 0.4, "markeredgecolor": "white", "zorder": 4}
        _draw_marks(axes, x[drawn], row[drawn], number, size, edge)
    without = np.flatnonzero(np.isfinite(values).any(axis=1) & ~chosen.any(axis=1))
    for rank, number in enumerate(without.tolist(), start=1):
        last = np.flatnonzero(np.isfinite(values[number]))[-1:]
        ring = {"markerfacecolor": "none", "markeredgewidth": 0.9, "zorder": 5}
        _draw_marks(axes, x[last], values[number, last], number, size + _RING_PT * rank, ring)


def _draw_marks(
    axes: Axes, x: Floats, y: Floats, number: int, size: float, edge: dict[str, Any]
) -> None:
    style = series_style(number) | {"linestyle": "none", "markersize": size} | edge
    axes.plot(x, y, clip_on=False, **style)


def add_band(figure: Figure, side: Literal["top", "right"] | None) -> tuple[Axes, Axes | None]:
    """Add axes and, beyond a break, a band for infinite values."""
    if side is None:
        return figure.add_subplot(), None
    engine: Any = figure.get_layout_engine()
    if side == "top":
        engine.set(h_pad=0.03, hspace=0.0)
        grid = figure.add_gridspec(2, 1, height_ratios=[0.34, max(figure.get_figheight() - 0.9, 1)])
        axes = figure.add_subplot(grid[1])
        band = figure.add_subplot(grid[0], sharex=axes)
        band.set(ylim=(-1, 1), yticks=[0], yticklabels=["infinite"])
        ends, inner = ([0, 1], [1, 1], [0, 1], [0, 0]), "bottom"
    else:
        engine.set(w_pad=0.03, wspace=0.0)
        grid = figure.add_gridspec(1, 2, width_ratios=[max(figure.get_figwidth() - 2.2, 1), 0.55])
        axes = figure.add_subplot(grid[0])
        band = figure.add_subplot(grid[1], sharey=axes)
        band.set(xlim=(-1, 1), xticks=[0], xticklabels=["infinite"])
        ends, inner = ([1, 1], [0, 1], [0, 0], [0, 1]), "left"
    hidden: dict[str, Any] = {inner: False, f"label{inner}": False}
    band.tick_params(**hidden)
    band.spines[inner].set_visible(False)
    axes.spines[side].set_visible(False)
    axes.plot(*ends[:2], transform=axes.transAxes, **_BREAK)
    band.plot(*ends[2:], transform=band.transAxes, **_BREAK)
    return axes, band

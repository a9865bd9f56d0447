"""Marks of many methods in one picture: side by side where they meet, and what is infinite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import series_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["add_band", "draw_lines", "draw_markers", "side_by_side"]

_POINTS = 72.0
_BREAK: Any = {
    "marker": [(-1, -0.6), (1, 0.6)],
    "markersize": 7,
    "linestyle": "none",
    "color": "black",
    "markeredgewidth": 1,
    "clip_on": False,
}


def side_by_side(values: Floats, near: float) -> Floats:
    """Shift marks that would cover each other.

    Parameters
    ----------
    values : (M,) array
        Of marks at one place of the axis; NaN for none.
    near : float
        Marks no farther apart than this meet.

    Returns
    -------
    (M,) float64
        Shifts in widths of a mark, around 0 for every bunch of marks that meet, in the order of
        methods; 0 for one that stands alone.
    """
    shifts = np.zeros(len(values))
    there = np.flatnonzero(np.isfinite(values))
    order = there[np.argsort(values[there], kind="stable")]
    bunches = np.split(order, np.flatnonzero(np.diff(values[order]) > near) + 1)
    for bunch in bunches:
        shifts[np.sort(bunch)] = np.arange(len(bunch)) - (len(bunch) - 1) / 2
    return shifts


def draw_lines(
    axes: Axes, xs: Sequence[Floats], ys: Sequence[Floats], *, steps: bool = False
) -> None:
    """Draw a line a method; one that others follow exactly is wider, so that it shows beneath."""
    drawn: Any = {"drawstyle": "steps-mid" if steps else "default", "zorder": 2}
    for number, (x, y) in enumerate(zip(xs, ys, strict=True)):
        style = series_style(number) | {"marker": "none"}
        later = sum(_follows(y, other) for other in ys[number + 1 :])
        axes.plot(x, y, linewidth=1.4 + 1.4 * min(later, 3), **drawn, **style)


def _follows(one: Floats, other: Floats) -> bool:
    common = min(len(one), len(other))
    return bool(np.allclose(one[:common], other[:common], atol=0.3, rtol=0))


def draw_markers(
    axes: Axes, x: Floats, values: Floats, *, near: float, room_pt: float, size: float = 4.5
) -> None:
    """Draw markers of methods at places of the x-axis, side by side where they meet.

    Parameters
    ----------
    axes : Axes
    x : (X,) array
    values : (M, X) array
        NaN for no marker.
    near : float
        See `side_by_side`.
    room_pt : float
        How wide a bunch may be.
    size : float
        Of a marker, in points; smaller where a bunch is large.
    """
    for place, column in zip(x, values.T, strict=True):
        shifts = side_by_side(column, near)
        step = min(1.15 * size, room_pt / (2 * float(np.abs(shifts).max()) + 1))
        for number in np.flatnonzero(np.isfinite(column)):
            _draw_marker(axes, place, column[number], int(number), step * shifts[number], size)


def _draw_marker(axes: Axes, x: float, y: float, number: int, shift_pt: float, size: float) -> None:
    from matplotlib.transforms import ScaledTranslation

    figure = axes.get_figure(root=True)
    style = series_style(number) | {"linestyle": "none"}
    shifted = axes.transData
    if shift_pt and figure is not None:
        shifted = shifted + ScaledTranslation(shift_pt / _POINTS, 0, figure.dpi_scale_trans)
    axes.plot(
        [x],
        [y],
        markersize=size,
        markeredgewidth=0.4,
        markeredgecolor="white",
        clip_on=False,
        zorder=4,
        transform=shifted,
        **style,
    )


def add_band(figure: Figure, side: Literal["top", "right"] | None) -> tuple[Axes, Axes | None]:
    """Add axes, and beyond a break of them a band for what is infinite.

    Parameters
    ----------
    figure : Figure
    side : {"top", "right"} or None
        Where the band is; None for no band.

    Returns
    -------
    (Axes, Axes or None)
        The axes and the band: the first shares its other axis with the second, whose own reaches
        from -1 to 1.
    """
    if side is None:
        return figure.add_subplot(), None
    engine: Any = figure.get_layout_engine()
    if side == "top":
        engine.set(h_pad=0.03, hspace=0.0)
        height = figure.get_figheight()
        grid = figure.add_gridspec(2, 1, height_ratios=[0.34, max(height - 0.9, 1.0)])
        axes = figure.add_subplot(grid[1])
        band = figure.add_subplot(grid[0], sharex=axes)
        band.set(ylim=(-1, 1), yticks=[0], yticklabels=["infinite"])
        band.tick_params(bottom=False, labelbottom=False)
        band.spines["bottom"].set_visible(False)
        axes.spines["top"].set_visible(False)
        axes.plot([0, 1], [1, 1], transform=axes.transAxes, **_BREAK)
        band.plot([0, 1], [0, 0], transform=band.transAxes, **_BREAK)
        return axes, band
    engine.set(w_pad=0.03, wspace=0.0)
    grid = figure.add_gridspec(1, 2, width_ratios=[max(figure.get_figwidth() - 2.2, 1.0), 0.55])
    axes = figure.add_subplot(grid[0])
    band = figure.add_subplot(grid[1], sharey=axes)
    band.set(xlim=(-1, 1), xticks=[0], xticklabels=["infinite"])
    band.tick_params(left=False, labelleft=False)
    band.spines["left"].set_visible(False)
    axes.spines["right"].set_visible(False)
    axes.plot([1, 1], [0, 1], transform=axes.transAxes, **_BREAK)
    band.plot([0, 0], [0, 1], transform=band.transAxes, **_BREAK)
    return axes, band

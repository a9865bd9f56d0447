"""Pictures of the matching track: error curves, matches, queries on the map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.core.plurals import counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.curves import share_below
from airzoo_bench.report.figures import COLOURS, new_figure, series_style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_error_curves", "draw_matches", "draw_queries_on_map"]

_MOST_LINES = 200
_GAP = 1.02


@default_style()
def draw_error_curves(
    records: pd.DataFrame, titles: dict[str, str], thresholds_m: Sequence[float]
) -> Figure:
    """Draw, for each scene, the share of queries whose error is strictly below a value.

    Failures never come below any value, so that a curve ends at the share that was posed.

    Parameters
    ----------
    records : DataFrame
        With the columns ``scene`` and ``error_m``.
    titles : dict of str to str
        Titles of the scenes by id, in the order of the legend.
    thresholds_m : sequence of float
        Marked by vertical lines.
    """
    figure, axes = new_figure()
    finite = records.loc[np.isfinite(records["error_m"]), "error_m"]
    right = max(2 * max(thresholds_m), 1.0)
    left = min(max(float(finite.min()) / 2, 1e-3) if len(finite) else 0.1, min(thresholds_m) / 2)
    for number, (scene, title) in enumerate(titles.items()):
        errors = records.loc[records["scene"] == scene, "error_m"].to_numpy(np.float64)
        _draw_steps(axes, errors, left, right, f"{title} (n = {len(errors)})", number)
    for limit in thresholds_m:
        axes.axvline(limit, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
        axes.annotate(
            f"{limit:g} m", (limit, 1.01), xycoords=("data", "axes fraction"), ha="center"
        )
    axes.set(xscale="log", xlim=(left, right), ylim=(0, 100))
    axes.set(xlabel="translation error [m]", ylabel="queries below [%]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False)
    return figure


def _draw_steps(
    axes: Axes, errors: Floats, left: float, right: float, label: str, number: int
) -> None:
    inside = errors[(errors > left) & (errors < right)]
    x = np.concatenate([[left], np.unique(inside), [right]])
    style = series_style(number) | {"marker": "none"}
    # The share counts errors strictly below, so that it is the same up to and with the next error.
    axes.step(x, 100 * share_below(errors, x), where="pre", label=label, **style)


@default_style()
def draw_matches(
    query: NDArray[np.uint8],
    crop: NDArray[np.uint8],
    query_xy: Floats,
    crop_xy: Floats,
    inliers: NDArray[np.bool_],
    title: str,
) -> Figure:
    """Draw matches between a query and its crop of the map, outliers below inliers.

    Parameters
    ----------
    query, crop : (H, W, 3) uint8
        Pictures; of any size.
    query_xy, crop_xy : (M, 2) float64
        In pixels of the pictures as given.
    inliers : (M,) bool
        Of the pose that was found; all false where there is none.
    title : str

    Notes
    -----
    Of more than 200 inliers or outliers an even selection is drawn, and the caption says so.
    """
    scale = query.shape[0] / crop.shape[0]
    wide = query.shape[1] * _GAP + crop.shape[1] * scale
    figure, axes = new_figure(9.0, 9.0 * query.shape[0] / wide + 0.4)
    axes.imshow(query, extent=(0, query.shape[1], query.shape[0], 0))
    shift = query.shape[1] * _GAP
    axes.imshow(crop, extent=(shift, shift + crop.shape[1] * scale, query.shape[0], 0))
    drawn = ((~inliers, COLOURS[1], 0.35, "outlier"), (inliers, COLOURS[2], 0.8, "inlier"))
    for kind, colour, alpha, label in drawn:
        chosen = _spread(np.flatnonzero(kind))
        ends = crop_xy[chosen] * scale + (shift, 0)
        x = np.stack([query_xy[chosen, 0], ends[:, 0]])
        y = np.stack([query_xy[chosen, 1], ends[:, 1]])
        axes.plot(x, y, color=colour, alpha=alpha, linewidth=0.6)
        axes.plot([], [], color=colour, label=label)
    axes.legend(loc="lower right", fontsize=7)
    axes.set(xlim=(0, shift + crop.shape[1] * scale), ylim=(query.shape[0], 0))
    axes.set_axis_off()
    axes.set_title(
        f"{title}: {counted(int(inliers.sum()), 'inlier')} of {counted(len(inliers), 'match')}",
        fontsize=9,
    )
    return figure


def _spread(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    if len(rows) <= _MOST_LINES:
        return rows
    return rows[np.linspace(0, len(rows) - 1, _MOST_LINES).astype(np.intp)]


@default_style()
def draw_queries_on_map(
    dom: NDArray[np.uint8],
    extent: tuple[float, float, float, float],
    truth_xy: Floats,
    estimate_xy: Floats,
    title: str,
) -> Figure:
    """Draw where queries are, and vectors from truth to estimate.

    Parameters
    ----------
    dom : (H, W, 3) uint8
        The map.
    extent : (left, right, bottom, top)
        Of the map in metres.
    truth_xy, estimate_xy : (Q, 2) float64
        Camera centres; NaN estimates are failures, drawn as crosses.
    title : str
    """
    figure, axes = new_figure(7.0, 6.5)
    left, _, bottom, _ = extent
    axes.imshow(dom, extent=tuple(np.subtract(extent, (left, left, bottom, bottom))))
    truth, estimate = truth_xy - (left, bottom), estimate_xy - (left, bottom)
    failed = np.isnan(estimate).any(axis=1)
    for start, end in zip(truth[~failed], estimate[~failed], strict=True):
        axes.plot(*np.stack([start, end], axis=1), color=COLOURS[1], linewidth=1.2)
    axes.plot(*truth[~failed].T, "o", color=COLOURS[0], markersize=4, label="truth")
    axes.plot(*estimate[~failed].T, "o", color=COLOURS[1], markersize=2.5, label="estimate")
    if failed.any():
        label = "truth, no pose found"
        axes.plot(*truth[failed].T, "x", color=COLOURS[3], markersize=6, label=label)
    axes.set(xlabel="east of the map's corner [m]", ylabel="north of the map's corner [m]")
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal")
    axes.legend(loc="best", fontsize=8)
    return figure

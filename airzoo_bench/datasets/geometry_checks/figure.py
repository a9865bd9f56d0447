"""The distribution of depth errors, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.datasets.geometry_checks.depth_report import QUANTILES, DepthConsistency
from airzoo_bench.report.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["PAPER_QUANTILES", "draw_depth_errors"]

PAPER_QUANTILES = (0.00066, 0.00174, 0.00380)
"""Median, P90 and P95 that the AirZoo paper reports for its renders."""

_STEPS = 512
_LEFT, _RIGHT = 1e-6, 1e1  # percent


@default_style()
def draw_depth_errors(scenes: dict[str, DepthConsistency]) -> Figure:
    """Draw the share of pixels whose relative depth error is below a value, for each scene.

    Parameters
    ----------
    scenes : dict of str to DepthConsistency
        Of one limit; scenes of which nothing was compared have no curve.
    """
    figure, axes = new_figure()
    for number, (name, depth) in enumerate(scenes.items()):
        if depth.error.size:
            _draw_curve(axes, name, depth, number)
    limit = 100 * next(iter(scenes.values())).median_below
    axes.axvline(limit, color="0.5", linewidth=0.8, linestyle="--", zorder=0)
    axes.annotate(
        f"limit of the median, {limit:g} %",
        (limit, 0.02),
        xycoords=("data", "axes fraction"),
        rotation=90,
        ha="left",
        va="bottom",
        color="0.4",
        fontsize="small",
    )
    paper = 100 * np.array(PAPER_QUANTILES)
    axes.plot(paper, 100 * np.array(QUANTILES), "kx", label="the paper's median, P90, P95")
    axes.set(xscale="log", xlim=(_LEFT, _RIGHT), ylim=(0, 100))
    axes.set(xlabel="relative depth error [%]", ylabel="pixels below [%]")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False, fontsize="small")
    return figure


def _draw_curve(axes: Axes, name: str, depth: DepthConsistency, number: int) -> None:
    errors = np.sort(np.abs(depth.error)).astype(np.float64)
    x = np.logspace(np.log10(_LEFT), np.log10(_RIGHT), _STEPS)
    share = 100 * np.searchsorted(errors, x / 100, side="right") / len(errors)
    label = f"{name}: median {100 * depth.median:.2g} % (n = {len(errors):,})"
    axes.plot(x, share, color=COLOURS[number % len(COLOURS)], label=label)

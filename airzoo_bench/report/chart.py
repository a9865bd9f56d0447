"""Markers, axes and cell colours of the report's page: computed here, only placed by its script."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import COLOURS, series_style
from airzoo_bench.report.labels import shown_value, spans_decades
from airzoo_bench.report.overview import colour_scale
from airzoo_bench.results.result import ScoreColumn

__all__ = ["marker", "tints", "vertical_axis"]

_MARKER_PX = 11.0
_DARKEST = 0.42  # black text on it stays readable
_DIGITS = 4
_TICKS = 4
_FEW_DECADES = 3
_LEAST_TOP = 1e-9  # below it errors are of rounding, and all alike
_COMMANDS = {1: "M", 2: "L", 3: "Q", 4: "C", 79: "Z"}  # of SVG, by the codes of matplotlib's paths


@cache
def marker(number: int) -> dict[str, str]:
    """Return a method's colour and marker (an SVG path around 0, 0), the same as in pictures."""
    from matplotlib.markers import MarkerStyle

    style = series_style(number)
    made = MarkerStyle(style["marker"])
    path = made.get_path().transformed(made.get_transform())
    outline = ""
    for points, code in path.iter_segments(simplify=False):
        command = _COMMANDS[int(code)]
        pixels = (
            () if command == "Z" else points * np.resize([_MARKER_PX, -_MARKER_PX], len(points))
        )
        outline += command + " ".join(f"{value:.4g}" for value in pixels)
    # Black would not be seen where the reader wants the page dark.
    colour = "currentColor" if style["color"] == COLOURS[-1] else style["color"]
    return {"colour": colour, "path": outline}


def vertical_axis(score: ScoreColumn, values: Floats) -> dict[str, Any]:
    """Return a vertical axis: from zero up, or logarithmic where errors span decades."""
    shown = shown_value(score, values)
    finite = shown[np.isfinite(shown)]
    log = spans_decades(score, finite)
    ticks = _decade_ticks(finite) if log else _linear_ticks(finite)
    scale = np.log10 if log else np.asarray
    low, high = (float(scale(ticks[end])) for end in (0, -1)) if len(ticks) else (0.0, 1.0)

    def heights(of: Floats) -> Floats:
        return np.round((scale(of) - low) / (high - low), _DIGITS)

    texts = [f"{tick:g}" for tick in ticks]
    return {
        "log": log,
        "ticks": list(zip(heights(ticks).tolist(), texts, strict=True)),
        "heights": heights(shown),
    }


def _decade_ticks(finite: Floats) -> Floats:
    first, last = int(np.floor(np.log10(finite.min()))), int(np.ceil(np.log10(finite.max())))
    factors = (1.0,) if last - first > _FEW_DECADES else (1.0, 2.0, 5.0)
    return np.array([f * 10.0**p for p in range(first, last) for f in factors] + [10.0**last])


def _linear_ticks(finite: Floats) -> Floats:
    from matplotlib.ticker import MaxNLocator

    if not len(finite):
        return finite
    steps = [1, 2, 2.5, 5, 10]
    top = max(float(finite.max()), _LEAST_TOP)
    return np.array(MaxNLocator(_TICKS, steps=steps).tick_values(0.0, top))


def tints(score: ScoreColumn, values: Floats) -> Floats:
    """Return the opacity of each cell's background, 0 to 0.42: higher for better values."""
    shown = shown_value(score, values)
    finite = np.isfinite(shown)
    levels = np.zeros(shown.shape)
    levels[finite] = colour_scale(score, shown[finite])(shown[finite])
    better: Floats = np.where(score.higher_is_better, levels, 1 - levels) * finite
    return np.round(_DARKEST * better, _DIGITS)

"""Pictures of methods side by side, as curves: recall over K, errors, thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import name_text, new_canvas, series_style
from airzoo_bench.report.labels import error_label, noted, over_scenes, who
from airzoo_bench.report.markers import draw_lines, draw_markers
from airzoo_bench.report.sheet import Sheet, finish, wrapped
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "NEAR",
    "PERCENT",
    "error_shares",
    "errors",
    "kept_ranks",
    "longest_list",
    "recall",
    "recall_curve",
    "share_below",
]

_STEPS = 256
_FEW_DECADES = 1e3
_LEAST_RATIO = 4.0
_KS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
PERCENT = (-2.0, 102.0)
NEAR = 2.2
"""Within how many percent markers cover each other, in a picture of 3.6 inches."""
_MARKS = 9
_COUNTED = 6


def recall_curve(method: Scored, up_to: int) -> Floats:
    """Recall at K = 1 ... `up_to`, the unweighted mean over scenes, from first hits."""
    shares = []
    for _, rows in method.records.groupby("scene", sort=True):
        ranks = rows["first_hit_rank"].to_numpy(np.int64)
        hits = np.bincount(ranks[(ranks >= 1) & (ranks <= up_to)], minlength=up_to + 1)[1:]
        shares.append(np.cumsum(hits) / len(ranks))
    mean: Floats = np.mean(shares, axis=0)
    return mean


def longest_list(method: Scored, up_to: int) -> int:
    """Return the length of a method's longest list of tiles, 1 to `up_to`."""
    if "ranked" not in method.records:
        return up_to
    return int(np.clip(method.records["ranked"].max(), 1, up_to))


def kept_ranks(method: Scored) -> int:
    """Return how many ranks of each query the protocol keeps."""
    if "first_hit_rank" not in method.records:
        raise UsageError(
            f"results of the {method.result.track} track have no ranks",
            expected="results of the retrieval track",
        )
    kept = method.result.protocol.settings.get("scores", {}).get("ranks_kept")
    if not isinstance(kept, int) or kept < 1:
        raise UsageError(
            "the protocol's settings do not say how many ranks were kept",
            expected="a number above 0 as scores.ranks_kept",
        )
    return kept


@default_style()
def recall(
    methods: Sequence[Scored], up_to: int | None = None, sheet: Sheet | None = None
) -> Figure:
    """Draw recall at K over K, for each method up to the length of its longest list."""
    kept, sheet = kept_ranks(methods[0]), noted(methods, sheet)
    if up_to is not None and up_to > kept:
        raise UsageError(f"--up-to {up_to}: the protocol keeps {kept} ranks of each query")
    up_to = up_to or kept
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
    axes.set(xscale="log", xlim=(0.9, max(2, last) * 1.13), ylim=PERCENT)
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
    """Return the share of errors strictly below each limit (L,), as protocols count; 0 if empty."""
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
def errors(methods: Sequence[Scored], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the share of queries with an error below a value; failures never count as below."""
    sheet = noted(methods, sheet)
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
    axes.set(xlim=(limits[0], limits[-1]), ylim=PERCENT)
    _scale(axes, limits)
    unit = plural(methods[0].result.unit)
    mean = over_scenes(methods) if unit == "queries" else ""
    label = wrapped(f"{unit} below{mean} [%]", _height(sheet) - 0.5, sheet.font(6.4))
    axes.set(xlabel=error_label(score), ylabel=label)
    axes.grid(alpha=0.3)
    beyond = _beyond(methods, score.key, limits[-1], unit)
    finish(figure, sheet.noting(beyond), [method.name for method in methods])
    return figure


def _beyond(methods: Sequence[Scored], key: str, right: float, unit: str) -> str:
    """Count the errors beyond the right end of the axis, which curves do not show."""
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
    """Make the axis logarithmic, unless errors span too little for decade ticks."""
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
    """Return the errors at which curves are drawn, between the extreme quantiles of finite ones."""
    errors = np.concatenate([method.records[key].to_numpy(np.float64) for method in methods])
    there = errors[np.isfinite(errors) & (errors > 0)]
    low, high = np.quantile(there, [0.001, 0.999]) if len(there) else (0.1, 100.0)
    limits: Floats = np.geomspace(low / 1.1, high * 1.1, _STEPS)
    return limits


def _height(sheet: Sheet) -> float:
    return 3.6 if sheet.wide(6.4) >= 5.0 else 2.3


def _near(sheet: Sheet) -> float:
    """Return the distance in percent below which markers overlap; larger in a lower picture."""
    return NEAR * 3.6 / _height(sheet)

"""The pictures of results, a function a kind, and what they are drawn of."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import UsageError, plural
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import (
    NARROW_IN,
    Sheet,
    axis_label,
    default_style,
    error_label,
    finish,
    label_text,
    new_canvas,
    noted,
    over_scenes,
    series_style,
)
from airzoo_bench.report.matching import draw_arrows, draw_matches
from airzoo_bench.report.reconstruction import draw_clouds
from airzoo_bench.report.retrieval import draw_hits, draw_tiles
from airzoo_bench.report.sections import find_places, read_sections
from airzoo_bench.results.comparison import check_same_queries, choose_scores, find_scene
from airzoo_bench.results.records import Method, read_methods
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import breakdown_table, condition_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STEPS, _MARKS = 256, 9
_KS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000)
_PERCENT = (-2.0, 102.0)
_THRESHOLD = re.compile(r"(precision|recall|f1)_([0-9.e+-]+)m")
_LETTER_IN = 0.0625  # of the names along an axis
_PLAN = ResamplingConfig()


def recall_curve(method: Method, up_to: int) -> Floats:
    """Recall at K = 1 ... `up_to`, the unweighted mean over scenes, from first hits."""
    first = pd.to_numeric(method.records["first_hit_rank"], errors="coerce")
    scenes = first.groupby(method.records["scene"])
    ranks = [np.where((r >= 1) & (r <= up_to), r, up_to + 1).astype(np.int64) for _, r in scenes]
    hits = [np.bincount(r, minlength=up_to + 2)[1:-1] / len(r) for r in ranks]
    return np.asarray(np.mean(np.cumsum(hits, axis=1), axis=0))


def error_shares(method: Method, key: str, limits: Floats) -> Floats:
    """Return the share of queries with an error strictly below each limit, mean over scenes."""
    every = (np.sort(v.to_numpy(np.float64)) for _, v in method.records.groupby("scene")[key])
    shares = [np.searchsorted(values, limits, side="left") / len(values) for values in every]
    return np.asarray(np.mean(shares, axis=0))


def _new_axes(sheet: Sheet) -> tuple[Figure, Axes]:
    wide = sheet.wide(6.4)
    figure = new_canvas(wide, 3.4 if wide >= NARROW_IN else 2.2)
    axes = figure.add_subplot()
    axes.grid(alpha=0.3)
    return figure, axes


def _draw_lines(axes: Axes, xs: Iterable[Floats], ys: Iterable[Floats], **more: Any) -> None:
    style = {"clip_on": False, "zorder": 2, "linewidth": 1.4, "markersize": 4.5, **more}
    for number, (x, y) in enumerate(zip(xs, ys, strict=True)):
        axes.plot(x, y, **series_style(number), **style)


@default_style()
def recall(
    methods: Sequence[Method], up_to: int | None = None, sheet: Sheet | None = None
) -> Figure:
    """Draw recall at K over K, for each method up to the length of its longest list."""
    result, sheet = methods[0].result, noted(methods, sheet)
    if "first_hit_rank" not in methods[0].records:
        expected = "results of the retrieval track"
        raise UsageError(f"results of the {result.track} track have no ranks", expected=expected)
    kept = int(result.protocol.settings["scores"]["ranks_kept"])
    if up_to is not None and up_to > kept:
        raise UsageError(f"--up-to {up_to}: the protocol keeps {kept} ranks of each query")
    most = up_to or kept
    lengths = [int(np.clip(m.records.get("ranked", most), 1, most).max()) for m in methods]
    last = max(2, *lengths)
    ticks = [k for k in _KS if k <= last]
    figure, axes = _new_axes(sheet)
    curves = [100 * recall_curve(m, n) for m, n in zip(methods, lengths, strict=True)]
    _draw_lines(axes, [np.arange(1.0, n + 1) for n in lengths], curves)
    for line, length in zip(axes.lines, lengths, strict=True):
        line.set_markevery(sorted({k - 1 for k in (*ticks, length) if k <= length}))
    axes.set(xscale="log", xlim=(0.9, last * 1.13), ylim=_PERCENT)
    axes.set(xlabel="K, number of tiles looked at", ylabel=f"R@K{over_scenes(methods)} [%]")
    axes.set_xticks(ticks, [f"{k}" for k in ticks])
    axes.set_xticks([], minor=True)
    finish(figure, sheet, [method.name for method in methods])
    return figure


@default_style()
def errors(methods: Sequence[Method], score: ScoreColumn, sheet: Sheet | None = None) -> Figure:
    """Draw the share of queries with an error below a value; failures never count as below."""
    sheet = noted(methods, sheet)
    figure, axes = _new_axes(sheet)
    every = np.concatenate([m.records[score.key].to_numpy(np.float64) for m in methods])
    there = every[np.isfinite(every) & (every > 0)]
    low, high = np.quantile(there, [0.001, 0.999]) if len(there) else (0.1, 100.0)
    limits = np.geomspace(low / 1.1, high * 1.1, _STEPS)
    curves = [100 * error_shares(method, score.key, limits) for method in methods]
    _draw_lines(axes, [limits] * len(methods), curves, drawstyle="steps-mid")
    for number, line in enumerate(axes.lines):
        line.set_markevery((number % 5 * _STEPS // (5 * _MARKS), _STEPS // _MARKS))
    unit = plural(methods[0].result.unit)
    mean = over_scenes(methods) if unit == "queries" else ""
    axes.set(xlim=(limits[0], limits[-1]), ylim=_PERCENT)
    axes.set(xlabel=error_label(score), ylabel=f"{unit} below{mean} [%]")
    if limits[-1] >= 4 * limits[0]:
        wide = limits[-1] / limits[0]
        steps = [1] if wide >= 1000 else [1, 2, 5] if wide >= 20 else [1, 1.5, 2, 3, 4, 5, 7]
        axes.set_xscale("log")
        axes.locator_params("x", subs=steps, numticks=20)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    finish(figure, sheet, [method.name for method in methods])
    return figure


def threshold_scores(columns: Sequence[ScoreColumn]) -> dict[str, dict[float, str]]:
    """Map each distance to the key of its score, separately for precision, recall and F1."""
    found: dict[str, dict[float, str]] = {"precision": {}, "recall": {}, "f1": {}}
    for column in columns:
        if match := _THRESHOLD.fullmatch(column.key):
            found[match[1]][float(match[2])] = column.key
    return {what: dict(sorted(keys.items())) for what, keys in found.items()}


@default_style()
def thresholds(methods: Sequence[Method], sheet: Sheet | None = None) -> Figure:
    """Draw precision, recall and F1 at the protocol's distances, averaged over scenes."""
    result, sheet = methods[0].result, noted(methods, sheet)
    keys = threshold_scores(result.columns)
    if not keys["f1"]:
        what = f"results of the {result.track} track have no precision over distance"
        raise UsageError(what, expected="results of the reconstruction track")
    distances = np.array(list(keys["f1"]))
    values = [[[m.result.overall[k] for k in at.values()] for m in methods] for at in keys.values()]
    curves = dict(zip(keys, 100 * np.array(values), strict=True))
    wide = sheet.wide(3.0 * len(curves))
    narrow = wide < 2.4 * len(curves)
    figure = new_canvas(wide, 1.4 * len(curves) if narrow else 2.8)
    shape: Any = {"nrows": len(curves), "sharex": True} if narrow else {"ncols": len(curves)}
    panels = figure.subplots(**shape, sharey=True, squeeze=False).ravel()
    headline = result.protocol.settings.get("scores", {}).get("headline_below_m")
    for axes, (what, lines) in zip(panels, curves.items(), strict=True):
        _draw_lines(axes, [distances] * len(methods), lines)
        if headline:
            axes.axvline(headline, color="0.45", linewidth=0.9, linestyle="--", zorder=0)
        axes.set_xscale("log" if distances[-1] >= 10 * distances[0] else "linear")
        axes.set_xticks(distances.tolist(), [f"{d:g}" for d in distances])
        axes.set_xticks([], minor=True)
        axes.grid(alpha=0.3)
        axes.set(ylabel=f"{what.replace('f1', 'F1')} [%]", ylim=_PERCENT)
    for axes in panels[-1:] if narrow else panels:
        axes.set_xlabel("distance d [m]")
    dashed = f"dashed: d = {headline:g} m, of the headline scores" if headline else ""
    sheet = sheet.noting(over_scenes(methods).removeprefix(", "), dashed)
    finish(figure, sheet, [method.name for method in methods])
    return figure


@default_style()
def condition(
    methods: Sequence[Method],
    score: ScoreColumn,
    by: str,
    bins: Sequence[float] | None = None,
    sheet: Sheet | None = None,
    plan: ResamplingConfig | None = _PLAN,
) -> Figure:
    """Draw the table of `breakdown`: a score by a condition, with intervals of 95 %."""
    table = breakdown_table(methods, [score], by, bins=bins, resampling=plan)
    cells = [[(c.value, *(c.uncertainty or (None, None))) for c in r.cells[2:]] for r in table.rows]
    shown = np.where(np.isinf(values := np.array(cells, np.float64)), np.nan, values)
    groups, count = shown.shape[:2]
    notes = [note.replace("in square brackets", "bars") for note in table.notes]
    sheet = noted(methods, sheet).noting("; ".join(notes))
    infinite = int(np.isinf(values[..., 0]).sum())
    sheet = sheet.noting(f"not drawn: {infinite} infinite values" if infinite else "")
    wide = sheet.wide(float(np.clip(1.2 + groups * max(0.5, 0.25 + 0.075 * count), 6.4, 14.0)))
    figure = new_canvas(wide, 3.2 if wide >= NARROW_IN else 2.4)
    axes = figure.add_subplot()
    for number in range(count):
        places = np.arange(groups) + 0.84 / count * (number - (count - 1) / 2)
        style: dict[str, Any] = series_style(number) | {"linestyle": "none", "markersize": 5}
        axes.plot(places, shown[:, number, 0], **style)
        low, high = shown[:, number, 1:].T
        axes.vlines(places, low, high, colors=style["color"], linewidth=0.9)
    axes.set_ylim(*(_PERCENT if score.unit == "share" else (0.0, None)))
    axes.yaxis.set_major_formatter("{x:g}")
    for edge in np.arange(1, groups) - 0.5:
        axes.axvline(edge, color="0.85", linewidth=0.8, zorder=0)
    axes.set(xlim=(-0.5, groups - 0.5), ylabel=axis_label(score), xlabel=condition_title(by))
    axes.grid(axis="y", alpha=0.3)
    names = [label_text(f"{row.name} (n = {row.cells[1].value})") for row in table.rows]
    axes.set_xticks(range(groups), names)
    long = max(map(len, names)) * _LETTER_IN
    if long > (wide - 0.9) / groups:
        for text in axes.get_xticklabels():
            text.set(rotation=45, ha="right", va="center", rotation_mode="anchor")
        figure.set_figheight(figure.get_figheight() + min(0.8 * long, 2.5))
    finish(figure, sheet, [method.name for method in methods], lines=False)
    return figure


_KINDS: dict[str, Any] = {f.__name__: f for f in (condition, errors, recall, thresholds)}
KINDS = tuple(_KINDS)
"""The pictures of several methods; those of one run are ``map``, ``query`` and ``cloud``."""


def draw_methods(
    kind: str, methods: Sequence[Method], score: str | None = None, **more: Any
) -> Figure:
    """Draw one of `KINDS`: by the score that is named, else the first headline one or error."""
    check_same_queries(methods)
    every = score is None and kind == "errors"
    found = choose_scores(methods, [score] if score else [], every=every)
    if kind == "errors":
        fitting = [one for one in found if one.unit != "share"]
        if not fitting:
            raise UsageError(f"{found[0].title} is no error", expected="a score in m or degrees")
        found = fitting
    scores = [] if kind in ("recall", "thresholds") else found[:1]
    figure: Figure = _KINDS[kind](methods, *scores, **more)
    return figure


def picture(kind: str, paths: Sequence[Path], sheet: Sheet, **more: Any) -> Figure:
    """Draw a kind of picture as ``airzoo-bench plot`` does."""
    if kind in KINDS:
        return draw_methods(kind, read_methods(paths), sheet=sheet, **more)
    return draw_run(kind, paths, sheet, **more)


def draw_run(
    kind: str,
    paths: Sequence[Path],
    sheet: Sheet | None = None,
    *,
    scene: str | None = None,
    data: Path = Path(),
    query: str = "",
) -> Figure:
    """Draw a scene's ``map``, a ``query`` or a scene's ``cloud`` of a single run."""
    section, sheet = read_sections(paths)[0], sheet or Sheet()
    if len(paths) > 1 or (kind == "cloud") == section.by_query:
        track = "reconstruction" if kind == "cloud" else "retrieval or matching"
        raise UsageError(f"plot {kind} draws a single run", expected=f"one result of {track}")
    titles, matching = section.first.truth.scene_titles, section.track == "matching"
    wanted = next(iter(titles)) if scene is None else find_scene(titles, scene)
    if kind == "cloud":
        return draw_clouds(section, wanted, sheet)
    places = find_places(section, data)
    if kind == "map":
        place = next(place for place in places if place.scene == wanted)
        return (draw_arrows if matching else draw_hits)(section, place, sheet)
    known = {name: place for place in places for name in place.photos}
    if query not in known:
        raise UsageError(f"--query {query}: there is no such query{nearest(query, [*known])}")
    return (draw_matches if matching else draw_tiles)(section, known[query], query, sheet)

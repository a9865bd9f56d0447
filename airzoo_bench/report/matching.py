"""Pictures of the matching track: error curves, matches, queries on the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.core.errors import counted
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.rasters import open_info, pixel_to_world, read_rgb, to_map_pixels
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.truth import MatchingTruth, ReferenceMap
from airzoo_bench.report.curves import share_below
from airzoo_bench.report.figures import COLOURS, new_figure, save_figure, series_style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_error_curves", "draw_figures", "draw_matches", "draw_queries_on_map"]

_MOST_LINES = 200
_GAP = 1.02


@default_style()
def draw_error_curves(
    records: pd.DataFrame, titles: dict[str, str], thresholds_m: Sequence[float]
) -> Figure:
    """Draw, for each scene, the share of queries whose error is strictly below a value."""
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
    """Draw matches between a query and its crop of the map, outliers below inliers."""
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
    """Draw where queries are, and vectors from truth to estimate."""
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


_LONG_SIDE_PX = 1200


def draw_figures(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Draw error curves of all scenes; for each scene a map, and the matches of every query."""
    if not wanted or out is None:
        return
    folder, protocol = out / "figures", evaluation.protocol
    titles = {scene.id: scene.title for scene in protocol.scenes}
    limits = protocol.scores.translation_below_m
    save_figure(draw_error_curves(evaluation.records, titles, limits), folder / "errors.png")
    drawn, benchmark = 1, evaluation.benchmark
    for truth in evaluation.truths:
        matches, estimates = evaluation.scored[truth.scene].details
        if truth.scene_map is not None:
            path = folder / f"{truth.scene}_map.png"
            centres = np.array([one.centre for one in estimates])
            _draw_map(truth, truth.scene_map, centres, titles[truth.scene], path)
            drawn += 1
        images = benchmark.resolve(benchmark.scene(truth.scene).images)
        rows = range(len(truth.queries) if matches.kind == "matches" else 0)
        for row in run.progress(rows, "pictures", len(rows)):
            _draw_query(truth, matches, estimates[row].inliers, row, images, folder)
        drawn += len(rows)
    yield f"drew {drawn} pictures into {folder}"


def _draw_map(
    truth: MatchingTruth, scene: ReferenceMap, estimated: Floats, title: str, path: Path
) -> None:
    """Draw in metres along the map's sides: its CRS may differ from the scene's, and be rotated."""
    dom, scene_crs = scene.dom, open_info(scene.dsm).crs
    corners = pixel_to_world(dom.transform, [(0, 0), (dom.width, 0), (0, dom.height)])
    origin, right, down = change_of_plane(dom.crs, scene_crs)(corners)
    sides = np.linalg.norm([right - origin, down - origin], axis=1)
    to_pixels = to_map_pixels(scene_crs, dom)

    def along_sides(centres: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels = to_pixels(centres[:, :2])
        east, south = (pixels * sides / (dom.width, dom.height)).T
        return np.stack([east, sides[1] - south], axis=1)

    figure = draw_queries_on_map(
        read_rgb(dom.path, long_side_px=_LONG_SIDE_PX),
        (0.0, float(sides[0]), 0.0, float(sides[1])),
        along_sides(truth.poses.centres),
        along_sides(estimated),
        title,
    )
    save_figure(figure, path)


def _draw_query(
    truth: MatchingTruth,
    matches: Correspondences,
    inliers: NDArray[np.bool_],
    row: int,
    images: Path,
    folder: Path,
) -> None:
    query, part = truth.queries.iloc[row], matches.parts()[row]
    x, y, width, height = (int(side) for side in truth.crops[row])
    photo = read_rgb_photo(images / query["image"], _LONG_SIDE_PX)
    dom = truth.map_of(row).dom
    crop = read_rgb(dom.path, (x, y, width, height), long_side_px=_LONG_SIDE_PX)
    shrunk = np.array([photo.shape[1] / query["width"], photo.shape[0] / query["height"]])
    map_xy = matches.map_xy if matches.map_xy is not None else np.zeros((0, 2))
    figure = draw_matches(
        photo,
        crop,
        matches.query_xy[part] * shrunk,
        (map_xy[part] - (x, y)) * (crop.shape[1] / width, crop.shape[0] / height),
        inliers,
        str(query["id"]),
    )
    name = str(query["id"]).replace("/", "_")
    save_figure(figure, folder / f"{name}_matches.png")

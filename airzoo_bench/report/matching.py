"""Pictures of single runs of matching: match lines of a query, and error arrows on the map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.core.errors import counted
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.solving import lift
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    add_error_bar,
    default_style,
    error_colours,
    finish,
    new_canvas,
    save_figure,
)
from airzoo_bench.report.sections import (
    Arrays,
    Place,
    Section,
    draw_ground,
    keep,
    mark_failures,
    need_kept,
    places_of,
    read_kept,
)
from airzoo_bench.results.records import Method

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MOST_LINES = 200  # of inliers, and of the others
_LONG_SIDE_PX = 1000
_LONGEST_ARROW = 0.08  # of the map's longer side, for nine of ten errors
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def gather_matches(
    truth: MatchingTruth, content: object, poses: Poses, inlier: Bools | None, half_px: float
) -> Arrays:
    """Gather estimated places (Q, 3) of a scene, and of each query an even choice of matches.

    Of a match are kept its pixels in photo and map, whether it is an inlier, and its residual: how
    far the photo's pixel is from where the true camera sees the map's point. `counts` (Q, 2) are
    inliers and matches, `sizes` (Q,) the matches that were chosen.
    """
    is_drawn = isinstance(content, Correspondences) and content.map_xy is not None
    none = Correspondences(np.zeros(len(poses) + 1, np.int64), *np.zeros((2, 0, 2)))
    found: Any = content if is_drawn else none
    parts, counts, names = [], [], ("query_xy", "map_xy", "inliers", "residual_px")
    for row, part in enumerate(found.row_slices()):
        inliers = inlier[part] if is_drawn and inlier is not None else np.zeros(0, np.bool_)
        kinds = [np.flatnonzero(kind) for kind in (~inliers, inliers)]
        rows = np.concatenate([kind[:: -(-len(kind) // _MOST_LINES) or 1] for kind in kinds])
        query_xy, map_xy = found.query_xy[part][rows], found.map_xy[part][rows]
        scene = truth.map_of(row)
        residuals = np.zeros(0)
        if len(rows):
            points = lift(map_xy + half_px, scene.dom, scene.dsm, jobs=1).points
            camera, pose = truth.cameras.take(row), truth.poses.take(row)
            seen = project(camera, world_to_camera(pose, points[None]))[0]
            residuals = np.linalg.norm(seen - query_xy, axis=1)
        parts.append((query_xy, map_xy, inliers[rows], residuals))
        counts.append([int(inliers.sum()), len(inliers)])
    return {
        "queries": truth.queries["id"].to_numpy(str),
        "centres": poses.centres,
        "counts": np.array(counts).reshape(-1, 2),
        "sizes": np.array([len(part[0]) for part in parts], np.int64),
        **dict(zip(names, map(np.concatenate, zip(*parts, strict=True)), strict=True)),
    }


def draw_figures(evaluation: Evaluation, run: Run, out: Path) -> None:
    """Keep matches and estimated places, and draw these on the map of each scene."""
    del run
    half_px = 0.5 if evaluation.opened.protocol.lift.map_pixel_centres == "integer" else 0.0
    parts = []
    for truth in evaluation.truths:
        content, poses, inliers = evaluation.scored[truth.scene].details
        parts.append(gather_matches(truth, content, poses, inliers, half_px))
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    joined["offsets"] = np.concatenate([[0], np.cumsum(joined.pop("sizes"))]).astype(np.int64)
    folder = keep(out, "matching", joined)
    result = evaluation.result
    section = Section([Method(result.predictions.method, result, evaluation.records)], [out])
    for place in places_of(section, evaluation.benchmark):
        if place.dom is not None:
            save_figure(draw_arrows(section, place, Sheet()), folder / f"{place.scene}_map.png")


def matches_text(section: Section, query: str) -> str:
    """Count the matches of a query that a run has left to draw; empty without any."""
    found = read_kept(section)
    if found is None or query not in found["queries"]:
        return ""
    row = found["queries"].tolist().index(query)
    (inliers, total), drawn = found["counts"][row].tolist(), np.diff(found["offsets"])[row]
    counts = f"{counted(inliers, 'inlier')} of {counted(total, 'match')}"
    return f"{counts}, {drawn} drawn; thick: inliers" if drawn else ""


@default_style()
def draw_matches(
    section: Section, place: Place, query: str, sheet: Sheet, *, bare: bool = False
) -> Figure:
    """Draw a query's photo and its crop, with lines of its matches coloured by residual."""
    matches, at = need_kept(section), place.row_of(query)
    row = int(np.flatnonzero(matches["queries"] == query)[0])
    part = slice(*matches["offsets"][row : row + 2].tolist())
    limit = float(section.first.protocol.settings["solver"]["max_error_px"])
    x, y, width, height = place.truth.crops[at].tolist()
    dom = place.truth.map_of(at).dom
    photo = read_rgb_photo(place.photos[query], _LONG_SIDE_PX)
    crop = read_rgb(dom.path, (x, y, width, height), long_side_px=_LONG_SIDE_PX)
    tall, across = photo.shape[:2]
    scale, shift = tall / height, across
    right = shift + width * scale
    wide = sheet.wide(9.0)
    high = wide * tall / right
    figure = new_canvas(wide, high if bare else 0.88 * high + 0.3)
    axes = figure.add_subplot()
    axes.imshow(photo, extent=(0, across, tall, 0))
    axes.imshow(crop, extent=(shift, right, tall, 0))
    full = place.truth.queries["width"].iloc[at]
    starts = matches["query_xy"][part] * across / full
    ends = (matches["map_xy"][part] - (x, y)) * scale + (shift, 0)
    residual = np.nan_to_num(matches["residual_px"][part], nan=np.inf)
    colours = error_colours(residual, limit) / 255
    for one in np.argsort(-residual, kind="stable"):  # the best above
        thick, alpha = (0.8, 0.9) if matches["inliers"][part][one] else (0.5, 0.5)
        line = np.stack([starts[one], ends[one]], axis=1)
        axes.plot(*line, color="white", linewidth=2.5 * thick, alpha=0.5 * alpha)
        axes.plot(*line, color=colours[one], linewidth=thick, alpha=alpha)
    axes.set(xlim=(0, right), ylim=(tall, 0))
    axes.set_axis_off()
    if bare:
        figure.set_layout_engine("constrained", w_pad=0, h_pad=0)
    else:
        said, drawn = section.failures[query], matches_text(section, query)
        if drawn:
            add_error_bar(figure, axes, limit, "residual under the true pose [px]")
        said = "; ".join(filter(None, (said, drawn))) or "no matches to draw"
        finish(figure, sheet.noting(f"{query}: {said}"))
    return figure


def arrow_factor(errors_px: Floats, side_px: float) -> int:
    """Return a round factor that makes arrows of errors visible."""
    finite = errors_px[np.isfinite(errors_px)]
    typical = float(np.quantile(finite, 0.9)) if len(finite) else 0.0
    return max(1, *(f for f in _FACTORS if typical * f <= _LONGEST_ARROW * side_px), 1)


def estimates_on_map(section: Section, place: Place) -> Floats | None:
    """Return where the first method puts the queries of a place (Q, 2), in pixels of its map."""
    matches = read_kept(section)
    if matches is None or place.to_map is None:
        return None
    centres = matches["centres"][np.isin(matches["queries"], list(place.photos))]
    return place.to_map(centres[:, :2])


@default_style()
def draw_arrows(section: Section, place: Place, sheet: Sheet) -> Figure:
    """Draw arrows on the map from true to estimated places, magnified by a stated factor."""
    need_kept(section)
    figure, axes, metres = draw_ground(place, sheet)
    estimates = estimates_on_map(section, place)
    assert estimates is not None
    assert place.dom is not None
    gaps = estimates - place.centres
    factor = arrow_factor(np.linalg.norm(gaps, axis=1), max(place.dom.width, place.dom.height))
    starts, failed = place.centres * metres, mark_failures(section, place, axes, metres)
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
    style |= {"color": COLOURS[4], "edgecolor": "black", "linewidth": 0.4}
    axes.quiver(*starts[~failed].T, *(factor * metres * gaps[~failed]).T, **style)
    axes.plot(*starts[~failed].T, "o", color=COLOURS[5], markersize=4, label="true place")
    axes.legend(loc="best", fontsize=8)
    name = section.names[0]
    finish(figure, sheet.noting(f"{name}, scene {place.scene}; arrows: errors × {factor}"))
    return figure

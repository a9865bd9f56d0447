"""Pictures of single runs of matching: match lines of a query, and error arrows on the map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import world_to_camera
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.matching.lifting import lift
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.solving import PoseEstimate
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    add_error_bar,
    error_colours,
    finish,
    new_canvas,
    save_figure,
)
from airzoo_bench.report.places import Place, draw_ground, places_of, true_window
from airzoo_bench.report.plots import errors
from airzoo_bench.report.sections import Section
from airzoo_bench.results.records import Scored

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FILE = "figures/matches.npz"
_LIMIT_BYTES = 1 << 30
_MOST_LINES = 200  # of inliers, and of the others
_LONG_SIDE_PX = 1000
_GAP = 1.02
_LONGEST_ARROW = 0.08  # of the map's longer side, for nine of ten errors
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True, eq=False)
class Matches:
    """Q queries of all scenes with some of their matches, which a run keeps for pictures."""

    queries: NDArray[np.str_]
    centres: Floats  # (Q, 3), estimated, in the scene's CRS; NaN without a pose
    counts: Ints  # (Q, 2), inliers and matches, before some were chosen to be drawn
    offsets: Ints  # (Q + 1,), of each query's matches in the arrays below
    query_xy: Floats  # (M, 2), pixels of the photo
    map_xy: Floats  # (M, 2), pixels of the whole map
    inliers: Bools
    residual_px: Floats  # from the photo's pixel to where the true camera sees the map's point


def read_matches(folder: Path) -> Matches | None:
    """Read what ``eval --figures`` left in a run's folder; None where it did not."""
    path = folder / _FILE
    return _read(path, path.stat().st_mtime_ns) if path.is_file() else None


@lru_cache(maxsize=32)
def _read(path: Path, written: int) -> Matches:
    del written  # a file that was written anew is read anew
    file = NpzFile(path, _LIMIT_BYTES)
    return Matches(**{one.name: file.read(one.name) for one in fields(Matches)})


def has_matches(folder: Path, query: str) -> bool:
    """Tell whether a run has left matches of a query to draw."""
    found = read_matches(folder)
    rows = [] if found is None else np.flatnonzero(found.queries == query).tolist()
    return found is not None and any(np.diff(found.offsets)[row] for row in rows)


def _gather(
    truth: MatchingTruth, content: object, estimates: list[PoseEstimate], half_px: float
) -> Matches:
    """Gather what is shown of a scene: of each query an even choice of its matches."""
    count = len(truth.queries)
    centres = np.array([one.centre for one in estimates]).reshape(-1, 3)
    queries = truth.queries["id"].to_numpy(str)
    if not isinstance(content, Correspondences) or content.map_xy is None:
        none, pixels = np.zeros(0), np.zeros((0, 2))
        no_counts, starts = np.zeros((count, 2), np.int64), np.zeros(count + 1, np.int64)
        return Matches(queries, centres, no_counts, starts, pixels, pixels, none > 0, none)
    chosen, counts = [], []
    for part, estimate in zip(content.parts(), estimates, strict=True):
        inliers = estimate.inliers
        kinds = [_spread(np.flatnonzero(kind)) for kind in (~inliers, inliers)]
        chosen.append(part.start + np.concatenate(kinds))
        counts.append([int(inliers.sum()), len(inliers)])
    rows = np.concatenate([np.zeros(0, np.intp), *chosen])
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in chosen])]).astype(np.int64)
    every = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in estimates)])
    query_xy, map_xy = content.query_xy[rows], content.map_xy[rows]
    residual = _residuals(truth, offsets, query_xy, map_xy + half_px)
    return Matches(
        queries, centres, np.array(counts), offsets, query_xy, map_xy, every[rows], residual
    )


def _spread(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    few = len(rows) <= _MOST_LINES
    return rows if few else rows[np.linspace(0, len(rows) - 1, _MOST_LINES).astype(np.intp)]


def _residuals(truth: MatchingTruth, offsets: Ints, query_xy: Floats, map_xy: Floats) -> Floats:
    """Return how far pixels (M, 2) are from where the true cameras see the map's points."""
    found = np.full(len(query_xy), np.nan)
    cameras, poses = truth.cameras, truth.poses
    for row, (start, end) in enumerate(pairwise(offsets.tolist())):
        if start == end:
            continue
        part, scene = slice(start, end), truth.map_of(row)
        points = lift(map_xy[part], scene.dom, scene.dsm, jobs=1).points
        seen = project(cameras.take(row), world_to_camera(poses.take(row), points[None]))[0]
        found[part] = np.linalg.norm(seen - query_xy[part], axis=1)
    return found


def _joined(parts: list[Matches]) -> dict[str, NDArray[np.generic]]:
    arrays = {
        one.name: np.concatenate([getattr(part, one.name) for part in parts])
        for one in fields(Matches)
    }
    counts = np.concatenate([np.diff(part.offsets) for part in parts])
    return arrays | {"offsets": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)}


def draw_figures(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Draw error curves, maps with arrows, and the matches of every query, and keep these."""
    if not wanted or out is None:
        return
    half_px = 0.5 if evaluation.protocol.lift.map_pixel_centres == "integer" else 0.0
    parts = []
    for truth in evaluation.truths:
        content, estimates = evaluation.scored[truth.scene].details
        parts.append(_gather(truth, content, estimates, half_px))
    (out / "figures").mkdir(parents=True, exist_ok=True)
    with atomic_write(out / _FILE) as stream:
        write_npz(stream, _joined(parts), compress=True)
    result = evaluation.result
    method = Scored(result.predictions.method, result, evaluation.records)
    section = Section([method], [out])
    score = next(column for column in result.columns if column.key == "error_m")
    save_figure(errors([method], score), out / "figures" / "errors.png")
    drawn = 1
    for place in places_of(section, evaluation.benchmark):
        if place.dom is not None:
            figure = draw_arrows(section, place)
            save_figure(figure, out / "figures" / f"{place.scene}_map.png")
            drawn += 1
        queries = [*place.photos] if len(parts[0].query_xy) else []
        for query in run.progress(queries, "pictures", len(queries)):
            name = query.replace("/", "_")
            figure = draw_matches(section, place, query)
            save_figure(figure, out / "figures" / f"{name}_matches.png")
        drawn += len(queries)
    yield f"drew {drawn} pictures into {out / 'figures'}; report and plot show them too"


def _need_matches(section: Section, number: int) -> Matches:
    found = read_matches(section.folders[number])
    if found is None:
        raise UsageError(
            "this run has left no matches and cameras to draw",
            where=section.folders[number],
            fix="score the predictions again with `eval matching ... --out DIR --figures`",
        )
    return found


@default_style()
def draw_matches(
    section: Section, place: Place, query: str, sheet: Sheet | None = None, number: int = 0
) -> Figure:
    """Draw a query's photo and its crop, with lines of its matches coloured by residual."""
    sheet, matches = sheet or Sheet(), _need_matches(section, number)
    row = int(np.flatnonzero(matches.queries == query)[0])
    part = slice(int(matches.offsets[row]), int(matches.offsets[row + 1]))
    limit = float(section.first.protocol.settings["solver"]["max_error_px"])
    assert place.matching is not None
    window = true_window(place, query)
    assert window is not None
    dom, (x, y, width, height) = window
    record = place.matching.queries.iloc[place.rows_of([query])[0]]
    photo = read_rgb_photo(place.photos[query], _LONG_SIDE_PX)
    crop = read_rgb(dom.path, (x, y, width, height), long_side_px=_LONG_SIDE_PX)
    scale = photo.shape[0] / crop.shape[0]
    shift, right = photo.shape[1] * _GAP, photo.shape[1] * _GAP + crop.shape[1] * scale
    wide = sheet.wide(9.0)
    figure = new_canvas(wide, wide * 0.88 * photo.shape[0] / right + 0.3)
    axes = figure.add_subplot()
    axes.imshow(photo, extent=(0, photo.shape[1], photo.shape[0], 0))
    axes.imshow(crop, extent=(shift, right, photo.shape[0], 0))
    starts = matches.query_xy[part] * photo.shape[1] / record["width"]
    ends = (matches.map_xy[part] - (x, y)) * (crop.shape[1] / width) * scale + (shift, 0)
    residual, inlier = matches.residual_px[part], matches.inliers[part]
    colours = error_colours(np.nan_to_num(residual, nan=np.inf), limit) / 255
    order = np.argsort(-np.nan_to_num(residual, nan=np.inf), kind="stable")  # the best above
    for one in order:
        thick, alpha = (0.8, 0.9) if inlier[one] else (0.5, 0.5)
        line = np.stack([starts[one], ends[one]], axis=1)
        axes.plot(*line, color=colours[one], linewidth=thick, alpha=alpha)
    axes.set(xlim=(0, right), ylim=(photo.shape[0], 0))
    axes.set_axis_off()
    add_error_bar(axes, limit, "residual under the true pose [px]")
    inliers, total = matches.counts[row].tolist()
    said = f"{query}: {counted(inliers, 'inlier')} of {counted(total, 'match')}"
    shown = f"; {part.stop - part.start} drawn" * (part.stop - part.start < total)
    finish(figure, sheet.noting(f"{said}{shown}; thick: inliers"))
    return figure


def arrow_factor(errors_px: Floats, side_px: float) -> int:
    """Return a round factor that makes arrows of errors visible."""
    finite = errors_px[np.isfinite(errors_px)]
    typical = float(np.quantile(finite, 0.9)) if len(finite) else 0.0
    fitting = [f for f in _FACTORS if typical * f <= _LONGEST_ARROW * side_px]
    return fitting[-1] if fitting else 1


def estimates_on_map(section: Section, place: Place, number: int) -> Floats | None:
    """Return where a method puts the queries of a place (Q, 2), in pixels of its map."""
    matches = read_matches(section.folders[number]) if section.folders else None
    if matches is None or place.to_map is None:
        return None
    known = {query: row for row, query in enumerate(matches.queries.tolist())}
    rows = [known.get(query, -1) for query in place.photos]
    centres = np.vstack([matches.centres, np.full((1, 3), np.nan)])[rows]
    found = np.full((len(centres), 2), np.nan)
    posed = np.isfinite(centres).all(axis=1)
    found[posed] = place.to_map(centres[posed, :2])
    return found


@default_style()
def draw_arrows(
    section: Section, place: Place, sheet: Sheet | None = None, number: int = 0
) -> Figure:
    """Draw arrows on the map from true to estimated places, magnified by a stated factor."""
    sheet = sheet or Sheet()
    _need_matches(section, number)
    figure, axes, metres = draw_ground(place, sheet)
    estimates = estimates_on_map(section, place, number)
    assert estimates is not None
    assert place.dom is not None
    gaps = estimates - place.centres
    factor = arrow_factor(np.linalg.norm(gaps, axis=1), max(place.dom.width, place.dom.height))
    starts, failed = place.centres * metres, ~np.isfinite(estimates).all(axis=1)
    axes.quiver(
        *starts[~failed].T,
        *(factor * metres * gaps[~failed]).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.004,
        color=COLOURS[4],
        edgecolor="black",
        linewidth=0.4,
    )
    axes.plot(*starts[~failed].T, "o", color=COLOURS[5], markersize=4, label="true place")
    if failed.any():
        label = f"no pose ({int(failed.sum())})"
        axes.plot(*starts[failed].T, "X", color=COLOURS[1], markersize=7, label=label)
    axes.legend(loc="best", fontsize=8)
    name = section.methods[number].name
    finish(figure, sheet.noting(f"{name}, scene {place.scene}; arrows: errors × {factor}"))
    return figure

"""Pictures of single runs of reconstruction: predicted and true cloud, coloured by their errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.reconstruction.track import CloudComparison
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    add_error_bar,
    default_style,
    error_codes,
    error_colours,
    finish,
    new_canvas,
    save_figure,
)
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.sections import Arrays, Place, Section, jpeg, keep, need_kept, read_kept
from airzoo_bench.results.records import Method

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MOST_POINTS = 150_000
_PIECE = 1 << 20
_FRAME = (0.1, 99.9)  # percentiles that pictures reach between: strays would make all else a dot
_CELLS = 160  # along the longer side of a map
_PAGE_POINTS, _PHOTO_PX = 98_000, 800  # of all clouds of a section: 1 MB


def gather_clouds(scene: CloudComparison) -> Arrays:
    """Gather an even choice of the points of both clouds, with their distances to the other.

    Points are relative to `origin`; `curve` (3, K) has distances, precision and recall below them.
    """
    pieces = [[p.points for p in cloud.source.pieces(_PIECE)] for cloud in scene.clouds]
    points = [np.concatenate([np.zeros((0, 3)), *part]) for part in pieces]
    errors = (scene.distances.to_truth, scene.distances.to_prediction)
    origin = np.floor(points[1].mean(axis=0)) if len(points[1]) else np.zeros(3)
    steps = [max(1, -(-len(part) // _MOST_POINTS)) for part in points]
    near = [(p[::s] - origin).astype(np.float32) for p, s in zip(points, steps, strict=True)]
    kept = [e[::s].astype(np.float32) for e, s in zip(errors, steps, strict=True)]
    curve = np.stack([scene.curve.thresholds, scene.curve.precision, scene.curve.recall])
    names = ("origin", "predicted", "true", "precision_m", "recall_m", "curve")
    return dict(zip(names, (origin, *near, *kept, curve), strict=True))


def read_clouds(section: Section) -> dict[str, Arrays]:
    """Read by scene what `gather_clouds` gathered in the first run; empty where it did not."""
    kept = read_kept(section) or {"scenes": np.zeros(0, str)}
    return {
        scene: {n.rpartition("_")[0]: kept[n] for n in kept if n.endswith(f"_{place}")}
        for place, scene in enumerate(kept["scenes"].tolist())
    }


def draw_figures(evaluation: Evaluation, run: Run, out: Path) -> None:
    """Draw the clouds of each scene by their errors, and keep some of their points."""
    details = {name: scene.details for name, scene in evaluation.scored.items()}
    scenes = {name: one for name, one in details.items() if one is not None}
    arrays: dict[str, NDArray[Any]] = {"scenes": np.array([*scenes], dtype=str)}
    for number, scene in enumerate(run.progress(scenes.values(), "figures", len(scenes))):
        arrays |= {f"{name}_{number}": array for name, array in gather_clouds(scene).items()}
    folder, result = keep(out, "reconstruction", arrays), evaluation.result
    section = Section([Method(result.predictions.method, result, evaluation.records)], [out])
    for name in scenes:
        save_figure(draw_clouds(section, name, Sheet()), folder / f"{name}_cloud.png")


def error_limit(errors: Floats) -> float:
    """Return a round distance that nine of ten finite errors are below, where colours end."""
    finite = errors[np.isfinite(errors)]
    typical = float(np.quantile(finite, 0.9)) if len(finite) else 1.0
    power = 10.0 ** np.floor(np.log10(max(typical, 1e-6)))
    return next(float(f"{k * power:.3g}") for k in (1, 2, 5, 10) if k * power >= typical * 0.999)


@default_style()
def draw_clouds(section: Section, scene: str, sheet: Sheet) -> Figure:
    """Draw both clouds from above, coloured by their errors, and precision and recall."""
    need_kept(section)
    found = read_clouds(section).get(scene)
    if found is None:
        raise UsageError(f"this run has left no clouds of scene {scene} to draw")
    wide = sheet.wide(10.0)
    figure = new_canvas(wide, 0.36 * wide)
    left, right, last = figure.subplots(1, 3)
    both = np.concatenate([found["predicted"][:, :2], found["true"][:, :2], np.zeros((1, 2))])
    low, high = np.percentile(both, _FRAME, axis=0)
    limit = error_limit(np.concatenate([found["precision_m"], found["recall_m"]]))
    for axes, name, errors in ((left, "predicted", "precision_m"), (right, "true", "recall_m")):
        _draw_above(axes, found[name].astype(np.float64), found[errors], limit, low, high)
        axes.set(title=f"{name} points", xlabel="east [m]")
    add_error_bar(figure, [left, right], limit, "distance to the other cloud [m]")
    left.set(ylabel="north [m]")
    distances, precision, recall = found["curve"]
    last.plot(distances, 100 * precision, color=COLOURS[0], label="precision")
    last.plot(distances, 100 * recall, "--", color=COLOURS[1], label="recall")
    headline = section.first.protocol.settings.get("scores", {}).get("headline_below_m")
    if headline:
        last.axvline(headline, color="0.6", linewidth=0.8)
    settled = (found["curve"][1:] >= 0.99 * found["curve"][1:, -1:]).all(axis=0)
    last.set(xlabel="distance d [m]", ylabel="points nearer than d [%]")
    last.set(xlim=(0, 1.1 * distances[np.argmax(settled)] or distances[-1]), ylim=(0, 102))
    last.grid(alpha=0.3)
    last.legend(loc="lower right", fontsize=8)
    name = section.names[0]
    finish(figure, sheet.noting(f"{name}, scene {scene}; colours: mean distances from above"))
    return figure


def _draw_above(
    axes: Axes, points: Floats, errors: Floats, limit: float, low: Floats, high: Floats
) -> None:
    """Draw the mean error of points, each cut at the limit, over cells as seen from above."""
    high = np.maximum(high, low + 1.0)
    side = float((high - low).max()) / _CELLS
    shape = np.maximum(np.ceil((high - low) / side).astype(int), 1)
    grid: Any = {"bins": shape, "range": np.stack([low, low + shape * side], axis=1)}
    count = np.histogramdd(points[:, :2], **grid)[0].T
    cut = np.minimum(errors, limit).astype(np.float64)
    total = np.histogramdd(points[:, :2], weights=cut, **grid)[0].T
    # A mean of limits only may be rounded to a little less.
    mean = total / np.maximum(count, 1) * (1 + 1e-6)
    picture = np.dstack([error_colours(mean, limit), np.where(count > 0, 255, 0)]).astype(np.uint8)
    width, height = (shape * side).tolist()
    axes.imshow(picture, origin="lower", extent=(0, width, 0, height), zorder=1)


def pack_clouds(section: Section, places: Sequence[Place], blobs: Blobs) -> list[dict[str, Any]]:
    """Pack predicted and true cloud of each scene and method, where runs have kept them."""
    if section.track != "reconstruction":
        return []
    kept = dict(zip(section.names, map(read_clouds, section.alone), strict=True))
    photos = {place.scene: _photo(place) for place in places}
    most, packed = _PAGE_POINTS // max(1, sum(map(len, kept.values()))), []
    kinds = (("predicted", "truth", "precision_m"), ("true", "prediction", "recall_m"))
    for scene, title in section.first.truth.scene_titles.items():
        every = [(name, one[scene]) for name, one in kept.items() if scene in one]
        photo = blobs.picture(photos[scene]) if every and photos.get(scene) else -1
        for which, other, key in kinds:
            limit = error_limit(np.concatenate([np.zeros(0), *(one[key] for _, one in every)]))
            for name, one in every:
                cloud = _pack_cloud(one[which], one[key], limit, one["true"], most, blobs)
                about = f"distance to the {other}, from 0 to {limit:g} m; vermilion: farther"
                named = f"{title}: {name}, {which} points"
                packed.append(cloud | {"title": named, "about": about, "photo": photo})
    return packed


def _pack_cloud(
    points: Floats, errors: Floats, limit: float, true: Floats, most: int, blobs: Blobs
) -> dict[str, Any]:
    """Pack points within a cube around the true ones in 16 bits a coordinate, errors in 8."""
    low, high = np.percentile(true if len(true) else np.zeros((1, 3)), (0.2, 99.8), axis=0)
    shares = (points - (low + high) / 2) / (1.3 * max(float((high - low).max()), 1.0)) + 0.5
    inside = np.flatnonzero(((shares >= 0) & (shares < 1)).all(axis=1))
    inside = inside[:: max(1, -(-len(inside) // most))]
    return {
        "points": blobs.array((shares[inside] * 65535).astype(np.int64).ravel()),
        "codes": blobs.array(error_codes(errors[inside], limit)),
    }


def _photo(place: Place) -> str:
    """Return a photo from the middle of a scene, empty if it cannot be read."""
    try:
        path = list(place.photos.values())[len(place.photos) // 2]
        return data_uri(jpeg(read_rgb(path, long_side_px=_PHOTO_PX)), "image/jpeg")
    except (UserError, IndexError):
        return ""

"""Pictures of single runs of reconstruction: predicted and true cloud, coloured by their errors."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.reconstruction.track import Comparison
from airzoo_bench.report.figures import (
    COLOURS,
    Sheet,
    add_error_bar,
    error_codes,
    error_colours,
    finish,
    new_canvas,
    save_figure,
)
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.places import Place, jpeg
from airzoo_bench.report.sections import Section
from airzoo_bench.results.records import Scored

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_FILE = "figures/clouds.npz"
_LIMIT_BYTES = 1 << 30
_MOST_POINTS = 150_000
_PIECE = 1 << 20
# Percentiles of each axis between which maps reach: a few strays would make all else a dot.
_FRAME = (0.1, 99.9)
_CELLS = 160  # along the longer side of a map
_CUBE = (0.2, 99.8)  # percentiles of the true points that the page's view reaches between
_CLOUDS_BYTES, _POINT_BYTES, _PHOTO_PX = 1536 << 10, 8, 800


@dataclass(frozen=True, eq=False)
class Clouds:
    """An even choice of the points of both clouds of a scene, which a run keeps for pictures."""

    origin: Floats  # (3,), in the scene's CRS; points are relative to it
    predicted: Floats  # (N, 3)
    true: Floats
    precision_m: Floats  # (N,), distances of predicted points to the truth
    recall_m: Floats  # of true points to the prediction
    curve: Floats  # (3, K): distances, the precision and the recall below them


def read_clouds(folder: Path) -> dict[str, Clouds]:
    """Read by scene what ``eval --figures`` left in a run's folder; empty where it did not."""
    path = folder / _FILE
    return _read(path, path.stat().st_mtime_ns) if path.is_file() else {}


@lru_cache(maxsize=16)
def _read(path: Path, written: int) -> dict[str, Clouds]:
    del written  # a file that was written anew is read anew
    file = NpzFile(path, _LIMIT_BYTES)
    names = list(Clouds.__dataclass_fields__)
    return {
        scene: Clouds(**{name: file.read(f"{name}_{number}") for name in names})
        for number, scene in enumerate(file.read("scenes").tolist())
    }


def _gather(scene: Comparison) -> Clouds:
    points = [_points(cloud.source) for cloud in scene.clouds]
    errors = [scene.distances.to_truth, scene.distances.to_prediction]
    origin = np.floor(points[1].mean(axis=0)) if len(points[1]) else np.zeros(3)
    steps = [max(1, -(-len(part) // _MOST_POINTS)) for part in points]
    near = [p[::s] - origin for p, s in zip(points, steps, strict=True)]
    kept = [e[::s] for e, s in zip(errors, steps, strict=True)]
    curve = np.stack([scene.curve.thresholds, scene.curve.precision, scene.curve.recall])
    return Clouds(origin, near[0], near[1], kept[0], kept[1], curve)


def _points(source: CloudSource) -> Floats:
    pieces = [piece.points for piece in source.pieces(_PIECE)]
    return np.concatenate([np.zeros((0, 3)), *pieces])


def _compared(evaluation: Evaluation) -> dict[str, Comparison]:
    found = {name: scene.details for name, scene in evaluation.scored.items()}
    return {name: one for name, one in found.items() if one is not None}


def draw_figures(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Draw the clouds of each scene by their errors, and keep some of their points."""
    if not wanted or out is None:
        return
    scenes = _compared(evaluation)
    arrays: dict[str, NDArray[Any]] = {"scenes": np.array([*scenes], dtype=str)}
    for number, scene in enumerate(run.progress(scenes.values(), "figures", len(scenes))):
        for key, array in vars(_gather(scene)).items():
            kind = np.float64 if key == "origin" else np.float32
            arrays[f"{key}_{number}"] = array.astype(kind)
    (out / "figures").mkdir(parents=True, exist_ok=True)
    with atomic_write(out / _FILE) as stream:
        write_npz(stream, arrays, compress=True)
    result = evaluation.result
    section = Section([Scored(result.predictions.method, result, evaluation.records)], [out])
    for name in scenes:
        save_figure(draw_clouds(section, name), out / "figures" / f"{name}_cloud.png")
    yield f"drew {len(scenes)} pictures into {out / 'figures'}; report and plot show them too"


def write_clouds(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Write prediction and truth of each scene, coloured by their errors, into ``clouds``."""
    if not wanted or out is None:
        return
    folder, scenes = out / "clouds", _compared(evaluation)
    for name, scene in run.progress(scenes.items(), "clouds", len(scenes)):
        errors = (scene.distances.to_truth, scene.distances.to_prediction)
        for which, cloud, distances in zip(
            ("precision", "recall"), scene.clouds, errors, strict=True
        ):
            colours = error_colours(distances, error_limit([distances]))
            write_ply(folder / f"{name}_{which}.ply", Cloud(_points(cloud.source), colours))
    yield f"wrote {2 * len(scenes)} clouds into {folder}"


def error_limit(errors: Sequence[Floats]) -> float:
    """Return a round distance that nine of ten finite errors are below, where colours end."""
    listed = np.concatenate([np.zeros(0), *errors])
    finite = listed[np.isfinite(listed)]
    typical = float(np.quantile(finite, 0.9)) if len(finite) else 1.0
    power = 10.0 ** np.floor(np.log10(max(typical, 1e-6)))
    return next(float(f"{k * power:.3g}") for k in (1, 2, 5, 10) if k * power >= typical * 0.999)


@default_style()
def draw_clouds(
    section: Section, scene: str, sheet: Sheet | None = None, number: int = 0
) -> Figure:
    """Draw both clouds from above, coloured by their errors, and precision and recall."""
    found = read_clouds(section.folders[number]).get(scene)
    if found is None:
        raise UsageError(
            f"this run has left no clouds of scene {scene} to draw",
            where=section.folders[number],
            fix="score the predictions again with `eval reconstruction ... --out DIR --figures`",
        )
    sheet = sheet or Sheet()
    wide = sheet.wide(10.0)
    figure = new_canvas(wide, 0.36 * wide)
    left, right, last = figure.subplots(1, 3)
    both = np.concatenate([found.predicted[:, :2], found.true[:, :2]])
    low, high = np.percentile(both, _FRAME, axis=0) if len(both) else np.zeros((2, 2))
    _draw_above(left, found.predicted, found.precision_m, (low, high))
    _draw_above(right, found.true, found.recall_m, (low, high))
    left.set(title="predicted points", ylabel="north [m]")
    right.set(title="true points")
    distances, precision, recall = found.curve
    last.plot(distances, 100 * precision, color=COLOURS[0], label="precision")
    last.plot(distances, 100 * recall, "--", color=COLOURS[1], label="recall")
    headline = section.first.protocol.settings.get("scores", {}).get("headline_below_m")
    if headline:
        last.axvline(headline, color="0.6", linewidth=0.8)
    last.set(xlabel="distance d [m]", ylabel="points nearer than d [%]", ylim=(0, 102))
    last.grid(alpha=0.3)
    last.legend(loc="lower right", fontsize=8)
    name = section.methods[number].name
    finish(figure, sheet.noting(f"{name}, scene {scene}; colours: mean distances from above"))
    return figure


def _draw_above(axes: Axes, points: Floats, errors: Floats, frame: tuple[Floats, Floats]) -> None:
    """Draw the mean error of points, each cut at the limit, over cells as seen from above."""
    limit = error_limit([errors])
    low, high = frame[0], np.maximum(frame[1], frame[0] + 1.0)
    side = float((high - low).max()) / _CELLS
    columns, rows = np.maximum(np.ceil((high - low) / side).astype(int), 1)
    cells = np.floor((points[:, :2] - low) / side).astype(np.int64)
    inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
    flat = cells[inside, 1] * columns + cells[inside, 0]
    count = np.bincount(flat, minlength=int(columns * rows))
    total = np.bincount(flat, np.minimum(errors[inside], limit), minlength=len(count))
    mean = np.where(count > 0, total / np.maximum(count, 1), 0.0)
    # A mean of limits only may be rounded to a little less.
    mean[mean >= limit * (1 - 1e-6)] = limit
    picture = np.full((len(count), 4), 0, np.uint8)
    picture[:, :3], picture[:, 3] = error_colours(mean, limit), np.where(count > 0, 255, 0)
    width, height = columns * side, rows * side
    axes.imshow(
        picture.reshape(rows, columns, 4), origin="lower", extent=(0, width, 0, height), zorder=1
    )
    axes.set_xlabel("east [m]")
    add_error_bar(axes, limit, "distance to the other cloud [m]")


def pack_clouds(section: Section, places: Sequence[Place], blobs: Blobs) -> list[dict[str, Any]]:
    """Pack predicted and true cloud of each scene and method, where runs have kept them."""
    kept = [read_clouds(folder) for folder in section.folders]
    kept = kept if section.track == "reconstruction" else []
    photos = {place.scene: _photo(place) for place in places} if any(kept) else {}
    most = _CLOUDS_BYTES // (2 * _POINT_BYTES * max(1, sum(map(len, kept))))
    packed = []
    for scene, title in section.first.truth.scene_titles.items():
        every = [found[scene] for found in kept if scene in found]
        photo = blobs.picture(photos[scene]) if photos.get(scene) else -1
        limits = [
            error_limit([one.precision_m for one in every]),
            error_limit([one.recall_m for one in every]),
        ]
        for method, found in zip(section.methods, kept, strict=False):
            if scene not in found:
                continue
            one = found[scene]
            clouds = (
                ("predicted", "truth", one.predicted, one.precision_m),
                ("true", "prediction", one.true, one.recall_m),
            )
            for (which, other, points, errors), limit in zip(clouds, limits, strict=True):
                cloud = _pack_cloud(points, errors, limit, one.true, most, blobs)
                about = f"distance to the {other}, from 0 to {limit:g} m; vermilion: farther"
                name = f"{title}: {method.name}, {which} points"
                packed.append(cloud | {"title": name, "about": about, "photo": photo})
    return packed


def _pack_cloud(
    points: Floats, errors: Floats, limit: float, true: Floats, most: int, blobs: Blobs
) -> dict[str, Any]:
    """Pack points within a cube around the true ones in 16 bits a coordinate, errors in 8."""
    low, high = np.percentile(true, _CUBE, axis=0) if len(true) else np.zeros((2, 3))
    side = 1.3 * max(float((high - low).max()), 1.0)
    shares = (points - (low + high) / 2) / side + 0.5
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
        return data_uri(jpeg(read_rgb(path, long_side_px=_PHOTO_PX), 70), "image/jpeg")
    except (UserError, IndexError):
        return ""


@cache
def error_bar() -> str:
    """Return the scale of errors as a picture."""
    from PIL import Image

    stream = io.BytesIO()
    scale = np.append(np.linspace(0, 0.999, 240), np.ones(16))
    Image.fromarray(error_colours(scale, 1.0)[None]).save(stream, "PNG")
    return data_uri(stream.getvalue(), "image/png")

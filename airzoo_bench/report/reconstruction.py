"""Pictures of reconstruction: scores over distance, and errors as seen from above."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.optional_imports import default_style, load_matplotlib
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.metrics import Curve
from airzoo_bench.reconstruction.scoring import Comparison
from airzoo_bench.report.figures import COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

__all__ = ["draw_curve", "draw_error_map", "draw_figures", "error_colours", "write_clouds"]

_MAP = "viridis"  # even steps of lightness, for print and colour-blind readers
# Percentiles of each axis between which maps reach: a few strays would make all else a dot.
_FRAME = (0.02, 99.98)
_BEYOND = (213, 94, 0)  # vermilion: at the limit or farther
_LEAST_CELLS, _MOST_CELLS = 40, 400
_POINTS_A_CELL = 2


@default_style()
def draw_curve(path: Path, curve: Curve, limit: float, title: str) -> None:
    """Draw precision, recall and F1 over the distance below which points count as right."""
    figure, axes = new_figure(6.0, 4.0)
    for values, name, colour, style in (
        (curve.precision, "precision", COLOURS[0], "-"),
        (curve.recall, "recall", COLOURS[1], "--"),
        (curve.f1, "F1", COLOURS[6], "-."),
    ):
        axes.plot(curve.thresholds, 100 * values, style, color=colour, label=name)
    axes.axvline(limit, color="0.6", linewidth=0.8)
    axes.set(xlabel="distance d [m]", ylabel="points nearer than d [%]", title=title)
    axes.set_xlim(0, float(curve.thresholds[-1]))
    axes.set_ylim(0, 102)
    axes.grid(color="0.9")
    axes.legend(loc="lower right")
    save_figure(figure, path)


@default_style()
def draw_error_map(path: Path, points: Floats, distances: Floats, limit: float, title: str) -> None:
    """Draw the mean distance of points as seen from above, cut at a limit."""
    figure, axes = new_figure(6.4, 5.2)
    axes.set(xlabel="east [m]", ylabel="north [m]", title=title)
    if len(points):
        low = np.floor(np.percentile(points[:, :2], _FRAME[0], axis=0))
        high = np.maximum(np.ceil(np.percentile(points[:, :2], _FRAME[1], axis=0)), low + 1.0)
        mean = _mean_by_cell(points[:, :2], np.minimum(distances, limit), low, high)
        # A mean of limits only may be rounded to a little less.
        mean[mean >= limit * (1 - 1e-9)] = 2 * limit
        extent = (0.0, float(high[0] - low[0]), 0.0, float(high[1] - low[1]))
        image = axes.imshow(
            mean, origin="lower", extent=extent, cmap=_colours(), vmin=0, vmax=limit, aspect="equal"
        )
        label = f"mean distance, each cut at {limit:g} [m]"
        figure.colorbar(image, ax=axes, label=label, extend="max", shrink=0.85)
        axes.set_xlabel(f"east of {low[0]:.0f} [m]")
        axes.set_ylabel(f"north of {low[1]:.0f} [m]")
    save_figure(figure, path)


def error_colours(distances: Floats, limit: float) -> NDArray[np.uint8]:
    """Colour points by their distance: dark to bright up to the limit, vermilion from there on."""
    table = (
        (load_matplotlib().colormaps[_MAP](np.arange(256))[:, :3] * 255).round().astype(np.uint8)
    )
    steps = np.minimum(distances / limit * 256, 255).astype(np.intp)
    colours: NDArray[np.uint8] = table[steps]
    colours[distances >= limit] = _BEYOND
    return colours


def _colours() -> Colormap:
    red, green, blue = (band / 255 for band in _BEYOND)
    colours: Colormap = load_matplotlib().colormaps[_MAP]
    return colours.with_extremes(over=(red, green, blue))


def _mean_by_cell(xy: Floats, values: Floats, low: Floats, high: Floats) -> Floats:
    """Return the mean (rows, columns) of values over a grid of square cells, NaN where none is."""
    longest, area = float((high - low).max()), float((high - low).prod())
    side = np.sqrt(_POINTS_A_CELL * area / len(xy))
    side = float(np.clip(side, longest / _MOST_CELLS, longest / _LEAST_CELLS))
    shape = np.maximum(np.ceil((high - low) / side).astype(int), 1)
    cells = np.floor((xy - low) / side).astype(np.int64)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    flat = cells[inside, 1] * shape[0] + cells[inside, 0]
    total = np.bincount(flat, values[inside], minlength=int(shape.prod()))
    count = np.bincount(flat, minlength=int(shape.prod()))
    mean = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    return np.asarray(mean.reshape(shape[1], shape[0]), dtype=np.float64)


_PIECE = 1 << 20


def draw_figures(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Draw the curves of each scene, and its errors as seen from above, into ``figures``."""
    if not wanted or out is None:
        return
    limit, folder, scenes = _limit(evaluation), out / "figures", _compared(evaluation)
    for name, scene in run.progress(scenes.items(), "figures", len(scenes)):
        _draw_scene(folder, name, scene, limit)
    yield f"drew {3 * len(scenes)} pictures into {folder}"


def _draw_scene(folder: Path, name: str, scene: Comparison, limit: float) -> None:
    draw_curve(folder / f"{name}_curve.png", scene.curve, limit, name)
    there, back = scene.distances.to_truth, scene.distances.to_prediction
    for which, cloud, distances, what in (
        ("precision", scene.clouds[0], there, "from predicted points to the truth"),
        ("recall", scene.clouds[1], back, "from true points to the prediction"),
    ):
        points = _cloud(cloud.source).points
        path = folder / f"{name}_{which}.png"
        draw_error_map(path, points, distances, limit, f"{name}: {what}")


def write_clouds(evaluation: Evaluation, wanted: bool, out: Path | None, run: Run) -> Iterator[str]:
    """Write prediction and truth of each scene, coloured by their errors, into ``clouds``."""
    if not wanted or out is None:
        return
    limit, folder, scenes = _limit(evaluation), out / "clouds", _compared(evaluation)
    for name, scene in run.progress(scenes.items(), "clouds", len(scenes)):
        predicted, true = (_cloud(cloud.source).points for cloud in scene.clouds)
        for which, points, distances in (
            ("precision", predicted, scene.distances.to_truth),
            ("recall", true, scene.distances.to_prediction),
        ):
            colours = error_colours(distances, limit)
            write_ply(folder / f"{name}_{which}.ply", Cloud(points, colours))
    yield f"wrote {2 * len(scenes)} clouds into {folder}"


def _limit(evaluation: Evaluation) -> float:
    limit: float = evaluation.protocol.scores.headline_below_m
    return limit


def _compared(evaluation: Evaluation) -> dict[str, Comparison]:
    found = {name: scene.details for name, scene in evaluation.scored.items()}
    return {name: one for name, one in found.items() if one is not None}


def _cloud(source: CloudSource) -> Cloud:
    pieces = [piece.points for piece in source.pieces(_PIECE)]
    return Cloud(np.concatenate([np.zeros((0, 3)), *pieces]))

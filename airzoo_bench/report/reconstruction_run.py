"""What a run of the reconstruction track shows beside its scores: curves, maps, clouds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.reconstruction.scoring import ScoredScene
from airzoo_bench.report.reconstruction import draw_curve, draw_error_map, error_colours

__all__ = ["draw_figures", "write_clouds"]

_PIECE = 1 << 20


def draw_figures(
    evaluation: Evaluation, wanted: bool, out: Path | None, resources: Resources
) -> Iterator[str]:
    """Draw the curves of each scene, and its errors as seen from above, into ``figures``."""
    if not wanted or out is None:
        return
    limit, folder, scenes = _limit(evaluation), out / "figures", _compared(evaluation)
    for name, scene in resources.progress(scenes.items(), "figures", len(scenes)):
        _draw_scene(folder, name, scene, limit)
    yield f"drew {3 * len(scenes)} pictures into {folder}"


def _draw_scene(folder: Path, name: str, scene: ScoredScene, limit: float) -> None:
    if scene.curve is None or scene.clouds is None or scene.distances is None:
        return
    draw_curve(folder / f"{name}_curve.png", scene.curve, limit, name)
    there, back = scene.distances.to_truth, scene.distances.to_prediction
    for which, cloud, distances, what in (
        ("precision", scene.clouds[0], there, "from predicted points to the truth"),
        ("recall", scene.clouds[1], back, "from true points to the prediction"),
    ):
        points = _cloud(cloud.source).points
        path = folder / f"{name}_{which}.png"
        draw_error_map(path, points, distances, limit, f"{name}: {what}")


def write_clouds(
    evaluation: Evaluation, wanted: bool, out: Path | None, resources: Resources
) -> Iterator[str]:
    """Write prediction and truth of each scene, coloured by their errors, into ``clouds``."""
    if not wanted or out is None:
        return
    limit, folder, scenes = _limit(evaluation), out / "clouds", _compared(evaluation)
    for name, scene in resources.progress(scenes.items(), "clouds", len(scenes)):
        if scene.clouds is None or scene.distances is None:
            continue
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


def _compared(evaluation: Evaluation) -> dict[str, ScoredScene]:
    return {name: scene for name, scene in evaluation.scored.items() if scene.distances is not None}


def _cloud(source: CloudSource) -> Cloud:
    pieces = [piece.points for piece in source.pieces(_PIECE)]
    return Cloud(np.concatenate([np.zeros((0, 3)), *pieces]))

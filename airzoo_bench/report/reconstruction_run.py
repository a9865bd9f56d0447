"""What the reconstruction track shows beside its scores: alignments, curves, maps, clouds."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.ply_writer import write_ply
from airzoo_bench.reconstruction.alignment.cameras import Alignment, Residuals
from airzoo_bench.reconstruction.track import ReconstructionEvaluation
from airzoo_bench.report.reconstruction import draw_curve, draw_error_map, error_colours

__all__ = ["draw_figures", "save_alignments", "write_clouds"]

_PIECE = 1 << 20


def save_alignments(evaluation: ReconstructionEvaluation, folder: Path) -> None:
    """Write ``alignment.json``: of each scene the transform, its scale and its residuals."""
    values = {
        name: _alignment(scene.alignment)
        for name, scene in evaluation.scored.items()
        if scene.alignment is not None
    }
    with atomic_write(folder / "alignment.json", "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


def draw_figures(
    evaluation: ReconstructionEvaluation, folder: Path, progress: Progress = silent
) -> int:
    """Draw the curves of each scene, and its errors as seen from above; returns how many."""
    limit = evaluation.protocol.scores.headline_below_m
    scenes = _compared(evaluation)
    for name in progress(scenes, "figures", len(scenes)):
        scene = evaluation.scored[name]
        if scene.curve is None or scene.clouds is None or scene.distances is None:
            continue
        draw_curve(folder / f"{name}_curve.png", scene.curve, limit, name)
        there, back = scene.distances.to_truth, scene.distances.to_prediction
        for which, cloud, distances, what in (
            ("precision", scene.clouds[0], there, "from predicted points to the truth"),
            ("recall", scene.clouds[1], back, "from true points to the prediction"),
        ):
            points = _cloud(cloud.source).points
            path = folder / f"{name}_{which}.png"
            draw_error_map(path, points, distances, limit, f"{name}: {what}")
    return 3 * len(scenes)


def write_clouds(
    evaluation: ReconstructionEvaluation, folder: Path, progress: Progress = silent
) -> int:
    """Write prediction and truth of each scene, coloured by their errors; returns how many."""
    limit = evaluation.protocol.scores.headline_below_m
    scenes = _compared(evaluation)
    for name in progress(scenes, "clouds", len(scenes)):
        scene = evaluation.scored[name]
        if scene.clouds is None or scene.distances is None:
            continue
        predicted, true = (_cloud(cloud.source).points for cloud in scene.clouds)
        for which, points, distances in (
            ("precision", predicted, scene.distances.to_truth),
            ("recall", true, scene.distances.to_prediction),
        ):
            colours = error_colours(distances, limit)
            write_ply(folder / f"{name}_{which}.ply", Cloud(points, colours))
    return 2 * len(scenes)


def _compared(evaluation: ReconstructionEvaluation) -> list[str]:
    return [name for name, scene in evaluation.scored.items() if scene.distances is not None]


def _cloud(source: CloudSource) -> Cloud:
    pieces = [piece.points for piece in source.pieces(_PIECE)]
    return Cloud(np.concatenate([np.zeros((0, 3)), *pieces]))


def _alignment(found: Alignment) -> dict[str, Any]:
    values: dict[str, Any] = {
        "method": found.method,
        "scale": found.transform.scale,
        "matrix": found.transform.matrix.tolist(),
        "cameras": found.cameras,
        "cameras_missing": found.missing,
        "inliers": found.inliers,
        "inlier_names": list(found.inlier_names),
        "inlier_limit_m": found.inlier_limit,
        "used_orientations": found.used_orientations,
        "robust": found.robust,
    }
    for name in ("centres", "inlier_centres", "rotations_deg"):
        residuals: Residuals | None = getattr(found, name)
        values[name] = None if residuals is None else _finite(asdict(residuals))
    values["icp"] = None if found.icp is None else _finite(asdict(found.icp))
    values["icp_failure"] = found.icp_failure
    return values


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Write infinite numbers as text, as in results, at whatever depth."""
    return {
        key: _finite(one) if isinstance(one, dict) else _text(one) for key, one in values.items()
    }


def _text(value: object) -> object:
    return "Infinity" if isinstance(value, float) and np.isinf(value) else value

"""The matching baseline: SIFT between the photos of a benchmark and their crops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.queries import check_npz, write_predictions
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LONLAT_CRS, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, to_map_pixels
from airzoo_bench.matching.baseline_settings import SiftSettings
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.sift import Task, match_photos
from airzoo_bench.matching.truth import MatchingTruth, read_truth

__all__ = ["plan", "predict"]

# Nearer to the horizon than 6 degrees a photo is treated as if it were that far below it.
_LEAST_SINE = 0.1


def predict(
    protocol: MatchingProtocol,
    benchmark: Benchmark,
    settings: SiftSettings,
    out: Path,
    run: Run,
    note: Callable[[str], None],
) -> None:
    """Match every query of a benchmark to its crop and write a prediction file."""
    check_npz(out)
    ids: list[str] = []
    matches: list[tuple[Floats, Floats]] = []
    for scene in protocol.scenes:
        truth = read_truth(benchmark, scene.id)
        ids += truth.queries["id"].tolist()
        tasks = _tasks(benchmark, truth)
        progress = Headed(scene.id, run.progress)
        matches += match_photos(tasks, settings, engine=run.processes, progress=progress)
    offsets = np.concatenate([[0], np.cumsum([len(query_xy) for query_xy, _ in matches])])
    arrays = {
        "query_ids": np.array(ids, dtype=str),
        "offsets": offsets.astype(np.int64),
        "query_xy": np.concatenate([np.zeros((0, 2)), *(query_xy for query_xy, _ in matches)]),
        "map_xy": np.concatenate([np.zeros((0, 2)), *(map_xy for _, map_xy in matches)]),
    }
    write_predictions(out, protocol.name, arrays)


def plan(
    photo: Path,
    camera: Cameras,
    prior: Poses | None,
    crs: Any,
    dom: RasterInfo,
    window: tuple[int, int, int, int],
    *,
    ground_height_m: float,
) -> Task:
    """Work out from a prior how a photo lies on the map."""
    turn, ratio = (
        _lie(camera, prior, crs, dom, ground_height_m) if prior is not None else (0.0, 1.0)
    )
    return Task(
        photo=photo,
        camera=camera,
        dom=dom.path,
        window=window,
        turn_deg=turn if np.isfinite(turn) else 0.0,
        gsd_ratio=ratio if ratio > 0.0 else 1.0,
    )


def _lie(
    camera: Cameras, prior: Poses, crs: Any, dom: RasterInfo, ground_height_m: float
) -> tuple[float, float]:
    """Return the turn and the ratio of ground sizes as `Task` has them, perhaps not usable."""
    right, forward = prior.rotation[0, 0], prior.rotation[0, 2]
    centre = prior.centres[0]
    ends = np.stack((centre[:2], centre[:2] + right[:2]))
    start, end = to_map_pixels(LONLAT_CRS, dom)(to_lonlat(crs, ends))
    turn = float(np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
    away = (centre[2] - ground_height_m) / max(-forward[2], _LEAST_SINE)
    ratio = away / np.sqrt(camera.focal[0].prod()) / np.sqrt(np.prod(gsd_m(dom)))
    return turn, float(ratio)


def _tasks(benchmark: Benchmark, truth: MatchingTruth) -> list[Task]:
    scene = benchmark.scene(truth.scene)
    images, cameras, priors = benchmark.resolve(scene.images), truth.cameras, truth.priors
    ground = np.nan  # which nothing asks of photos without a prior
    if not truth.own_maps:
        ground = needed(scene.plane_height_m, "height of the ground", scene.id)
    return [
        plan(
            images / name,
            cameras.take(row),
            None if truth.own_maps else priors.take(row),
            scene.crs,
            truth.map_of(row).dom,
            (int(x), int(y), int(width), int(height)),
            ground_height_m=ground,
        )
        for row, (name, (x, y, width, height)) in enumerate(
            zip(truth.queries["image"], truth.crops, strict=True)
        )
    ]

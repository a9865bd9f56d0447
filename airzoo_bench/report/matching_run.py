"""Pictures of a run of the matching track."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.geometry.frames import change_of_plane
from airzoo_bench.geometry.rasters import open_info, pixel_to_world, read_rgb, world_to_pixel
from airzoo_bench.matching.scene_predictions import ScenePredictions
from airzoo_bench.matching.scoring import ScoredScene
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.report.figures import save_figure
from airzoo_bench.report.matching import draw_error_curves, draw_matches, draw_queries_on_map

__all__ = ["draw_figures"]

_LONG_SIDE_PX = 1200


def draw_figures(
    evaluation: Evaluation, wanted: bool, out: Path | None, resources: Resources
) -> Iterator[str]:
    """Draw error curves of all scenes, and of each a map and every query's matches.

    Parameters
    ----------
    evaluation : Evaluation
    wanted : bool
    out : Path or None
        The folder of the run; pictures go into its ``figures``.
    resources : Resources

    Raises
    ------
    BenchmarkError
        A photo is not there.
    """
    if not wanted or out is None:
        return
    folder, protocol = out / "figures", evaluation.protocol
    titles = {scene.id: scene.title for scene in protocol.scenes}
    limits = protocol.scores.translation_below_m
    save_figure(draw_error_curves(evaluation.records, titles, limits), folder / "errors.png")
    drawn, benchmark = 1, evaluation.benchmark
    for truth, predicted in zip(evaluation.truths, evaluation.scene_predictions, strict=True):
        scored = evaluation.scored[truth.scene]
        _draw_map(truth, scored, titles[truth.scene], folder / f"{truth.scene}_map.png")
        images = benchmark.resolve(benchmark.scene(truth.scene).images)
        rows = range(len(truth.queries) if predicted.map_xy is not None else 0)
        for row in resources.progress(rows, "pictures", len(rows)):
            _draw_query(truth, predicted, scored, row, images, folder)
        drawn += 1 + len(rows)
    yield f"drew {drawn} pictures into {folder}"


def _draw_map(truth: MatchingTruth, scored: ScoredScene, title: str, path: Path) -> None:
    """Draw in metres along the map's sides: its CRS need not be the scene's, nor north be up."""
    dom, scene_crs = truth.dom, open_info(truth.dsm).crs
    corners = pixel_to_world(dom.transform, [(0, 0), (dom.width, 0), (0, dom.height)])
    origin, right, down = change_of_plane(dom.crs, scene_crs)(corners)
    sides = np.linalg.norm([right - origin, down - origin], axis=1)
    to_dom = change_of_plane(scene_crs, dom.crs)

    def along_sides(centres: NDArray[np.float64]) -> NDArray[np.float64]:
        pixels = world_to_pixel(dom.transform, to_dom(centres[:, :2]))
        east, south = (pixels * sides / (dom.width, dom.height)).T
        return np.stack([east, sides[1] - south], axis=1)

    figure = draw_queries_on_map(
        read_rgb(dom.path, long_side_px=_LONG_SIDE_PX),
        (0.0, float(sides[0]), 0.0, float(sides[1])),
        along_sides(truth.poses.centres),
        along_sides(scored.centres),
        title,
    )
    save_figure(figure, path)


def _draw_query(
    truth: MatchingTruth,
    predicted: ScenePredictions,
    scored: ScoredScene,
    row: int,
    images: Path,
    folder: Path,
) -> None:
    query, part = truth.queries.iloc[row], predicted.parts()[row]
    x, y, width, height = (int(side) for side in truth.crops[row])
    photo = read_rgb_photo(images / query["image"], _LONG_SIDE_PX)
    crop = read_rgb(truth.dom.path, (x, y, width, height), long_side_px=_LONG_SIDE_PX)
    shrunk = np.array([photo.shape[1] / query["width"], photo.shape[0] / query["height"]])
    map_xy = predicted.map_xy if predicted.map_xy is not None else np.zeros((0, 2))
    figure = draw_matches(
        photo,
        crop,
        predicted.query_xy[part] * shrunk,
        (map_xy[part] - (x, y)) * (crop.shape[1] / width, crop.shape[0] / height),
        scored.inliers[row],
        str(query["id"]),
    )
    name = str(query["id"]).replace("/", "_")
    save_figure(figure, folder / f"{name}_matches.png")

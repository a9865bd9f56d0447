"""The matching baseline: SIFT between the photos of a benchmark and their crops of the map.

The photo and the crop are brought to one ground resolution, that of the coarser, and the crop is
turned as the prior says that the camera was, by quarters, which only move pixels. Features are SIFT
(Lowe, IJCV 2004) as RootSIFT (Arandjelovic and Zisserman, CVPR 2012), matched where they are each
other's nearest and clearly nearer than the second. A prior whose yaw is wrong does no harm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Headed
from airzoo_bench.evaluation.predictions import check_npz, write_predictions
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.photos import open_photo
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LONLAT_CRS, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, read_rgb, to_map_pixels
from airzoo_bench.geometry.sift import Grey, extract, mutual_nearest
from airzoo_bench.matching.info import SiftSettings
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.matching.truth import read_truth

_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601
# Nearer to the horizon than 6 degrees a photo is treated as if it were that far below it.
_LEAST_SINE = 0.1


@dataclass(frozen=True)
class Task:
    """A photo and the part of the map to match it with.

    `turn_deg` says where the photo's right points on the map, clockwise from the map's right, and
    `gsd_ratio` is the ground size of its pixel over that of the map's; 0 and 1 where not known.
    """

    photo: Path
    size: tuple[int, int]
    dom: Path
    window: tuple[int, int, int, int]
    turn_deg: float = 0.0
    gsd_ratio: float = 1.0


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
    matches = [(np.zeros((0, 2)), np.zeros((0, 2)))]
    for scene in protocol.scenes:
        truth, entry = read_truth(benchmark, scene.id), benchmark.scene(scene.id)
        ids += truth.queries["id"].tolist()
        tasks = []
        for row, name in enumerate(truth.queries["image"]):
            dom, camera, lie_on_map = truth.map_of(row).dom, truth.cameras.take(row), (0.0, 1.0)
            if not truth.map_per_query:
                ground = needed(entry.plane_height_m, "height of the ground", scene.id)
                lie_on_map = turn_and_ratio(camera, truth.priors.take(row), entry.crs, dom, ground)
            photo, window = benchmark.resolve(entry.images) / name, tuple(truth.crops[row].tolist())
            size = (int(camera.width[0]), int(camera.height[0]))
            tasks.append(Task(photo, size, dom.path, window, *lie_on_map))
        matched = run.processes.map(
            match_task, tasks, shared=settings, stage="photos", name=lambda task: str(task.photo)
        )
        matches += Headed(scene.id, run.progress)(matched, "photos", len(tasks))
    query_xy, map_xy = zip(*matches, strict=True)
    arrays = {
        "query_ids": np.array(ids, dtype=str),
        "offsets": np.cumsum([len(xy) for xy in query_xy], dtype=np.int64),
        "query_xy": np.concatenate(query_xy),
        "map_xy": np.concatenate(map_xy),
    }
    write_predictions(out, protocol.name, arrays)


def turn_and_ratio(
    camera: Cameras, prior: Poses, crs: Any, dom: RasterInfo, ground_height_m: float
) -> tuple[float, float]:
    """Return from a prior the turn and the ratio of ground sizes that `Task` has."""
    right, forward, centre = prior.rotation[0, 0], prior.rotation[0, 2], prior.centres[0]
    ends = np.stack((centre[:2], centre[:2] + right[:2]))
    start, end = to_map_pixels(LONLAT_CRS, dom)(to_lonlat(crs, ends))
    turn = float(np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
    away = (centre[2] - ground_height_m) / max(-forward[2], _LEAST_SINE)
    ratio = float(away / np.sqrt(camera.focal[0].prod()) / np.sqrt(np.prod(gsd_m(dom))))
    return turn if np.isfinite(turn) else 0.0, ratio if ratio > 0.0 else 1.0


def match_task(settings: SiftSettings, task: Task) -> tuple[Floats, Floats]:
    """Match a photo with its part of the map, in pixels of both at their full size."""
    photo_scale, crop_scale = min(1.0, task.gsd_ratio), min(1.0, 1.0 / task.gsd_ratio)
    largest = max(max(task.size) * photo_scale, max(task.window[2:]) * crop_scale)
    fit = min(1.0, settings.long_side_px / largest)
    width, height = (max(round(side * photo_scale * fit), 1) for side in task.size)
    colours = read_rgb(task.dom, task.window)
    # Black is where a map has no data; what is nearly black is not.
    crop = np.maximum(np.round(colours @ _GREY).astype(np.uint8), colours.any(axis=-1))
    with open_photo(task.photo, "put the photos back where benchmark.toml says") as image:
        if image.size != task.size:
            what = "the photo is {} x {} px".format(*image.size)
            expected = "{} x {} px, the size of its camera".format(*task.size)
            raise BenchmarkError(what, where=task.photo, expected=expected)
        # libjpeg skips what is thrown away. Its last pixel may reach beyond the photo's edge,
        # so the box says where that is.
        reduced = image.draft("L", (width, height))
        box = reduced[1] if reduced else (0, 0, *image.size)
        query = image.convert("L").resize((width, height), Image.Resampling.LANCZOS, box)
    size, grey, scale = task.size, np.asarray(query), crop_scale * fit
    query_xy, crop_xy = match(grey, size, crop, task.turn_deg, scale, settings)
    return query_xy, crop_xy + task.window[:2]


def match(
    query_grey: Grey,
    size: tuple[int, int],
    crop_grey: Grey,
    turn_deg: float,
    crop_scale: float,
    settings: SiftSettings,
) -> tuple[Floats, Floats]:
    """Match a photo of a size with a crop; return pixels (M, 2) of the full photo and the crop."""
    peak, doubled = settings.peak_threshold, settings.doubled
    query_xy, query_found = extract(query_grey, settings.max_features, peak, doubled=doubled)
    query_xy = query_xy * (np.array(size, np.float64) / query_grey.shape[::-1])
    turned, back = resample(crop_grey, crop_scale, turn_deg)
    there, crop_found = extract(turned, settings.max_map_features, peak, doubled=doubled)
    crop_xy = there @ back[:, :2].T + back[:, 2]
    column, row = np.floor(crop_xy).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < crop_grey.shape[1]) & (row < crop_grey.shape[0])
    inside[inside] = crop_grey[row[inside], column[inside]] > 0
    crop_xy, crop_found = crop_xy[inside], crop_found[inside]
    query, crop = mutual_nearest(query_found, crop_found, settings.ratio)
    pairs = np.hstack((query_xy[query], crop_xy[crop]))
    # Features of one place and several orientations may agree more than once.
    _, first = np.unique(pairs, axis=0, return_index=True)
    kept = pairs[np.sort(first)]
    return kept[:, :2], kept[:, 2:]


def resample(grey: Grey, scale: float, turn_deg: float) -> tuple[Grey, Floats]:
    """Make an image smaller, then turn it so that what pointed to `turn_deg` points right.

    Returns the matrix (2, 3) that takes its pixels back to the image, too.
    """
    full = np.array(grey.shape[::-1], dtype=np.float64)
    size = np.maximum(np.round(full * scale), 1.0)
    small = Image.fromarray(grey).resize((int(size[0]), int(size[1])), Image.Resampling.LANCZOS)
    quarters = round(turn_deg / 90.0) % 4
    cos, sin = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters]
    axes = np.array(((cos, -sin), (sin, cos)))
    back = np.column_stack((axes, size / 2.0 - axes @ (np.abs(axes).T @ size / 2.0)))
    turned = np.ascontiguousarray(np.rot90(np.asarray(small), quarters))
    return turned, back * (full / size)[:, None]

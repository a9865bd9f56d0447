"""SIFT matches between a photo and the crop of the map below it.

The photo and the crop of the map are brought to one ground resolution, that of the coarser, and
the crop is turned as the prior says that the camera was, by quarters, which only move pixels.
Features are SIFT (Lowe, IJCV 2004) as RootSIFT (Arandjelovic and Zisserman, CVPR 2012), matched
where they are each other's nearest and clearly nearer than the second. The turn is no assumption:
SIFT finds its own orientation, so a prior whose yaw is wrong does no harm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.photos import opened_photo
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.geometry.sift import Descriptors, Grey, extract, mutual_nearest
from airzoo_bench.matching.baseline_settings import SiftSettings

__all__ = ["Task", "match", "match_photos", "resample"]

_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601
_FIX = "put the photos back where benchmark.toml says, or prepare with --copy"


@dataclass(frozen=True)
class Task:
    """A photo and the part of the map to match it with; see `baseline.plan`.

    Attributes
    ----------
    camera : Cameras
        One, of the photo at full size.
    window : (column, row, width, height)
        The crop, in whole pixels of the map.
    turn_deg : float
        Where the photo's right points on the map, clockwise from the map's right; 0 where it is
        not known.
    gsd_ratio : float
        Ground size of the photo's pixel over that of the map's; 1 where it is not known.
    """

    photo: Path
    camera: Cameras
    dom: Path
    window: tuple[int, int, int, int]
    turn_deg: float
    gsd_ratio: float


def match_photos(
    tasks: Sequence[Task],
    settings: SiftSettings,
    *,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> Iterator[tuple[Floats, Floats]]:
    """Match photos with the map."""
    matched = engine.map(_match_task, tasks, shared=settings, stage="photos", name=_photo_name)
    yield from progress(matched, "photos", len(tasks))


def match(
    query_grey: Grey,
    query_camera: Cameras,
    crop_grey: Grey,
    *,
    turn_deg: float,
    crop_scale: float,
    settings: SiftSettings,
) -> tuple[Floats, Floats]:
    """Match a photo with a crop of the map."""
    seen = (query_grey.shape[1], query_grey.shape[0])
    full = np.array((query_camera.width[0], query_camera.height[0]), dtype=np.float64)
    query_xy, query_found = _features(query_grey, settings.max_features, settings)
    turned, back = resample(crop_grey, crop_scale, turn_deg)
    there, crop_found = _features(turned, settings.max_map_features, settings)
    crop_xy = there @ back[:, :2].T + back[:, 2]
    known = _has_data(crop_grey, crop_xy)
    crop_xy, crop_found = crop_xy[known], crop_found[known]
    query, crop = mutual_nearest(query_found, crop_found, settings.ratio)
    pairs = np.hstack((query_xy[query] * (full / seen), crop_xy[crop]))
    # Features of one place and several orientations may agree more than once.
    _, first = np.unique(pairs, axis=0, return_index=True)
    kept = pairs[np.sort(first)]
    return kept[:, :2], kept[:, 2:]


def _photo_name(task: Task) -> str:
    return str(task.photo)


def _match_task(settings: SiftSettings, task: Task) -> tuple[Floats, Floats]:
    size = np.array((task.camera.width[0], task.camera.height[0]))
    photo_scale, crop_scale = min(1.0, task.gsd_ratio), min(1.0, 1.0 / task.gsd_ratio)
    largest = max(size.max() * photo_scale, max(task.window[2:]) * crop_scale)
    fit = min(1.0, settings.max_side_px / largest)
    wanted = np.maximum(np.round(size * photo_scale * fit), 1).astype(int)
    query_xy, crop_xy = match(
        _read_photo(task.photo, size, wanted),
        task.camera,
        _read_crop(task.dom, task.window),
        turn_deg=task.turn_deg,
        crop_scale=crop_scale * fit,
        settings=settings,
    )
    return query_xy, crop_xy + task.window[:2]


def _read_crop(dom: Path, window: tuple[int, int, int, int]) -> Grey:
    colours = read_rgb(dom, window)
    grey = np.round(colours @ _GREY).astype(np.uint8)
    # Black is where a map has no data; what is nearly black is not.
    data: Grey = np.maximum(grey, colours.any(axis=-1))
    return data


def _read_photo(path: Path, size: Ints, wanted: Ints) -> Grey:
    from PIL.Image import Resampling

    with opened_photo(path, _FIX) as image:
        _require_size(path, image.size, size)
        target = (int(wanted[0]), int(wanted[1]))
        # libjpeg skips what is thrown away. Its last pixel may reach beyond the photo's edge,
        # so the box says where that is.
        reduced = image.draft("L", target)
        box = reduced[1] if reduced else (0, 0, *image.size)
        small = image.convert("L").resize(target, Resampling.LANCZOS, box)
    grey: Grey = np.asarray(small)
    return grey


def _require_size(path: Path, found: tuple[int, int], expected: Ints) -> None:
    if found != tuple(expected.tolist()):
        raise BenchmarkError(
            f"the photo is {found[0]} x {found[1]} px",
            where=path,
            expected=f"{expected[0]} x {expected[1]} px, the size of its camera",
        )


def _has_data(grey: Grey, xy: Floats) -> Bools:
    column, row = np.floor(xy).astype(np.int64).T
    inside: Bools = (column >= 0) & (row >= 0) & (column < grey.shape[1]) & (row < grey.shape[0])
    inside[inside] = grey[row[inside], column[inside]] > 0
    return inside


def _features(image: Grey, count: int, settings: SiftSettings) -> tuple[Floats, Descriptors]:
    return extract(image, count, settings.peak_threshold, doubled=settings.doubled)


def resample(grey: Grey, scale: float, turn_deg: float) -> tuple[Grey, Floats]:
    """Make an image smaller, then turn it so that what pointed to `turn_deg` points right."""
    from PIL import Image

    full = np.array(grey.shape[::-1], dtype=np.float64)
    size = np.maximum(np.round(full * scale), 1.0)
    small = Image.fromarray(grey).resize((int(size[0]), int(size[1])), Image.Resampling.LANCZOS)
    quarters = round(turn_deg / 90.0) % 4
    cos, sin = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters]
    axes = np.array(((cos, -sin), (sin, cos)))
    back = np.column_stack((axes, size / 2.0 - axes @ (np.abs(axes).T @ size / 2.0)))
    turned = np.ascontiguousarray(np.rot90(np.asarray(small), quarters))
    return turned, back * (full / size)[:, None]

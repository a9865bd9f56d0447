"""The matching baseline on pictures with known places, and pairs of features."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.distance import cdist

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.geometry.sift import mutual_nearest
from airzoo_bench.matching.baseline import Task, match, match_task, turn_and_ratio
from airzoo_bench.matching.info import SiftSettings
from tests.geometry.support import write_tif

SETTINGS = SiftSettings(doubled=False, max_features=4096, max_map_features=8192)


def texture(width: int, height: int, seed: int = 0) -> np.ndarray:
    """Grey of many sizes of structure, never 0."""
    random = np.random.default_rng(seed)
    layers = [gaussian_filter(random.normal(size=(height, width)), s) * s for s in (1.5, 3, 6)]
    grey = sum(layers)
    return np.clip(128 + 60 * (grey - grey.mean()) / grey.std(), 1, 255).astype(np.uint8)


def seen_through(image: np.ndarray, H: np.ndarray, width: int, height: int) -> np.ndarray:
    """Image whose pixel p shows `image` at H p; corners are (0, 0)."""
    at = moved(H, np.stack(np.indices((height, width))[::-1], axis=-1).reshape(-1, 2) + 0.5)
    grey = map_coordinates(image.astype(float), at.T[::-1] - 0.5, order=3, mode="nearest")
    return np.clip(np.round(grey), 0, 255).astype(np.uint8).reshape(height, width)


def moved(H: np.ndarray, xy: np.ndarray) -> np.ndarray:
    ends = np.column_stack((xy, np.ones(len(xy)))) @ H.T
    return ends[:, :2] / ends[:, 2:]


def matched(query: np.ndarray, crop: np.ndarray, turn_deg: float = 0.0) -> Any:
    """Match a photo with a crop of the same ground size."""
    return match(query, query.shape[::-1], crop, turn_deg, 1.0, SETTINGS)


def similarity(scale: float, turn_deg: float, x: float, y: float) -> np.ndarray:
    cos, sin = scale * np.cos(np.radians(turn_deg)), scale * np.sin(np.radians(turn_deg))
    return np.array(((cos, -sin, x), (sin, cos, y), (0.0, 0.0, 1.0)))


def test_matches_follow_a_known_homography() -> None:
    crop = texture(320, 280)
    H = similarity(0.9, 30.0, 110.0, 20.0)
    H[2, :2] = (2e-4, -3e-4)
    query = seen_through(crop, H, 220, 180)
    found, there = matched(query, crop, turn_deg=97.0)  # a wrong turn does no harm
    off = there - moved(H, found)
    assert len(found) > 100
    assert (np.linalg.norm(off, axis=1) < 1).mean() > 0.97
    assert np.abs(np.median(off, axis=0)).max() < 0.03
    assert len(np.unique(np.hstack((found, there)), axis=0)) == len(found)


def test_nothing_is_matched_where_the_map_has_no_data() -> None:
    crop = texture(300, 240)
    row, column = np.indices(crop.shape) % 40 - 20
    crop[np.hypot(row, column) < 5] = 0  # round holes are good features
    found, there = matched(crop, crop)
    column, row = np.floor(there).astype(int).T
    assert len(found) > 50
    assert (crop[row, column] > 0).all()


def test_photos_are_matched_with_the_whole_map(tmp_path: Path) -> None:
    # A photo of a map, 3.1 times as fine; libjpeg's reductions do not divide it.
    grey, corner = texture(500, 400, seed=2), (200.0, 150.0)
    dom = write_tif(tmp_path / "dom.tif", np.stack((grey, grey, grey)))
    shown = seen_through(grey, similarity(1 / 3.1, 0.0, *corner), 803, 651)
    Image.fromarray(shown).save(tmp_path / "a.jpg", quality=95)
    task = Task(tmp_path / "a.jpg", (803, 651), dom, (170, 130, 320, 260), 0.0, 1 / 3.1)
    query_xy, map_xy = match_task(SETTINGS, task)
    off = query_xy - 3.1 * (map_xy - corner)
    assert len(off) > 100
    assert np.abs(np.median(off, axis=0)).max() < 0.3
    # At the far edge, too: a reduced JPG may reach beyond the photo, here by up to 5 pixels.
    far = query_xy[:, 0] > 600
    assert np.abs(np.median(off[far], axis=0)).max() < 0.4


@pytest.mark.parametrize(
    ("yaw", "pitch", "height", "turn", "ratio"),
    [
        (0.0, -90.0, 150.0, 0.0, 0.2),  # 100 m above ground, f = 1000 px: 0.1 m of 0.5 m
        (90.0, -90.0, 150.0, 90.0, 0.2),
        (-140.0, -45.0, 150.0, -140.0, 0.2 * np.sqrt(2)),
        (0.0, 10.0, 150.0, 0.0, 2.0),  # over the horizon: as if 6 degrees below it
        (0.0, -90.0, 50.0, 0.0, 1.0),  # on the ground: not known
        (0.0, -90.0, np.nan, 0.0, 1.0),
    ],
)
def test_plans_worked_by_hand(
    tmp_path: Path, yaw: float, pitch: float, height: float, turn: float, ratio: float
) -> None:
    rotation = angles_to_rotations(yaw, pitch, 0.0, convergence_deg=0.0)[None]
    prior = Poses(rotation=rotation, centres=np.array(((576010.0, 5187990.0, height),)))
    dom = open_info(write_tif(tmp_path / "dom.tif", np.zeros((3, 40, 40), np.uint8)))
    camera = Cameras.from_matrices([np.diag((1000.0, 1000.0, 1.0))], 800, 600)
    found = turn_and_ratio(camera, prior, "EPSG:32615", dom, 50.0)
    assert found[0] == pytest.approx(turn, abs=1e-6)
    assert found[1] == pytest.approx(ratio, rel=1e-3)  # the grid's metres are not quite true


# --- features and their pairs ---


def test_mutual_nearest_against_all_distances() -> None:
    random = np.random.default_rng(0)
    b = random.integers(0, 90, (1100, 128)).astype(np.float32)  # more than a block
    a = b[random.permutation(1100)[:900]] + random.integers(0, 12, (900, 128))
    a = np.vstack((a, random.integers(0, 90, (200, 128)))).astype(np.float32)
    distances = cdist(a, b)
    nearest = distances.argmin(axis=1)
    first, second = np.sort(distances, axis=1)[:, :2].T
    kept = (distances.argmin(axis=0)[nearest] == np.arange(len(a))) & (first < 0.8 * second)
    rows_a, rows_b = mutual_nearest(a, b, 0.8)
    assert np.array_equal(rows_a, np.flatnonzero(kept))
    assert np.array_equal(rows_b, nearest[kept])
    assert 800 < len(rows_a) < len(mutual_nearest(a, b, 1.0)[0]) < len(a)

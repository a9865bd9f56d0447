"""Pictures that the baseline can match, and what is known of them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.matching.baseline_settings import SiftSettings

SETTINGS = SiftSettings(
    doubled=True,
    max_features=4096,
    max_map_features=8192,
    peak_threshold=0.0067,
    ratio=0.8,
    max_side_px=2000,
)


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


def camera(width: int, height: int) -> Cameras:
    return Cameras.from_matrices([np.diag((width, width, 1.0))], width, height)


def similarity(scale: float, turn_deg: float, x: float, y: float) -> np.ndarray:
    cos, sin = scale * np.cos(np.radians(turn_deg)), scale * np.sin(np.radians(turn_deg))
    return np.array(((cos, -sin, x), (sin, cos, y), (0.0, 0.0, 1.0)))

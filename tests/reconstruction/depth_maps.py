"""Depth maps with cameras, as a file holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import Poses

N, H, W = 4, 6, 8


def poses(count: int = N, seed: int = 0) -> Poses:
    random = np.random.default_rng(seed)
    rotation = Rotation.random(count, rng=random).as_matrix()
    return Poses.from_centres(rotation, random.random((count, 3)) * 100)


def matrices(given: Poses) -> np.ndarray:
    return np.concatenate([given.rotation, given.translation[..., None]], axis=-1)


def made(**changes: Any) -> dict[str, Any]:
    random = np.random.default_rng(1)
    K = np.array([[7.0, 0, W / 2], [0, 7.0, H / 2], [0, 0, 1]])
    arrays = {
        "depth": random.random((N, H, W)).astype("f4"),
        "conf": random.random((N, H, W)).astype("f4"),
        "intrinsics": np.tile(K, (N, 1, 1)),
        "extrinsics": matrices(poses()),
        "image_names": np.array([f"DJI_{n:04}.JPG" for n in range(N)]),
    } | changes
    return {name: array for name, array in arrays.items() if array is not None}

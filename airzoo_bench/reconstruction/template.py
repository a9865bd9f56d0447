"""An example of a prediction of depth maps, with the benchmark's own image names."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["depth_template"]

_LONG_SIDE_PX = 32
_DEPTH_M = (20.0, 120.0)


def depth_template(truth: ReconstructionTruth, seed: int) -> dict[str, NDArray[Any]]:
    """Make small random depth maps at random poses, one for each photo of a scene."""
    random = np.random.default_rng(seed)
    count = len(truth.photos)
    size = np.array([truth.cameras.width[0], truth.cameras.height[0]], dtype=np.float64)
    width, height = np.maximum(np.rint(size * _LONG_SIDE_PX / size.max()), 1).astype(int)
    turned, _ = np.linalg.qr(random.normal(size=(count, 3, 3)))
    turned *= np.linalg.det(turned)[:, None, None]
    middle = np.zeros(3) if truth.is_sealed else truth.poses.centres.mean(axis=0)
    centres = middle + random.normal(0.0, 50.0, (count, 3))
    moved = -(turned @ centres[..., None])
    focal = float(max(width, height))
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return {
        "image_names": truth.photos["image"].to_numpy(str),
        "pixel_centres": np.array("half"),
        "depth": random.uniform(*_DEPTH_M, (count, height, width)).astype(np.float32),
        "conf": random.uniform(0.0, 1.0, (count, height, width)).astype(np.float32),
        "intrinsics": np.tile(matrix, (count, 1, 1)),
        "extrinsics": np.concatenate([turned, moved], axis=2),
    }

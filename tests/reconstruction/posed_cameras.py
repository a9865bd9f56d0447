"""Cameras, their true places, and an alignment of the two."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.alignment import (
    Alignment,
    PosedCameras,
    Similarity,
    align,
    shipped_alignment,
)
from airzoo_bench.reconstruction.settings import AlignmentSettings
from tests.geometry.support import looking_down

UTM = np.array((576663.25, 5188165.5, 197.0))


def ransac(**changes: Any) -> AlignmentSettings:
    """Return settings of few trials, some of them changed."""
    few = {"min_trials": 50, "max_trials": 5000, "inlier_below_m": 1.0, "line_ratio": 0.02}
    return shipped_alignment(**(few | changes))


def cameras(centres: np.ndarray, rng: np.random.Generator) -> PosedCameras:
    names = tuple(f"{row:03}.jpg" for row in range(len(centres)))
    shake = Rotation.from_euler("xyz", rng.normal(0, 10, (len(centres), 3)), degrees=True)
    return PosedCameras(names, centres, shake.as_matrix() @ looking_down(20.0))


def grid(rng: np.random.Generator) -> PosedCameras:
    x, y = np.meshgrid(np.arange(6.0) * 30, np.arange(4.0) * 40)
    flat = np.stack((x.ravel(), y.ravel(), rng.normal(60, 1, 24)), axis=1)
    return cameras(flat + UTM, rng)


def strip(rng: np.random.Generator) -> PosedCameras:
    along = np.arange(12.0)[:, None] * (20.0, 11.0, 0.5)
    return cameras(along + rng.normal(0, 0.05, (12, 3)) + UTM, rng)


def seen_from(truth: PosedCameras, made: Similarity) -> PosedCameras:
    """Return the cameras in the frame that `made` takes into the truth's."""
    assert truth.rotation is not None
    centres = made.inverse().apply(truth.centres)
    return PosedCameras(truth.names, centres, truth.rotation @ made.rotation)


def made_by(rng: np.random.Generator) -> Similarity:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(25.0, rotation, UTM + rng.normal(0, 50, 3), rng.normal(size=3))


def sim3(predicted: PosedCameras, truth: PosedCameras, **changes: Any) -> Alignment:
    return align(predicted, truth, ransac(**changes))


def moved(cameras: PosedCameras, rows: list[int], by: np.ndarray | float) -> PosedCameras:
    centres = cameras.centres.copy()
    centres[rows] += by
    return replace(cameras, centres=centres)


def assert_same(found: Similarity, made: Similarity, points: np.ndarray, atol: float) -> None:
    np.testing.assert_allclose(found.apply(points), made.apply(points), rtol=0, atol=atol)

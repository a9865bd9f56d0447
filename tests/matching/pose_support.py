"""Made-up 2D-3D matches with known poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg, world_to_camera
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.protocol import Solver
from airzoo_bench.matching.solving import PoseEstimate
from tests.geometry.support import looking_down

SOLVER = Solver(
    name="colmap",
    max_error_px=5.0,
    min_inlier_ratio=0.01,
    min_trials=1000,
    max_trials=100_000,
    confidence=0.9999,
    seed=0,
    least_matches=4,
    max_matches=20_000,
    max_trials_times_matches=500_000_000,
)
PROJECTED = (400_000.0, 3_130_000.0, 60.0)


class Problem(NamedTuple):
    """One query: its camera (Cameras of one), query_xy (M, 2) and points (M, 3)."""

    camera: Cameras
    query_xy: np.ndarray
    points: np.ndarray


class Scene(NamedTuple):
    problem: Problem
    rotation: np.ndarray
    centre: np.ndarray
    wrong: np.ndarray


def make_scene(
    seed: int,
    *,
    count: int = 400,
    lens: tuple[float, ...] = (0.0,) * 5,
    noise_px: float = 0.0,
    outliers: float = 0.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Scene:
    """An oblique photo of 25 m hills from 140 m above; outliers are anywhere in the image."""
    rng = np.random.default_rng([seed, count])
    K = np.array([[[2900.0, 0.0, 2010.0], [0.0, 2930.0, 1480.0], [0.0, 0.0, 1.0]]])
    camera = Cameras.from_matrices(K, 4000, 3000, [lens])
    rotation = looking_down(rng.uniform(5.0, 35.0), rng.uniform(0.0, 360.0))
    poses = Poses.from_centres(rotation, rng.normal((0.0, 0.0, 140.0), 5.0)[None])
    points = rng.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 25.0), (60 * count, 3))
    xy = project(camera, world_to_camera(poses, points[None]))[0]
    seen = np.flatnonzero(((xy > 0.0) & (xy < (4000.0, 3000.0))).all(axis=1))[:count]
    query_xy, points = xy[seen] + rng.normal(0.0, noise_px, (len(seen), 2)), points[seen]
    wrong = rng.permutation(count) < round(outliers * count)
    query_xy[wrong] = rng.random((wrong.sum(), 2)) * (4000.0, 3000.0)
    problem = Problem(camera, query_xy, points + origin)
    return Scene(problem, rotation[0], poses.centres[0] + origin, wrong)


def errors(estimate: PoseEstimate, scene: Scene) -> tuple[float, float]:
    """Metres and degrees between an estimate and the truth."""
    metres = float(np.linalg.norm(estimate.centre - scene.centre))
    return metres, float(rotation_angle_deg(estimate.rotation, scene.rotation))


def joined(problems: Sequence[Problem]) -> tuple[Cameras, Correspondences]:
    """Put queries one after the other."""
    cameras = [
        np.concatenate(values)
        for values in zip(*(vars(p.camera).values() for p in problems), strict=True)
    ]
    offsets = np.cumsum([0, *(len(problem.points) for problem in problems)])
    query_xy, points = (np.concatenate([p[part] for p in problems]) for part in (1, 2))
    return Cameras(*cameras), Correspondences(offsets, query_xy, points3d=points)

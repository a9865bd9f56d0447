"""Clouds, cameras and similarities, made at random."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import PosedCameras, Similarity, shipped_alignment
from airzoo_bench.reconstruction.settings import AlignmentSettings
from tests.geometry.support import looking_down

UTM = np.array((576663.25, 5188165.5, 197.0))


def all_pairs(points: Floats, others: Floats) -> Floats:
    """Distances to nearest neighbours by trying all pairs, in float64."""
    found = np.empty(len(points))
    for start in range(0, len(points), 512):
        x, y, z = np.moveaxis(points[start : start + 512, None] - others, -1, 0)
        found[start : start + 512] = np.sqrt(((x * x + y * y) + z * z).min(axis=1, initial=np.inf))
    return found


def surface(count: int, seed: int, *, far: float = 0.0) -> Floats:
    """Hills of 100 m, and a share of points up to ten times as far outside."""
    random = np.random.default_rng(seed)
    points = random.uniform(0.0, 100.0, (count, 3))
    points[:, 2] = 5.0 * np.sin(points[:, 0] / 9.0) + random.normal(0.0, 0.05, count)
    outside = random.random(count) < far
    points[outside] = random.uniform(-1000.0, 1000.0, (np.count_nonzero(outside), 3))
    return points


_SHAPES = (
    lambda random, n: random.normal(size=(n, 3)),
    lambda random, n: random.integers(0, 4, (n, 3)) * 0.1,  # many ties, all but for roundings
    lambda random, n: random.integers(0, 4, (n, 3)) * 0.1 + 0.05,  # middles of their cells
    lambda random, n: np.full((n, 3), 0.1),
    lambda random, n: random.random((n, 1)) * np.array((1.0, 2.0, -3.0)),  # a line
    lambda random, n: random.random((n, 3)) * np.array((1e6, 1.0, 1e-6)),
    lambda random, n: random.random((n, 3)) + np.array((5e5, 4.4e6, 100.0)),
    lambda random, n: random.random((n, 3)) * 10.0 ** random.integers(-9, 10, (n, 1)),
    lambda random, n: sphere(random, n),
)


def sphere(random: np.random.Generator, count: int) -> Floats:
    points = random.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@st.composite
def clouds(draw: st.DrawFn, most: int = 120) -> Floats:
    """Clouds of many shapes, degenerate ones among them, one to `most` points."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = [
        draw(st.sampled_from(_SHAPES))(random, draw(st.integers(1, max(1, most // 2))))
        for _ in range(draw(st.integers(1, 2)))
    ]
    return random.permutation(np.concatenate(parts))


def write_laz(path: Path, points: Floats) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.floor([*points, np.zeros(3)][0])
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(path)


def poses(rng: np.random.Generator, count: int, spread: float = 50.0) -> Poses:
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    return Poses(rotation=rotation, centres=rng.normal(size=(count, 3)) * spread)


def shaken(truth: Poses, rng: np.random.Generator, degrees: float, metres: float) -> Poses:
    count = len(truth)
    turn = Rotation.from_rotvec(rng.normal(0, degrees, (count, 3)), degrees=True).as_matrix()
    centres = truth.centres + rng.normal(0, metres, (count, 3))
    return Poses(rotation=turn @ truth.rotation, centres=centres)


def cameras(centres: np.ndarray, rng: np.random.Generator) -> PosedCameras:
    """Cameras that look down, at these places about a point of a projected CRS."""
    names = tuple(f"{row:03}.jpg" for row in range(len(centres)))
    shake = Rotation.from_euler("xyz", rng.normal(0, 10, (len(centres), 3)), degrees=True)
    return PosedCameras(names, centres + UTM, shake.as_matrix() @ looking_down(20.0))


def similarity(rng: np.random.Generator, scale: float = 25.0) -> Similarity:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(scale, rotation, UTM + rng.normal(0, 50, 3), rng.normal(size=3))


def seen_from(truth: PosedCameras, made: Similarity) -> PosedCameras:
    """Return the cameras in the frame that `made` takes into the truth's."""
    assert truth.rotation is not None
    centres = made.inverse().apply(truth.centres)
    return PosedCameras(truth.names, centres, truth.rotation @ made.rotation)


def moved(cameras: PosedCameras, rows: list[int], by: Any) -> PosedCameras:
    centres = cameras.centres.copy()
    centres[rows] += by
    return replace(cameras, centres=centres)


def ransac(**changes: Any) -> AlignmentSettings:
    """Return settings of few trials, some of them changed."""
    few = {"min_trials": 50, "max_trials": 5000, "inlier_below_m": 1.0, "line_ratio": 0.02}
    return shipped_alignment(**(few | changes))

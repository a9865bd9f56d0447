from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
from hypothesis import strategies as st

from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.las import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.settings import Preparation


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
    lambda random, n: random.random((n, 3)) * np.array((1.0, 1.0, 0.0)),  # a plane
    lambda random, n: random.random((n, 3)) * np.array((1e6, 1.0, 1e-6)),
    lambda random, n: random.random((n, 3)) + np.array((5e5, 4.4e6, 100.0)),
    lambda random, n: random.random((n, 3)) * 10.0 ** random.integers(-9, 10, (n, 1)),
    lambda random, n: _on_sphere(random.normal(size=(n, 3))),
)


def _on_sphere(points: Floats) -> Floats:
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


def settings(**changes: Any) -> Preparation:
    crop = {"crop": "none", "crop_margin_m": 1.0, "crop_cell_m": 1.0}
    region = {"region": "all", "observed_photos": 2, "observed_cell_m": 1.0, "hidden_beyond_m": 3.0}
    return Preparation(**(crop | region | {"voxel_m": "none"} | changes))


def write_laz(path: Path, points: Floats) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.floor([*points, np.zeros(3)][0])
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(path)


def in_shards(folder: Path, points: Floats, count: int) -> Path:
    folder.mkdir(parents=True)
    for number, part in enumerate(np.array_split(points, count)):
        write_laz(folder / f"tile-{number:02}.laz", part)
    return folder


def opened(folder: Path) -> FileCloud:
    return open_shards(folder, shards_in(folder))


def points_in(cloud: FileCloud) -> Floats:
    return np.concatenate([piece.points for piece in cloud.pieces(50)])

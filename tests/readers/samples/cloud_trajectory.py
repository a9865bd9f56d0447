"""A cloud and its trajectory in the layouts of TUM and KITTI, a folder a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import World


def write(folder: Path, world: World, *, kitti: bool = False) -> Path:
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        place = folder / scene
        place.mkdir(parents=True)
        write_ply(place / "map.ply", Cloud(views.points[views.depth > 0]))
        if kitti:
            np.savetxt(place / "poses.txt", views.c2w[:, :3].reshape(-1, 12), fmt="%.12g")
            continue
        xyzw = Rotation.from_matrix(views.c2w[:, :3, :3]).as_quat()
        stamps = 1_700_000_000.5 + np.arange(len(views.c2w))
        rows = np.column_stack([stamps, views.c2w[:, :3, 3], xyzw])
        np.savetxt(place / "trajectory.txt", rows, fmt="%.12g", header="timestamp tx ty tz q")
    return folder


def write_kitti(folder: Path, world: World) -> Path:
    return write(folder, world, kitti=True)

"""The true cloud of a region: every surface that the photos of a flight see, from exact depth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from airzoo_bench.core.progress import Progress
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, camera_to_world
from airzoo_bench.mini.frame_files import frame_paths
from airzoo_bench.mini.frame_list import FrameList
from airzoo_bench.reconstruction.voxels import VoxelGrid

__all__ = ["depth_to_points", "seen_surface"]

_DECIMALS = 4


def seen_surface(
    frames: FrameList,
    rows: list[int],
    folder: Path,
    *,
    voxel_m: float,
    origin: Floats,
    progress: Progress,
) -> Cloud:
    """Return what rendered frames see, one point for each voxel.

    Parameters
    ----------
    frames : FrameList
    rows : list of int
        Which frames.
    folder : Path
        Where they were rendered to.
    voxel_m : float
        Side of the voxels.
    origin : (3,) array
        A corner of their grid.
    progress : Progress

    Returns
    -------
    Cloud
        In `world.CRS`, to 0.1 mm. Without colours: those of photos depend on the processor in the
        last bit, the points do not.
    """
    from PIL import Image

    grid = VoxelGrid(voxel_m, origin)
    for row in progress(rows, "true cloud", len(rows)):
        _, depth_file = frame_paths(folder, frames.names[row])
        with Image.open(depth_file) as picture:
            depth = np.asarray(picture, dtype=np.float64)
        pose = frames.poses.take(row)
        grid.add(Cloud(depth_to_points(depth, depth > 0, frames.camera(row), pose)))
    cloud = grid.cloud()
    return replace(cloud, points=np.round(cloud.points, _DECIMALS) + 0.0)


def depth_to_points(depth: Floats, chosen: Bools, camera: Cameras, pose: Poses) -> Floats:
    """Back-project chosen pixels of a z-depth map.

    Parameters
    ----------
    depth : (H, W) array
        Metres along the optical axis.
    chosen : (H, W) bool array
    camera, pose : Cameras, Poses
        One of each.

    Returns
    -------
    (N, 3) array
        World coordinates, in the order of rows.
    """
    rows, columns = np.nonzero(chosen)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    rays = back_project(camera, pixels[None])[0]
    points = rays / rays[:, 2:] * depth[rows, columns][:, None]
    world: Floats = camera_to_world(pose, points[None])[0]
    return world

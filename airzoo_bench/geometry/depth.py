"""Depth maps: their pixels as points of the world."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, camera_to_world

__all__ = ["depth_to_points"]


def depth_to_points(
    depth: Floats, chosen: Bools, camera: Cameras, pose: Poses, *, along_ray: bool = False
) -> Floats:
    """Back-project chosen pixels of a depth map to the world.

    Parameters
    ----------
    depth : (H, W) array
        Along the optical axis, in the world's units.
    chosen : (H, W) array
        Of bool.
    camera, pose : Cameras, Poses
        Of length 1.
    along_ray : bool
        Whether depth is the distance from the camera's centre instead.

    Returns
    -------
    (N, 3) array
        In the order of rows.
    """
    rows, columns = np.nonzero(chosen)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    rays = back_project(camera, pixels[None])[0]
    if not along_ray:
        rays = rays / rays[:, 2:]
    points = rays * depth[rows, columns][:, None]
    world: Floats = camera_to_world(pose, points[None])[0]
    return world

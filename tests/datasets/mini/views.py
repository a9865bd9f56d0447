"""Cameras and poses over the small world, for tests of rendering."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from airzoo_bench.datasets.mini.renderer import default_camera
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from tests.datasets.mini.small_world import REGION

CORNER = np.array([REGION.west, REGION.south, 0.0])
LENS = ((-0.12, 0.04, 0.001, -0.002, 0.0),)


def camera(width: int = 160, height: int = 120, *, bent: bool = False) -> Cameras:
    """Return a small camera, a pinhole or with a bent lens."""
    straight = default_camera(width, height)
    if not bent:
        return straight
    return Cameras.from_matrices(straight.matrices, width, height, LENS)


def pose(centre: Sequence[float], yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    """Return one pose; the centre is in the world's local frame."""
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], np.array([centre]) + CORNER)


NADIR = pose((48.0, 48.0, 100.0), 20.0, -90.0)
OBLIQUE = pose((48.0, -20.0, 90.0), 5.0, -45.0)
HORIZON = pose((110.0, -10.0, 45.0), -35.0, -10.0)


def rays(camera: Cameras, pose: Poses) -> Floats:
    """Return directions (H * W, 3) in the world, z of the camera being 1."""
    width, height = int(camera.width[0]), int(camera.height[0])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    unit = back_project(camera, np.stack([x.ravel(), y.ravel()], axis=-1)[None])[0]
    directions: Floats = (unit / unit[:, 2:]) @ pose.rotation[0]
    return directions

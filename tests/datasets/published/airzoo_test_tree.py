"""Trajectories in the layout that frames of AirZoo-Mini are written in, made of the made world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from airzoo_bench.datasets.mini.frames import FrameList, frames_csv
from airzoo_bench.datasets.mini.world.model import CRS, REGIONS
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from tests.datasets.published.reconstruction_world import FRAME, MATRIX, local_poses, write_photo
from tests.reconstruction.world import MAP_SIZE, ORIGIN, exact_depth

CORNER = np.array((REGIONS["city"].west + 300.0, REGIONS["city"].south + 300.0, 45.0))
CAMERA = Cameras.from_matrices(MATRIX[None], *MAP_SIZE)
NAMES = tuple(f"frame_{number:05d}" for number in range(6))


def grid_poses() -> Poses:
    """The true poses in AirZoo-Mini's projected CRS."""
    poses = local_poses()
    return Poses(rotation=poses.rotation, centres=poses.centres - FRAME + CORNER)


def depths(*, along_ray: bool = False) -> np.ndarray:
    """Exact depth of ground and box, (6, H, W)."""
    poses = local_poses()
    made = Poses(rotation=poses.rotation, centres=poses.centres - FRAME + ORIGIN)
    found = exact_depth(made, boxed=True)
    if not along_ray:
        return found
    width, height = MAP_SIZE
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x, y = (u - width / 2) / MATRIX[0, 0], (v - height / 2) / MATRIX[1, 1]
    return np.asarray(found * np.sqrt(x * x + y * y + 1.0))


def make_trajectory(home: Path, *, along_ray: bool = False) -> Path:
    """Write photos, depth and the table of frames."""
    conditions = ("sunny", "foggy") * 3, ("day",) * 6
    frames = FrameList(NAMES, CAMERA, grid_poses(), *conditions)
    for name, depth in zip(NAMES, depths(along_ray=along_ray), strict=True):
        write_photo(home / "images" / f"{name}.jpg")
        (home / "depth").mkdir(exist_ok=True)
        Image.fromarray(depth.astype(np.float32)).save(home / "depth" / f"{name}.tif")
    (home / "frames.csv").write_text(frames_csv(frames))
    return home


__all__ = ["CORNER", "CRS", "NAMES", "depths", "grid_poses", "make_trajectory"]

"""True depth, points and cameras of a made scene, in a frame as methods choose theirs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.reconstruction.world import ORIGIN, World, camera_poses, exact_depth, matrix_of_maps

Array = np.ndarray[Any, Any]

SCALE = 1 / 32.0


@dataclass(frozen=True)
class TrueViews:
    """Views of a scene; the world is the first camera's frame, shrunk; pixel centres are integers.

    Attributes
    ----------
    names : list of str
        Sorted.
    depth : (N, H, W) float64
    intrinsics : (N, 3, 3)
    w2c : (N, 4, 4)
    """

    names: list[str]
    depth: Array
    intrinsics: Array
    w2c: Array

    @property
    def c2w(self) -> Array:
        return np.linalg.inv(self.w2c)

    @property
    def points(self) -> Array:
        """Points (N, H, W, 3) of the world by pinhole and pose: no code of the suite."""
        height, width = self.depth.shape[1:]
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(float)
        rays = np.einsum("nij,hwj->nhwi", np.linalg.inv(self.intrinsics), pixels)
        local = rays * self.depth[..., None]
        turned = np.einsum("nij,nhwj->nhwi", self.c2w[:, :3, :3], local)
        found: Array = turned + self.c2w[:, None, None, :3, 3]
        return found

    def quaternions(self) -> Array:
        """Quaternions w x y z of the world-to-camera rotations."""
        from scipy.spatial.transform import Rotation

        found: Array = Rotation.from_matrix(self.w2c[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
        return found


def true_views(world: World, scene: str) -> TrueViews:
    poses = camera_poses(scene)
    rotation, centres = poses.rotation, (poses.centres - ORIGIN) * SCALE
    first = rotation[0]
    w2c = np.tile(np.eye(4), (len(poses), 1, 1))
    w2c[:, :3, :3] = rotation @ first.T
    moved = (centres - centres[0]) @ first.T
    w2c[:, :3, 3] = -np.einsum("nij,nj->ni", w2c[:, :3, :3], moved)
    K = matrix_of_maps()
    K[:2, 2] -= 0.5
    depth = exact_depth(poses, boxed=scene == "yard") * SCALE
    return TrueViews(world.images(scene), depth, np.tile(K, (len(poses), 1, 1)), w2c)

"""Frames with depth: read when they are needed, kept while there is room, sampled by a seed."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind, read_depth
from airzoo_bench.geometry.arrays import Floats, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses

__all__ = ["Frame", "FrameStore", "Sampling"]

_CACHE_BYTES = 256 << 20


@dataclass(frozen=True)
class Sampling:
    """How depths are read and sampled.

    Attributes
    ----------
    pixels : int
        Sampled of each frame; all where it has fewer.
    seed : int
    kind : DepthKind
    scale_m : float or None
        See `depth_maps.read_depth`.
    """

    pixels: int = 4096
    seed: int = 0
    kind: DepthKind = DepthKind.Z
    scale_m: float | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """A photo's camera, pose and depth.

    Attributes
    ----------
    camera : Cameras
        Of length 1.
    rotation : (3, 3) array
        World-to-camera.
    centre : (3,) array
    depth : (height, width) float32 array
        As stored, of `kind`; NaN where there is none.
    kind : DepthKind
    points : (S, 3) array
        The sampled pixels that have a depth, back-projected, in the camera's frame.
    """

    camera: Cameras
    rotation: Floats
    centre: Floats
    depth: NDArray[np.float32]
    kind: DepthKind
    points: Floats

    @property
    def world_points(self) -> Floats:
        """The sampled points (S, 3) in the world."""
        return apply_matrix(self.rotation.T, self.points) + self.centre


class FrameStore:
    """N frames, of which as many are kept as fit 256 MiB.

    Parameters
    ----------
    cameras, poses : Cameras, Poses
    depths : sequence of N Path
    sampling : Sampling
    """

    def __init__(
        self, cameras: Cameras, poses: Poses, depths: Sequence[Path], sampling: Sampling
    ) -> None:
        self.cameras, self.poses, self.depths = cameras, poses, depths
        self.sampling = sampling
        self._kept: OrderedDict[int, Frame] = OrderedDict()

    def __len__(self) -> int:
        return len(self.depths)

    def frame(self, index: int) -> Frame:
        """Return a frame, read if it is not kept.

        Raises
        ------
        BenchmarkError
            See `depth_maps.read_depth`.
        """
        frame = self._kept.pop(index, None) or self._read(index)
        self._kept[index] = frame
        while len(self._kept) > 2 and self._bytes() > _CACHE_BYTES:
            self._kept.popitem(last=False)
        return frame

    def _bytes(self) -> int:
        return sum(f.depth.nbytes + f.points.nbytes for f in self._kept.values())

    def _read(self, index: int) -> Frame:
        camera, pose = self.cameras.take(index), self.poses.take(index)
        width, height = int(camera.width[0]), int(camera.height[0])
        depth = read_depth(self.depths[index], width, height, self.sampling.scale_m)
        points = _sampled_points(camera, depth, index, self.sampling)
        return Frame(camera, pose.rotation[0], pose.centres[0], depth, self.sampling.kind, points)


def _sampled_points(
    camera: Cameras, depth: NDArray[np.float32], index: int, sampling: Sampling
) -> Floats:
    count = min(sampling.pixels, depth.size)
    picked = np.random.default_rng((sampling.seed, index)).choice(depth.size, count, replace=False)
    row, column = np.divmod(picked, depth.shape[1])
    distance = depth[row, column].astype(np.float64)
    rays = back_project(camera, np.stack((column, row), axis=-1)[None] + 0.5)[0]
    if sampling.kind is DepthKind.Z:
        rays = rays / rays[:, 2:]
    points: Floats = rays * distance[:, None]
    return points[np.isfinite(points).all(axis=1)]

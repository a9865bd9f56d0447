"""Depth maps fused into one surface by a truncated signed distance function.

Curless and Levoy, A volumetric method for building complex models from range images, SIGGRAPH
1996, by Open3D's ``VoxelBlockGrid``. (Its older ``ScalableTSDFVolume`` extracts nothing in Open3D
0.20.) Values of voxels do not depend on threads, only the order in which blocks come out does: the
points are sorted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.geometry.arrays import Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.cloud_sources import DepthMaps, surface_depth

__all__ = ["TsdfSettings", "fuse"]

_BLOCK = 8  # voxels along a side of a block, Open3D's unit of memory
_FIRST_BLOCKS = 1024
# Voxels are this share of their size off its multiples: a surface that lies exactly on voxels (a
# flat ground at height 0) has no sign to change there, and would not be found.
_OFF_GRID = 0.382
_BLOCK_PIXELS = 1 << 18
_AXIS_BITS = 21


@dataclass(frozen=True)
class TsdfSettings:
    """How depth maps are fused.

    Attributes
    ----------
    voxel : float
        Side of a voxel, in units of the truth.
    truncation : float
        Distance from the surface within which voxels are updated; at least a voxel.
    max_depth : float
        A surface beyond it is none, so that an outlier does not fill the world with voxels.
    max_voxels : int
        The most voxels there may be, of 8 bytes each.
    """

    voxel: float
    truncation: float
    max_depth: float
    max_voxels: int


def fuse(
    maps: DepthMaps,
    transform: Similarity,
    settings: TsdfSettings,
    *,
    confidence_above: float | None,
) -> Floats:
    """Fuse depth maps and return the points where the surface crosses edges between voxels."""
    if maps.cameras.distortion.any():
        raise PredictionError(
            "depth maps of cameras with lens distortion cannot be fused by TSDF",
            expected="pinhole cameras",
            fix="undistort the maps, or fuse by back-projection",
        )
    poses = transform.apply_poses(maps.poses)
    origin = _origin(poses, settings)
    volume = _Volume(load_open3d(), settings)
    for row in range(len(maps.depth)):
        depth = surface_depth(
            maps,
            row,
            scale=transform.scale,
            max_depth=settings.max_depth,
            confidence_above=confidence_above,
        )
        if depth.any():
            camera, pose = maps.cameras.take(row), poses.take(row)
            volume.add(depth, camera, Poses(rotation=pose.rotation, centres=pose.centres - origin))
    return volume.surface() + origin


class _Volume:
    """Open3D's grid of voxel blocks, within a budget."""

    def __init__(self, o3d: Any, settings: TsdfSettings) -> None:
        self._o3d, self._settings = o3d, settings
        kinds, sizes = [o3d.core.float32] * 2, [(1,), (1,)]
        self._grid = o3d.t.geometry.VoxelBlockGrid(
            ["tsdf", "weight"], kinds, sizes, settings.voxel, _BLOCK, _FIRST_BLOCKS
        )
        self._steps = settings.truncation / settings.voxel

    def add(self, depth: Floats, camera: Cameras, pose: Poses) -> None:
        blocks = _touched(depth, camera, pose, self._settings)
        self._require(len(blocks))
        tensor, image = self._o3d.core.Tensor, self._o3d.t.geometry.Image
        # A voxel takes the depth of pixel (floor u, floor v): of the image whose corner is (0, 0),
        # so that the camera stays as it is, though other parts of Open3D have pixel centres there.
        K = camera.matrices[0]
        view = (tensor(K), tensor(_extrinsics(pose)), 1.0, self._settings.max_depth, self._steps)
        # It takes no voxel beyond the start of the last row and column, so there is one more.
        border = ((0, 1), (0, 1), (0, 0))
        seen = image(tensor(np.pad(depth.astype(np.float32)[..., None], border)))
        self._grid.integrate(tensor(blocks), seen, *view)
        self._require(self._grid.hashmap().size())

    def surface(self) -> Floats:
        if not self._grid.hashmap().size():
            return np.zeros((0, 3))
        cloud = self._grid.extract_point_cloud(0.0)
        points: Floats = cloud.point.positions.numpy().astype(np.float64)
        return points[np.lexsort(points.T[::-1])]

    def _require(self, blocks: int) -> None:
        voxels = blocks * _BLOCK**3
        if voxels > self._settings.max_voxels:
            raise PredictionError(
                f"the fused surface takes more than {self._settings.max_voxels:,} voxels of "
                f"{self._settings.voxel:g}",
                expected="depths and poses of one scene, in one scale",
                fix="check the scale of the depth maps against that of the poses",
            )


def _origin(poses: Poses, settings: TsdfSettings) -> Floats:
    side = settings.voxel * _BLOCK
    least = np.floor(poses.centres.min(axis=0, initial=np.inf) / side) * side
    return np.asarray(least + _OFF_GRID * settings.voxel)


def _touched(
    depth: Floats, camera: Cameras, pose: Poses, settings: TsdfSettings
) -> NDArray[np.int32]:
    # Open3D looks at every 16th pixel for this, which leaves holes where pixels are large.
    side = settings.voxel * _BLOCK
    steps = int(np.ceil(4 * settings.truncation / side)) + 1
    offsets = np.linspace(-settings.truncation, settings.truncation, steps)
    pixels = np.flatnonzero(depth)
    found = [
        np.unique(_keys(depth, pixels[start : start + _BLOCK_PIXELS], camera, pose, offsets, side))
        for start in range(0, len(pixels), _BLOCK_PIXELS)
    ]
    keys = np.unique(np.concatenate(found))
    shifts = np.array((2 * _AXIS_BITS, _AXIS_BITS, 0))
    axes = (keys[:, None] >> shifts & ((1 << _AXIS_BITS) - 1)) - (1 << _AXIS_BITS - 1)
    return np.asarray(axes, np.int32)


def _keys(
    depth: Floats, pixels: Ints, camera: Cameras, pose: Poses, offsets: Floats, side: float
) -> Ints:
    # Blocks around the surface that these pixels see, each packed into one whole number.
    places = np.stack(np.divmod(pixels, depth.shape[1])[::-1], axis=-1) + 0.5
    rays = back_project(camera, places[None])[0]
    along = depth.ravel()[pixels] + offsets[:, None]
    local = rays * (along / rays[:, 2])[..., None]
    world = apply_matrix(pose.rotation[0].T, local) + pose.centres[0]
    half = 1 << _AXIS_BITS - 1
    # A block beyond the range of a key is so far off that it is an outlier: it goes to the rim.
    axes = np.clip(np.floor(world / side), -half, half - 1).astype(np.int64) + half
    packed: Ints = (axes[..., 0] << 2 * _AXIS_BITS) | (axes[..., 1] << _AXIS_BITS) | axes[..., 2]
    return packed


def _extrinsics(pose: Poses) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = pose.rotation[0]
    matrix[:3, 3] = pose.translation[0]
    return matrix

"""Depth maps and point maps of views, and the clouds that they become.

Maps are read view by view. Pixel centres sit at integer + 0.5, the image's corner being (0, 0), as
in `geometry.cameras`: the pixel in column u and row v looks through (u + 0.5, v + 0.5).

A truncated signed distance function fuses depth maps into one surface (Curless and Levoy, A
volumetric method for building complex models from range images, SIGGRAPH 1996), by Open3D's
``VoxelBlockGrid``. Only the order of its points depends on threads: they are sorted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.cloud import ArrayPieces, Cloud
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, depth_to_points
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.clouds import PieceCloud
from airzoo_bench.reconstruction.settings import Fusion

# Views are worked through in parts of this many pixels, whatever pieces are asked for.
_BLOCK_PIXELS = 1 << 18
_BLOCK = 8  # voxels along a side of a block, Open3D's unit of memory
_FIRST_BLOCKS = 1024
# Voxels are this share of their size off its multiples: a surface that lies exactly on voxels (a
# flat ground at height 0) has no sign to change there, and would not be found.
_OFF_GRID = 0.382
_FURTHEST_BLOCK = 1 << 20


@dataclass(frozen=True, eq=False)
class DepthMaps:
    """Depth maps (N, H, W) of N views, along the camera's z axis.

    0, negative, NaN and infinite depths stand for no surface. Cameras are at the size of the maps,
    poses in the frame of the prediction.
    """

    values: NDArray[Any]
    cameras: Cameras
    poses: Poses
    confidence: NDArray[Any] | None = None

    def take(self, rows: Ints) -> DepthMaps:
        """Return the maps of some views."""
        conf = None if self.confidence is None else self.confidence[rows]
        return DepthMaps(self.values[rows], self.cameras.take(rows), self.poses.take(rows), conf)


@dataclass(frozen=True, eq=False)
class PointMaps:
    """Point maps (N, H, W, 3) of views in the frame of the prediction; not finite: no surface."""

    values: NDArray[Any]
    confidence: NDArray[Any] | None = None


def depth_cloud(maps: DepthMaps, transform: Similarity, settings: Fusion) -> PieceCloud:
    """Make a cloud of all pixels of depth maps that have a surface, view by view and row by row.

    The transform leads into the frame of the truth, and depths grow by its scale.
    """
    poses, rows = transform.apply_poses(maps.poses), range(len(maps.values))

    def read(points: int) -> Iterator[Cloud]:
        for row in rows:
            depth = _scaled_depth(maps, row, transform, settings)
            depth[~_trusted(maps, row, settings)] = 0.0
            camera, pose = maps.cameras.take(row), poses.take(row)
            yield from map(Cloud, _lift(depth, camera, pose, min(points, _BLOCK_PIXELS)))

    depths = (_scaled_depth(maps, row, transform, settings) for row in rows)
    return PieceCloud(sum(int(np.count_nonzero(depth)) for depth in depths), read)


def point_map_cloud(maps: PointMaps, transform: Similarity, settings: Fusion) -> PieceCloud:
    """Make a cloud of all pixels of point maps that have a surface; see `depth_cloud`."""
    rows = range(len(maps.values))

    def surface(row: int) -> Bools:
        return np.asarray(np.isfinite(maps.values[row]).all(axis=-1))

    def read(points: int) -> Iterator[Cloud]:
        for row in rows:
            chosen = maps.values[row][surface(row) & _trusted(maps, row, settings)]
            for piece in ArrayPieces(chosen)(min(points, _BLOCK_PIXELS)):
                yield Cloud(transform.apply(piece.points))

    return PieceCloud(sum(int(surface(row).sum()) for row in rows), read)


def _scaled_depth(maps: DepthMaps, row: int, transform: Similarity, settings: Fusion) -> Floats:
    """Return the depth map (H, W) of one view, 0 where it has no surface."""
    with np.errstate(invalid="ignore"):  # of NaN, which compares false
        depth = maps.values[row].astype(np.float64) * transform.scale
    return np.where((depth > 0.0) & (depth <= settings.max_depth_m), depth, 0.0)


def _trusted(maps: DepthMaps | PointMaps, row: int, settings: Fusion) -> Bools:
    """Say which pixels (H, W) of a view have enough confidence."""
    if maps.confidence is None or settings.least_confidence is None:
        return np.ones(maps.values.shape[1:3], np.bool_)
    return np.asarray(maps.confidence[row] > settings.least_confidence)


def _lift(depth: Floats, camera: Cameras, pose: Poses, size: int) -> Iterator[Floats]:
    """Yield the points (P, 3) that pixels with a depth above 0 see, in bounded blocks."""
    pixels = np.flatnonzero(depth > 0.0)
    for start in range(0, len(pixels), size):
        chosen = np.zeros(depth.shape, np.bool_)
        chosen.flat[pixels[start : start + size]] = True
        yield depth_to_points(depth, chosen, camera, pose)


# --- truncated signed distances ---


def fuse(maps: DepthMaps, transform: Similarity, settings: Fusion) -> PieceCloud:
    """Fuse depth maps into the points where their surface crosses edges between voxels."""
    poses = transform.apply_poses(maps.poses)
    side = settings.tsdf_voxel_m * _BLOCK
    origin = np.floor(poses.centres.min(axis=0, initial=np.inf) / side) * side
    origin = np.asarray(origin + _OFF_GRID * settings.tsdf_voxel_m)
    o3d = load_open3d()
    kinds, sizes = [o3d.core.float32] * 2, [(1,), (1,)]
    shape = kinds, sizes, settings.tsdf_voxel_m, _BLOCK, _FIRST_BLOCKS
    grid = o3d.t.geometry.VoxelBlockGrid(["tsdf", "weight"], *shape)
    distrusted = 0
    for row in range(len(maps.values)):
        depth, pose = _scaled_depth(maps, row, transform, settings), poses.take(row)
        doubtful = ~_trusted(maps, row, settings)
        distrusted += int(np.count_nonzero(depth[doubtful]))
        depth[doubtful] = 0.0
        if depth.any():
            near = Poses(rotation=pose.rotation, centres=pose.centres - origin)
            _integrate(o3d, grid, depth, maps.cameras.take(row), near, settings)
    surface = np.zeros((0, 3))
    if grid.hashmap().size():
        points = grid.extract_point_cloud(0.0).point.positions.numpy().astype(np.float64)
        surface = points[np.lexsort(points.T[::-1])] + origin
    return PieceCloud(len(surface) + distrusted, ArrayPieces(surface))


def _integrate(
    o3d: Any, grid: Any, depth: Floats, camera: Cameras, pose: Poses, settings: Fusion
) -> None:
    """Add a view to Open3D's grid of voxel blocks."""
    blocks = _touched_blocks(depth, camera, pose, settings)
    _check_room(len(blocks), settings)
    extrinsics = np.eye(4)
    extrinsics[:3, :3], extrinsics[:3, 3] = pose.rotation[0], pose.translation[0]
    # A voxel takes the depth of pixel (floor u, floor v): of the image whose corner is (0, 0),
    # so that the camera stays as it is, though other parts of Open3D have pixel centres there.
    steps = settings.tsdf_truncation_m / settings.tsdf_voxel_m
    tensor = o3d.core.Tensor
    view = (tensor(camera.matrices[0]), tensor(extrinsics), 1.0, settings.max_depth_m, steps)
    # It takes no voxel beyond the start of the last row and column, so there is one more.
    padded = np.pad(depth.astype(np.float32)[..., None], ((0, 1), (0, 1), (0, 0)))
    grid.integrate(tensor(blocks), o3d.t.geometry.Image(tensor(padded)), *view)
    _check_room(grid.hashmap().size(), settings)


def _check_room(blocks: int, settings: Fusion) -> None:
    if blocks * _BLOCK**3 > settings.tsdf_max_voxels:
        what = f"the fused surface takes more than {settings.tsdf_max_voxels:,} voxels"
        raise PredictionError(what, fix="check the scale of the depths against that of the poses")


def _touched_blocks(
    depth: Floats, camera: Cameras, pose: Poses, settings: Fusion
) -> NDArray[np.int32]:
    """Return the blocks (B, 3) around the surface that a view sees, sorted."""
    # Open3D looks at every 16th pixel for this, which leaves holes where pixels are large.
    side, far = settings.tsdf_voxel_m * _BLOCK, settings.tsdf_truncation_m
    keys = []
    for offset in np.linspace(-far, far, int(np.ceil(4 * far / side)) + 1):
        moved = np.where(depth > 0.0, np.maximum(depth + offset, np.finfo(float).tiny), 0.0)
        for points in _lift(moved, camera, pose, _BLOCK_PIXELS):
            # A block further off is of an outlier: it goes to the rim.
            blocks = np.clip(np.floor(points / side), -_FURTHEST_BLOCK, _FURTHEST_BLOCK - 1)
            x, y, z = blocks.T.astype(np.int64) + _FURTHEST_BLOCK
            keys.append(np.unique((x << 42) | (y << 21) | z))
    occupied = np.unique(np.concatenate(keys))
    return np.asarray((occupied[:, None] >> np.array((42, 21, 0)) & 0x1FFFFF) - (1 << 20), np.int32)

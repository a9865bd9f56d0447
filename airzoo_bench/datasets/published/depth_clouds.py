"""True clouds out of exact depth, made once and kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import fingerprint
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.geometry_checks.depth_maps import find_depths, read_depth
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, depth_to_points
from airzoo_bench.reconstruction.prepared import grid_origin
from airzoo_bench.reconstruction.voxels import VoxelGrid

__all__ = ["DepthFrames"]

_DECIMALS = 4


@dataclass(frozen=True, eq=False)
class DepthFrames:
    """N frames whose depth shows a surface.

    Attributes
    ----------
    depths : Path
        Folder of the depth maps, which have the names of the photos.
    names : tuple of N str
    cameras, poses : Cameras, Poses
    along_ray : bool
        Whether depth is the distance from the camera, instead of along the optical axis.
    scale_m : float or None
        Metres of a unit of depth, where it is not metres.
    max_depth_m : float
        What is farther away is left out.
    voxel_m : float
        The cloud has a point in each voxel of this side.
    """

    depths: Path
    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    along_ray: bool
    scale_m: float | None
    max_depth_m: float
    voxel_m: float

    def cloud(self, folder: Path, label: str, progress: Progress) -> Path:
        """Make the cloud, unless one of the same frames stands in the folder."""
        paths = self._paths()
        kept = folder / f"{label}-{self._key(paths)[:16]}.ply"
        if kept.is_file():
            return kept
        grid = VoxelGrid(self.voxel_m, grid_origin(self.voxel_m))
        for row in progress(range(len(paths)), f"{label}, true cloud", len(paths)):
            self._add(grid, row, paths[row])
        points = grid.points()
        if not len(points):
            raise BenchmarkError(
                f"no depth below {self.max_depth_m:g} m in {len(paths)} frames",
                where=self.depths,
                expected="metres",
                fix="name the unit with --depth-scale",
            )
        folder.mkdir(parents=True, exist_ok=True)
        write_ply(kept, Cloud(np.round(points, _DECIMALS) + 0.0))
        return kept

    def _paths(self) -> list[Path]:
        found = find_depths(self.depths, self.names)
        missing = [name for name, path in zip(self.names, found, strict=True) if path is None]
        if missing:
            raise BenchmarkError(
                f"photos without a depth map: {first_of(missing, len(self.names))}",
                where=self.depths,
                fix="complete the download",
            )
        return [path for path in found if path is not None]

    def _key(self, paths: list[Path]) -> str:
        files = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
        cameras, poses = self.cameras, self.poses
        arrays = (*vars(cameras).values(), poses.rotation, poses.centres)
        return fingerprint(
            {
                "depths": [str(self.depths.resolve()), files],
                "arrays": [np.asarray(array).tolist() for array in arrays],
                "settings": [self.along_ray, self.scale_m, self.max_depth_m, self.voxel_m],
            }
        )

    def _add(self, grid: VoxelGrid, row: int, path: Path) -> None:
        camera, pose = self.cameras.take(row), self.poses.take(row)
        width, height = int(camera.width[0]), int(camera.height[0])
        depth = read_depth(path, width, height, self.scale_m).astype(np.float64)
        chosen = depth <= self.max_depth_m  # NaN where there is none
        points = depth_to_points(depth, chosen, camera, pose, along_ray=self.along_ray)
        grid.add(points[np.isfinite(points).all(axis=1)])

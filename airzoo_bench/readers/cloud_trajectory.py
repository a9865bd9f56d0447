"""A cloud with the poses that it was made with, as SLAM systems leave them: TUM or KITTI text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.readers.pose_text import first_rows, numbers_of, pose_rows, unit_share
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.trajectories import Trajectory, refuse_other_names

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["CLOUD_TRAJECTORY", "CloudTrajectory"]

_TUM, _KITTI = 8, 12
_CLOUDS = (".ply", ".pcd", ".las", ".laz", ".xyz", ".pts")
_SURE = 0.55  # of a method that writes such files, its own reader is surer


class CloudTrajectory(SceneReader):
    """Reads a cloud and cameras; a folder of it is one scene's."""

    title = "a cloud with a trajectory of TUM or KITTI"
    layout = "a folder a scene with one cloud and one text of 8 (TUM) or 12 (KITTI) numbers a row"
    methods = ("SLAM systems", "evo")

    def sure_of(self, place: Path) -> float:
        """Look for one cloud and one text of poses."""
        found = _files(place)
        return _SURE if found is not None else 0.0

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        listed = scenes.reading.names
        return (
            "poses camera-to-world, axes of OpenCV, in the frame of the cloud",
            "8 numbers a row: time stamp, tx ty tz, qx qy qz qw; 12: the 3 x 4 matrix [R | C]",
            "views in the order of the names of the photos"
            if listed is None
            else f"views in the order of {listed.name}",
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        from airzoo_bench.formats.clouds.formats import open_cloud
        from airzoo_bench.reconstruction.predictions import ScenePrediction

        found = _files(place)
        if found is None:
            raise PredictionError(
                "holds not one cloud and one text of poses",
                where=place,
                expected=f"one of {', '.join(_CLOUDS)}, and rows of {_TUM} or {_KITTI} numbers",
            )
        cloud, text = found
        trajectory = _trajectory(text, memory)
        names = scenes.listed_names(place)
        refuse_other_names(trajectory, names)
        poses = trajectory.poses(None if names is None else scenes.photos(place, names))
        return ScenePrediction(open_cloud(cloud, limit_bytes=memory, sampling=None), poses)


def _files(place: Path) -> tuple[Path, Path] | None:
    """Return the one cloud and the one text of poses in a folder."""
    if not place.is_dir():
        return None
    files = [one for one in sorted(place.iterdir()) if one.is_file()]
    texts = [one for one in files if _columns(one) is not None]
    clouds = [one for one in files if one.name.lower().endswith(_CLOUDS)]
    return (clouds[0], texts[0]) if len(texts) == len(clouds) == 1 else None


def _columns(path: Path) -> int | None:
    """Return how many numbers a row has, if rows are poses."""
    rows = first_rows(path)
    count = len(rows[0]) if rows else 0
    alike = [row for row in rows if len(row) == count and numbers_of([row], 0) is not None]
    values = numbers_of(alike, 0) if count in (_TUM, _KITTI) and alike else None
    if values is None:
        return None
    share = unit_share(values[:, 4:] if count == _TUM else values[:, :3])
    return count if share > 0.5 else None


def _trajectory(path: Path, memory: int) -> Trajectory:
    import numpy as np

    from airzoo_bench.geometry.poses import quaternion_to_matrix

    values = pose_rows(path, _columns(path) or _TUM, named=False, memory_bytes=memory).values
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if wrong.size:
        raise PredictionError(
            f"row {wrong[0] + 1} has a number that is not finite",
            where=path,
            expected="a pose of each photo",
            fix="leave the row out, and list the photos of the others with --names",
        )
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    if values.shape[1] == _KITTI:
        poses[:, :3] = values.reshape(-1, 3, 4)
    else:
        with np.errstate(over="ignore"):  # an infinite length is not 1
            lengths = np.linalg.norm(values[:, 4:], axis=1)
        if (np.abs(lengths - 1.0) > 1e-3).any():
            row = int(np.argmax(np.abs(lengths - 1.0)))
            raise PredictionError(
                f"the quaternion of row {row + 1} has length {lengths[row]:.6g}",
                where=path,
                expected="qx qy qz qw of unit length",
            )
        poses[:, :3, :3] = quaternion_to_matrix(values[:, [7, 4, 5, 6]])
        poses[:, :3, 3] = values[:, 1:4]
    return Trajectory(path, [float(row) for row in range(len(values))], poses)


CLOUD_TRAJECTORY = CloudTrajectory()
"""Registered as ``cloud-trajectory``."""

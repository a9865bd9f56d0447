"""Poses that a method computed itself, by the names of photos or in the order of a list."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.evaluation.predictions import (
    PredictionFile,
    QueryPredictions,
    Reader,
    ReadRequest,
)
from airzoo_bench.formats.npz import Budget
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.matching.predictions import PredictedPoses, make_poses
from airzoo_bench.readers.names import query_names, read_names
from airzoo_bench.readers.pose_files import (
    KITTI,
    TUM,
    first_rows,
    numbers_of,
    read_images,
    read_rows,
    read_trajectory,
    trajectory_columns,
    unit_share,
)

_MOST = 0.5  # of the rows, which are then taken to be quaternions
_BY_TRACK = 0.4  # other tracks have such files, too: it must be known that matching is meant


class NamedPoses(NamedTuple):
    """Poses of N images, world-to-camera; a row that is not finite is none.

    `rotation` has quaternions w x y z (N, 4) or matrices (N, 3, 3), `place` translations or, if
    `centred`, centres (N, 3).
    """

    names: Sequence[str]
    rotation: Floats
    place: Floats
    centred: bool = False


class PoseReader(Reader):
    """Reads poses by the names of photos, in the CRS of the scene.

    `conventions` say what is taken to be so.
    """

    track = "matching"

    @abstractmethod
    def poses(self, path: Path, request: ReadRequest) -> NamedPoses:
        """Read the poses."""

    def notes(self, found: PredictedPoses) -> tuple[str, ...]:
        """Return what must be known of the poses."""
        return ()

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """See `Reader.read`."""
        given = self.poses(path, request)
        ids = query_names(request).find_all(given.names, path)
        kept = np.array([row for row, one in enumerate(ids) if one is not None], dtype=np.int64)
        rotation, place = given.rotation[kept], given.place[kept]
        flat = np.column_stack([rotation.reshape(len(kept), -1), place])
        there = np.isfinite(flat).all(axis=1)
        rotation[~there], place[~there] = np.nan, np.nan
        names = [given.names[row] for row in kept]
        content = make_poses(path, names, rotation, place, centred=given.centred)
        query_ids = np.array([ids[row] for row in kept], dtype=str)
        predictions = QueryPredictions(path, None, query_ids, content)
        strange = len(ids) - len(kept)
        left = (f"{counted(strange, 'pose')} of photos that are no queries left out",)
        notes = (*left * (strange > 0), *self.notes(content))
        return PredictionFile(predictions, self.conventions, notes)


class _HlocPoses(PoseReader):
    """Results of hloc's localisation and of LTVL, with names that are no ids of the benchmark."""

    title = "poses of hloc"
    layout = "text, a line a photo: its name without a scene, qw qx qy qz, tx ty tz"
    methods = ("hloc", "MASt3R", "DUSt3R")
    conventions = (
        "poses are world-to-camera, quaternions w x y z, OpenCV axes, in the scene's CRS",
        "the identity stands for a pose that was not found",
    )

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`; names with a scene mean the suite's own pose lists."""
        rows = first_rows(path)
        values = numbers_of(rows, 1) if {len(row) for row in rows} == {TUM} else None
        if values is None or unit_share(values[:, :4]) < _MOST:
            return 0.0
        if unit_share(values[:, 3:]) >= _MOST and numbers_of(rows, 0) is not None:
            return 0.0  # a time stamp and an odd place
        return 0.2 if any("/" in row[0] for row in rows) else 0.8

    def poses(self, path: Path, request: ReadRequest) -> NamedPoses:
        names, values = read_rows(path, 7, named=True, memory=request.memory_bytes)
        values[(values == (1, 0, 0, 0, 0, 0, 0)).all(axis=1)] = np.nan
        return NamedPoses(names, values[:, :4], values[:, 4:])

    def notes(self, found: PredictedPoses) -> tuple[str, ...]:
        failed = int((~found.has_pose).sum())
        if failed:
            return (f"{counted(failed, 'photo')} at the identity or NaN count as not found",)
        return (
            "hloc writes the pose of the best retrieved image, unmarked, where it found none: such "
            "poses are scored as they stand",
        )


@dataclass(frozen=True)
class _Trajectory(PoseReader):
    """A trajectory with poses in the order of ``--names``."""

    title: str
    layout: str
    columns: int
    methods: tuple[str, ...]
    conventions = (
        "poses are camera-to-world, OpenCV axes, in the scene's CRS",
        "rows are in the order of --names",
    )

    def recognise(self, path: Path) -> float:
        return _BY_TRACK * (trajectory_columns(path) == self.columns)

    def poses(self, path: Path, request: ReadRequest) -> NamedPoses:
        _, poses = read_trajectory(path, self.columns, request.memory_bytes)
        names = [] if request.names is None else read_names(request.names)
        if len(names) != len(poses):
            what = f"{counted(len(poses), 'pose')}, and {counted(len(names), 'name')} of photos"
            expected = "--names LIST, a text with the photo of each row, in their order"
            raise PredictionError(what, where=path, expected=expected)
        rotation = poses[:, :3, :3].swapaxes(1, 2)
        return NamedPoses(names, rotation, poses[:, :3, 3], centred=True)


class _Colmap(PoseReader):
    """Queries registered in a COLMAP model: the poses of its images, and nothing else of it."""

    title = "photos registered in a COLMAP model"
    layout = "a folder with cameras.bin and images.bin, whose world is the scene's CRS"
    methods = ("COLMAP", "hloc", "pycolmap")
    conventions = (
        "poses are world-to-camera, quaternions w x y z, in the scene's CRS",
        "cameras of the model are not read: those of the benchmark count",
    )

    def _file(self, path: Path) -> Path | None:
        folders = (path / below for below in (".", "sparse/0", "sparse"))
        there = (one / "images.bin" for one in folders if (one / "cameras.bin").is_file())
        return next((one for one in there if one.is_file()), None)

    def recognise(self, path: Path) -> float:
        return _BY_TRACK * (self._file(path) is not None)

    def poses(self, path: Path, request: ReadRequest) -> NamedPoses:
        file = self._file(path) or path / "images.bin"
        names, values = read_images(file, Budget(request.memory_bytes))
        return NamedPoses(names, values[:, :4], values[:, 4:])


HLOC_POSES, COLMAP_POSES = _HlocPoses(), _Colmap()
TUM_POSES = _Trajectory(
    "a trajectory in the layout of TUM",
    "text, rows of 8 numbers: time stamp, tx ty tz, qx qy qz qw",
    TUM,
    ("SLAM systems", "evo"),
)
KITTI_POSES = _Trajectory(
    "a trajectory in the layout of KITTI",
    "text, rows of 12 numbers: a 3 x 4 matrix row by row",
    KITTI,
    ("visual odometry", "evo"),
)

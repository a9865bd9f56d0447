"""Poses as lines of numbers, and clouds with the trajectories that they were made with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import CameraError, PredictionError, UnreadableError
from airzoo_bench.core.files import first_bytes, read_text
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.npz import Budget
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import quaternion_to_matrix
from airzoo_bench.readers.scenes import Layout, SceneOutput, ViewNames
from airzoo_bench.readers.views import MadeArrays, inverted
from airzoo_bench.reconstruction.cameras import ImagePoses, image_poses
from airzoo_bench.reconstruction.predictions import ScenePrediction

TUM, KITTI = 8, 12
"""Columns of a row: number, place and quaternion, or a matrix of 3 x 4."""

_TEXTS = ("", ".txt", ".tum", ".kitti", ".log")
_CLOUDS = (".ply", ".pcd", ".las", ".laz", ".xyz", ".pts")
_LIMIT_BYTES = 1 << 27
_HEAD_BYTES, _HEAD_ROWS = 1 << 16, 50
_BYTES_A_BYTE = 32  # of memory, while the words of a line are texts and numbers of Python
_UNIT_TOLERANCE = 1e-3


def first_rows(path: Path) -> list[list[str]]:
    """Return the first rows of a text, split at blanks; none if it is no text."""
    if not path.is_file() or path.suffix.lower() not in _TEXTS:
        return []
    head = first_bytes(path, _HEAD_BYTES)
    whole = head[: head.rfind(b"\n")] if len(head) == _HEAD_BYTES else head
    return _rows(whole.decode("utf-8", "replace"))[:_HEAD_ROWS]


def _rows(text: str) -> list[list[str]]:
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.split() for line in lines if line.strip() and line.lstrip()[0] != "#"]


def numbers_of(rows: list[list[str]], start: int) -> Floats | None:
    """Return the numbers of rows from a column on; None where some are none, or rows differ."""
    if len({len(row) for row in rows}) != 1:
        return None
    try:
        return np.array([[float(word) for word in row[start:]] for row in rows], dtype=np.float64)
    except ValueError:
        return None


def unit_share(values: Floats) -> float:
    """Return the share of rows (N, 4) of length 1; rows that are not finite are not counted."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(values, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    return float((np.abs(lengths - 1) <= _UNIT_TOLERANCE).mean()) if len(lengths) else 0.0


def read_rows(path: Path, columns: int, named: bool, memory: int) -> tuple[list[str], Floats]:
    """Read all rows of a text: the names before the numbers, none if not `named`, and these."""
    Budget(memory).hold(path, "its text", path.stat().st_size * _BYTES_A_BYTE)
    rows = _rows(read_text(path, UnreadableError, "text of poses", _LIMIT_BYTES))
    wrong = [number for number, row in enumerate(rows, 1) if len(row) != columns + named]
    values = None if wrong else numbers_of(rows, int(named))
    if values is None:
        what = "holds words where numbers should be" if rows else "holds no pose"
        if wrong:
            what = f"row {wrong[0]} has {len(rows[wrong[0] - 1])} columns"
        expected = f"{'a name and ' if named else ''}{columns} numbers in each row"
        raise PredictionError(what, where=path, expected=expected)
    return [row[0] for row in rows] if named else [], values


def trajectory_columns(path: Path) -> int | None:
    """Return how many numbers a row has, where rows are poses of TUM's or KITTI's layout."""
    rows = first_rows(path)
    count = len(rows[0]) if rows else 0
    alike = [row for row in rows if len(row) == count and numbers_of([row], 0) is not None]
    values = numbers_of(alike, 0) if count in (TUM, KITTI) and alike else None
    if values is None:
        return None
    return count if unit_share(values[:, 4:] if count == TUM else values[:, :3]) > 0.5 else None


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Cameras in the order of a file: the first entry of each row, and poses (N, 4, 4)."""

    path: Path
    numbers: list[float]
    camera_to_world: Floats

    def poses(self, names: ViewNames | None) -> ImagePoses:
        """Return the cameras world-to-camera, under names if there are any."""
        fields = {"extrinsics": inverted(self.camera_to_world)}
        if names is not None:
            names.check(self.path, len(self.numbers))
            fields["image_names"] = np.array(names.names, dtype=str)
        made = MadeArrays(self.path, Budget(_LIMIT_BYTES * 8), fields)
        return image_poses(made, len(self.numbers))


def rotations_of(path: Path, wxyz: Floats, names: Sequence[str] | None = None) -> Floats:
    """Turn the quaternions of a file into rotations (N, 3, 3)."""
    try:
        return quaternion_to_matrix(wxyz, names)
    except CameraError as error:
        raise PredictionError(error.what, where=path, expected=error.expected) from error


def read_trajectory(path: Path, columns: int, memory: int, *, w_first: bool = False) -> Trajectory:
    """Read the camera-to-world poses of a text; quaternions are x y z w unless `w_first`."""
    _, values = read_rows(path, columns, named=False, memory=memory)
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if wrong.size:
        what = f"row {wrong[0] + 1} has a number that is not finite"
        fix = "leave the row out, and list the photos of the others with --names"
        raise PredictionError(what, where=path, expected="a pose of each photo", fix=fix)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    if columns == KITTI:
        poses[:, :3] = values.reshape(-1, 3, 4)
    else:
        poses[:, :3, :3] = rotations_of(path, values[:, 4:] if w_first else values[:, [7, 4, 5, 6]])
        poses[:, :3, 3] = values[:, 1:4]
    return Trajectory(path, values[:, 0].tolist(), poses)


def cameras_only(trajectory: Trajectory, names: ViewNames | None, what: str) -> ScenePrediction:
    """Return a scene with cameras and no surface: its clouds score 0."""
    note = f"cameras alone, without a surface, which scores 0: {what}"
    path, dtype = trajectory.path, np.dtype(np.float64)
    cloud = FileCloud(path, "cameras", 0, lambda _: iter(()), dtype, (note,))
    return ScenePrediction(cloud, trajectory.poses(names), (note,))


@dataclass(frozen=True)
class CamerasAlone(Layout):
    """A text of a name with a camera a row, quaternions w x y z; `missing` says what has more."""

    file: str
    missing: str
    said = ("camera-to-world, quaternions w x y z, axes of OpenCV; cameras alone",)

    def sure(self, place: Path) -> float:
        """See `Layout.sure`."""
        return 0.9 * (trajectory_columns(self._file(place)) == TUM)

    def _file(self, place: Path) -> Path:
        path = place / self.file if place.is_dir() else place
        return path if path.name == self.file else Path()

    def views(self, output: SceneOutput) -> ViewNames | None:
        """See `Layout.views`."""
        return output.view_names(self._file(output.place).parent / "images")

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`."""
        trajectory = read_trajectory(self._file(output.place), TUM, memory, w_first=True)
        return cameras_only(trajectory, self.views(output), self.missing)


class CloudWithTrajectory(Layout):
    """A folder with one cloud and one text of poses, as SLAM systems leave them."""

    said = (
        "poses camera-to-world, axes of OpenCV, in the frame of the cloud",
        "8 numbers a row: time stamp, tx ty tz, qx qy qz qw; 12: the 3 x 4 matrix [R | C]",
    )

    def sure(self, place: Path) -> float:
        """See `Layout.sure`; of a method that writes such files, its own reader is surer."""
        return 0.55 * (self._files(place) is not None)

    def _files(self, place: Path) -> tuple[Path, Path] | None:
        """Return the one cloud and the one text of poses in a folder."""
        if not place.is_dir():
            return None
        files = [one for one in sorted(place.iterdir()) if one.is_file()]
        texts = [one for one in files if trajectory_columns(one) is not None]
        clouds = [one for one in files if one.name.lower().endswith(_CLOUDS)]
        return (clouds[0], texts[0]) if len(texts) == len(clouds) == 1 else None

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`."""
        found = self._files(output.place)
        assert found is not None
        cloud, text = found
        trajectory = read_trajectory(text, trajectory_columns(text) or TUM, memory)
        poses = trajectory.poses(output.view_names())
        return ScenePrediction(open_cloud(cloud, limit_bytes=memory, sampling=None), poses)

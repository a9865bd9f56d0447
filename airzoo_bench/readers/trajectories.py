"""Trajectories as text: a camera a line, its number, its place and its turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.cameras import ImagePoses
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = [
    "Trajectory",
    "cameras_only",
    "looks_like_trajectory",
    "read_trajectory",
    "refuse_other_names",
]

_COLUMNS = 8
_LOOKED_AT = 4096
_LIMIT_BYTES = 1 << 27
_UNIT = 1e-3


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Cameras in the order of a file.

    Attributes
    ----------
    path : Path
    numbers : list of float
        What stands first in each line.
    camera_to_world : (N, 4, 4) float64
    """

    path: Path
    numbers: list[float]
    camera_to_world: Any

    def poses(self, names: list[str] | None) -> ImagePoses:
        """Return the cameras world-to-camera, under names, or without."""
        import numpy as np

        from airzoo_bench.formats.budget import Budget
        from airzoo_bench.readers.view_files import GivenArrays, inverted
        from airzoo_bench.reconstruction.cameras import image_poses

        fields = {"extrinsics": lambda: inverted(self.camera_to_world)}
        if names is not None:
            fields["image_names"] = lambda: np.array(names, dtype=str)
        given = GivenArrays(self.path, Budget(_LIMIT_BYTES * 8), fields)
        return image_poses(given, len(self.numbers))


def looks_like_trajectory(path: Path) -> bool:
    """Say whether the first camera of a file is 8 numbers, of which the last 4 are a quaternion."""
    try:
        with path.open("rb") as stream:
            lines = stream.read(_LOOKED_AT).split(b"\n")
    except OSError:
        return False
    first = next((line for line in lines if line.strip() and not line.startswith(b"#")), b"")
    row = _row(first)
    return row is not None and _is_unit(row[4:])


def _row(line: bytes) -> list[float] | None:
    words = line.split()
    try:
        row = [float(word) for word in words]
    except ValueError:
        return None
    return row if len(row) == _COLUMNS else None


def _is_unit(quaternion: list[float]) -> bool:
    return abs(math.hypot(*quaternion) - 1.0) < _UNIT


def read_trajectory(path: Path, *, w_first: bool) -> Trajectory:
    """Read lines of number, centre and quaternion of camera-to-world poses."""
    import numpy as np

    from airzoo_bench.core.files import read_text
    from airzoo_bench.geometry.poses import quaternion_to_matrix

    text = read_text(path, PredictionError, "trajectory", _LIMIT_BYTES)
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        row = _row(line.encode(errors="replace"))
        if row is None or not all(map(math.isfinite, row)) or not _is_unit(row[4:]):
            raise PredictionError(
                f"line {number} is {line[:60]!r}",
                where=path,
                expected="8 numbers: that of the camera, x y z, and a unit quaternion",
            )
        rows.append(row)
    if not rows:
        raise PredictionError("holds no camera", where=path, expected="a line a camera")
    values = np.array(rows)
    quaternions = values[:, 4:] if w_first else values[:, [7, 4, 5, 6]]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = quaternion_to_matrix(quaternions)
    poses[:, :3, 3] = values[:, 1:4]
    return Trajectory(path, values[:, 0].tolist(), poses)


def refuse_other_names(trajectory: Trajectory, names: list[str] | None) -> None:
    """Refuse names that are not as many as the cameras."""
    if names is not None and len(names) != len(trajectory.numbers):
        raise PredictionError(
            f"holds {counted(len(trajectory.numbers), 'camera')}, and there are {len(names):,} "
            "names",
            where=trajectory.path,
            expected="the name of each camera's photo",
            fix="list the photos in the order in which the method was given them, with --names",
        )


def cameras_only(trajectory: Trajectory, names: list[str] | None, what: str) -> ScenePrediction:
    """Return a scene of which there are cameras and no surface: its clouds score 0."""
    import numpy as np

    from airzoo_bench.formats.clouds.cloud import FileCloud
    from airzoo_bench.reconstruction.predictions import ScenePrediction

    refuse_other_names(trajectory, names)
    note = f"cameras alone, without a surface, which scores 0: {what}"
    cloud = FileCloud(
        trajectory.path, "cameras", 0, lambda _: iter(()), np.dtype(np.float64), (note,)
    )
    return ScenePrediction(cloud, trajectory.poses(names), (note,))

"""Trajectories as TUM and KITTI write them: camera-to-world, without names of images."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.evaluation.reader import SURE, Reader, Reading, ReadPredictions
from airzoo_bench.readers.names import read_names
from airzoo_bench.readers.pose_text import first_rows, numbers_of, pose_rows, unit_share

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["KITTI", "TUM"]

_SURE_ENOUGH = 0.4  # other tracks have such files, too: it must be known that matching is meant


class _Trajectory(Reader):
    """Poses in the order of `--names`; `columns` numbers a row, `order` says which."""

    track = "matching"
    takes_names = True
    columns: ClassVar[int]
    order: ClassVar[str]

    @abstractmethod
    def split(self, values: Floats) -> tuple[Floats, Floats]:
        """Return world-to-camera rotations, as quaternions or matrices, and centres."""

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        import numpy as np

        from airzoo_bench.readers.matching import NamedPoses, posed, refuse_other_world, scenes_of

        rows = pose_rows(path, self.columns, named=False, memory_bytes=reading.memory_bytes)
        names = _names(reading.names, len(rows.values), path)
        found: Bools = np.asarray(np.isfinite(rows.values).all(axis=1))
        rotation, centres = self.split(rows.values)
        given = NamedPoses(names, rotation, centres, found, centred=True)
        predictions, strange = posed(given, reading, path)
        refuse_other_world(predictions.content, scenes_of(reading, path), path)
        left = (f"{counted(strange, 'pose')} of photos that are no queries left out",)
        return ReadPredictions(
            predictions,
            (
                f"a row is {self.order}, camera-to-world, OpenCV axes, in the scene's CRS",
                "rows are in the order of --names",
            ),
            left if strange else (),
        )


class _Tum(_Trajectory):
    title = "a trajectory in the layout of TUM"
    layout = "text, rows of 8 numbers: time stamp, tx ty tz, qx qy qz qw"
    methods = ("SLAM systems", "evo")
    columns = 8
    order = "time stamp, tx ty tz, qx qy qz qw"

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        values = _numbers(path, self.columns)
        return _SURE_ENOUGH if values is not None and unit_share(values[:, 4:]) >= SURE else 0.0

    def split(self, values: Floats) -> tuple[Floats, Floats]:
        """See `_Trajectory.split`."""
        import numpy as np

        x, y, z, w = values[:, 4:].T
        return np.stack([w, -x, -y, -z], axis=1), values[:, 1:4]


class _Kitti(_Trajectory):
    title = "a trajectory in the layout of KITTI"
    layout = "text, rows of 12 numbers: a 3 x 4 matrix row by row"
    methods = ("visual odometry", "evo")
    columns = 12
    order = "the 3 x 4 matrix [R | C] row by row"

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        values = _numbers(path, self.columns)
        return _SURE_ENOUGH if values is not None and unit_share(values[:, :3]) >= SURE else 0.0

    def split(self, values: Floats) -> tuple[Floats, Floats]:
        """See `_Trajectory.split`."""
        matrices = values.reshape(-1, 3, 4)
        return matrices[:, :, :3].swapaxes(1, 2), matrices[:, :, 3]


def _numbers(path: Path, columns: int) -> Floats | None:
    rows = first_rows(path)
    return numbers_of(rows, 0) if rows and len(rows[0]) == columns else None


def _names(path: Path | None, count: int, where: Path) -> list[str]:
    if path is None:
        raise PredictionError(
            f"{counted(count, 'pose')} without the names of their photos",
            where=where,
            expected="--names LIST, a text with the photo of each row",
            fix="write the names in the order in which the method saw the photos",
        )
    names = read_names(path)
    if len(names) != count:
        raise PredictionError(
            f"{counted(count, 'pose')}, and {counted(len(names), 'name')} in {path}",
            where=where,
            expected="a name for each row",
            fix="list the photos that have a pose, in the order of the rows",
        )
    return names


TUM = _Tum()
"""Registered as ``tum``."""

KITTI = _Kitti()
"""Registered as ``kitti``."""

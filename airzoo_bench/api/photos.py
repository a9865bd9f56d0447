"""Photos as a method may know them: what leads to their true poses is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.benchmark.images import photo_size, read_rgb_photo
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    PRIOR_COLUMNS,
    cameras_of,
    conditions_of,
    poses_of,
)
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Camera", "Photo", "Photos", "Pose"]


@dataclass(frozen=True, eq=False, repr=False)
class Camera:
    """The camera of one photo at its full size.

    Pixel centres sit at integer + 0.5, the image's corner is (0, 0); camera axes are OpenCV's: x
    right, y down, z forward.

    Attributes
    ----------
    batch : Cameras
        The same as a batch of one, as `airzoo_bench.geometry` takes it.
    """

    batch: Cameras

    @property
    def width(self) -> int:
        """Width of the photo in pixels."""
        return int(self.batch.width[0])

    @property
    def height(self) -> int:
        """Height of the photo in pixels."""
        return int(self.batch.height[0])

    @property
    def K(self) -> Floats:  # noqa: N802 - the field's name
        """Calibration matrix (3, 3) in pixels."""
        matrix: Floats = self.batch.matrices[0]
        return matrix

    @property
    def distortion(self) -> Floats:
        """Distortion (5,) k1 k2 p1 p2 k3, in OpenCV's order."""
        coefficients: Floats = self.batch.distortion[0]
        return coefficients

    def scaled(self, width: int, height: int) -> Camera:
        """Return the camera of the photo resized to `width` x `height` pixels."""
        return Camera(self.batch.scaled(width, height))

    def rays(self, xy: ArrayLike) -> Floats:
        """Return the rays (M, 3) of pixels (M, 2): unit vectors of the camera frame."""
        found: Floats = back_project(self.batch, np.asarray(xy, np.float64)[None])[0]
        return found

    def __repr__(self) -> str:
        fx, fy = self.batch.focal[0]
        return f"Camera({self.width} x {self.height} px, focal {fx:.1f}, {fy:.1f} px)"


@dataclass(frozen=True, eq=False, repr=False)
class Pose:
    """Where a camera is: x_cam = R (X - C), in the scene's CRS.

    Attributes
    ----------
    batch : Poses
        The same as a batch of one, as `airzoo_bench.geometry` takes it.
    """

    batch: Poses

    @property
    def rotation(self) -> Floats:
        """World-to-camera rotation R, (3, 3)."""
        matrix: Floats = self.batch.rotation[0]
        return matrix

    @property
    def centre(self) -> Floats:
        """Centre C of the camera, (3,), in metres of the scene's CRS."""
        place: Floats = self.batch.centres[0]
        return place

    def __repr__(self) -> str:
        x, y, z = self.centre
        return f"Pose(centre {x:.2f}, {y:.2f}, {z:.2f})"


@dataclass(frozen=True, eq=False, repr=False)
class Photo:
    """A photo as a method may know it; its true pose is not here.

    Attributes
    ----------
    id : str
        ``scene/name``, as prediction files have it.
    name : str
        The file's name relative to the folder of photos, such as ``DJI_0018.JPG``.
    path : Path
        The file.
    prior : Pose or None
        By the photo's own GPS and gimbal angles; None where it has none.
    conditions : mapping of str to str
        Such as weather and time of day. What is a number (altitude, pitch) is left out: it comes
        from the true pose.
    """

    id: str
    name: str
    path: Path
    prior: Pose | None
    conditions: Mapping[str, str]
    _camera: Camera | None

    @property
    def camera(self) -> Camera:
        """The camera of the photo."""
        if self._camera is None:
            raise BenchmarkError(f"the camera of {self.id} is not known", where=self.path)
        return self._camera

    @property
    def image(self) -> NDArray[np.uint8]:
        """The photo (H, W, 3) at full size, read now; see `read`."""
        return self.read()

    def read(self, long_side_px: int | None = None) -> NDArray[np.uint8]:
        """Read the photo in colour."""
        size = photo_size(self.path)
        if self._camera is not None and size != (self._camera.width, self._camera.height):
            raise BenchmarkError(
                f"the photo is {size[0]} x {size[1]} px",
                where=self.path,
                expected=f"{self._camera.width} x {self._camera.height} px, the size of its camera",
            )
        return read_rgb_photo(self.path, long_side_px or max(size))

    def __repr__(self) -> str:
        return f"Photo({self.id!r})"


@dataclass(frozen=True, eq=False)
class Photos:
    """Photos by row, made of columns from which the true poses have been taken out."""

    ids: list[str]
    names: list[str]
    folder: Path
    conditions: dict[str, list[str]]
    cameras: Cameras | None
    priors: dict[int, Poses]

    @classmethod
    def of(cls, table: pd.DataFrame, folder: Path) -> Photos:
        """Take from a scene's table of photos what a method may know."""
        # Numbers, such as altitude and pitch, were computed from the true poses.
        conditions = conditions_of(table).select_dtypes(exclude="number")
        return cls(
            table["id"].tolist(),
            table["image"].tolist(),
            folder,
            {str(name): conditions[name].astype(str).tolist() for name in conditions},
            cameras_of(table) if set(CAMERA_COLUMNS) <= set(table.columns) else None,
            _priors(table),
        )

    def __len__(self) -> int:
        return len(self.ids)

    def photo(self, row: int) -> Photo:
        """Return one photo."""
        name, prior = self.names[row], self.priors.get(row)
        return Photo(
            self.ids[row],
            name,
            self.folder / name,
            None if prior is None else Pose(prior),
            {key: values[row] for key, values in self.conditions.items()},
            None if self.cameras is None else Camera(self.cameras.take(row)),
        )


def _priors(table: pd.DataFrame) -> dict[int, Poses]:
    """Return the priors by row, of the photos that have one."""
    if not set(PRIOR_COLUMNS) <= set(table.columns):
        return {}
    there = np.isfinite(table[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    poses = poses_of(table[there], PRIOR_COLUMNS)
    return {int(row): poses.take(index) for index, row in enumerate(np.flatnonzero(there))}

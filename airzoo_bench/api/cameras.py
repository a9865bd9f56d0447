"""The camera of one photo, and where it is by the photo's own metadata."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses

__all__ = ["Camera", "Pose"]


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
        """Return the rays (M, 3) of pixels (M, 2): unit vectors of the camera frame.

        The distortion is undone; NaN beyond the range of the lens model.

        Examples
        --------
        >>> matrix = [[[80.0, 0.0, 50.0], [0.0, 80.0, 30.0], [0.0, 0.0, 1.0]]]
        >>> camera = Camera(Cameras.from_matrices(matrix, 100, 60))
        >>> camera
        Camera(100 x 60 px, focal 80.0, 80.0 px)
        >>> camera.rays([[50.0, 30.0], [110.0, 30.0]])
        array([[0. , 0. , 1. ],
               [0.6, 0. , 0.8]])
        """
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

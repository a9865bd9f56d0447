"""Camera poses: world-to-camera, OpenCV axes, x_cam = R X + t, centre C = -R^T t."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats, apply_matrix, refuse_cameras, transposed
from airzoo_bench.geometry.rotations import (
    check_rotations,
    matrix_to_quaternion,
    quaternion_to_matrix,
    unit_quaternion_to_matrix,
)

__all__ = [
    "FARTHEST",
    "Poses",
    "camera_to_world",
    "rays_to_world",
    "world_to_camera",
]

# Steps of poses in a truth: quaternions to 1e-9, centres to 0.1 mm.
_QUATERNION_DECIMALS = 9
_CENTRE_DECIMALS = 4
FARTHEST = 1e12
"""No coordinate of a pose is larger, in metres: squares of what is far beyond it overflow."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """Poses of N cameras, as rotation and centre.

    The centre is stored and t derived, not the other way round: with centres in projected
    coordinates (millions of metres) R X + t is a small difference of large numbers, R (X - C) is
    not, and a centre given is a centre kept, to the last bit. Build with `from_centres`,
    `from_translations` or `from_quaternions`, which check; the fields are by keyword only, so that
    t is never taken for C.

    Parameters
    ----------
    rotation : (N, 3, 3) array
        World-to-camera rotations.
    centres : (N, 3) array
        Camera centres in world coordinates.
    """

    rotation: Floats
    centres: Floats

    @classmethod
    def from_centres(
        cls, R: ArrayLike, C: ArrayLike, names: Sequence[object] | None = None
    ) -> Poses:
        """Build poses from rotations (N, 3, 3) and camera centres (N, 3), kept exactly.

        Parameters
        ----------
        R : (N, 3, 3) array
            World-to-camera rotations.
        C : (N, 3) array
            Camera centres in world coordinates.
        names : sequence of N, optional
            Names of the cameras for messages.

        Returns
        -------
        Poses
            With the nearest exact rotations.

        Raises
        ------
        CameraError
            See `check_rotations`; centres of another shape or not finite.
        """
        rotation = check_rotations(R, names)
        return cls(rotation=rotation, centres=_vectors("centres", C, len(rotation), names))

    @classmethod
    def from_translations(
        cls, R: ArrayLike, t: ArrayLike, names: Sequence[object] | None = None
    ) -> Poses:
        """Build poses from rotations (N, 3, 3) and translations (N, 3) of x_cam = R X + t.

        Parameters
        ----------
        R : (N, 3, 3) array
            World-to-camera rotations.
        t : (N, 3) array
            In the units of the world.
        names : sequence of N, optional
            Names of the cameras for messages.

        Returns
        -------
        Poses
            With centres -R^T t.

        Raises
        ------
        CameraError
            See `check_rotations`; translations of another shape or not finite.
        """
        rotation = check_rotations(R, names)
        translation = _vectors("translations", t, len(rotation), names)
        return cls(rotation=rotation, centres=-apply_matrix(transposed(rotation), translation))

    @classmethod
    def from_quaternions(
        cls, wxyz: ArrayLike, t: ArrayLike, names: Sequence[object] | None = None
    ) -> Poses:
        """Build poses from world-to-camera quaternions (N, 4) w x y z and translations (N, 3).

        Parameters
        ----------
        wxyz : (N, 4) array
            World-to-camera, of unit norm to 1e-3.
        t : (N, 3) array
            Of x_cam = R X + t.
        names : sequence of N, optional
            Names of the cameras for messages.

        Returns
        -------
        Poses
            With centres -R^T t.

        Raises
        ------
        CameraError
            See `quaternion_to_matrix`; translations of another shape or not finite.
        """
        return cls.from_translations(quaternion_to_matrix(wxyz, names), t, names)

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def translation(self) -> Floats:
        """Translations t = -R C, (N, 3)."""
        return -apply_matrix(self.rotation, self.centres)

    def take(self, index: Any) -> Poses:
        """Return the poses at an integer, index array, mask or slice, as Poses.

        Parameters
        ----------
        index : int, slice or array
            Of integers, or a mask (N,).

        Returns
        -------
        Poses
            One for an integer.
        """
        rows = np.atleast_1d(np.arange(len(self))[index])
        return Poses(rotation=self.rotation[rows], centres=self.centres[rows])

    def rounded(self) -> Poses:
        """Return the poses as a truth holds them, the same on every machine.

        Sines, PROJ and BLAS differ in the last bit from one processor to another. The three
        smaller numbers of each quaternion are rounded to 1e-9, and the largest follows from unit
        norm, so that a second rounding changes nothing; centres are rounded to 0.1 mm. NaN stays.

        Returns
        -------
        Poses
            Of which `rounded` is the same.
        """
        quaternions = np.round(matrix_to_quaternion(self.rotation), _QUATERNION_DECIMALS)
        each = np.arange(len(quaternions))
        largest = np.argmax(np.abs(quaternions), axis=1)
        sign = np.where(quaternions[each, largest] < 0.0, -1.0, 1.0)
        quaternions[each, largest] = 0.0
        rest = 1.0 - (quaternions * quaternions).sum(axis=1)
        quaternions[each, largest] = sign * np.sqrt(rest)
        # Adding 0 makes a negative zero positive.
        centres = np.round(self.centres, _CENTRE_DECIMALS) + 0.0
        return Poses(rotation=unit_quaternion_to_matrix(quaternions + 0.0), centres=centres)


def rays_to_world(poses: Poses, rays: Floats) -> Floats:
    """Turn directions of the camera frame (N, M, 3) into world directions R^T d, (N, M, 3).

    Parameters
    ----------
    poses : Poses
        N poses.
    rays : (N, M, 3) array
        x right, y down, z forward.

    Returns
    -------
    (N, M, 3) array
        Of the same lengths.
    """
    return apply_matrix(transposed(poses.rotation)[:, None], rays)


def world_to_camera(poses: Poses, points: Floats) -> Floats:
    """Take world points (N, M, 3) into the camera frame, R (X - C), (N, M, 3).

    Parameters
    ----------
    poses : Poses
        N poses.
    points : (N, M, 3) array
        World coordinates.

    Returns
    -------
    (N, M, 3) array
        x right, y down, z forward.
    """
    return apply_matrix(poses.rotation[:, None], points - poses.centres[:, None])


def camera_to_world(poses: Poses, points_cam: Floats) -> Floats:
    """Take points of the camera frame (N, M, 3) into the world, R^T x + C, (N, M, 3).

    Parameters
    ----------
    poses : Poses
        N poses.
    points_cam : (N, M, 3) array
        x right, y down, z forward.

    Returns
    -------
    (N, M, 3) array
        World coordinates.
    """
    return rays_to_world(poses, points_cam) + poses.centres[:, None]


def _vectors(what: str, value: ArrayLike, count: int, names: Sequence[object] | None) -> Floats:
    vectors = np.array(value, dtype=np.float64)
    if vectors.shape != (count, 3):
        raise CameraError(f"{what} have shape {vectors.shape}", expected=f"shape ({count}, 3)")
    bad = ~np.isfinite(vectors).all(axis=1)
    refuse_cameras(bad, f"{what} have NaN or infinite entries", names=names)
    beyond = (np.abs(vectors) > FARTHEST).any(axis=1)
    refuse_cameras(
        beyond,
        f"{what} have entries beyond {FARTHEST:g}",
        names=names,
        expected="coordinates of the scene's CRS",
    )
    return vectors

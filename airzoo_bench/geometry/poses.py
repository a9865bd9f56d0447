"""Camera poses: world-to-camera, OpenCV axes, x_cam = R X + t, centre C = -R^T t."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Floats, apply_matrix, multiply, refuse_cameras
from airzoo_bench.geometry.rotations import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    unit_quaternion_to_matrix,
)

__all__ = [
    "FARTHEST",
    "Poses",
    "camera_to_world",
    "check_rotations",
    "rays_to_world",
    "rotation_angle_deg",
    "world_to_camera",
]

_ROTATION_TOLERANCE = 1e-4
# From within the tolerance the error goes 1e-4, 1e-8, 1e-16: the third step only tidies up.
_NEWTON_STEPS = 3
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
        return cls(rotation=rotation, centres=-apply_matrix(_transposed(rotation), translation))

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


def check_rotations(
    R: ArrayLike, names: Sequence[object] | None = None, where: object = None
) -> Floats:
    """Refuse matrices that do not rotate, and return the nearest exact rotations.

    Parameters
    ----------
    R : (N, 3, 3) array
        World-to-camera, or any other rotations.
    names : sequence of N, optional
        Names of the cameras for messages.
    where : object, optional
        The file the rotations are from.

    Returns
    -------
    (N, 3, 3) array
        The nearest orthonormal matrices (Frobenius), the polar factors, so that digits rounded
        away in a file do not scale or shear the geometry. Found by Newton-Schulz steps
        R (3 I - R^T R) / 2 (Higham, Functions of Matrices, 2008, equation 8.20), written out, since
        LAPACK's rounding depends on the processor.

    Raises
    ------
    CameraError
        Another shape, entries not finite, |R^T R - I| above 1e-4 in any entry, or a reflection
        (det < 0). The first three cameras are named with how far they are off.
    """
    matrices = np.asarray(R, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3):
        raise CameraError(
            f"rotations have shape {matrices.shape}", where=where, expected="shape (N, 3, 3)"
        )
    not_finite = ~np.isfinite(matrices).all(axis=(1, 2))
    refuse_cameras(not_finite, "rotation has NaN or infinite entries", names=names, where=where)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(multiply(_transposed(matrices), matrices) - np.eye(3)).max(axis=(1, 2))
    refuse_cameras(
        ~(off <= _ROTATION_TOLERANCE),
        "rotation is not orthonormal",
        names=names,
        details=[f"|R^T R - I| = {value:.2g}" for value in off],
        where=where,
        expected=f"|R^T R - I| <= {_ROTATION_TOLERANCE:g} in every entry",
    )
    determinant = np.linalg.det(matrices)
    refuse_cameras(
        determinant < 0.0,
        "rotation is a reflection",
        names=names,
        details=[f"det = {value:.3g}" for value in determinant],
        where=where,
        expected="det = +1",
        fix="check the axes: exactly one of them points the wrong way",
    )
    for _ in range(_NEWTON_STEPS):
        matrices = (
            multiply(matrices, 3.0 * np.eye(3) - multiply(_transposed(matrices), matrices)) / 2.0
        )
    return matrices


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
    return apply_matrix(_transposed(poses.rotation)[:, None], rays)


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


def rotation_angle_deg(Ra: ArrayLike, Rb: ArrayLike) -> Floats:
    """Geodesic angle between rotations, in degrees.

    atan2 of sine (the skew part of Ra Rb^T) and cosine (its trace): unlike arccos of the trace, it
    keeps all digits near 0 and near 180 degrees.

    Parameters
    ----------
    Ra, Rb : (..., 3, 3) array
        Rotations; leading dimensions broadcast.

    Returns
    -------
    (...) array
        0 to 180; NaN where a rotation is NaN.
    """
    inverse = _transposed(np.asarray(Rb, dtype=np.float64))
    relative = multiply(np.asarray(Ra, dtype=np.float64), inverse)
    skew = relative - _transposed(relative)
    x, y, z = skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = np.trace(relative, axis1=-2, axis2=-1) - 1.0
    return np.asarray(np.degrees(np.arctan2(sine, cosine)), dtype=np.float64)


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, -1, -2)


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

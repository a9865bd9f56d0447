"""Camera poses and rotations: world-to-camera, OpenCV axes, x_cam = R X + t, centre C = -R^T t.

Gimbal angles are DJI's: yaw, then pitch, then roll turn a camera that looks north at the horizon
about its own axes down, right and forward (z-y-x in north-east-down). Yaw 0 is true north,
clockwise positive; pitch 0 is the horizon, -90 nadir; roll is clockwise, as seen by the camera.
The world is then a projected CRS: x east, y north on its grid, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import (
    Bools,
    Floats,
    apply_matrix,
    multiply,
    refuse_cameras,
    transpose,
)
from airzoo_bench.geometry.cameras import Cameras, back_project

# Steps of poses in a truth: quaternions to 1e-9, centres to 0.1 mm.
_QUATERNION_DECIMALS = 9
_CENTRE_DECIMALS = 4
FARTHEST = 1e12
"""No coordinate of a pose is larger, in metres: squares of what is far beyond it overflow."""

_QUATERNION_TOLERANCE = 1e-3
_ROTATION_TOLERANCE = 2e-4  # entries of four decimals are off by up to 1.7e-4
# From within the tolerance the error goes 2e-4, 3e-8, 7e-16: the third step only tidies up.
_NEWTON_STEPS = 3
# Within this (rad) of straight down or up yaw and roll turn about one axis: with rounding at 1e-16
# they could not be told apart to better than 1e-8.
_LOCKED = 1e-8


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """Poses of N cameras: world-to-camera rotations (N, 3, 3) and centres (N, 3) in the world.

    The centre is stored and t derived, not the other way round: with centres in projected
    coordinates (millions of metres) R X + t is a small difference of large numbers, R (X - C) is
    not, and a centre given is a centre kept, to the last bit. Build with `from_centres` or
    `from_translations`, which raise CameraError, with the cameras' names, for invalid poses; the
    fields are by keyword only, so that t is never taken for C.
    """

    rotation: Floats
    centres: Floats

    @classmethod
    def from_centres(
        cls, R: ArrayLike, C: ArrayLike, names: Sequence[object] | None = None
    ) -> Poses:
        """Build poses from rotations (N, 3, 3) and camera centres (N, 3), which stay as they are.

        The rotations become the nearest exact ones, see `check_rotations`.
        """
        rotation = check_rotations(R, names)
        return cls(rotation=rotation, centres=_vectors("centres", C, len(rotation), names))

    @classmethod
    def from_translations(
        cls, R: ArrayLike, t: ArrayLike, names: Sequence[object] | None = None
    ) -> Poses:
        """Build poses from rotations (N, 3, 3) and translations (N, 3) of x_cam = R X + t."""
        rotation = check_rotations(R, names)
        translation = _vectors("translations", t, len(rotation), names)
        return cls(rotation=rotation, centres=-apply_matrix(transpose(rotation), translation))

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def translation(self) -> Floats:
        """Translations t = -R C, (N, 3)."""
        return -apply_matrix(self.rotation, self.centres)

    def take(self, index: Any) -> Poses:
        """Return the poses at an integer, index array, mask or slice, as Poses."""
        rows = np.atleast_1d(np.arange(len(self))[index])
        return Poses(rotation=self.rotation[rows], centres=self.centres[rows])

    def rounded(self) -> Poses:
        """Return the poses as a truth holds them, the same on every machine.

        Sines, PROJ and BLAS differ in the last bit from one processor to another. The three
        smaller numbers of each quaternion are rounded to 1e-9, and the largest follows from unit
        norm, so that a second rounding changes little; centres are rounded to 0.1 mm. NaN stays.
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
    """Turn directions (N, M, 3) of the camera frame into world directions R^T d."""
    return apply_matrix(transpose(poses.rotation)[:, None], rays)


def world_to_camera(poses: Poses, points: Floats) -> Floats:
    """Take world points (N, M, 3) into the camera frame, R (X - C)."""
    return apply_matrix(poses.rotation[:, None], points - poses.centres[:, None])


def camera_to_world(poses: Poses, points_cam: Floats) -> Floats:
    """Take points (N, M, 3) of the camera frame into the world, R^T x + C."""
    return rays_to_world(poses, points_cam) + poses.centres[:, None]


def depth_to_points(
    depth: Floats, chosen: Bools, camera: Cameras, pose: Poses, *, along_ray: bool = False
) -> Floats:
    """Back-project chosen pixels of a depth map (H, W) to world points (N, 3), row by row.

    Depth runs along the optical axis, or along the ray from the camera's centre; camera and pose
    have length 1.
    """
    rows, columns = np.nonzero(chosen)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=-1)
    rays = back_project(camera, pixels[None])[0]
    if not along_ray:
        rays = rays / rays[:, 2:]
    points = rays * depth[rows, columns][:, None]
    world: Floats = camera_to_world(pose, points[None])[0]
    return world


def check_rotations(
    R: ArrayLike, names: Sequence[object] | None = None, where: object = None
) -> Floats:
    """Return the nearest rotations (N, 3, 3); raise CameraError for matrices that do not rotate.

    The nearest orthonormal matrices (Frobenius) are the polar factors; with them, digits rounded
    away in a file do not scale or shear the geometry. Found by Newton-Schulz steps
    R (3 I - R^T R) / 2 (Higham, Functions of Matrices, 2008, equation 8.20), written out, since
    LAPACK's rounding depends on the processor.
    """
    matrices = np.asarray(R, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3):
        raise CameraError(
            f"rotations have shape {matrices.shape}", where=where, expected="shape (N, 3, 3)"
        )
    named: Any = {"names": names, "where": where}
    bad = ~np.isfinite(matrices).all(axis=(1, 2))
    refuse_cameras(bad, "rotation has NaN or infinite entries", **named)
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(multiply(transpose(matrices), matrices) - np.eye(3)).max(axis=(1, 2))
    said, bad = [f"|R^T R - I| = {value:.2g}" for value in off], ~(off <= _ROTATION_TOLERANCE)
    expected = f"|R^T R - I| <= {_ROTATION_TOLERANCE:g} in every entry"
    refuse_cameras(bad, "rotation is not orthonormal", details=said, expected=expected, **named)
    determinant = np.linalg.det(matrices)
    said = [f"det = {value:.3g}" for value in determinant]
    named |= {"expected": "det = +1", "fix": "check the axes: one of them points the wrong way"}
    refuse_cameras(determinant < 0.0, "rotation is a reflection", details=said, **named)
    for _ in range(_NEWTON_STEPS):
        rest = 3.0 * np.eye(3) - multiply(transpose(matrices), matrices)
        matrices = multiply(matrices, rest) / 2.0
    return matrices


def rotation_angle_deg(Ra: ArrayLike, Rb: ArrayLike) -> Floats:
    """Return the geodesic angle between rotations (..., 3, 3), 0 to 180 degrees; NaN stays NaN.

    atan2 of sine (the skew part of Ra Rb^T) and cosine (its trace): unlike arccos of the trace, it
    keeps all digits near 0 and near 180 degrees.
    """
    inverse = transpose(np.asarray(Rb, dtype=np.float64))
    relative = multiply(np.asarray(Ra, dtype=np.float64), inverse)
    skew = relative - transpose(relative)
    x, y, z = skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = np.trace(relative, axis1=-2, axis2=-1) - 1.0
    return np.asarray(np.degrees(np.arctan2(sine, cosine)), dtype=np.float64)


def quaternion_to_matrix(wxyz: ArrayLike, names: Sequence[object] | None = None) -> Floats:
    """Turn quaternions (N, 4) w x y z, of unit norm to 1e-3, into rotations (N, 3, 3)."""
    quaternions = np.asarray(wxyz, dtype=np.float64)
    if quaternions.ndim != 2 or quaternions.shape[1] != 4:
        raise CameraError(f"quaternions have shape {quaternions.shape}", expected="shape (N, 4)")
    with np.errstate(over="ignore"):  # an infinite norm is not 1
        norm = np.sqrt((quaternions * quaternions).sum(axis=1))
    bad, said = (
        ~(np.abs(norm - 1.0) <= _QUATERNION_TOLERANCE),
        [f"norm = {one:.6g}" for one in norm],
    )
    expected = f"w x y z with norm 1 to {_QUATERNION_TOLERANCE:g}"
    what = "quaternion is not of unit norm"
    refuse_cameras(bad, what, names=names, details=said, expected=expected)
    return unit_quaternion_to_matrix(quaternions / norm[:, None])


def unit_quaternion_to_matrix(wxyz: Floats) -> Floats:
    """Turn quaternions (N, 4) w x y z of exactly unit norm into rotations (N, 3, 3)."""
    w, x, y, z = wxyz.T
    entries = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(entries), -1, 0)


def matrix_to_quaternion(R: ArrayLike) -> Floats:
    """Turn rotation matrices (N, 3, 3) into unit quaternions (N, 4) w x y z with w >= 0.

    Of the four rows of 4 q q^T (Shepperd 1978) the one with the largest diagonal is taken, which
    never divides by a small number.
    """
    m = np.moveaxis(np.asarray(R, dtype=np.float64), 0, -1)
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    ww = 1.0 + m[0, 0] + m[1, 1] + m[2, 2]
    xx = 1.0 + m[0, 0] - m[1, 1] - m[2, 2]
    yy = 1.0 - m[0, 0] + m[1, 1] - m[2, 2]
    zz = 1.0 - m[0, 0] - m[1, 1] + m[2, 2]
    outer = np.array(((ww, wx, wy, wz), (wx, xx, xy, xz), (wy, xy, yy, yz), (wz, xz, yz, zz)))
    largest = np.argmax(np.array((ww, xx, yy, zz)), axis=0)
    row = outer[largest, :, np.arange(len(largest))]
    row = np.where(row[:, :1] < 0.0, -row, row)
    unit: Floats = row / np.sqrt((row * row).sum(axis=1, keepdims=True))
    return unit


def angles_to_rotations(
    yaw_deg: ArrayLike, pitch_deg: ArrayLike, roll_deg: ArrayLike, *, convergence_deg: ArrayLike
) -> Floats:
    """Turn gimbal angles (...) into world-to-camera rotations (..., 3, 3).

    The convergence is `crs.grid_convergence_deg`, or 0 where yaw is relative to the grid's north.
    """
    given = (np.asarray(yaw_deg) - np.asarray(convergence_deg), pitch_deg, roll_deg)
    yaw, pitch, roll = np.broadcast_arrays(*(np.radians(np.asarray(a, float)) for a in given))
    (sy, cy), (sp, cp), (sr, cr) = ((np.sin(a), np.cos(a)) for a in (yaw, pitch, roll))
    forward = (cp * sy, cp * cy, sp)
    right = (sr * sp * sy + cr * cy, sr * sp * cy - cr * sy, -sr * cp)
    down = (cr * sp * sy - sr * cy, cr * sp * cy + sr * sy, -cr * cp)
    return np.moveaxis(np.array((right, down, forward)), (0, 1), (-2, -1))


def rotations_to_angles(R: ArrayLike, *, convergence_deg: ArrayLike) -> Floats:
    """Turn world-to-camera rotations (..., 3, 3) into gimbal angles (..., 3) yaw, pitch, roll.

    Yaw and roll lie in [-180, 180). Looking straight down or up, roll is 0 and yaw takes the whole
    turn.
    """
    rotation = np.asarray(R, dtype=np.float64)
    right, down, forward = (rotation[..., row, :] for row in range(3))
    level = np.hypot(forward[..., 0], forward[..., 1])
    locked = level < _LOCKED
    pitch = np.arctan2(forward[..., 2], level)
    roll = np.where(locked, 0.0, np.arctan2(-right[..., 2], -down[..., 2]))
    free = np.arctan2(forward[..., 0], forward[..., 1])
    yaw = np.where(locked, np.arctan2(-right[..., 1], right[..., 0]), free)
    grid = np.degrees(yaw) + np.asarray(convergence_deg, dtype=np.float64)
    around = (grid + 180.0) % 360.0 - 180.0
    return np.stack(np.broadcast_arrays(around, np.degrees(pitch), np.degrees(roll)), axis=-1)


def _vectors(what: str, value: ArrayLike, count: int, names: Sequence[object] | None) -> Floats:
    vectors = np.array(value, dtype=np.float64)
    if vectors.shape != (count, 3):
        raise CameraError(f"{what} have shape {vectors.shape}", expected=f"shape ({count}, 3)")
    bad = ~np.isfinite(vectors).all(axis=1)
    refuse_cameras(bad, f"{what} have NaN or infinite entries", names=names)
    beyond, said = (np.abs(vectors) > FARTHEST).any(axis=1), f"entries beyond {FARTHEST:g}"
    expected = "coordinates of the scene's CRS"
    refuse_cameras(beyond, f"{what} have {said}", names=names, expected=expected)
    return vectors

"""Calibrated cameras: intrinsics, lens, projection and back-projection.

Pixel centres sit at integer + 0.5: the image's corner is (0, 0) and its far corner (width, height).
Camera axes are OpenCV's: x right, y down, z forward.

Lens distortion is Brown-Conrady's with OpenCV's coefficients k1 k2 p1 p2 k3 (``calib3d``). For
points on the plane z = 1, with s = x^2 + y^2 and radial = 1 + k1 s + k2 s^2 + k3 s^3:

    x_d = x radial + 2 p1 x y + p2 (s + 2 x^2)
    y_d = y radial + p1 (s + 2 y^2) + 2 p2 x y

The model is a polynomial: far enough from the axis most sets of coefficients fold back, and two
rays meet one pixel. A point is in the *range* of the model while it is nearer to the axis than the
first turning point of r radial(r^2) and the Jacobian is positive definite there; in the range the
map is one to one. (The Jacobian is symmetric: the distortion is the gradient of a function.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, refuse_cameras

# Entries of K that should be 0 or 1 may be off by this much: far below any effect on a pixel.
_K_TOLERANCE = 1e-9
# Beyond these no camera is, and squares of rays overflow.
_LEAST_FOCAL_PX, _LARGEST_PX = 1e-6, 1e12
# Residual of undistorted points, relative to 1 + their size; Newton steps; points at a time.
_TOLERANCE = 1e-12
_MAX_STEPS = 100
_BLOCK = 1 << 18


@dataclass(frozen=True, eq=False)
class Cameras:
    """Intrinsics of N cameras.

    Attributes
    ----------
    width, height : (N,) int64 array
        Image size in pixels.
    focal, principal_point : (N, 2) array
        fx, fy and cx, cy in pixels.
    distortion : (N, 5) array
        k1 k2 p1 p2 k3, OpenCV's order; zeros make a pinhole.
    """

    width: Ints
    height: Ints
    focal: Floats
    principal_point: Floats
    distortion: Floats

    @classmethod
    def from_matrices(
        cls,
        K: ArrayLike,
        width: ArrayLike,
        height: ArrayLike,
        distortion: ArrayLike | None = None,
        names: Sequence[object] | None = None,
    ) -> Cameras:
        """Build cameras from calibration matrices (N, 3, 3); raise CameraError where one is none.

        Width and height are (N,) or scalars; the distortion is (N, 4) k1 k2 p1 p2 or (N, 5).
        """
        matrices = np.asarray(K, dtype=np.float64)
        count = len(matrices) if matrices.ndim else 0
        if matrices.shape != (count, 3, 3):
            raise CameraError(f"K has shape {matrices.shape}", expected=f"shape {(count, 3, 3)}")
        _check_matrices(matrices, names)
        return cls(
            width=_sizes("width", width, count, names),
            height=_sizes("height", height, count, names),
            focal=matrices[:, (0, 1), (0, 1)],
            principal_point=matrices[:, :2, 2].copy(),
            distortion=_distortion(distortion, count, names),
        )

    def __len__(self) -> int:
        return len(self.focal)

    @property
    def matrices(self) -> Floats:
        """Calibration matrices K, (N, 3, 3)."""
        matrices = np.tile(np.eye(3), (len(self), 1, 1))
        matrices[:, (0, 1), (0, 1)] = self.focal
        matrices[:, :2, 2] = self.principal_point
        return matrices

    def take(self, index: Any) -> Cameras:
        """Return the cameras at an integer, index array, mask or slice, as Cameras."""
        rows = np.atleast_1d(np.arange(len(self))[index])
        return Cameras(*(values[rows] for values in vars(self).values()))


def project(cameras: Cameras, points_cam: Floats) -> Floats:
    """Project points (N, M, 3) of the camera frame to pixels (N, M, 2), also outside the image.

    NaN where the point has no image: z <= 0, or outside the range of the lens model, where the
    polynomial would fold it back into the image. One camera broadcasts over all points.
    """
    z = points_cam[..., 2:]
    with np.errstate(over="ignore", invalid="ignore"):
        xy = points_cam[..., :2] / np.where(z > 0.0, z, np.nan)
        k = cameras.distortion[:, None]
        seen = _in_range(xy, k, _range_limit(cameras.distortion)[:, None])
        distorted = distort(xy, k)
        pixels = distorted * cameras.focal[:, None] + cameras.principal_point[:, None]
    return np.where(seen[..., None], pixels, np.nan)


def back_project(cameras: Cameras, pixels: Floats) -> Floats:
    """Turn pixels (N, M, 2) into unit rays (N, M, 3) of the camera frame, distortion undone.

    NaN for pixels beyond the range of the lens model. One camera broadcasts over all pixels.
    """
    distorted = (pixels - cameras.principal_point[:, None]) / cameras.focal[:, None]
    xy = undistort(distorted, cameras.distortion)
    x, y = xy[..., 0], xy[..., 1]
    norm = np.sqrt(x * x + y * y + 1.0)
    return np.stack((x / norm, y / norm, 1.0 / norm), axis=-1)


def anchor_pixels(cameras: Cameras, inset: float = 1 / 16) -> Floats:
    """Return the anchor pixels (N, 4, 2) of the retrieval truth: top left, then clockwise.

    The inset from the border is a share of width and height; 0 gives the image's corners.
    """
    near, far = inset, 1.0 - inset
    share = np.array([(near, near), (far, near), (far, far), (near, far)])
    anchors: Floats = share * np.stack((cameras.width, cameras.height), axis=-1)[:, None]
    return anchors


def distort(xy: Floats, k: Floats) -> Floats:
    """Distort points (..., 2) by coefficients (..., 5), also outside the range of the model."""
    (x, y), (k1, k2, p1, p2, k3) = np.moveaxis(xy, -1, 0), np.moveaxis(k, -1, 0)
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    x_d = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)
    y_d = y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack((x_d, y_d), axis=-1)


def undistort(xy: Floats, distortion: Floats) -> Floats:
    """Find the points of the range that `distort` takes to `xy`; NaN where there is none.

    Damped Newton steps from the axis with the analytic Jacobian, until the residual is below
    1e-12 (times 1 + max(|x|, |y|)).
    """
    count = max(len(xy), len(distortion))
    target = np.broadcast_to(xy, (count, *xy.shape[1:]))
    if not distortion.any():
        return np.where(np.isfinite(target).all(axis=-1, keepdims=True), target, np.nan)
    flat = target.reshape(-1, 2)
    camera = np.zeros(len(flat), np.int64)
    if len(distortion) > 1:
        camera = np.repeat(np.arange(count), target.shape[1])
    limit = _range_limit(distortion)
    solved = np.empty_like(flat)
    for start in range(0, len(flat), _BLOCK):
        part = slice(start, start + _BLOCK)
        # A step from near the fold may go very far; it is refused by its residual.
        with np.errstate(over="ignore", invalid="ignore"):
            solved[part] = _newton(flat[part], distortion[camera[part]], limit[camera[part]])
    return solved.reshape(target.shape)


def _newton(target: Floats, coefficients: Floats, limit: Floats) -> Floats:
    """Solve model(xy) = target (P, 2) for each row; NaN where the steps do not get there."""
    solved = np.full(target.shape, np.nan)
    todo = np.flatnonzero(np.isfinite(target).all(axis=-1))
    xy = np.zeros((len(todo), 2))
    residual = target[todo]
    damping = np.ones(len(todo))
    tolerance = _TOLERANCE * (1.0 + np.abs(target).max(axis=-1))
    for _ in range(_MAX_STEPS):
        open_ = np.abs(residual).max(axis=-1) > tolerance[todo]
        solved[todo[~open_]] = xy[~open_]
        todo, xy, residual, damping = todo[open_], xy[open_], residual[open_], damping[open_]
        if not todo.size:
            break
        k = coefficients[todo]
        (xx, xy_, yy), (x, y) = _jacobian(xy, k), residual.T
        steps = np.stack((yy * x - xy_ * y, xx * y - xy_ * x), axis=-1)
        trial = xy + damping[:, None] * (steps / (xx * yy - xy_ * xy_)[:, None])
        new = target[todo] - distort(trial, k)
        better = _in_range(trial, k, limit[todo])
        better &= np.hypot(*new.T) < np.hypot(*residual.T)
        xy = np.where(better[:, None], trial, xy)
        residual = np.where(better[:, None], new, residual)
        damping = np.where(better, np.minimum(1.0, 2.0 * damping), 0.5 * damping)
    return solved


def _jacobian(xy: Floats, k: Floats) -> tuple[Floats, Floats, Floats]:
    """Return d x_d/dx, d x_d/dy (= d y_d/dx) and d y_d/dy."""
    (x, y), (k1, k2, p1, p2, k3) = np.moveaxis(xy, -1, 0), np.moveaxis(k, -1, 0)
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xx, x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y, yy


def _in_range(xy: Floats, k: Floats, limit: Floats) -> Bools:
    """Tell which undistorted points (...) lie where the model is one to one."""
    (xx, xy_, yy), (x, y) = _jacobian(xy, k), np.moveaxis(xy, -1, 0)
    inside: Bools = (x * x + y * y < limit) & (xx + yy > 0.0) & (xx * yy > xy_ * xy_)
    return inside


def _range_limit(distortion: Floats) -> Floats:
    """Return the squared radius (N,) at which r radial(r^2) first turns; infinite without one."""
    companion = np.zeros((len(distortion), 3, 3))
    companion[:, 0, 0] = -3.0 * distortion[:, 0]
    companion[:, 0, 1] = -5.0 * distortion[:, 1]
    companion[:, 0, 2] = -7.0 * distortion[:, 4]
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.abs(roots.imag) <= 1e-7 * np.abs(roots.real)
    inverse = np.where(real & (roots.real > 0.0), roots.real, 0.0).max(axis=-1, initial=0.0)
    with np.errstate(divide="ignore"):
        return 1.0 / np.asarray(inverse, dtype=np.float64)


def _check_matrices(matrices: Floats, names: Sequence[object] | None) -> None:
    focal, entries = matrices[:, (0, 1), (0, 1)], np.abs(matrices).max(axis=(1, 2))
    off = np.abs(matrices[:, 2] - (0.0, 0.0, 1.0)).max(axis=1)
    limits = f"a focal length below {_LEAST_FOCAL_PX:g} px or an entry above {_LARGEST_PX:g}"
    faults = {
        "NaN or infinite entries": ~np.isfinite(matrices).all(axis=(1, 2)),
        "no positive focal length": (focal <= 0.0).any(axis=1),
        limits: (focal < _LEAST_FOCAL_PX).any(axis=1) | (entries > _LARGEST_PX),
        "skew": np.abs(matrices[:, 0, 1]) > _K_TOLERANCE,
        "a non-zero entry in row 2, column 1": np.abs(matrices[:, 1, 0]) > _K_TOLERANCE,
        "a last row other than 0 0 1": off > _K_TOLERANCE,
    }
    expected = "K = [fx 0 cx; 0 fy cy; 0 0 1] with fx, fy > 0, in pixels"
    for fault, bad in faults.items():
        refuse_cameras(bad, f"K has {fault}", names=names, expected=expected)


def _sizes(name: str, value: ArrayLike, count: int, names: Sequence[object] | None) -> Ints:
    sizes = np.broadcast_to(np.asarray(value, dtype=np.float64), (count,))
    whole, what = (sizes > 0.0) & (np.floor(sizes) == sizes) & (sizes < np.inf), f"image {name}"
    expected = "a positive whole number"
    refuse_cameras(~whole, f"{what} is not a size", names=names, expected=expected)
    return sizes.astype(np.int64)


def _distortion(value: ArrayLike | None, count: int, names: Sequence[object] | None) -> Floats:
    full = np.zeros((count, 5))
    if value is None:
        return full
    given = np.asarray(value, dtype=np.float64)
    if given.shape not in ((count, 4), (count, 5)):
        raise CameraError(
            f"distortion has shape {given.shape}",
            expected=f"({count}, 4) k1 k2 p1 p2 or ({count}, 5) k1 k2 p1 p2 k3",
        )
    bad = ~np.isfinite(given).all(axis=1)
    refuse_cameras(bad, "distortion has NaN or infinite coefficients", names=names)
    full[:, : given.shape[1]] = given
    return full

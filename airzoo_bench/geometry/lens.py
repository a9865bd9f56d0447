"""Brown-Conrady lens distortion, coefficients k1 k2 p1 p2 k3 in OpenCV's order.

With s = x^2 + y^2 and radial = 1 + k1 s + k2 s^2 + k3 s^3 (OpenCV, ``calib3d``):

    x_d = x radial + 2 p1 x y + p2 (s + 2 x^2)
    y_d = y radial + p1 (s + 2 y^2) + 2 p2 x y

The model is a polynomial: far enough from the axis most sets of coefficients fold back, and two
rays meet one pixel. A point is in the *range* of the model while it is nearer to the axis than the
first turning point of r radial(r^2) and the Jacobian is positive definite there; in the range the
map is one to one. (The Jacobian is symmetric: the distortion is the gradient of a function.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["distort", "in_range", "undistort"]

_TOLERANCE = 1e-12
_MAX_STEPS = 100
_BLOCK = 1 << 18


def distort(xy: Floats, distortion: Floats) -> Floats:
    """Distort normalised image points; the bare polynomial, also outside its range.

    Parameters
    ----------
    xy : (N, M, 2) array
        Points on the plane z = 1 of the camera frame.
    distortion : (N, 5) array
        k1 k2 p1 p2 k3. N = 1 broadcasts, here and in `xy`.

    Returns
    -------
    (N, M, 2) array
        Points on the same plane, where the lens puts them.
    """
    return np.stack(_model(xy[..., 0], xy[..., 1], _columns(distortion)), axis=-1)


def in_range(xy: Floats, distortion: Floats) -> Bools:
    """Tell which undistorted points lie where the model is one to one.

    Parameters
    ----------
    xy : (N, M, 2) array
        Points on the plane z = 1 of the camera frame.
    distortion : (N, 5) array
        k1 k2 p1 p2 k3.

    Returns
    -------
    (N, M) bool array
        False for points that are not finite.
    """
    limit = _range_limit(distortion)[:, None]
    return _in_range(xy[..., 0], xy[..., 1], _columns(distortion), limit)


def undistort(xy: Floats, distortion: Floats) -> Floats:
    """Undo the distortion: the point of the range that `distort` takes to `xy`.

    Damped Newton steps from the axis with the analytic Jacobian, until the residual is below
    1e-12 (times 1 + max(|x|, |y|)).

    Parameters
    ----------
    xy : (N, M, 2) array
        Distorted points on the plane z = 1.
    distortion : (N, 5) array
        k1 k2 p1 p2 k3. N = 1 broadcasts, here and in `xy`.

    Returns
    -------
    (N, M, 2) array
        NaN for a point that no point of the range is taken to (it lies beyond the fold of the
        model), or where `xy` is not finite.
    """
    count = max(len(xy), len(distortion))
    target = np.broadcast_to(xy, (count, *xy.shape[1:]))
    if not distortion.any():
        return np.where(np.isfinite(target).all(axis=-1, keepdims=True), target, np.nan)
    flat = target.reshape(-1, 2)
    row = np.arange(len(flat)) // max(target.shape[1], 1) if len(distortion) > 1 else None
    limit = _range_limit(distortion)
    solved = np.empty_like(flat)
    for start in range(0, len(flat), _BLOCK):
        part = slice(start, start + _BLOCK)
        camera = np.zeros(len(flat[part]), dtype=np.int64) if row is None else row[part]
        # A step from near the fold may go very far; it is refused by its residual.
        with np.errstate(over="ignore", invalid="ignore"):
            solved[part] = _newton(flat[part], distortion[camera], limit[camera])
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
        k = coefficients[todo].T
        trial = xy + damping[:, None] * _newton_step(xy, residual, k)
        new = target[todo] - np.stack(_model(trial[:, 0], trial[:, 1], k), axis=-1)
        better = _in_range(trial[:, 0], trial[:, 1], k, limit[todo])
        better &= np.hypot(*new.T) < np.hypot(*residual.T)
        xy = np.where(better[:, None], trial, xy)
        residual = np.where(better[:, None], new, residual)
        damping = np.where(better, np.minimum(1.0, 2.0 * damping), 0.5 * damping)
    return solved


def _newton_step(xy: Floats, residual: Floats, k: Sequence[Floats] | Floats) -> Floats:
    xx, xy_, yy = _jacobian(xy[:, 0], xy[:, 1], k)
    determinant = xx * yy - xy_ * xy_
    step_x = (yy * residual[:, 0] - xy_ * residual[:, 1]) / determinant
    step_y = (xx * residual[:, 1] - xy_ * residual[:, 0]) / determinant
    return np.stack((step_x, step_y), axis=-1)


def _model(x: Floats, y: Floats, k: Sequence[Floats] | Floats) -> tuple[Floats, Floats]:
    k1, k2, p1, p2, k3 = k
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    x_d = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x)
    y_d = y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
    return x_d, y_d


def _jacobian(x: Floats, y: Floats, k: Sequence[Floats] | Floats) -> tuple[Floats, Floats, Floats]:
    """Return d x_d/dx, d x_d/dy (= d y_d/dx) and d y_d/dy."""
    k1, k2, p1, p2, k3 = k
    s = x * x + y * y
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xx, x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y, yy


def _in_range(x: Floats, y: Floats, k: Sequence[Floats] | Floats, limit: Floats) -> Bools:
    xx, xy, yy = _jacobian(x, y, k)
    inside: Bools = (x * x + y * y < limit) & (xx + yy > 0.0) & (xx * yy > xy * xy)
    return inside


def _range_limit(distortion: Floats) -> Floats:
    """Squared radius (N,) of the first turning point of r radial(r^2); infinite without one."""
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


def _columns(distortion: Floats) -> list[Floats]:
    """Return the five coefficients as (N, 1) columns, to broadcast over the points."""
    return [distortion[:, None, index] for index in range(5)]

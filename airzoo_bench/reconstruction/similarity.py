"""Similarity transforms, and those that bring points or cameras nearest to their partners."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Bools, Floats, apply_matrix
from airzoo_bench.geometry.poses import Poses

# A width below this share of the largest is rounding: single precision keeps 6e-8 of it.
RANK_TOLERANCE = 1e-6


class AlignmentError(PredictionError):
    """A prediction cannot be brought into the frame of the truth."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """The transform y = scale * rotation (x - origin) + translation.

    With the origin amid the points, projected coordinates of millions of metres keep their last
    bits.
    """

    scale: float
    rotation: Floats
    translation: Floats
    origin: Floats = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def identity(cls) -> Similarity:
        """Return the transform that changes nothing, to the last bit."""
        return cls(1.0, np.eye(3), np.zeros(3))

    @property
    def matrix(self) -> Floats:
        """The (4, 4) matrix, scale times rotation and the translation from origin 0."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.scale * self.rotation
        matrix[:3, 3] = self.apply(np.zeros((1, 3)))[0]
        return matrix

    def apply(self, points: Floats) -> Floats:
        """Transform points (..., 3)."""
        turned = apply_matrix(self.rotation, points - self.origin)
        moved: Floats = self.scale * turned + self.translation
        return moved

    def apply_poses(self, poses: Poses) -> Poses:
        """Transform the world that world-to-camera poses are in."""
        return Poses(rotation=poses.rotation @ self.rotation.T, centres=self.apply(poses.centres))

    def inverse(self) -> Similarity:
        """Return the transform back."""
        return Similarity(1.0 / self.scale, self.rotation.T, self.origin, self.translation)

    def after(self, first: Similarity) -> Similarity:
        """Return the transform that does `first`, then this one."""
        scale, rotation = self.scale * first.scale, self.rotation @ first.rotation
        return Similarity(scale, rotation, self.apply(first.translation), first.origin)


def point_rank(points: Floats, tolerance: float) -> int:
    """Count the dimensions in which points (N, 3) extend: 0 a point, 1 a line, 2 a plane, 3 space.

    A dimension counts where its singular value, about the mean, is above a share (the tolerance) of
    the largest. The largest itself counts where it is above the rounding of the coordinates.
    """
    _, offset = _centred(points)
    # Roots of eigenvalues keep half the digits of a decomposition, and need no BLAS.
    scatter = np.einsum("ni,nj->ij", offset, offset)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[::-1], 0.0))
    rounding = 8.0 * float(np.finfo(np.float64).eps) * np.abs(points).max() * np.sqrt(len(points))
    return 0 if values[0] <= rounding else int((values > tolerance * values[0]).sum())


def umeyama(source: Floats, target: Floats, *, with_scale: bool) -> Similarity:
    """Return the similarity that brings points (N, 3) nearest to their partners, in least squares.

    The points are finite; the scale is 1 where it is not fitted. Fewer than 3 points are refused,
    and points on one line, in either set or in what both have in common: a rotation is left free.

    References
    ----------
    Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    PAMI 13(4), 1991, equations 34 to 42.
    """
    if len(source) < 3:
        raise AlignmentError(f"a similarity needs 3 points, not {len(source)}")
    (found,), (determined,) = fit_many(source[None], target[None], with_scale=with_scale)
    ranks = [point_rank(points, RANK_TOLERANCE) for points in (source, target)]
    for rank, name in zip((*ranks, 1 + determined), ("source", "target", "both"), strict=True):
        if rank < 2:
            raise AlignmentError(
                f"the points of {name} lie on one {'line' if rank else 'point'}, which leaves a "
                "rotation free",
                expected="points that span at least a plane",
            )
    return found


def fit_many(source: Floats, target: Floats, *, with_scale: bool) -> tuple[list[Similarity], Bools]:
    """Fit many sets of points (S, N, 3) as `umeyama` does; say which sets determine their fit."""
    (origin, a), (goal, b) = _centred(source), _centred(target)
    # Not by BLAS, whose sums depend on its threads.
    covariance = np.einsum("sni,snj->sij", b, a) / source.shape[1]
    u, values, vt = np.linalg.svd(covariance)
    last = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    signs = np.stack((np.ones_like(last), np.ones_like(last), last), axis=-1)
    rotation = (u * signs[:, None]) @ vt
    variance = (a * a).sum(axis=(1, 2)) / source.shape[1]
    determined = values[:, 1] > RANK_TOLERANCE**2 * values[:, 0]
    scale = np.ones(len(a))
    if with_scale:
        numerator = (values * signs).sum(axis=1)
        scalable = (numerator > 0.0) & (variance > 0.0)
        scale[scalable] = numerator[scalable] / variance[scalable]
        determined &= scalable
    return list(map(Similarity, scale.tolist(), rotation, goal, origin)), determined


def fit_strips(
    source: Floats, target: Floats, turns: Floats, *, axis_share: float
) -> tuple[list[Similarity], Bools]:
    """Fit many sets of cameras on a line; turns (S, N, 3, 3) fix the rotation about it."""
    (origin, a), (goal, b) = _centred(source), _centred(target)
    squares = (a * a).sum(axis=(1, 2)), (b * b).sum(axis=(1, 2))
    weight = axis_share**2 * np.sqrt(squares[0] * squares[1]) / source.shape[1]
    axes = weight[:, None, None] * turns.sum(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("sni,snj->sij", b, a) + axes)
    u[:, :, 2] *= (np.sign(np.linalg.det(u)) * np.sign(np.linalg.det(vt)))[:, None]
    rotation = u @ vt
    numerator = (b * apply_matrix(rotation[:, None], a)).sum(axis=(1, 2))
    determined = np.asarray((numerator > 0.0) & (squares[0] > 0.0))
    scale = np.ones(len(a))
    scale[determined] = numerator[determined] / squares[0][determined]
    return list(map(Similarity, scale.tolist(), rotation, goal, origin)), determined


def _centred(points: Floats) -> tuple[Floats, Floats]:
    """Split points (..., N, 3) into their mean (..., 3) and the offsets from it."""
    first = points[..., :1, :]
    mean = first + (points - first).mean(axis=-2, keepdims=True)
    return mean[..., 0, :], points - mean

"""Bringing a prediction into the frame of the truth by its cameras.

A similarity is fitted to partner cameras, outliers found by a seeded RANSAC. Samples are of three
cameras, or, on a straight flight strip, whose centres leave the turn about it free, of two and
their orientations. Each sample that is the best so far is refitted to its inliers until they stay,
and trials go on until a better sample is improbable.

References
----------
Fischler and Bolles, Random sample consensus, CACM 24(6), 1981; Chum, Matas, Kittler, Locally
optimized RANSAC, DAGM 2003.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.settings import AlignmentSettings

LEAST_CAMERAS = 3
_BLOCK = 50  # trials that are judged at once; how many are made depends on it
_MOST_REFITS = 100
# A width below this share of the largest is rounding: single precision keeps 6e-8 of it.
_RANK_TOLERANCE = 1e-6


class AlignmentError(PredictionError):
    """A prediction cannot be brought into the frame of the truth."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """The transform y = scale * rotation (x - origin) + translation.

    With the origin amid the points, coordinates of millions of metres keep their last bits.
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
        with np.errstate(over="ignore", invalid="ignore"):  # such points are counted later
            turned = apply_matrix(self.rotation, points - self.origin)
            return np.asarray(self.scale * turned + self.translation)

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


@dataclass(frozen=True, eq=False)
class PosedCameras:
    """N cameras by the names of their images.

    Centres (N, 3) are NaN for a camera without a pose; rotations (N, 3, 3) are world-to-camera in
    OpenCV's axes, None where there are positions only (GPS).
    """

    names: tuple[str, ...]
    centres: Floats
    rotation: Floats | None = None

    def take(self, rows: Ints) -> PosedCameras:
        """Return the cameras at these rows."""
        rotation = None if self.rotation is None else self.rotation[rows]
        return PosedCameras(tuple(self.names[row] for row in rows), self.centres[rows], rotation)


@dataclass(frozen=True, eq=False)
class Alignment:
    """A transform into the frame of the truth, and how well it fits.

    The transform is fitted to the inliers of the `cameras` that have a partner in the truth, or to
    all of them where fewer than 3 agreed, and so it is not `robust`. Residuals (root mean square
    ``rms``, ``median``, ``largest``) are those of all partners, and of the inliers.
    """

    method: str
    transform: Similarity
    cameras: int = 0
    cameras_missing: int = 0
    inlier_names: tuple[str, ...] = ()
    inlier_limit_m: float | None = None
    used_orientations: bool = False
    robust: bool = True
    centres: dict[str, float] | None = None
    inlier_centres: dict[str, float] | None = None
    rotations_deg: dict[str, float] | None = None
    icp: dict[str, Any] | None = None
    icp_failure: str | None = None

    @property
    def inliers(self) -> int:
        """The number of inliers; fewer than 3 are none."""
        return len(self.inlier_names) * self.robust

    @property
    def values(self) -> dict[str, Any]:
        """The content of ``alignment.json``: method, scale, matrix and residuals of a scene."""
        matrix, values = self.transform.matrix.tolist(), asdict(self) | {"inliers": self.inliers}
        del values["transform"]
        return {"scale": self.transform.scale, "matrix": matrix, **values}


def align(
    predicted: PosedCameras | None, truth: PosedCameras, settings: AlignmentSettings
) -> Alignment:
    """Find the transform of a prediction into the frame of the truth, by cameras."""
    alignment = Alignment("none", Similarity.identity())
    if predicted is None:
        return alignment
    if settings.method != "none":
        rows, true_rows = pair_cameras(predicted, truth)
        if len(rows) < LEAST_CAMERAS:
            what = f"a similarity needs {LEAST_CAMERAS} cameras with a partner in the truth"
            raise AlignmentError(f"{what}, and there are {len(rows)}")
        alignment = fit_cameras(predicted.take(rows), truth.take(true_rows), settings)
    return with_residuals(alignment, predicted, truth)


def shipped_alignment(**changes: Any) -> AlignmentSettings:
    """Return the alignment of the shipped protocols, some settings changed."""
    protocol: Any = load_protocol(shipped_protocols()["photos-reconstruction"])
    settings: AlignmentSettings = protocol.alignment.model_copy(update=changes)
    return settings


def pair_cameras(predicted: PosedCameras, truth: PosedCameras) -> tuple[Ints, Ints]:
    """Return the rows (P,) of cameras of the same name in both, in the order of the truth.

    A camera whose centre is not finite has no partner.
    """
    row_of = {name: row for row, name in enumerate(predicted.names)}
    pairs = [(row_of[name], row) for row, name in enumerate(truth.names) if name in row_of]
    rows, true_rows = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    both = predicted.centres[rows], truth.centres[true_rows]
    finite = np.isfinite(np.concatenate(both, axis=1)).all(axis=1)
    return rows[finite], true_rows[finite]


def with_residuals(alignment: Alignment, predicted: PosedCameras, truth: PosedCameras) -> Alignment:
    """Return an alignment with the residuals between partners after its transform."""
    rows, true_rows = pair_cameras(predicted, truth)
    source, target = predicted.take(rows), truth.take(true_rows)
    away = _distances(alignment.transform.apply(source.centres), target.centres)
    angles = np.zeros(0)
    if source.rotation is not None and target.rotation is not None:
        aligned = source.rotation @ alignment.transform.rotation.T
        angles = rotation_angle_deg(aligned, target.rotation)
    return replace(
        alignment,
        cameras=len(rows),
        cameras_missing=len(truth.names) - len(rows),
        centres=_summary(away),
        inlier_centres=_summary(away[np.isin(target.names, alignment.inlier_names)]),
        rotations_deg=_summary(angles),
    )


def _summary(values: Floats) -> dict[str, float] | None:
    if not len(values):
        return None
    rms = float(np.sqrt((values * values).mean()))
    return {"rms": rms, "median": float(np.median(values)), "largest": float(values.max())}


def _distances(a: Floats, b: Floats) -> Floats:
    offset = a - b
    return np.asarray(np.sqrt((offset * offset).sum(axis=-1)))


# --- the similarity that most partners agree with ---


def fit_cameras(
    source: PosedCameras, target: PosedCameras, settings: AlignmentSettings
) -> Alignment:
    """Fit the similarity that takes cameras to their partners."""
    if 0 in (_rank(one.centres, _RANK_TOLERANCE) for one in (source, target)):
        raise AlignmentError("the camera centres all lie at one point, which has no scale")
    tolerance = max(settings.line_ratio, _RANK_TOLERANCE)
    if _rank(target.centres, tolerance) > 1:
        found = _Consensus(source, target, settings).find()
        inliers = np.isin(target.names, found.inlier_names if found else ())
        # A plane may have been a strip with an outlier.
        if found is not None and _rank(target.centres[inliers], tolerance) > 1:
            return found
    if source.rotation is None or target.rotation is None:
        what = "the camera centres lie on a line, which leaves the turn about it free"
        raise AlignmentError(what, expected="centres off the line, or the cameras' orientations")
    turns = np.swapaxes(target.rotation, -1, -2) @ source.rotation
    found = _Consensus(source, target, settings, turns).find()
    if found is None:
        raise AlignmentError("the camera centres determine no similarity")
    return found


_Best = tuple[list[Similarity], Floats]
"""The best fit yet, as a list of one or none; its residuals (N,), infinite for outliers."""


@dataclass(frozen=True, eq=False)
class _Consensus:
    """The search for the largest set of partners that agree; with turns, in orientation too."""

    source: PosedCameras
    target: PosedCameras
    settings: AlignmentSettings
    turns: Floats | None = None  # (N, 3, 3), of the source's world, by each camera

    def fits(self, samples: Ints) -> list[Similarity]:
        """Fit to each of samples (S, k) of rows, except those that leave a rotation free."""
        both = self.source.centres[samples], self.target.centres[samples]
        turns = None if self.turns is None else self.turns[samples]
        found = fit_sim3(*both, turns=turns, axis_share=self.settings.line_ratio)
        return list(itertools.compress(*found))

    def residuals(self, fits: list[Similarity]) -> Floats:
        """Return distances of centres (S, N), infinite where a camera is no inlier."""
        moved = np.stack([fit.apply(self.source.centres) for fit in fits])
        away = _distances(moved, self.target.centres)
        inliers = away < self.settings.inlier_below_m
        if self.turns is not None and self.source.rotation is not None:
            back = np.array([fit.rotation.T for fit in fits])
            turned = self.source.rotation[None] @ back[:, None]
            angles = rotation_angle_deg(turned, np.asarray(self.target.rotation)[None])
            inliers &= angles < self.settings.inlier_below_deg
        return np.where(inliers, away, np.inf)

    def find(self) -> Alignment | None:
        """Find the largest set of cameras that agree; None where no fit is determined."""
        settings, count = self.settings, len(self.source.names)
        size, done = 3 if self.turns is None else 2, 0
        all_rows = self.fits(np.arange(count)[None])
        best = self._better(([], np.full(count, np.inf)), all_rows)
        for samples in _sample_blocks(count, size, settings):
            best = self._better(best, self.fits(samples))
            done += len(samples)
            bad = 1.0 - (np.isfinite(best[1]).sum() / count) ** size
            # A sample without outliers was drawn with the confidence.
            if done >= settings.min_trials and bad**done <= 1.0 - settings.confidence:
                break
        inliers = np.isfinite(best[1])
        robust = int(inliers.sum()) >= LEAST_CAMERAS
        rows = np.flatnonzero(inliers | (not robust))
        final = self.fits(rows[None]) or all_rows or best[0]
        if not final:
            return None
        return Alignment(
            settings.method,
            final[0],
            inlier_names=self.target.take(rows).names,
            inlier_limit_m=settings.inlier_below_m,
            used_orientations=self.turns is not None,
            robust=robust,
        )

    def _better(self, best: _Best, fits: list[Similarity]) -> _Best:
        """Return the best of some fits, refitted to its inliers, or the best yet."""
        if not fits:
            return best
        residuals = self.residuals(fits)
        inliers = np.isfinite(residuals)
        counts = inliers.sum(axis=1)
        means = np.where(inliers, residuals, 0.0).sum(axis=1) / np.maximum(counts, 1)
        first = np.lexsort((means, -counts))[0]
        refined = [fits[first]], residuals[first]
        for _ in range(_MOST_REFITS):
            inliers = np.isfinite(refined[1])
            fits = self.fits(np.flatnonzero(inliers)[None]) if inliers.sum() > 1 else []
            again = self.residuals(fits)[0] if fits else refined[1]
            if not fits or np.isfinite(again).sum() < inliers.sum():
                break
            refined = fits, again
            if (np.isfinite(again) == inliers).all():
                break
        return refined if _score(refined[1]) < _score(best[1]) else best


def _score(residuals: Floats) -> tuple[int, float]:
    """Rate a fit, smaller is better: the most inliers; among equals the least mean residual."""
    inliers = np.isfinite(residuals)
    count = int(inliers.sum())
    return -count, float(residuals[inliers].mean()) if count else np.inf


def _sample_blocks(count: int, size: int, settings: AlignmentSettings) -> Iterator[Ints]:
    """Yield samples of `size` of `count` rows, block by block (S, size), each ascending.

    Each is tried once where there are no more than `min_trials`.
    """
    if math.comb(count, size) <= settings.min_trials:
        every = itertools.combinations(range(count), size)
        while block := list(itertools.islice(every, _BLOCK)):
            yield np.array(block, dtype=np.int64)
        return
    random = np.random.default_rng(settings.seed)
    for start in range(0, settings.max_trials, _BLOCK):
        rows = np.empty((min(_BLOCK, settings.max_trials - start), 0), dtype=np.int64)
        for taken in range(size):
            row = random.integers(0, count - taken, len(rows))
            for column in rows.T:  # ascending
                row += row >= column
            rows = np.sort(np.column_stack((rows, row)), axis=1)
        yield rows


# --- least squares ---


def umeyama(source: Floats, target: Floats, *, with_scale: bool) -> Similarity:
    """Return the similarity that brings points (N, 3) nearest to their partners, in least squares.

    The scale is 1 where it is not fitted. Fewer than 3 points are refused, and points on one line,
    in either set or in what both have in common: a rotation is left free.

    References
    ----------
    Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    PAMI 13(4), 1991, equations 34 to 42.
    """
    if len(source) < LEAST_CAMERAS:
        what = f"a similarity needs {LEAST_CAMERAS} points, not {len(source)}"
        raise AlignmentError(what, expected="more points")
    (transform,), (determined,) = fit_sim3(source[None], target[None], with_scale=with_scale)
    if not determined or min(_rank(one, _RANK_TOLERANCE) for one in (source, target)) < 2:
        what = "the points lie on one line or point, which leaves a rotation free"
        raise AlignmentError(what, expected="points that span a plane")
    return transform


def fit_sim3(
    source: Floats,
    target: Floats,
    *,
    with_scale: bool = True,
    turns: Floats | None = None,
    axis_share: float = 0.0,
) -> tuple[list[Similarity], Bools]:
    """Fit many sets of points (S, N, 3) as `umeyama` does; say which sets determine their fit.

    Turns (S, N, 3, 3) of cameras on a line fix the rotation about it: an axis of each weighs as
    much as a point that is this share of the width off.
    """
    (origin, a), (goal, b) = _centred(source), _centred(target)
    # Not by BLAS, whose sums depend on its threads.
    covariance = np.einsum("sni,snj->sij", b, a) / source.shape[1]
    variance, true_variance = ((one * one).sum(axis=(1, 2)) / source.shape[1] for one in (a, b))
    if turns is not None:
        weight = axis_share**2 * np.sqrt(variance * true_variance)
        covariance += weight[:, None, None] * turns.mean(axis=1)
    u, values, vt = np.linalg.svd(covariance)
    last = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    signs = np.stack((np.ones_like(last), np.ones_like(last), last), axis=-1)
    rotation = (u * signs[:, None]) @ vt
    numerator = (values * signs).sum(axis=1)
    determined = values[:, 1] > _RANK_TOLERANCE**2 * values[:, 0]
    if turns is not None:
        numerator = (b * apply_matrix(rotation[:, None], a)).sum(axis=(1, 2)) / source.shape[1]
        determined = np.ones_like(determined)
    scale = np.ones(len(a))
    if with_scale:
        scalable = (numerator > 0.0) & (variance > 0.0)
        scale[scalable] = numerator[scalable] / variance[scalable]
        determined &= scalable
    return list(map(Similarity, scale.tolist(), rotation, goal, origin)), determined


def _rank(points: Floats, tolerance: float) -> int:
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


def _centred(points: Floats) -> tuple[Floats, Floats]:
    """Split points (..., N, 3) into their mean (..., 3) and the offsets from it."""
    first = points[..., :1, :]
    mean = first + (points - first).mean(axis=-2, keepdims=True)
    return mean[..., 0, :], points - mean

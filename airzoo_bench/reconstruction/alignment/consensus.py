"""A similarity from partner cameras, outliers found by a seeded RANSAC.

After the manner of Depth Anything 3's benchmark: samples of a share of the cameras, and where no
limit is given, its rule for one. Unlike there, centres on a line (a straight flight strip), which
leave the turn about it free, are aligned by the cameras' orientations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.alignment.similarity import (
    RANK_TOLERANCE,
    AlignmentError,
    Similarity,
    fit_many,
    fit_rotated,
    point_rank,
)

__all__ = [
    "LEAST_CAMERAS",
    "CameraFit",
    "PosedCameras",
    "RansacSettings",
    "distances",
    "fit_cameras",
    "mean_rotation",
]

LEAST_CAMERAS = 3
# Of the extent of the true centres: below it a residual is rounding, and no outlier's.
_LEAST_LIMIT = 1e-9
# The usual rejection of robust regression: 2.5 deviations, had from the median (Rousseeuw and
# Leroy, Robust Regression and Outlier Detection, 1987).
_ROBUST_FACTOR = 2.5 * 1.4826
_LEAST_ANGLE_DEG = 1e-6


@dataclass(frozen=True, eq=False)
class PosedCameras:
    """N cameras by the names of their images.

    Attributes
    ----------
    names : tuple of N str
    centres : (N, 3) array
        In world coordinates; NaN for a camera that could not be placed.
    rotation : (N, 3, 3) array or None
        World-to-camera, OpenCV axes; None where there are positions only (GPS).
    """

    names: tuple[str, ...]
    centres: Floats
    rotation: Floats | None = None

    def take(self, rows: Ints) -> PosedCameras:
        """Return the cameras at these rows."""
        rotation = None if self.rotation is None else self.rotation[rows]
        return PosedCameras(tuple(self.names[row] for row in rows), self.centres[rows], rotation)


@dataclass(frozen=True)
class RansacSettings:
    """How outliers among the camera centres are found.

    Attributes
    ----------
    iterations : int
        Samples drawn.
    sample_share : float
        Share of the cameras in a sample, which has 3 at least; Depth Anything 3 takes a half.
    inlier_limit : float or None
        Residuals of inliers are below it, in units of the truth. None is Depth Anything 3's rule:
        the median distance from a predicted centre to the nearest true one, whichever that is,
        once all cameras are aligned.
    line_ratio : float
        Centres whose second singular value about their mean is at most this share of the first
        lie on a line.
    seed : int
    """

    iterations: int
    sample_share: float
    inlier_limit: float | None
    line_ratio: float
    seed: int


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A similarity fitted to partner cameras.

    Attributes
    ----------
    transform : Similarity
    inliers : (N,) bool array
        Cameras that it is fitted to.
    limit : float
        Residuals of inliers are below it, in units of the truth.
    used_orientations : bool
        The centres lie on a line: the rotation is the mean of the orientations' differences.
    robust : bool
        False where fewer than 3 cameras agreed, so that all of them were fitted.
    """

    transform: Similarity
    inliers: Bools
    limit: float
    used_orientations: bool
    robust: bool


def fit_cameras(source: PosedCameras, target: PosedCameras, settings: RansacSettings) -> CameraFit:
    """Fit the similarity that takes cameras to their partners.

    Parameters
    ----------
    source, target : PosedCameras
        At least 3, row by row partners, with finite centres.
    settings : RansacSettings

    Returns
    -------
    CameraFit

    Raises
    ------
    AlignmentError
        Centres all at a point; or on a line, where not both have orientations.
    """
    everyone = np.ones(len(source.names), np.bool_)
    if _rank(source, target, everyone, settings.line_ratio) < 2:
        return _fit_strip(source, target, everyone, settings)
    fit = _fit_centres(source, target, settings)
    # What seemed a plane may have been a strip with an outlier.
    if _rank(source, target, fit.inliers, settings.line_ratio) < 2:
        return _fit_strip(source, target, fit.inliers, settings)
    return fit


def mean_rotation(rotations: Floats) -> Floats:
    """Return the rotation nearest to all, in the sum of squares of the chords.

    Parameters
    ----------
    rotations : (N, 3, 3) array

    Returns
    -------
    (3, 3) array

    References
    ----------
    Hartley, Trumpf, Dai, Li, Rotation averaging, IJCV 103, 2013, section 5.2.
    """
    u, _, vt = np.linalg.svd(rotations.mean(axis=0))
    u[:, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return np.asarray(u @ vt)


def distances(a: Floats, b: Floats) -> Floats:
    """Distances (N,) between partners (N, 3)."""
    offset = a - b
    squared: Floats = (offset * offset).sum(axis=1)
    return np.sqrt(squared)


def _fit_centres(source: PosedCameras, target: PosedCameras, settings: RansacSettings) -> CameraFit:
    a, b = source.centres, target.centres
    size = max(LEAST_CAMERAS, int(np.ceil(settings.sample_share * len(a))))
    samples = _samples(len(a), size, settings)
    firsts, _ = fit_many(a[None], b[None], with_scale=True)
    fits, determined = fit_many(a[samples], b[samples], with_scale=True)
    limit = _limit(firsts[0], a, b, settings.inlier_limit)
    tried = [firsts[0], *(fit for fit, d in zip(fits, determined, strict=True) if d)]
    inliers = _consensus(tried, a, b, limit)
    robust = int(inliers.sum()) >= LEAST_CAMERAS
    if not robust:
        inliers = np.ones(len(a), np.bool_)
    (fit,), (good,) = fit_many(a[None, inliers], b[None, inliers], with_scale=True)
    return CameraFit(
        fit if good else firsts[0], inliers, limit, used_orientations=False, robust=robust
    )


def _fit_strip(
    source: PosedCameras, target: PosedCameras, among: Bools, settings: RansacSettings
) -> CameraFit:
    if source.rotation is None or target.rotation is None:
        raise AlignmentError(
            "the camera centres lie on a line, which leaves the turn about it free, "
            f"and the {'truth' if target.rotation is None else 'prediction'} has no orientations",
            expected="centres that span a plane, or orientations of the cameras",
            mend="add photos beside the line, give camera poses, or predict in the truth's frame "
            "and align by 'none'",
        )
    a, b = source.centres, target.centres
    turns = np.swapaxes(target.rotation, -1, -2) @ source.rotation
    rows = np.flatnonzero(among)
    size = max(2, int(np.ceil(settings.sample_share * len(rows))))
    samples = [rows, *rows[_samples(len(rows), size, settings)]]
    fits = list(_with_rotation(a, b, samples, _robust_mean(turns[among], settings)))
    if not fits:
        raise AlignmentError(
            "the cameras' orientations contradict their centres",
            expected="a path that runs as the true one does once the orientations agree",
            mend="check whether rotations are world-to-camera, with x right, y down, z forward",
        )
    limit = _limit(fits[0], a[among], b[among], settings.inlier_limit)
    inliers = _consensus(fits, a, b, limit)
    robust = int(inliers.sum()) >= LEAST_CAMERAS
    if not robust:
        inliers = among
    kept = [np.flatnonzero(inliers)]
    fit = next(_with_rotation(a, b, kept, _robust_mean(turns[inliers], settings)), fits[0])
    return CameraFit(fit, inliers, limit, used_orientations=True, robust=robust)


def _with_rotation(
    a: Floats, b: Floats, samples: Sequence[Ints], rotation: Floats
) -> Iterator[Similarity]:
    for rows in samples:
        fit, determined = fit_rotated(a[rows], b[rows], rotation)
        if determined:
            yield fit


def _robust_mean(turns: Floats, settings: RansacSettings) -> Floats:
    # The mean of those near the one that is nearest to all.
    rng = np.random.default_rng(settings.seed)
    count = min(len(turns), settings.iterations)
    chosen = np.sort(rng.choice(len(turns), count, replace=False))
    away = np.array([rotation_angle_deg(turns, turns[row]) for row in chosen])
    nearest = away[away.sum(axis=1).argmin()]
    limit = max(_ROBUST_FACTOR * float(np.median(nearest)), _LEAST_ANGLE_DEG)
    return mean_rotation(turns[nearest <= limit])


def _samples(count: int, size: int, settings: RansacSettings) -> Ints:
    rng = np.random.default_rng(settings.seed)
    size = min(size, count)
    rows = [rng.choice(count, size, replace=False) for _ in range(settings.iterations)]
    return np.sort(np.array(rows, dtype=np.int64).reshape(-1, size), axis=1)


def _limit(first: Similarity, a: Floats, b: Floats, given: float | None) -> float:
    if given is not None:
        return given
    from scipy.spatial import cKDTree

    away, _ = cKDTree(b - b[0]).query(first.apply(a) - b[0])
    extent = float(distances(b, b[:1]).max())
    return max(float(np.median(away)), _LEAST_LIMIT * extent)


def _consensus(fits: Sequence[Similarity], a: Floats, b: Floats, limit: float) -> Bools:
    # The most inliers; of equals the least mean residual; of those the earliest.
    best, best_score = np.zeros(len(a), np.bool_), (1, np.inf)
    for fit in fits:
        residuals = distances(fit.apply(a), b)
        inliers: Bools = residuals < limit
        count = int(inliers.sum())
        score = (-count, float(residuals[inliers].mean()) if count else np.inf)
        if score < best_score:
            best, best_score = inliers, score
    return best


def _rank(source: PosedCameras, target: PosedCameras, among: Bools, line_ratio: float) -> int:
    ranks = []
    for cameras, whose in ((source, "predicted"), (target, "true")):
        rank = point_rank(cameras.centres[among], max(line_ratio, RANK_TOLERANCE))
        if rank == 0:
            raise AlignmentError(
                f"the {whose} camera centres all lie at one point, which has no scale",
                expected="cameras that move",
            )
        ranks.append(rank)
    return min(ranks)

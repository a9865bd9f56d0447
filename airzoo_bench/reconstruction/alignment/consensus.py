"""A similarity from partner cameras, outliers found by a seeded RANSAC.

Samples are of three cameras, or, on a straight flight strip, whose centres leave the turn about it
free, of two and their orientations. Each sample that is the best so far is refitted to its inliers
until they stay, and trials go on until a better sample is improbable. Depth Anything 3's rule,
samples of half of the cameras and one refit, is a variant.

References
----------
Fischler and Bolles, Random sample consensus, CACM 24(6), 1981; Chum, Matas, Kittler, Locally
optimized RANSAC, DAGM 2003.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.alignment.samples import sample_blocks
from airzoo_bench.reconstruction.alignment.similarity import (
    RANK_TOLERANCE,
    AlignmentError,
    Similarity,
    fit_many,
    fit_strips,
    point_rank,
)

__all__ = [
    "LEAST_CAMERAS",
    "CameraFit",
    "PosedCameras",
    "RansacSettings",
    "distances",
    "fit_cameras",
]

LEAST_CAMERAS = 3
# Of the extent of the true centres: below it a residual is rounding, and no outlier's.
_LEAST_LIMIT = 1e-9
_MOST_REFITS = 100


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
    min_trials, max_trials : int
        Samples drawn; where there are no more than `min_trials` minimal ones, each is tried once.
    confidence : float
        Trials end once a sample without outliers was drawn with this probability, judged by the
        largest share of inliers yet; 1 never ends before `max_trials`.
    sample_share : float or None
        None takes minimal samples: three cameras, two on a line. Otherwise the share of the
        cameras in a sample, and one refit only: Depth Anything 3 takes a half.
    inlier_limit : float or None
        Residuals of inliers are below it, in units of the truth. None is Depth Anything 3's rule:
        the median distance from a predicted centre to the nearest true one, whichever that is,
        once all cameras are aligned.
    inlier_limit_deg : float
        On a line, orientations of inliers are nearer than this, too.
    line_ratio : float
        Centres whose second singular value about their mean is at most this share of the first
        lie on a line. There, orientations weigh as much as points so far off the line.
    seed : int
    """

    min_trials: int
    max_trials: int
    confidence: float
    sample_share: float | None
    inlier_limit: float | None
    inlier_limit_deg: float
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
        The centres lie on a line: orientations give the turn about it.
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
        At least 3, row by row partners, with finite centres; their order decides the samples.
    settings : RansacSettings

    Returns
    -------
    CameraFit

    Raises
    ------
    AlignmentError
        Centres all at a point; or on a line, where not both have orientations.
    """
    _refuse_points(source, target)
    if not _on_a_line(target.centres, settings):
        fit = _consensus(_Centres(source, target, settings))
        # What seemed a plane may have been a strip with an outlier.
        if fit is not None and not _on_a_line(target.centres[fit.inliers], settings):
            return fit
    strip = _consensus(_Strip(source, target, settings))
    if strip is None:
        raise _contradiction()
    return strip


def distances(a: Floats, b: Floats) -> Floats:
    """Distances (..., N) between partners (..., N, 3)."""
    offset = a - b
    squared: Floats = (offset * offset).sum(axis=-1)
    return np.sqrt(squared)


class _Centres:
    """Cameras whose centres alone give the similarity."""

    least = 3

    def __init__(
        self, source: PosedCameras, target: PosedCameras, settings: RansacSettings
    ) -> None:
        self.a, self.b, self.settings = source.centres, target.centres, settings
        self.limit = 0.0

    def fits(self, samples: Ints) -> list[Similarity]:
        """Fit to each of samples (S, k) of rows; those that leave a rotation free are left out."""
        found, determined = fit_many(self.a[samples], self.b[samples], with_scale=True)
        return [fit for fit, good in zip(found, determined, strict=True) if good]

    def residuals(self, fits: list[Similarity]) -> Floats:
        """Residuals (S, N), infinite where a camera is no inlier."""
        away = distances(_applied(fits, self.a), self.b)
        return np.where(away < self.limit, away, np.inf)


class _Strip(_Centres):
    """Cameras on a line, whose orientations give the turn about it."""

    least = 2

    def __init__(
        self, source: PosedCameras, target: PosedCameras, settings: RansacSettings
    ) -> None:
        super().__init__(source, target, settings)
        if source.rotation is None or target.rotation is None:
            raise _no_orientations(target.rotation is None)
        self._from, self._to = source.rotation, target.rotation
        self._turns = np.swapaxes(target.rotation, -1, -2) @ source.rotation

    def fits(self, samples: Ints) -> list[Similarity]:
        share = self.settings.line_ratio
        parts = self.a[samples], self.b[samples], self._turns[samples]
        found, determined = fit_strips(*parts, axis_share=share)
        return [fit for fit, good in zip(found, determined, strict=True) if good]

    def residuals(self, fits: list[Similarity]) -> Floats:
        near = super().residuals(fits)
        back = np.array([fit.rotation.T for fit in fits])
        turned = rotation_angle_deg(self._from[None] @ back[:, None], self._to[None])
        return np.where(turned < self.settings.inlier_limit_deg, near, np.inf)

    def contradicts(self, fit: Similarity) -> bool:
        """Whether at least half of the centres agree, but no three of their orientations."""
        near = np.isfinite(super().residuals([fit])[0]).sum()
        return bool(2 * near >= len(self.a) and near >= LEAST_CAMERAS)


def _consensus(cameras: _Centres) -> CameraFit | None:
    """Find the largest set of cameras that agree; None where no fit is determined."""
    settings, count = cameras.settings, len(cameras.a)
    everyone = np.arange(count)[None]
    first = cameras.fits(everyone)
    cameras.limit = _limit(first, cameras.a, cameras.b, settings.inlier_limit)
    best = _search(cameras, first)
    inliers = np.isfinite(best.residuals)
    robust = int(inliers.sum()) >= LEAST_CAMERAS
    is_strip = isinstance(cameras, _Strip)
    if not robust:
        if isinstance(cameras, _Strip) and first and cameras.contradicts(first[0]):
            raise _contradiction()
        inliers = np.ones(count, np.bool_)
    final = cameras.fits(np.flatnonzero(inliers)[None]) or first or best.fits
    if not final:
        return None
    return CameraFit(final[0], inliers, cameras.limit, used_orientations=is_strip, robust=robust)


@dataclass(frozen=True, eq=False)
class _Best:
    """The best fit yet, as a list of one or none; its residuals (N,), infinite for outliers."""

    fits: list[Similarity]
    residuals: Floats

    @property
    def score(self) -> tuple[int, float]:
        # The most inliers; of equals the least mean residual. Smaller is better.
        inliers = np.isfinite(self.residuals)
        count = int(inliers.sum())
        return -count, float(self.residuals[inliers].mean()) if count else np.inf


def _search(cameras: _Centres, first: list[Similarity]) -> _Best:
    settings, count = cameras.settings, len(cameras.a)
    size, minimal = cameras.least, settings.sample_share is None
    if settings.sample_share is not None:
        size = min(count, max(size, math.ceil(settings.sample_share * count)))
    best = _better(cameras, _Best([], np.full(count, np.inf)), first, refit=minimal)
    done = 0
    for samples in sample_blocks(count, size, settings, minimal=minimal):
        best = _better(cameras, best, cameras.fits(samples), refit=minimal)
        done += len(samples)
        if done >= settings.min_trials and done >= _trials_needed(-best.score[0], cameras, size):
            break
    return best


def _better(cameras: _Centres, best: _Best, fits: list[Similarity], *, refit: bool) -> _Best:
    if not fits:
        return best
    residuals = cameras.residuals(fits)
    inliers = np.isfinite(residuals)
    counts = inliers.sum(axis=1)
    means = np.where(inliers, residuals, 0.0).sum(axis=1) / np.maximum(counts, 1)
    first = np.lexsort((means, -counts))[0]
    found = _Best([fits[first]], residuals[first])
    found = _settled(cameras, found) if refit else found
    return found if found.score < best.score else best


def _settled(cameras: _Centres, best: _Best) -> _Best:
    """Refit to the inliers until they stay, as long as they do not become fewer."""
    for _ in range(_MOST_REFITS):
        inliers = np.isfinite(best.residuals)
        fits = cameras.fits(np.flatnonzero(inliers)[None]) if inliers.sum() > 1 else []
        if not fits:
            break
        found = _Best(fits, cameras.residuals(fits)[0])
        if found.score[0] > best.score[0]:
            break
        same = bool((np.isfinite(found.residuals) == inliers).all())
        best = found
        if same:
            break
    return best


def _trials_needed(inliers: int, cameras: _Centres, size: int) -> float:
    good = (inliers / len(cameras.a)) ** size
    missed = 1.0 - cameras.settings.confidence
    if good >= 1.0:
        return 0.0
    if good <= 0.0 or missed <= 0.0:
        return math.inf
    return math.log(missed) / math.log1p(-good)


def _applied(fits: list[Similarity], points: Floats) -> Floats:
    """Points (N, 3) moved by each of S fits, (S, N, 3)."""
    return np.stack([fit.apply(points) for fit in fits])


def _limit(first: list[Similarity], a: Floats, b: Floats, given: float | None) -> float:
    if given is not None:
        return given
    from scipy.spatial import cKDTree

    extent = float(distances(b, b[:1]).max())
    if not first:
        return _LEAST_LIMIT * extent
    away, _ = cKDTree(b - b[0]).query(first[0].apply(a) - b[0])
    return max(float(np.median(away)), _LEAST_LIMIT * extent)


def _on_a_line(true_centres: Floats, settings: RansacSettings) -> bool:
    return point_rank(true_centres, max(settings.line_ratio, RANK_TOLERANCE)) < 2


def _refuse_points(source: PosedCameras, target: PosedCameras) -> None:
    for cameras, whose in ((source, "predicted"), (target, "true")):
        if point_rank(cameras.centres, RANK_TOLERANCE) == 0:
            raise AlignmentError(
                f"the {whose} camera centres all lie at one point, which has no scale",
                expected="cameras that move",
            )


def _no_orientations(of_truth: bool) -> AlignmentError:
    return AlignmentError(
        "the camera centres lie on a line, which leaves the turn about it free, "
        f"and the {'truth' if of_truth else 'prediction'} has no orientations",
        expected="centres that span a plane, or orientations of the cameras",
        mend="add photos beside the line, give camera poses, or predict in the truth's frame "
        "and align by 'none'",
    )


def _contradiction() -> AlignmentError:
    return AlignmentError(
        "the cameras' orientations contradict their centres",
        expected="a path that runs as the true one does once the orientations agree",
        mend="check whether rotations are world-to-camera, with x right, y down, z forward",
    )

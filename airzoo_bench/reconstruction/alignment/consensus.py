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

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.alignment.camera_sets import (
    LEAST_CAMERAS,
    Centres,
    PosedCameras,
    RansacSettings,
    Strip,
    distances,
    sample_blocks,
)
from airzoo_bench.reconstruction.alignment.similarity import (
    RANK_TOLERANCE,
    AlignmentError,
    Similarity,
    point_rank,
)

__all__ = ["CameraFit", "fit_cameras"]

# Of the width of the true centres: below it a residual is rounding, and no outlier's.
_LEAST_LIMIT = 1e-9
_MOST_REFITS = 100


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A similarity fitted to partner cameras.

    Attributes
    ----------
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
    """Fit the similarity that takes cameras to their partners."""
    _refuse_points(source, target)
    if not _on_a_line(target.centres, settings):
        fit = _consensus(Centres(source, target, settings))
        # What seemed a plane may have been a strip with an outlier.
        if fit is not None and not _on_a_line(target.centres[fit.inliers], settings):
            return fit
    strip = _consensus(Strip(source, target, settings))
    if strip is None:
        raise AlignmentError("the camera centres determine no similarity")
    return strip


def _consensus(cameras: Centres) -> CameraFit | None:
    """Find the largest set of cameras that agree; None where no fit is determined."""
    settings, count = cameras.settings, len(cameras.a)
    everyone = np.arange(count)[None]
    first = cameras.fits(everyone)
    cameras.limit = _limit(first, cameras.a, cameras.b, settings.inlier_limit)
    best = _search(cameras, first)
    inliers = np.isfinite(best.residuals)
    robust = int(inliers.sum()) >= LEAST_CAMERAS
    is_strip = isinstance(cameras, Strip)
    if not robust:
        if isinstance(cameras, Strip) and first and cameras.contradicts(first[0]):
            raise PredictionError(
                "the cameras' orientations contradict their centres",
                expected="a path that runs as the true one does once the orientations agree",
                fix="check whether rotations are world-to-camera, with x right, y down, z forward",
            )
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


def _search(cameras: Centres, first: list[Similarity]) -> _Best:
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


def _better(cameras: Centres, best: _Best, fits: list[Similarity], *, refit: bool) -> _Best:
    if not fits:
        return best
    residuals = cameras.residuals(fits)
    inliers = np.isfinite(residuals)
    counts = inliers.sum(axis=1)
    means = np.where(inliers, residuals, 0.0).sum(axis=1) / np.maximum(counts, 1)
    first = np.lexsort((means, -counts))[0]
    found = _Best([fits[first]], residuals[first])
    found = _refitted(cameras, found) if refit else found
    return found if found.score < best.score else best


def _refitted(cameras: Centres, best: _Best) -> _Best:
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


def _trials_needed(inliers: int, cameras: Centres, size: int) -> float:
    good = (inliers / len(cameras.a)) ** size
    missed = 1.0 - cameras.settings.confidence
    if good >= 1.0:
        return 0.0
    if good <= 0.0 or missed <= 0.0:
        return math.inf
    return math.log(missed) / math.log1p(-good)


def _limit(first: list[Similarity], a: Floats, b: Floats, given: float | None) -> float:
    if given is not None:
        return given
    from scipy.spatial import cKDTree

    width = float(distances(b, b[:1]).max())
    if not first:
        return _LEAST_LIMIT * width
    away, _ = cKDTree(b - b[0]).query(first[0].apply(a) - b[0])
    return max(float(np.median(away)), _LEAST_LIMIT * width)


def _on_a_line(true_centres: Floats, settings: RansacSettings) -> bool:
    return point_rank(true_centres, max(settings.line_ratio, RANK_TOLERANCE)) < 2


def _refuse_points(source: PosedCameras, target: PosedCameras) -> None:
    for cameras, whose in ((source, "predicted"), (target, "true")):
        if point_rank(cameras.centres, RANK_TOLERANCE) == 0:
            raise AlignmentError(
                f"the {whose} camera centres all lie at one point, which has no scale",
                expected="cameras that move",
            )

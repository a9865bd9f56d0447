"""Partner cameras as RANSAC sees them: samples, what fits to one, which cameras agree with it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.alignment.similarity import (
    AlignmentError,
    Similarity,
    fit_many,
    fit_strips,
)

__all__ = [
    "LEAST_CAMERAS",
    "Centres",
    "PosedCameras",
    "RansacSettings",
    "Strip",
    "distances",
    "sample_blocks",
]

LEAST_CAMERAS = 3
# Trials of a block are judged at once, so that how many are made depends on it.
_BLOCK = 50


@dataclass(frozen=True, eq=False)
class PosedCameras:
    """N cameras by the names of their images.

    Attributes
    ----------
    names : tuple of N str
    centres : (N, 3) array
        In world coordinates; NaN for a camera without a pose.
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


def distances(a: Floats, b: Floats) -> Floats:
    """Distances (..., N) between partners (..., N, 3)."""
    offset = a - b
    squared: Floats = (offset * offset).sum(axis=-1)
    return np.sqrt(squared)


class Centres:
    """Partner cameras whose centres alone give the similarity."""

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
        away = distances(np.stack([fit.apply(self.a) for fit in fits]), self.b)
        return np.where(away < self.limit, away, np.inf)


class Strip(Centres):
    """Partner cameras on a line, whose orientations give the turn about it."""

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
        """As for `Centres`, by centres and orientations."""
        share = self.settings.line_ratio
        parts = self.a[samples], self.b[samples], self._turns[samples]
        found, determined = fit_strips(*parts, axis_share=share)
        return [fit for fit, good in zip(found, determined, strict=True) if good]

    def residuals(self, fits: list[Similarity]) -> Floats:
        """As for `Centres`; orientations of inliers have to agree, too."""
        near = super().residuals(fits)
        back = np.array([fit.rotation.T for fit in fits])
        turned = rotation_angle_deg(self._from[None] @ back[:, None], self._to[None])
        return np.where(turned < self.settings.inlier_limit_deg, near, np.inf)

    def contradicts(self, fit: Similarity) -> bool:
        """Whether at least half of the centres agree, but no three of their orientations."""
        near = np.isfinite(super().residuals([fit])[0]).sum()
        return bool(2 * near >= len(self.a) and near >= LEAST_CAMERAS)


def _no_orientations(of_truth: bool) -> AlignmentError:
    return AlignmentError(
        "the camera centres lie on a line, which leaves the turn about it free, "
        f"and the {'truth' if of_truth else 'prediction'} has no orientations",
        expected="centres that span a plane, or orientations of the cameras",
        fix="add photos off the line, give camera poses, or predict in the truth's frame "
        "and align by 'none'",
    )


def sample_blocks(
    count: int, size: int, settings: RansacSettings, *, minimal: bool
) -> Iterator[Ints]:
    """Yield samples of `size` of `count` rows, block by block (S, size), each ascending."""
    if minimal and math.comb(count, size) <= settings.min_trials:
        yield from _all(count, size)
        return
    random = np.random.default_rng(settings.seed)
    for start in range(0, settings.max_trials, _BLOCK):
        yield _drawn(random, min(_BLOCK, settings.max_trials - start), count, size)


def _all(count: int, size: int) -> Iterator[Ints]:
    every = itertools.combinations(range(count), size)
    while block := list(itertools.islice(every, _BLOCK)):
        yield np.array(block, dtype=np.int64)


def _drawn(random: np.random.Generator, trials: int, count: int, size: int) -> Ints:
    """Draw without replacement: the n-th row is one of those that are left."""
    rows = np.empty((trials, 0), dtype=np.int64)
    for taken in range(size):
        row = random.integers(0, count - taken, trials)
        for column in rows.T:  # ascending
            row += row >= column
        rows = np.sort(np.column_stack((rows, row)), axis=1)
    return rows

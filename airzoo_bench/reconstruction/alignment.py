"""Bringing a prediction into the frame of the truth by its cameras.

A similarity is fitted to partner cameras, outliers found by a seeded RANSAC. Samples are of three
cameras, or, on a straight flight strip, whose centres leave the turn about it free, of two and
their orientations. Each sample that is the best so far is refitted to its inliers until they stay,
and trials go on until a better sample is improbable. Depth Anything 3's rule, samples of half of
the cameras and one refit, is a variant.

References
----------
Fischler and Bolles, Random sample consensus, CACM 24(6), 1981; Chum, Matas, Kittler, Locally
optimized RANSAC, DAGM 2003.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.settings import AlignmentSettings
from airzoo_bench.reconstruction.similarity import (
    RANK_TOLERANCE,
    AlignmentError,
    Similarity,
    fit_many,
    fit_strips,
    point_rank,
)

LEAST_CAMERAS = 3
_BLOCK = 50  # trials that are judged at once; how many are made depends on it
_LEAST_LIMIT = 1e-9  # of the width of the true centres: a residual below it is rounding
_MOST_REFITS = 100


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


Residuals = dict[str, float]
"""Residuals between partners: root mean square (rms), median and largest."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A transform into the frame of the truth, and how well it fits.

    The transform is fitted to the inliers of the `cameras` that have a partner in the truth, or to
    all of them where fewer than 3 agreed, and so it is not `robust`. Residuals are those of all
    partners, in units of the truth, and of the inliers.
    """

    method: str
    transform: Similarity
    cameras: int = 0
    cameras_missing: int = 0
    inlier_names: tuple[str, ...] = ()
    inlier_limit_m: float | None = None
    used_orientations: bool = False
    robust: bool = True
    centres: Residuals | None = None
    inlier_centres: Residuals | None = None
    rotations_deg: Residuals | None = None
    icp: dict[str, Any] | None = None
    icp_failure: str | None = None

    @property
    def inliers(self) -> int:
        """The number of inliers."""
        return len(self.inlier_names)

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
    found = Alignment("none", Similarity.identity())
    if predicted is None:
        return found
    if settings.method != "none":
        rows, true_rows = partners(predicted, truth)
        if len(rows) < LEAST_CAMERAS:
            raise AlignmentError(
                f"a similarity needs {LEAST_CAMERAS} cameras, and {len(rows)} of "
                f"{len(predicted.names)} predicted ones have a position and a partner in the truth",
                expected=f"at least {LEAST_CAMERAS} cameras",
                fix="give poses of more images, or predict in the truth's frame and align by "
                "'none'",
            )
        found = fit_cameras(predicted.take(rows), truth.take(true_rows), settings)
    return with_residuals(found, predicted, truth)


def shipped_alignment(**changes: Any) -> AlignmentSettings:
    """Return the alignment of the shipped protocols, some settings changed."""
    protocol: Any = load_protocol(shipped_protocols()["photos-reconstruction"])
    settings: AlignmentSettings = protocol.alignment.model_copy(update=changes)
    return settings


def partners(predicted: PosedCameras, truth: PosedCameras) -> tuple[Ints, Ints]:
    """Return the rows (P,) of cameras of the same name in both, in the order of the truth.

    A camera whose centre is not finite has no partner.
    """
    place = {name: row for row, name in enumerate(predicted.names)}
    pairs = [(place[name], row) for row, name in enumerate(truth.names) if name in place]
    rows, true_rows = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    both = predicted.centres[rows], truth.centres[true_rows]
    finite = np.isfinite(np.concatenate(both, axis=1)).all(axis=1)
    return rows[finite], true_rows[finite]


def with_residuals(found: Alignment, predicted: PosedCameras, truth: PosedCameras) -> Alignment:
    """Return an alignment with the residuals between partners after its transform."""
    rows, true_rows = partners(predicted, truth)
    source, target = predicted.take(rows), truth.take(true_rows)
    away = _apart(found.transform.apply(source.centres), target.centres)
    angles = np.zeros(0)
    if source.rotation is not None and target.rotation is not None:
        aligned = source.rotation @ found.transform.rotation.T
        angles = rotation_angle_deg(aligned, target.rotation)
    return replace(
        found,
        cameras=len(rows),
        cameras_missing=len(truth.names) - len(rows),
        centres=_summary(away),
        inlier_centres=_summary(away[np.isin(target.names, found.inlier_names)]),
        rotations_deg=_summary(angles),
    )


def _summary(values: Floats) -> Residuals | None:
    if not len(values):
        return None
    rms = float(np.sqrt((values * values).mean()))
    return {"rms": rms, "median": float(np.median(values)), "largest": float(values.max())}


def _apart(a: Floats, b: Floats) -> Floats:
    offset = a - b
    return np.asarray(np.sqrt((offset * offset).sum(axis=-1)))


# --- the similarity that most partners agree with ---


def fit_cameras(
    source: PosedCameras, target: PosedCameras, settings: AlignmentSettings
) -> Alignment:
    """Fit the similarity that takes cameras to their partners."""
    if 0 in (point_rank(one.centres, RANK_TOLERANCE) for one in (source, target)):
        raise AlignmentError(
            "the camera centres all lie at one point, which has no scale",
            expected="cameras that move",
        )
    found, tolerance = None, max(settings.line_ratio, RANK_TOLERANCE)
    if point_rank(target.centres, tolerance) > 1:
        found = _Consensus(source, target, settings, strip=False).find()
    if found is not None:
        inliers = np.isin(target.names, found.inlier_names)
        # A plane may have been a strip with an outlier.
        if point_rank(target.centres[inliers], tolerance) > 1:
            return found
    if source.rotation is None or target.rotation is None:
        whose = "truth" if target.rotation is None else "prediction"
        raise AlignmentError(
            "the camera centres lie on a line, which leaves the turn about it free, and the "
            f"{whose} has no orientations",
            expected="centres that span a plane, or orientations of the cameras",
            fix="add photos off the line, give camera poses, or predict in the truth's frame "
            "and align by 'none'",
        )
    found = _Consensus(source, target, settings, strip=True).find()
    if found is None:
        raise AlignmentError("the camera centres determine no similarity")
    return found


_Best = tuple[list[Similarity], Floats]
"""The best fit yet, as a list of one or none; its residuals (N,), infinite for outliers."""


class _Consensus:
    """The search for the largest set of partners that agree; on a strip, orientations count too."""

    def __init__(
        self,
        source: PosedCameras,
        target: PosedCameras,
        settings: AlignmentSettings,
        *,
        strip: bool,
    ) -> None:
        self.source, self.target, self.settings, self.strip = source, target, settings, strip
        self.all = self.fits(np.arange(len(source.names))[None])
        limit, true = settings.inlier_below_m, target.centres
        self.limit = _LEAST_LIMIT * float(_apart(true, true[:1]).max())
        if not isinstance(limit, str):
            self.limit = limit
        elif self.all:
            found = self.all[0].apply(source.centres) - true[0]
            self.limit = max(float(np.median(cKDTree(true - true[0]).query(found)[0])), self.limit)

    def fits(self, samples: Ints) -> list[Similarity]:
        """Fit to each of samples (S, k) of rows, except those that leave a rotation free."""
        a, b = self.source.centres[samples], self.target.centres[samples]
        if self.strip and self.source.rotation is not None and self.target.rotation is not None:
            turns = (np.swapaxes(self.target.rotation, -1, -2) @ self.source.rotation)[samples]
            found = fit_strips(a, b, turns, axis_share=self.settings.line_ratio)
        else:
            found = fit_many(a, b, with_scale=True)
        return list(itertools.compress(*found))

    def residuals(self, fits: list[Similarity]) -> Floats:
        """Return distances of centres (S, N), infinite where a camera is no inlier."""
        moved = np.stack([fit.apply(self.source.centres) for fit in fits])
        away = _apart(moved, self.target.centres)
        inliers = away < self.limit
        if self.strip and self.source.rotation is not None and self.target.rotation is not None:
            back = np.array([fit.rotation.T for fit in fits])
            turned = self.source.rotation[None] @ back[:, None]
            angles = rotation_angle_deg(turned, self.target.rotation[None])
            inliers &= angles < self.settings.inlier_below_deg
        return np.where(inliers, away, np.inf)

    def find(self) -> Alignment | None:
        """Find the largest set of cameras that agree; None where no fit is determined."""
        fits, residuals = self._search()
        inliers = np.isfinite(residuals)
        robust = int(inliers.sum()) >= LEAST_CAMERAS
        rows = np.flatnonzero(inliers | (not robust))
        final = self.fits(rows[None]) or self.all or fits
        if not final:
            return None
        return Alignment(
            self.settings.method,
            final[0],
            inlier_names=self.target.take(rows).names,
            inlier_limit_m=self.limit,
            used_orientations=self.strip,
            robust=robust,
        )

    def _search(self) -> _Best:
        settings, count = self.settings, len(self.source.names)
        size = 2 if self.strip else 3
        if not isinstance(settings.sample_share, str):
            size = min(count, max(size, math.ceil(settings.sample_share * count)))
        best = self._better(([], np.full(count, np.inf)), self.all)
        done = 0
        for samples in _sample_blocks(count, size, settings):
            best = self._better(best, self.fits(samples))
            done += len(samples)
            good = (np.isfinite(best[1]).sum() / count) ** size
            if done >= settings.min_trials and done >= _trials_needed(good, settings.confidence):
                break
        return best

    def _better(self, best: _Best, fits: list[Similarity]) -> _Best:
        if not fits:
            return best
        residuals = self.residuals(fits)
        inliers = np.isfinite(residuals)
        counts = inliers.sum(axis=1)
        means = np.where(inliers, residuals, 0.0).sum(axis=1) / np.maximum(counts, 1)
        first = np.lexsort((means, -counts))[0]
        found = [fits[first]], residuals[first]
        if self.settings.sample_share == "minimal":
            found = self._refitted(found)
        return found if _score(found[1]) < _score(best[1]) else best

    def _refitted(self, best: _Best) -> _Best:
        """Refit to the inliers until they stay, as long as they do not become fewer."""
        for _ in range(_MOST_REFITS):
            inliers = np.isfinite(best[1])
            fits = self.fits(np.flatnonzero(inliers)[None]) if inliers.sum() > 1 else []
            residuals = self.residuals(fits)[0] if fits else best[1]
            again = np.isfinite(residuals)
            if not fits or again.sum() < inliers.sum():
                break
            best = fits, residuals
            if (again == inliers).all():
                break
        return best


def _score(residuals: Floats) -> tuple[int, float]:
    """Rate a fit, smaller is better: the most inliers; among equals the least mean residual."""
    inliers = np.isfinite(residuals)
    count = int(inliers.sum())
    return -count, float(residuals[inliers].mean()) if count else np.inf


def _trials_needed(good: float, confidence: float) -> float:
    """Return how many samples hold a good one with a confidence, given the share of good ones."""
    if good >= 1.0:
        return 0.0
    return math.log(1.0 - confidence) / math.log1p(-good) if good > 0 and confidence < 1 else np.inf


def _sample_blocks(count: int, size: int, settings: AlignmentSettings) -> Iterator[Ints]:
    """Yield samples of `size` of `count` rows, block by block (S, size), each ascending.

    Minimal samples are each tried once where there are no more than `min_trials`.
    """
    is_minimal = settings.sample_share == "minimal"
    if is_minimal and math.comb(count, size) <= settings.min_trials:
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

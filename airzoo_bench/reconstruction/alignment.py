"""Bringing a prediction into the frame of the truth by its cameras and by ICP.

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
from typing import Any, Literal

import numpy as np
from pykdtree.kdtree import KDTree
from scipy.spatial import cKDTree

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.clouds import (
    concatenate_pieces,
    finite_pieces,
    finite_rows,
    map_points,
)
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
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
_PART = 1 << 18  # points of a cloud at a time


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


@dataclass(frozen=True, kw_only=True)
class RansacSettings:
    """Settings of the search for outliers among cameras; all shipped protocols have the defaults.

    Minimal samples (`sample_share` None) are each tried once where there are no more than
    `min_trials`. Trials end once a sample without outliers was drawn with the confidence, judged
    by the largest share of inliers yet. Residuals of inliers are below `inlier_limit`, in units of
    the truth; None is Depth Anything 3's rule: the median distance from a predicted centre to the
    nearest true one, whichever that is, once all cameras are aligned. Centres whose second singular
    value is at most `line_ratio` of the first lie on a line. There, orientations weigh as much as
    points so far off the line, and those of inliers are nearer than `inlier_limit_deg`.
    """

    inlier_limit: float | None
    inlier_limit_deg: float = 10.0
    min_trials: int = 1_000
    max_trials: int = 100_000
    confidence: float = 0.9999
    sample_share: float | None = None
    line_ratio: float = 0.1
    seed: int = 0

    @classmethod
    def from_protocol(cls, stated: AlignmentSettings) -> RansacSettings:
        """Take the settings of a protocol."""
        share, limit = stated.sample_share, stated.inlier_below_m
        names = ("min_trials", "max_trials", "confidence", "line_ratio", "seed")
        return cls(
            inlier_limit=None if isinstance(limit, str) else limit,
            inlier_limit_deg=stated.inlier_below_deg,
            sample_share=None if isinstance(share, str) else share,
            **{name: getattr(stated, name) for name in names},
        )


Residuals = dict[str, float]
"""Residuals between partners: root mean square (rms), median and largest."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A transform into the frame of the truth, and how well it fits.

    The transform is fitted to `inliers` of the `cameras` that have a partner in the truth, or to
    all of them where fewer than 3 agreed, and so it is not `robust`. Residuals are those of all
    partners, in units of the truth, and of the inliers.
    """

    method: Literal["none", "sim3", "sim3+icp"]
    transform: Similarity
    cameras: int = 0
    cameras_missing: int = 0
    inliers: int = 0
    inlier_limit_m: float | None = None
    used_orientations: bool = False
    robust: bool = True
    centres: Residuals | None = None
    inlier_centres: Residuals | None = None
    rotations_deg: Residuals | None = None
    icp: dict[str, Any] | None = None
    icp_failure: str | None = None
    inlier_names: tuple[str, ...] = ()


def alignment_values(found: Alignment) -> dict[str, Any]:
    """Return what ``alignment.json`` says: how a scene was aligned, its scale, its residuals."""
    values = asdict(found)
    del values["transform"]
    scale, matrix = found.transform.scale, found.transform.matrix.tolist()
    return {"scale": scale, "matrix": matrix, **values}


def align(
    method: Literal["none", "sim3", "sim3+icp"],
    predicted: PosedCameras | None,
    truth: PosedCameras,
    ransac: RansacSettings,
) -> Alignment:
    """Find the transform of a prediction into the frame of the truth, by cameras."""
    if predicted is None:
        return Alignment("none", Similarity.identity())
    if method == "none":
        return with_residuals(Alignment("none", Similarity.identity()), predicted, truth)
    rows, true_rows = partners(predicted, truth)
    if len(rows) < LEAST_CAMERAS:
        raise AlignmentError(
            f"a similarity needs {LEAST_CAMERAS} cameras, and {len(rows)} of "
            f"{len(predicted.names)} predicted ones have a position and a partner in the truth",
            expected=f"at least {LEAST_CAMERAS} cameras",
            fix="give poses of more images, or predict in the truth's frame and align by 'none'",
        )
    target = truth.take(true_rows)
    fit = fit_cameras(predicted.take(rows), target, ransac)
    found = Alignment(
        method=method,
        transform=fit.transform,
        inliers=int(fit.inliers.sum()),
        inlier_limit_m=fit.limit,
        used_orientations=fit.used_orientations,
        robust=fit.robust,
        inlier_names=target.take(np.flatnonzero(fit.inliers)).names,
    )
    return with_residuals(found, predicted, truth)


def partners(predicted: PosedCameras, truth: PosedCameras) -> tuple[Ints, Ints]:
    """Return the rows (P,) of cameras of the same name in both, in the order of the truth.

    No camera has a name twice; one whose centre is not finite has no partner.
    """
    place = {name: row for row, name in enumerate(predicted.names)}
    pairs = [(place[name], row) for row, name in enumerate(truth.names) if name in place]
    rows, true_rows = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    both = predicted.centres[rows], truth.centres[true_rows]
    kept = np.isfinite(np.concatenate(both, axis=1)).all(axis=1)
    return rows[kept], true_rows[kept]


def with_residuals(found: Alignment, predicted: PosedCameras, truth: PosedCameras) -> Alignment:
    """Return an alignment with the residuals between partners after its transform."""
    rows, true_rows = partners(predicted, truth)
    source, target = predicted.take(rows), truth.take(true_rows)

    def summarise(values: Floats) -> Residuals | None:
        if not len(values):
            return None
        rms = float(np.sqrt((values * values).mean()))
        return {"rms": rms, "median": float(np.median(values)), "largest": float(values.max())}

    away = _apart(found.transform.apply(source.centres), target.centres)
    angles = None
    if source.rotation is not None and target.rotation is not None:
        aligned = source.rotation @ found.transform.rotation.T
        angles = summarise(rotation_angle_deg(aligned, target.rotation))
    return replace(
        found,
        cameras=len(rows),
        cameras_missing=len(truth.names) - len(rows),
        centres=summarise(away),
        inlier_centres=summarise(away[np.isin(target.names, found.inlier_names)]),
        rotations_deg=angles,
    )


def _apart(a: Floats, b: Floats) -> Floats:
    offset = a - b
    squared: Floats = (offset * offset).sum(axis=-1)
    return np.sqrt(squared)


# --- the similarity that most partners agree with ---


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A similarity fitted to partner cameras; `Alignment` explains the attributes."""

    transform: Similarity
    inliers: Bools
    limit: float
    used_orientations: bool
    robust: bool


def fit_cameras(source: PosedCameras, target: PosedCameras, settings: RansacSettings) -> CameraFit:
    """Fit the similarity that takes cameras to their partners."""
    for cameras, whose in ((source, "predicted"), (target, "true")):
        if point_rank(cameras.centres, RANK_TOLERANCE) == 0:
            raise AlignmentError(
                f"the {whose} camera centres all lie at one point, which has no scale",
                expected="cameras that move",
            )
    if not _on_a_line(target.centres, settings):
        fit = _Consensus(source, target, settings, strip=False).find()
        # What seemed a plane may have been a strip with an outlier.
        if fit is not None and not _on_a_line(target.centres[fit.inliers], settings):
            return fit
    if source.rotation is None or target.rotation is None:
        whose = "truth" if target.rotation is None else "prediction"
        raise AlignmentError(
            "the camera centres lie on a line, which leaves the turn about it free, and the "
            f"{whose} has no orientations",
            expected="centres that span a plane, or orientations of the cameras",
            fix="add photos off the line, give camera poses, or predict in the truth's frame "
            "and align by 'none'",
        )
    fit = _Consensus(source, target, settings, strip=True).find()
    if fit is None:
        raise AlignmentError("the camera centres determine no similarity")
    return fit


def _on_a_line(true_centres: Floats, settings: RansacSettings) -> bool:
    return point_rank(true_centres, max(settings.line_ratio, RANK_TOLERANCE)) < 2


_Best = tuple[list[Similarity], Floats]
"""The best fit yet, as a list of one or none; its residuals (N,), infinite for outliers."""


class _Consensus:
    """The search for the largest set of partners that agree; on a strip, orientations count too."""

    def __init__(
        self, source: PosedCameras, target: PosedCameras, settings: RansacSettings, *, strip: bool
    ) -> None:
        self.a, self.b, self.settings, self.strip = source.centres, target.centres, settings, strip
        self.turned, self.true = (
            np.zeros((0, 3, 3)) if one.rotation is None else one.rotation
            for one in (source, target)
        )
        self.all = self.fits(np.arange(len(self.a))[None])
        self.limit = settings.inlier_limit or _LEAST_LIMIT * float(_apart(self.b, self.b[:1]).max())
        if settings.inlier_limit is None and self.all:
            here = self.b[0]
            away, _ = cKDTree(self.b - here).query(self.all[0].apply(self.a) - here)
            self.limit = max(float(np.median(away)), self.limit)

    def fits(self, samples: Ints) -> list[Similarity]:
        """Fit to each of samples (S, k) of rows, except those that leave a rotation free."""
        a, b = self.a[samples], self.b[samples]
        if self.strip:
            turns = (np.swapaxes(self.true, -1, -2) @ self.turned)[samples]
            found = fit_strips(a, b, turns, axis_share=self.settings.line_ratio)
        else:
            found = fit_many(a, b, with_scale=True)
        return list(itertools.compress(*found))

    def near(self, fits: list[Similarity]) -> Floats:
        """Return distances of centres (S, N), infinite from the limit on."""
        away = _apart(np.stack([fit.apply(self.a) for fit in fits]), self.b)
        return np.where(away < self.limit, away, np.inf)

    def residuals(self, fits: list[Similarity]) -> Floats:
        """Return distances of centres (S, N), infinite where a camera is no inlier."""
        if not self.strip:
            return self.near(fits)
        back = np.array([fit.rotation.T for fit in fits])
        angles = rotation_angle_deg(self.turned[None] @ back[:, None], self.true[None])
        return np.where(angles < self.settings.inlier_limit_deg, self.near(fits), np.inf)

    def find(self) -> CameraFit | None:
        """Find the largest set of cameras that agree; None where no fit is determined."""
        fits, residuals = self._search()
        inliers = np.isfinite(residuals)
        robust = int(inliers.sum()) >= LEAST_CAMERAS
        if not robust:
            near = self.near(self.all)[0] if self.strip and self.all else np.full(1, np.inf)
            if np.isfinite(near).sum() >= max(LEAST_CAMERAS, len(near) / 2):
                # Most centres agree, and no three orientations.
                raise PredictionError(
                    "the cameras' orientations contradict their centres",
                    expected="a path that runs as the true one does once the orientations agree",
                    fix="check whether rotations are world-to-camera, x right, y down, z forward",
                )
            inliers = np.ones(len(inliers), np.bool_)
        final = self.fits(np.flatnonzero(inliers)[None]) or self.all or fits
        return CameraFit(final[0], inliers, self.limit, self.strip, robust) if final else None

    def _search(self) -> _Best:
        settings, count = self.settings, len(self.a)
        size, minimal = 2 if self.strip else 3, settings.sample_share is None
        if settings.sample_share is not None:
            size = min(count, max(size, math.ceil(settings.sample_share * count)))
        best = self._better(([], np.full(count, np.inf)), self.all, refit=minimal)
        done = 0
        for samples in _sample_blocks(count, size, settings):
            best = self._better(best, self.fits(samples), refit=minimal)
            done += len(samples)
            share = np.isfinite(best[1]).sum() / count
            if done >= settings.min_trials and done >= _trials_needed(share**size, settings):
                break
        return best

    def _better(self, best: _Best, fits: list[Similarity], *, refit: bool) -> _Best:
        if not fits:
            return best
        residuals = self.residuals(fits)
        inliers = np.isfinite(residuals)
        counts = inliers.sum(axis=1)
        means = np.where(inliers, residuals, 0.0).sum(axis=1) / np.maximum(counts, 1)
        first = np.lexsort((means, -counts))[0]
        found = [fits[first]], residuals[first]
        found = self._refitted(found) if refit else found
        return found if _score(found[1]) < _score(best[1]) else best

    def _refitted(self, best: _Best) -> _Best:
        """Refit to the inliers until they stay, as long as they do not become fewer."""
        for _ in range(_MOST_REFITS):
            inliers = np.isfinite(best[1])
            fits = self.fits(np.flatnonzero(inliers)[None]) if inliers.sum() > 1 else []
            if not fits:
                break
            residuals = self.residuals(fits)[0]
            again = np.isfinite(residuals)
            if again.sum() < inliers.sum():
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


def _trials_needed(good: float, settings: RansacSettings) -> float:
    """Return how many samples hold a good one with the confidence asked for."""
    missed = 1.0 - settings.confidence
    if good >= 1.0:
        return 0.0
    return math.log(missed) / math.log1p(-good) if good > 0.0 and missed > 0.0 else math.inf


def _sample_blocks(count: int, size: int, settings: RansacSettings) -> Iterator[Ints]:
    """Yield samples of `size` of `count` rows, block by block (S, size), each ascending."""
    if settings.sample_share is None and math.comb(count, size) <= settings.min_trials:
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


# --- iterated closest points ---

# Open3D's registration_icp sums in the order in which its threads finish, so that the same clouds
# give other last bits on every run; neighbours of pykdtree do not depend on threads.


def refine(
    predicted: CloudSource, truth: CloudSource, settings: AlignmentSettings, *, memory_points: int
) -> tuple[Similarity, dict[str, Any]]:
    """Find the similarity that brings a cloud in the frame of the truth nearer to it, by ICP.

    The report has the rounds, the points used, and how near the clouds were before and after: the
    share of points with the other cloud within the limit (fitness), the root mean square distance
    of those (rmse), and that of all, each at most the limit (cost).
    """
    limit = settings.icp_below_m
    points = draw_points(predicted, settings.icp_points, settings.seed)
    origin = next((part[0] for part in finite_pieces(truth, _PART) if len(part)), None)
    if not len(points) or origin is None:
        raise AlignmentError("ICP needs points in the prediction and in the truth")
    # Near zero: the tree works on offsets from a point of the truth.
    points, near_zero = points - origin, (part - origin for part in finite_pieces(truth, _PART))
    targets = (map_points if truth.count > memory_points else concatenate_pieces)(near_zero)
    tree = KDTree(targets)

    def nearest(queries: Floats) -> tuple[Floats, Floats]:
        _, index = tree.query(queries, distance_upper_bound=limit)
        there = targets[np.minimum(index, len(targets) - 1)]
        offset = queries - there
        found = np.sqrt((offset * offset).sum(axis=1))
        # The tree compares rounded squares: what it let through at the limit is cut here.
        found[(index >= len(targets)) | (found > limit)] = np.inf
        return found, there

    transform = Similarity.identity()
    distances, partners = nearest(points)
    before = fit = _fit_of(distances, limit)
    if np.isfinite(distances).sum() < 3:
        raise AlignmentError(
            f"ICP has {np.isfinite(distances).sum()} of {len(distances)} predicted points within "
            f"{limit:g} of the truth",
            expected="clouds that overlap after the alignment by cameras",
            fix="check the poses, or choose an alignment without ICP",
        )
    rounds = 0
    while rounds < settings.icp_iterations:
        rounds += 1
        near = np.isfinite(distances)
        # Without scale the clouds are fitted as they are now: the scale of before stays.
        moved, with_scale = transform.apply(points[near]), settings.icp_with_scale
        (step,), (determined,) = fit_many(moved[None], partners[near][None], with_scale=with_scale)
        step = step.after(transform) if determined else transform
        distances, found = nearest(step.apply(points))
        new = _fit_of(distances, limit)
        if not new["cost"] < fit["cost"]:
            break
        gain, transform, fit, partners = fit["cost"] - new["cost"], step, new, found
        if gain < settings.icp_tolerance * fit["cost"]:
            break
    report = {"before": before, "after": fit, "iterations": rounds, "points": len(points)}
    if fit == before:
        return Similarity.identity(), report
    back, start = transform.translation + origin, transform.origin + origin
    return Similarity(transform.scale, transform.rotation, back, start), report


def draw_points(source: CloudSource, count: int, seed: int) -> Floats:
    """Draw at most `count` of the finite points of a cloud, kept in their order."""
    random = np.random.default_rng(seed)
    points, keys = np.zeros((0, 3)), np.zeros(0)
    for piece in source.pieces(_PART):
        finite = finite_rows(piece.points)
        points = np.concatenate((points, piece.points[finite]))
        keys = np.concatenate((keys, random.random(len(piece))[finite]))
        if len(keys) > count:
            kept = np.sort(np.argpartition(keys, count)[:count])
            points, keys = points[kept], keys[kept]
    return points


def _fit_of(distances: Floats, limit: float) -> dict[str, float]:
    near = distances[np.isfinite(distances)]
    squared = float((near * near).sum())
    capped = squared + limit * limit * (len(distances) - len(near))
    rmse = float(np.sqrt(squared / len(near))) if len(near) else np.inf
    cost = float(np.sqrt(capped / len(distances)))
    return {"fitness": len(near) / len(distances), "rmse": rmse, "cost": cost}
